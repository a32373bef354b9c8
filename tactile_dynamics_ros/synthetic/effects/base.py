"""What every hidden effect may do: push the object, twist contacts, spoil measurements."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

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
