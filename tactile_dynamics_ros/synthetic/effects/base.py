"""What every hidden effect may do, and effects that act within bounds only."""

from __future__ import annotations

import dataclasses
import re
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from tactile_dynamics_ros.synthetic.grasp import FINGERS
from tactile_dynamics_ros.synthetic.scenario import Scene
from tactile_dynamics_ros.synthetic.sensors import Readings


@dataclass(frozen=True)
class Quantity:
    """A true parameter value with its unit; signature-only quantities are not graded."""

    value: float | list[float]
    unit: str


@dataclass(frozen=True)
class HiddenEffect:
    """A disturbance that the recording contains and nobody states.

    Attributes:
        magnitude: multiple of the effect's typical size; 0 switches it off.
    """

    name: ClassVar[str] = ""
    magnitude: float

    @property
    def parameters(self) -> dict[str, Quantity]:
        """True values by name."""
        return {}

    @property
    def reading(self) -> str:
        """Which of several meanings of the name was drawn, or nothing."""
        return ""

    @property
    def signature(self) -> dict[str, object]:
        """What an attentive observer could see: channels, frequency."""
        return {}

    def wrench(self, scene: Scene) -> np.ndarray:
        """(N, 6) torque about the body origin and force on the object, world axes."""
        return np.zeros((len(scene.time), 6))

    def contact_torque(self, scene: Scene) -> np.ndarray:
        """(N, C, 3, 3) torque that each contact applies per newton of its force, body axes."""
        return np.zeros((*scene.contacts.weight.shape, 3, 3))

    def transduce(self, readings: Readings) -> Readings:
        """Change what the sensor feels, before noise."""
        return readings

    def output(self, readings: Readings) -> Readings:
        """Change what the sensor sends, after noise."""
        return readings


def force_at_origin(force: np.ndarray) -> np.ndarray:
    """Wrench of a world force (N, 3) through the body origin."""
    return np.concatenate([np.zeros_like(force), force], axis=1)


def force_at_point(scene: Scene, point: np.ndarray, force: np.ndarray) -> np.ndarray:
    """Wrench of a world force (N, 3) at a point (3,) of the body."""
    return np.concatenate([np.cross(scene.motion.to_world(point), force), force], axis=1)


def pure_torque(torque: np.ndarray) -> np.ndarray:
    """Wrench of a world torque (N, 3)."""
    return np.concatenate([torque, np.zeros_like(torque)], axis=1)


QUANTITIES = ("t", "x", "y", "z", "speed", "turn", *(f"load_{name}" for name in FINGERS))
"""Quantities that bounds may be of: s, m, m/s, rad/s, N. Loads are known to errors of sensors."""


@dataclass(frozen=True)
class Bounds:
    """Bounds of one quantity."""

    quantity: str
    low: float = -np.inf
    high: float = np.inf

    @classmethod
    def read(cls, text: str) -> Bounds:
        """Bounds written as ``z<0.6``, ``z>0.6`` or ``12<t<20``.

        Raises:
            ValueError: the text has another form, or the quantity is unknown.
        """
        parts = re.split("([<>])", text)
        if len(parts) == 5 and parts[1] == parts[3] == "<":
            found = cls(parts[2], float(parts[0]), float(parts[4]))
        elif len(parts) == 3:
            end = float(parts[2])
            found = cls(parts[0], high=end) if parts[1] == "<" else cls(parts[0], low=end)
        else:
            raise ValueError(f"'{text}': expected z<0.6, z>0.6 or 12<t<20")
        if found.quantity not in QUANTITIES:
            raise ValueError(f"'{found.quantity}' is none of {', '.join(QUANTITIES)}")
        return found

    def hold(self, time: np.ndarray, position: np.ndarray, rotation: np.ndarray) -> np.ndarray:
        """(N,) whether they hold for a quantity of the motion."""
        if self.quantity == "t":
            return self._within(time - time[0])
        if self.quantity in "xyz":
            return self._within(position[:, "xyz".index(self.quantity)])
        if self.quantity == "speed":
            return self._within(np.linalg.norm(np.gradient(position, time, axis=0), axis=1))
        change = np.gradient(rotation, time, axis=0)
        return self._within(np.sqrt(0.5 * np.sum(change**2, axis=(1, 2))))

    def hold_for_load(self, force: np.ndarray) -> np.ndarray:
        """(N,) whether they hold for the force (N, C, 3) of a finger."""
        finger = FINGERS.index(self.quantity.removeprefix("load_"))
        return self._within(np.linalg.norm(force[:, finger], axis=1))

    @property
    def of_load(self) -> bool:
        """Whether the quantity is the force of a finger."""
        return self.quantity.startswith("load_")

    def _within(self, values: np.ndarray) -> np.ndarray:
        return (values > self.low) & (values < self.high)


@dataclass(frozen=True)
class Gated(HiddenEffect):
    """A hidden effect within bounds; outside it does nothing.

    Attributes:
        inner: what acts.
        bounds: where.
    """

    inner: HiddenEffect
    bounds: Bounds

    @property
    def name(self) -> str:  # type: ignore[override]
        """Name of what acts; the bounds are a part of the signature."""
        return self.inner.name

    @property
    def parameters(self) -> dict[str, Quantity]:
        """True values of what acts."""
        return self.sized.parameters

    @property
    def reading(self) -> str:
        """Meaning of the name of what acts."""
        return self.inner.reading

    @property
    def signature(self) -> dict[str, object]:
        """Where it acts."""
        return {"regime": dataclasses.asdict(self.bounds)}

    @property
    def sized(self) -> HiddenEffect:
        """What acts, at the magnitude of this effect."""
        return dataclasses.replace(self.inner, magnitude=self.magnitude)

    def acts(self, scene: Scene) -> np.ndarray:
        """(N,) whether the bounds hold."""
        return self.bounds.hold(scene.time, scene.motion.position, scene.motion.rotation)

    def wrench(self, scene: Scene) -> np.ndarray:
        """That of what acts, inside."""
        return self.acts(scene)[:, None] * self.sized.wrench(scene)

    def contact_torque(self, scene: Scene) -> np.ndarray:
        """That of what acts, inside."""
        return self.acts(scene)[:, None, None, None] * self.sized.contact_torque(scene)

    def transduce(self, readings: Readings) -> Readings:
        """Change what the sensor feels, inside."""
        return self._inside(readings, self.sized.transduce(readings))

    def output(self, readings: Readings) -> Readings:
        """Change what the sensor sends, inside."""
        return self._inside(readings, self.sized.output(readings))

    def _inside(self, before: Readings, after: Readings) -> Readings:
        if after is before:
            return before
        bounds = self.bounds
        if bounds.of_load:
            acts = bounds.hold_for_load(before.force)
        else:
            acts = bounds.hold(before.time, before.position, before.rotation)
        mixed = {}
        for name in ("force", "contact_position", "contact_rotation"):
            old, new = getattr(before, name), getattr(after, name)
            mixed[name] = np.where(acts.reshape(-1, *[1] * (old.ndim - 1)), new, old)
        return dataclasses.replace(before, **mixed)
