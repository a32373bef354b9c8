"""An object that four fingers move for ever, in closed form: the truth is known at any time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.rigid_body.rotation import exp_so3
from tactile_dynamics_ros.core.streams.streams import ContactStream, PoseStream, Streams

Motion = tuple[float, NDArray[np.float64], NDArray[np.float64]]

MASS = 0.25
COM = np.array([0.005, -0.003, 0.020])
INERTIA_COM = np.diag([3.0, 2.5, 2.0]) * 1e-4
POINTS = {
    "index": np.array([0.040, 0.0, 0.0]),
    "middle": np.array([-0.020, 0.035, 0.010]),
    "ring": np.array([-0.020, -0.035, -0.010]),
    "thumb": np.array([0.0, 0.010, -0.040]),
}
"""Contact points in the body frame, m; no three of them with the fourth in one plane."""
GRAVITY = np.array([0.0, 0.0, -9.81])
SQUEEZE_N, REACH = 3.0, 0.04
"""Each finger presses towards the middle of all with 3 N per 40 mm of its distance from it."""
TURN = 0.8, np.array([1.3, 1.9, 0.7]), np.array([0.0, 0.4, 1.0])
SHIFT = 0.05, np.array([2.1, 1.7, 1.1]), np.zeros(3)
"""Amplitude (rad, m), angular frequencies (rad/s) and phases of the sines about the mean pose."""
CENTRE = np.array([0.5, 0.0, 0.6])
FORCE_STD, POSITION_STD, ROTATION_STD = 0.03, 2e-4, 1e-3
"""White noise, N, m and rad; stated in the recording."""
RATE_HZ = 100.0
_STEP = 1e-4
"""Step of the central differences of the attitude, s; their error is 1e-8 of the acceleration."""


@dataclass(frozen=True)
class TrueBody:
    """What the recording's object really is: mass, kg, com (3,), m, and inertia (3, 3) about it."""

    mass: float
    com: Array
    inertia_com: Array

    def values(self) -> Array:
        """(10,) in the order of PARAMETER_NAMES."""
        rows, columns = (0, 0, 1, 0, 1, 2), (0, 1, 1, 2, 2, 2)
        return np.array([self.mass, *self.com, *np.asarray(self.inertia_com)[rows, columns]])


BODY = TrueBody(MASS, COM, INERTIA_COM)


def record_motion(start: float, stop: float, seed: int = 0, pace: float = 1.0) -> Streams:
    """Return what sensors at 100 Hz report of the motion from `start` to before `stop`, s.

    The noise depends on the seed and the chunk's start: chunks may be made one after the other.

    Args:
        start: s.
        stop: s.
        seed: of the noise.
        pace: factor of all angular frequencies; inertia shows with its square.
    """
    time = np.arange(round(start * RATE_HZ), round(stop * RATE_HZ)) / RATE_HZ
    rng = np.random.default_rng([seed, round(start * RATE_HZ)])
    turn, shift = _at_pace(TURN, pace), _at_pace(SHIFT, pace)
    rotation, position = _rotation(turn, time), CENTRE + _sines(shift, time)
    force = _contact_forces(_wanted_wrench(turn, shift, time))
    poses = PoseStream(
        time,
        position + POSITION_STD * rng.normal(size=position.shape),
        exp_so3(ROTATION_STD * rng.normal(size=position.shape)) @ rotation,
        np.tile(np.diag(np.repeat([ROTATION_STD**2, POSITION_STD**2], 3)), (len(time), 1, 1)),
        white=True,
    )
    contacts = {}
    frames = _contact_frames()
    for k, (name, point) in enumerate(POINTS.items()):
        world = np.einsum("nij,nj->ni", rotation, force[:, k])
        contacts[name] = ContactStream(
            name=name,
            time=time,
            force=world + FORCE_STD * rng.normal(size=world.shape),
            torque=np.zeros_like(world),
            force_std=np.full_like(world, FORCE_STD),
            pose_time=time,
            position=position + rotation @ point,
            rotation=rotation @ frames[k],
        )
    return Streams(poses, contacts)


def _at_pace(motion: Motion, pace: float) -> Motion:
    amplitude, rate, phase = motion
    return amplitude, pace * rate, phase


def _sines(motion: Motion, time: Array, derivative: int = 0) -> Array:
    """(N, 3) sines of a motion, or their derivative of that order."""
    amplitude, rate, phase = motion
    angle = time[:, None] * rate + phase + 0.5 * np.pi * derivative
    return np.asarray(amplitude * rate**derivative * np.sin(angle))


def _rotation(turn: Motion, time: Array) -> Array:
    """(N, 3, 3) R_WO."""
    return np.asarray(exp_so3(_sines(turn, time)))


def _spin(turn: Motion, time: Array) -> Array:
    """(N, 3) angular velocity in the body frame, from R^T R'."""
    rate = (_rotation(turn, time + _STEP) - _rotation(turn, time - _STEP)) / (2 * _STEP)
    skew = np.swapaxes(_rotation(turn, time), 1, 2) @ rate
    return 0.5 * np.stack(
        [
            skew[:, 2, 1] - skew[:, 1, 2],
            skew[:, 0, 2] - skew[:, 2, 0],
            skew[:, 1, 0] - skew[:, 0, 1],
        ],
        axis=1,
    )


def _wanted_wrench(turn: Motion, shift: Motion, time: Array) -> Array:
    """(N, 6) torque about the origin and force that the contacts must apply, body axes.

    Newton and Euler about the centre of mass: f = m (a_c - g), t_c = I w' + w x I w.
    """
    spin = _spin(turn, time)
    change = (_spin(turn, time + _STEP) - _spin(turn, time - _STEP)) / (2 * _STEP)
    linear = _sines(shift, time, 2) - GRAVITY
    centre = np.cross(change, COM) + np.cross(spin, np.cross(spin, COM))
    force = MASS * (np.einsum("nji,nj->ni", _rotation(turn, time), linear) + centre)
    torque = change @ INERTIA_COM + np.cross(spin, spin @ INERTIA_COM) + np.cross(COM, force)
    return np.concatenate([torque, force], axis=1)


def _contact_forces(wrench: Array) -> Array:
    """(N, C, 3) on the object, body axes: the smallest that make a wrench (N, 6), and a squeeze."""
    points = np.array(list(POINTS.values()))
    grasp = np.zeros((6, 3 * len(points)))
    for k, (x, y, z) in enumerate(points):
        grasp[:3, 3 * k : 3 * k + 3] = [[0, -z, y], [z, 0, -x], [-y, x, 0]]
        grasp[3:, 3 * k : 3 * k + 3] = np.eye(3)
    least = wrench @ np.linalg.pinv(grasp).T
    squeeze = -SQUEEZE_N * (points - points.mean(axis=0)) / REACH
    return least.reshape(len(wrench), len(points), 3) + squeeze


def _contact_frames() -> Array:
    """(C, 3, 3) contact frames in the body frame, whose z axes point to the middle."""
    points = np.array(list(POINTS.values()))
    normals = points.mean(axis=0) - points
    frames = []
    for normal in normals / np.linalg.norm(normals, axis=1, keepdims=True):
        side = np.cross(normal, np.eye(3)[np.argmin(np.abs(normal))])
        side /= np.linalg.norm(side)
        frames.append(np.stack([side, np.cross(normal, side), normal], axis=1))
    return np.array(frames)
