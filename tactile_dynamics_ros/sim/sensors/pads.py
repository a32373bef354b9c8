"""Flat fingertips that measure force and torque: contacts in, wrenches in the sensor frames out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.configuration import check_ranges, parameter
from tactile_dynamics_ros.core.rigid_body.rotation import cross
from tactile_dynamics_ros.sim.contacts import ContactReading

Array = NDArray[np.float64]


@dataclass(frozen=True)
class PadConfig:
    """Errors of a six-axis sensor behind a pad, tared before it touches.

    Source: sizes of what six-axis sensors of 17 mm (ATI Nano17) resolve, 3 mN and 0.02 mN m, times
    ten for a driver without averaging.
    """

    force_noise: float = parameter(0.03, "white noise of a force axis", "N", 0.0, 10.0)
    torque_noise: float = parameter(2e-4, "white noise of a torque axis", "N m", 0.0, 1.0)

    def __post_init__(self) -> None:
        check_ranges(self)


class ForceTorquePads:
    """Sensors of all pads.

    Args:
        fingers: names of the pads.
        config: errors.
        seed: of the noise.
    """

    def __init__(
        self, fingers: Sequence[str], config: PadConfig | None = None, seed: int = 0
    ) -> None:
        self.config = config or PadConfig()
        self._fingers = tuple(fingers)
        self._rng = np.random.default_rng([seed, 17])

    @property
    def force_std(self) -> Array:
        """(3,) standard deviation of a reported force, N."""
        return np.full(3, max(self.config.force_noise, 1e-4))

    def read(self, contacts: Mapping[str, ContactReading], poses: Array) -> Array:
        """Return the wrenches (F, 6) [torque, force] on the object about the frames' origins.

        Args:
            contacts: true ones by finger, world axes.
            poses: (F, 4, 4) true X_WS of the sensor frames.
        """
        std = np.repeat([self.config.torque_noise, self.config.force_noise], 3)
        wrenches = std * self._rng.standard_normal((len(self._fingers), 6))
        for row, finger, pose in zip(wrenches, self._fingers, poses, strict=True):
            contact = contacts[finger]
            if contact.in_contact:
                torque = contact.torque + cross(contact.point - pose[:3, 3], contact.force)
                row += np.concatenate([torque @ pose[:3, :3], contact.force @ pose[:3, :3]])
        return wrenches
