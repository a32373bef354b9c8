"""Turn measurements that lie in numpy arrays, CSV or HDF5 into a recording.

    python examples/31_bring_your_own_arrays.py --out my_recording.mcap

Here the "measurements" come from a small simulation of two fingers that swing a stick, in the
units and frames that a logger might use. Replace `load_my_measurements` by your own reading, for
instance `numpy.loadtxt` for CSV or `h5py.File(...)["force"][:]` for HDF5.

From the shell `tactile-dynamics import LOG.csv --guess` finds out what the columns of a table mean
and writes a yaml file, with which `tactile-dynamics import csv LOG.mapping.yaml OUT` reads it.
"""

import argparse
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from tactile_dynamics_ros.core.inertia.estimate import estimate
from tactile_dynamics_ros.recording import Recording

MASS_KG, COM_MM = 0.2, np.array([20.0, 0.0, 5.0])


def load_my_measurements(seconds: float) -> dict[str, np.ndarray]:
    """Return a log in milliseconds, millimetres and grams-force, forces in the object's axes."""
    random = np.random.default_rng(0)
    time = np.arange(0.0, seconds, 0.01)
    turn = 0.8 * np.stack([np.sin(1.3 * time), np.sin(1.9 * time), np.sin(0.7 * time)], axis=1)
    rotation = Rotation.from_rotvec(turn)
    # Moved slowly, so that gravity alone counts: the fingers hold the weight against it.
    weight = rotation.inv().apply([0.0, 0.0, MASS_KG * 9.81])
    lever, points = COM_MM / 1e3, np.array([[0.05, 0.0, 0.0], [-0.05, 0.0, 0.0]])
    moment = np.cross(lever, weight)
    pair = np.cross(moment, [0.1, 0.0, 0.0]) / 0.1**2  # two opposite forces make the moment
    squeeze = np.array([1.5, 0.0, 0.0])
    forces = [0.5 * weight + pair - squeeze, 0.5 * weight - pair + squeeze]
    torque = np.outer(moment[:, 0], [1.0, 0.0, 0.0])  # about the line between the fingers
    noise = random.normal(size=(3, len(time), 3))
    return {
        "stamp_ms": 1e3 * time + 12_000.0,
        "orientation_xyzw": rotation.as_quat(),
        "position_mm": np.tile([400.0, 0.0, 300.0], (len(time), 1)),
        "left_gf": (forces[0] + 0.02 * noise[0]) / 9.80665e-3,
        "right_gf": (forces[1] + 0.02 * noise[1]) / 9.80665e-3,
        "left_torque_nmm": 1e3 * torque + 1.0 * noise[2],
        "points_mm": 1e3 * points,
    }


def main(arguments: list[str] | None = None) -> None:
    """Convert, save, estimate."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, help="new .mcap file or rosbag2 directory")
    parser.add_argument("--seconds", type=float, default=10.0)
    options = parser.parse_args(arguments)
    log = load_my_measurements(options.seconds)

    # Everything in SI. A force is the force that the finger applies ON the object: if your sensor
    # reports what the object does to the sensor, turn its sign.
    time = 1e-3 * log["stamp_ms"]
    pose = {
        "time": time,
        "position": 1e-3 * log["position_mm"],
        "quaternion": log["orientation_xyzw"],
        "position_std": 5e-5,
        "rotation_std": 2e-4,
    }
    contacts = {
        "left": {
            "time": time,
            "force": 9.80665e-3 * log["left_gf"],
            "torque": 1e-3 * log["left_torque_nmm"],  # leave out where no torque is measured
            "force_std": 0.02,
            "position": 1e-3 * log["points_mm"][0],
            "normal": [-1.0, 0.0, 0.0],
        },
        "right": {
            "time": time,
            "force": 9.80665e-3 * log["right_gf"],
            "force_std": 0.02,
            "position": 1e-3 * log["points_mm"][1],
            "normal": [1.0, 0.0, 0.0],
        },
    }
    # These sensors turn with the object. With contact_frame="world" (the default) forces, torques
    # and contact points are in the world frame, as on the topics.
    recording = Recording.from_arrays(contacts, pose, contact_frame="object", source="my logger")

    found = estimate(recording).to_estimate()
    com_mm = 1e3 * found.inertia.com
    print(f"mass {found.inertia.mass:.4f} kg (put in: {MASS_KG})")
    print(f"centre of mass {np.round(com_mm, 2)} mm (put in: {COM_MM})")
    print(f"error in units of the noise: {found.error.whitened_rms:.2f}")
    if options.out:
        print(f"written: {recording.to_bag(options.out)}; every verb of tactile-dynamics reads it")


if __name__ == "__main__":
    main()
