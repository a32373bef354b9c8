"""What an arm with a load on its wrist does, in SI units, before anybody writes it to a file."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

GRAVITY_W = np.array([0.0, 0.0, -9.81])
"""m/s^2, as in every recording of this package."""
INERTIA_PER_MASS = np.diag([0.03**2 + 0.02**2, 0.04**2 + 0.02**2, 0.04**2 + 0.03**2])
"""m^2: a load that is spread by 4, 3 and 2 cm along its axes, about its centre of mass."""
_STEP_S = 1e-4
"""Step of the differences by which the motion is differentiated: errors of 1e-7 m/s^2."""


@dataclass(frozen=True)
class WristLog:
    """Pose of a wrist and the wrench that its sensor applies on the load.

    Attributes:
        time: (N,) s from zero.
        position: (N, 3) m, world; rotation: sensor to world.
        force: (N, 3) N on the load, torque: (N, 3) N m about the sensor, sensor axes, with bias and
            noise, as a perfect file would have them.
        mass: kg.
        com: (3,) m, sensor axes.
    """

    time: np.ndarray
    position: np.ndarray
    rotation: Rotation
    force: np.ndarray
    torque: np.ndarray
    mass: float
    com: np.ndarray

    @classmethod
    def draw(cls, seed: int, seconds: float = 20.0, rate_hz: float = 100.0) -> WristLog:
        """Draw a load of 0.5 to 3 kg that is turned and moved at up to 1 Hz."""
        rng = np.random.default_rng([seed, 71])
        time = np.arange(round(seconds * rate_hz)) / rate_hz
        motion = _Motion.draw(rng)
        mass = float(np.exp(rng.uniform(np.log(0.5), np.log(3.0))))
        com = rng.uniform([-0.03, -0.03, 0.02], [0.03, 0.03, 0.09])
        return cls._measured(rng, time, motion, [(mass, com)])

    @classmethod
    def carrying(
        cls, seed: int, loads: list[tuple[float, np.ndarray]], seconds: float = 20.0
    ) -> WristLog:
        """Record loads of given masses and centres that move as one; mass and com are their sum."""
        rng = np.random.default_rng([seed, 73])
        time = np.arange(round(seconds * 100.0)) / 100.0
        return cls._measured(rng, time, _Motion.draw(rng), loads)

    @classmethod
    def _measured(
        cls,
        rng: np.random.Generator,
        time: np.ndarray,
        motion: _Motion,
        loads: list[tuple[float, np.ndarray]],
    ) -> WristLog:
        """Sensors with bias and noise on what moves the loads."""
        wrenches = [motion.load(time, mass, com) for mass, com in loads]
        force, torque = (np.sum(part, axis=0) for part in zip(*wrenches, strict=True))
        mass = float(sum(one for one, _ in loads))
        position, rotation = motion.at(time)
        return cls(
            time,
            position + 1e-4 * rng.normal(size=position.shape),
            Rotation.from_rotvec(3e-4 * rng.normal(size=position.shape)) * rotation,
            force + rng.normal(scale=4.0, size=3) + 0.05 * rng.normal(size=force.shape),
            torque + rng.normal(scale=0.2, size=3) + 0.003 * rng.normal(size=force.shape),
            mass,
            np.sum([one * com for one, com in loads], axis=0) / mass,
        )

    @classmethod
    def draw_static(cls, seed: int, rows: int = 12) -> WristLog:
        """Draw orientations in which the load rests; there is no time in them."""
        rng = np.random.default_rng([seed, 72])
        mass = float(np.exp(rng.uniform(np.log(0.5), np.log(3.0))))
        com = rng.uniform([-0.03, -0.03, 0.02], [0.03, 0.03, 0.09])
        rotation = Rotation.random(rows, rng=rng)
        weight = mass * rotation.inv().apply(-GRAVITY_W)
        bias = rng.normal(scale=4.0, size=3)
        return cls(
            np.arange(rows, dtype=float),
            rng.uniform([0.3, -0.3, 0.3], [0.6, 0.3, 0.8], (rows, 3)),
            rotation,
            weight + bias + 0.03 * rng.normal(size=weight.shape),
            np.cross(com, weight) + 0.002 * rng.normal(size=weight.shape),
            mass,
            com,
        )

    @property
    def quaternion(self) -> np.ndarray:
        """(N, 4) xyzw, the sign continuous."""
        named = self.rotation.as_quat()
        flips = np.cumprod(np.where(np.sum(named[1:] * named[:-1], axis=1) < 0.0, -1.0, 1.0))
        return named * np.concatenate([[1.0], flips])[:, None]

    @property
    def world_force(self) -> np.ndarray:
        """(N, 3) N, the force on the load in axes of the world."""
        return self.rotation.apply(self.force)

    @property
    def world_torque(self) -> np.ndarray:
        """(N, 3) N m, the torque about the sensor in axes of the world."""
        return self.rotation.apply(self.torque)


@dataclass(frozen=True)
class _Motion:
    """Sums of sines for the place and for three angles."""

    centre: np.ndarray
    start: Rotation
    sizes: np.ndarray
    rates: np.ndarray
    phases: np.ndarray

    @classmethod
    def draw(cls, rng: np.random.Generator) -> _Motion:
        sizes = np.concatenate([np.full((2, 3), 0.05), np.full((2, 3), 0.8)])
        return cls(
            centre=rng.uniform([0.35, -0.25, 0.35], [0.55, 0.25, 0.6]),
            start=Rotation.random(rng=rng),
            sizes=sizes * rng.uniform(0.6, 1.0, sizes.shape),
            rates=2.0 * np.pi * rng.uniform(0.15, 0.7, sizes.shape),
            phases=rng.uniform(0.0, 2.0 * np.pi, sizes.shape),
        )

    def at(self, time: np.ndarray) -> tuple[np.ndarray, Rotation]:
        """Place (N, 3) and orientation."""
        waves = self.sizes * np.sin(self.rates * time[:, None, None] + self.phases)
        place = self.centre + waves[:, :2].sum(axis=1)
        return place, self.start * Rotation.from_rotvec(waves[:, 2:].sum(axis=1))

    def load(self, time: np.ndarray, mass: float, com: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Force and torque (N, 3) that move the load so, sensor axes, by Newton and Euler."""
        (p0, r0), (p1, r1), (p2, r2) = (self.at(time + k * _STEP_S) for k in (-1, 0, 1))
        centres = [p + r.apply(com) for p, r in ((p0, r0), (p1, r1), (p2, r2))]
        moved = (centres[0] - 2.0 * centres[1] + centres[2]) / _STEP_S**2
        force = mass * r1.inv().apply(moved - GRAVITY_W)
        before = (r0.inv() * r1).as_rotvec() / _STEP_S
        after = (r1.inv() * r2).as_rotvec() / _STEP_S
        rate, change = 0.5 * (before + after), (after - before) / _STEP_S
        inertia = mass * INERTIA_PER_MASS
        about_centre = change @ inertia + np.cross(rate, rate @ inertia)
        return force, about_centre + np.cross(com, force)
