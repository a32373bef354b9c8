"""My numbers do not fit at all: is a sign, a unit or an axis of my data wrong?

    python examples/24_wrong_sign.py

Prints the verdict on a simulated wrist sensor that reports what the load does to the sensor, where
the force on the object is expected.
"""

import numpy as np
from scipy.spatial.transform import Rotation

import tactile_dynamics_ros as td
from tactile_dynamics_ros.recording import Recording

random, time = np.random.default_rng(0), np.arange(0.0, 40.0, 0.05)
turn = [np.sin(0.19 * time), 1.2 * np.sin(0.26 * time), np.sin(0.13 * time)]
pose = Rotation.from_rotvec(np.transpose(turn))
weight = pose.inv().apply([0.0, 0.0, 9.81 * 1.2])
noise = random.normal(size=(2, *weight.shape))
wrist = {"time": time, "position": [0.0, 0.0, 0.0], "rotation": np.eye(3), "force_std": 0.05}
wrist["force"] = -(weight + 0.05 * noise[0])
wrist["torque"] = -(np.cross([0.0, 0.01, 0.06], weight) + 2e-3 * noise[1])
flange = {"time": time, "position": np.zeros_like(weight), "quaternion": pose.as_quat()}
recording = Recording.from_arrays({"wrist": wrist}, flange, contact_frame="object")
found = td.diagnose(recording)
print(found)
print(f"verdict {found.verdict}")
