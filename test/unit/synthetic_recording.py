"""A small recording of a held box with exact dynamics, for tests on recordings."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from tactile_dynamics_ros.recording import Recording

MASS = 0.4
COM = np.array([0.012, -0.008, 0.02])
INERTIA_COM = np.diag([9e-4, 7e-4, 5e-4])
GRAVITY = np.array([0.0, 0.0, -9.81])
FINGERS = {
    "index": ([0.03, 0.02, 0.01], [-1.0, 0.0, 0.0]),
    "middle": ([0.03, -0.02, 0.0], [-1.0, 0.0, 0.0]),
    "ring": ([0.0, -0.03, -0.02], [0.0, 1.0, 0.0]),
    "thumb": ([-0.03, 0.0, 0.0], [1.0, 0.0, 0.0]),
}
FORCE_STD, POSITION_STD, ROTATION_STD = 0.02, 2e-4, 2e-3


def held_box(seconds=6.0, rate=100.0, seed=0, noise=1.0, motion=1.0):
    """Return a recording of four fingers that move a box along smooth random sines."""
    random = np.random.default_rng(seed)
    time = np.arange(round(seconds * rate)) / rate
    fine = 1e-4
    waves = motion * random.uniform(-1, 1, (2, 3, 3)), random.uniform(0, 6, (2, 3, 3))
    position, rotation = _motion(time, waves)
    before, after = (_motion(time + sign * fine, waves) for sign in (-1, 1))
    acceleration = (before[0] - 2 * position + after[0]) / fine**2
    rate_b = (rotation.inv() * after[1]).as_rotvec() / fine
    rate_a = (before[1].inv() * rotation).as_rotvec() / fine
    omega, alpha = 0.5 * (rate_a + rate_b), (rate_b - rate_a) / fine
    wrench = _required_wrench(rotation, acceleration, omega, alpha)
    points = np.array([p for p, _ in FINGERS.values()])
    normals = np.array([n for _, n in FINGERS.values()])
    force = _distribute(wrench, points, normals)
    return _record(random, time, position, rotation, points, normals, force, noise)


def _motion(time, waves):
    amplitude, phase = waves
    frequency = np.array([0.5, 0.9, 1.4])
    sines = np.sin(2 * np.pi * frequency * time[:, None, None, None] + phase)
    travel = (sines * amplitude).sum(axis=-1)
    return 0.03 * travel[:, 0] + [0.5, 0.0, 0.6], Rotation.from_rotvec(0.35 * travel[:, 1])


def _required_wrench(rotation, acceleration, omega, alpha):
    specific = rotation.inv().apply(acceleration - GRAVITY)
    at_com = specific + np.cross(alpha, COM) + np.cross(omega, np.cross(omega, COM))
    force = MASS * at_com
    spin = alpha @ INERTIA_COM + np.cross(omega, omega @ INERTIA_COM)
    return np.concatenate([spin + np.cross(COM, force), force], axis=1)


def _distribute(wrench, points, normals):
    grasp = np.concatenate([np.concatenate([_skew(p), np.eye(3)]) for p in points], axis=1)
    squeeze = 3.0 * normals.ravel()
    missing = wrench - squeeze @ grasp.T
    return (squeeze + missing @ np.linalg.pinv(grasp).T).reshape(-1, len(points), 3)


def _skew(v):
    return np.array([[0, -v[2], v[1]], [v[2], 0, -v[0]], [-v[1], v[0], 0]])


def _record(random, time, position, rotation, points, normals, force, noise):
    white = random.standard_normal
    contacts = {}
    for k, name in enumerate(FINGERS):
        contacts[name] = {
            "time": time,
            "force": rotation.apply(force[:, k]) + noise * FORCE_STD * white((len(time), 3)),
            "force_std": FORCE_STD,
            "position": position + rotation.apply(points[k]),
            "normal": rotation.apply(normals[k]),
        }
    turned = rotation * Rotation.from_rotvec(noise * ROTATION_STD * white((len(time), 3)))
    pose = {
        "time": time,
        "position": position + noise * POSITION_STD * white((len(time), 3)),
        "quaternion": turned.as_quat(),
        "position_std": POSITION_STD,
        "rotation_std": ROTATION_STD,
    }
    return Recording.from_arrays(contacts, pose, source="held box")
