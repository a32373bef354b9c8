"""What does the tool on the wrist weigh, although the force sensor has an unknown zero?

    python examples/02_wrist_sensor.py

Prints mass and centre of mass of a simulated tool of 1.2 kg, and the sensor's zero, estimated with
them. The wrist turns slowly, so that the inertia is listed as undetermined.
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
wrist["force"] = weight + [4.0, -2.0, 6.0] + 0.05 * noise[0]
wrist["torque"] = np.cross([0.0, 0.01, 0.06], weight) + 2e-3 * noise[1]
flange = {"time": time, "position": np.zeros_like(weight), "quaternion": pose.as_quat()}
recording = Recording.from_arrays({"wrist": wrist}, flange, contact_frame="object")
print(td.estimate(recording, "force_bias"))
