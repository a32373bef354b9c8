"""Three-axis sensors in the tip and in the pads: what they report of true contacts."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.configuration import check_ranges, parameter
from tactile_dynamics_ros.sim.contacts import ContactReading

Array = NDArray[np.float64]


@dataclass(frozen=True)
class TouchSensorConfig:
    """Errors of three-axis sensors that are tared before they touch.

    Source: logs of arrays of nine pillars under load, of which a sum has 0.033 to 0.115 N of noise
    along the normal and 0.017 N across it.
    """

    force_noise: float = parameter(0.03, "white noise of a force axis", "N", 0.0, 1.0)
    point_noise: float = parameter(
        3e-4, "white noise of the contact point, each axis", "m", 0, 0.01
    )
    height_offset: float = parameter(0.0, "lasting error of the contact's height", "m", -0.02, 0.02)
    touch_force: float = parameter(0.15, "below it nothing is touched", "N", 0.0, 5.0)

    def __post_init__(self) -> None:
        check_ranges(self)


@dataclass(frozen=True)
class Felt:
    """What the sensor of one contact reports.

    Attributes:
        name: of the contact.
        time: s, of the force.
        force: (3,) N on the object, world axes; zero where nothing is touched.
        raw: (3,) N, as it was measured, noise alone where nothing is touched.
        pose: (4, 4) in the world: the contact point, z the normal into the object.
        touching: whether anything is touched.
    """

    name: str
    time: float
    force: Array
    raw: Array
    pose: Array
    touching: bool


class TouchSensors:
    """Sensors of tip and pads.

    Args:
        config: errors.
        seed: of the noise.
    """

    def __init__(self, config: TouchSensorConfig, seed: int) -> None:
        self.config, self._rng = config, np.random.default_rng([seed, 61])

    @property
    def force_std(self) -> Array:
        """(3,) standard deviation of a reported force, N."""
        return np.full(3, max(self.config.force_noise, 1e-4))

    def read(self, contacts: Iterable[ContactReading], rest: Array) -> list[Felt]:
        """Return what the sensors report.

        Args:
            contacts: of tip and pads, forces on the object in world axes.
            rest: pose (4, 4) of the tip, told where nothing is touched.
        """
        return [self._read(contact, rest) for contact in contacts]

    def _read(self, contact: ContactReading, rest: Array) -> Felt:
        config = self.config
        force = contact.force + config.force_noise * self._rng.standard_normal(3)
        error = config.point_noise * self._rng.standard_normal(3)
        error[2] += config.height_offset
        if not contact.in_contact or np.linalg.norm(force) < config.touch_force:
            return Felt(contact.name, contact.time, np.zeros(3), force, rest, False)
        pose = np.eye(4)
        across = np.array([-contact.normal[1], contact.normal[0], 0.0])
        pose[:3, :3] = np.column_stack([across, np.array([0.0, 0.0, 1.0]), contact.normal])
        pose[:3, 3] = contact.point + error
        return Felt(contact.name, contact.time, force, force, pose, True)
