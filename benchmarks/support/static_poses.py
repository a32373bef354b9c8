"""A load at rest on a wrist sensor in many orientations, with known truth."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from tactile_dynamics_ros.core.streams.streams import ContactStream, PoseStream, Streams

GRAVITY_M_S2 = 9.81
"""As in every recording of this package."""


@dataclass(frozen=True)
class StaticLoad:
    """A load behind a sensor that reads a constant too much.

    Attributes:
        mass: kg.
        com: (3,) m, sensor axes, from the sensor's origin.
        force_bias: (3,) N, torque_bias: (3,) N m, sensor axes, of the force on the load.
        force_std: N, torque_std: N m, of each reading and axis.
        rotation_std: rad, position_std: m, of each measured pose and axis.
    """

    mass: float
    com: np.ndarray
    force_bias: np.ndarray
    torque_bias: np.ndarray
    force_std: float = 0.05
    torque_std: float = 0.003
    rotation_std: float = 5e-4
    position_std: float = 1e-4

    @classmethod
    def draw(cls, seed: int) -> StaticLoad:
        """Draw a load of 0.3 to 3 kg within a decimetre, and biases of several newtons."""
        rng = np.random.default_rng([seed, 41])
        return cls(
            mass=float(np.exp(rng.uniform(np.log(0.3), np.log(3.0)))),
            com=rng.uniform([-0.03, -0.03, 0.02], [0.03, 0.03, 0.1]),
            force_bias=rng.normal(scale=5.0, size=3),
            torque_bias=rng.normal(scale=0.3, size=3),
        )

    def read(self, turned: Rotation, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
        """Force and torque (N, 3) that the sensor applies on the load, as it reads them."""
        up = turned.inv().apply([0.0, 0.0, 1.0])
        weight = self.mass * GRAVITY_M_S2 * up
        force = weight + self.force_bias + self.force_std * rng.normal(size=up.shape)
        torque = np.cross(self.com, weight) + self.torque_bias
        return force, torque + self.torque_std * rng.normal(size=up.shape)


@dataclass(frozen=True)
class StaticTable:
    """One row per orientation: rotation (N, 3, 3) to world, force (N, 3) N, torque (N, 3) N m."""

    rotation: np.ndarray
    force: np.ndarray
    torque: np.ndarray


def weigh_poses(load: StaticLoad, rows: int, seed: int) -> StaticTable:
    """Read the sensor once in each of some random orientations."""
    rng = np.random.default_rng([seed, 42])
    turned = Rotation.random(rows, rng=rng) if rows > 6 else _spread(rows)
    force, torque = load.read(turned, rng)
    shaken = Rotation.from_rotvec(load.rotation_std * rng.normal(size=(rows, 3))) * turned
    return StaticTable(shaken.as_matrix(), force, torque)


def hold_poses(
    load: StaticLoad,
    poses: int,
    seed: int,
    hold: float = 1.0,
    pause: float = 1.0,
    rate_hz: float = 50.0,
) -> Streams:
    """Record some orientations that are held; nothing is recorded while the arm moves on.

    Args:
        load: behind the sensor.
        poses: number of orientations.
        seed: of orientations and noise.
        hold: s of each.
        pause: s without samples after each.
        rate_hz: of samples.
    """
    rng = np.random.default_rng([seed, 43])
    each = round(hold * rate_hz)
    time = (np.arange(poses)[:, None] * (hold + pause) + np.arange(each) / rate_hz).ravel()
    turned = Rotation.from_matrix(
        np.repeat(Rotation.random(poses, rng=rng).as_matrix(), each, axis=0)
    )
    place = np.repeat(rng.uniform([0.3, -0.3, 0.3], [0.6, 0.3, 0.8], (poses, 3)), each, axis=0)
    force, torque = load.read(turned, rng)
    shaken = Rotation.from_rotvec(load.rotation_std * rng.normal(size=(len(time), 3))) * turned
    measured = place + load.position_std * rng.normal(size=place.shape)
    to_world = shaken.as_matrix()
    noise = np.repeat([load.rotation_std, load.position_std], 3) ** 2
    wrist = ContactStream(
        name="wrist",
        time=time,
        force=shaken.apply(force),
        torque=shaken.apply(torque),
        force_std=np.full((len(time), 3), load.force_std),
        pose_time=time,
        position=measured,
        rotation=to_world,
        carries_torque=True,
    )
    covariance = np.tile(np.diag(noise), (len(time), 1, 1))
    return Streams(PoseStream(time, measured, to_world, covariance), {"wrist": wrist})


def _spread(rows: int) -> Rotation:
    """Orientations with gravity along different axes, for tables of a few rows."""
    angles = [(0, 0, 0), (90, 0, 0), (0, 90, 0), (180, 0, 0), (-90, 0, 45), (0, -90, 30)]
    return Rotation.from_euler("xyz", angles[:rows], degrees=True)
