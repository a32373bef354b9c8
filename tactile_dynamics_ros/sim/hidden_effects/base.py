"""What a hidden effect may do to the simulated robot, and the least that it needs of the world."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar, Protocol

import numpy as np

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.sim.bodies import ContactReading


class Plant(Protocol):
    """The part of `HandWorld` that effects use; a free body in a test offers the same."""

    client: int
    robot: int
    table: int
    time: float
    model: Any
    config: Any
    machine: Any
    fingers: tuple[str, ...]

    @property
    def object_id(self) -> int:
        """Bullet id of the object."""

    @property
    def gravity(self) -> Array:
        """(3,) m/s^2, world axes."""

    def object_pose(self) -> Array:
        """X_WO (4, 4)."""

    def object_velocity(self) -> tuple[Array, Array]:
        """Angular velocity and velocity of the body origin, world axes."""

    def apply_force(self, force: Array, point: Array) -> None:
        """Push the object during the coming step, world axes."""

    def apply_torque(self, torque: Array) -> None:
        """Twist the object during the coming step, world axes."""

    def set_gravity(self, gravity: Array) -> None:
        """Change gravity for everything."""

    def add_pre_step(self, callback: Callable[[Any], None]) -> None:
        """Call back with the world before every step."""


@dataclass(frozen=True)
class SensorView:
    """What the fingertips feel at one instant, before the sensors' electronics and noise.

    Attributes:
        time: s.
        contacts: reading by finger, forces on the object in world axes.
        sensor_rotation: R_WS (3, 3) of each fingertip sensor.
        object_pose: X_WO (4, 4).
    """

    time: float
    contacts: Mapping[str, ContactReading]
    sensor_rotation: Mapping[str, Array]
    object_pose: Array


@dataclass
class HiddenEffect:
    """A disturbance that the simulated robot has and that no estimator is told; by itself, none.

    ``attach`` is called once, with the object in its place, before the simulation runs. ``feel``
    is called at every reading of the fingertips, ``see`` at every reading of the object's pose,
    and ``delay`` gives the seconds that the stamps of a stream are late.

    Attributes:
        magnitude: multiple of the effect's typical size, 0 is off.
        rng: draws directions and places when the effect is attached.
    """

    name: ClassVar[str] = "none"
    in_catalogue: ClassVar[bool] = True
    magnitude: float = 0.0
    rng: np.random.Generator = field(default_factory=lambda: np.random.default_rng(0))

    def attach(self, plant: Plant) -> None:
        """Enter the world."""

    def feel(self, view: SensorView) -> dict[str, ContactReading]:
        """Return what the fingertip sensors report of the true contacts."""
        return dict(view.contacts)

    def see(self, pose: Array, time: float) -> Array:
        """Return the pose X_WO (4, 4) that sensors report of the true one."""
        return pose

    def delay(self, stream: str) -> float:
        """Return by how many seconds the stamps of "touch" or "pose" are late."""
        return 0.0

    def truth(self) -> dict[str, Any]:
        """Return the true parameters by name, as {"value", "unit"}, for the reveal."""
        return {}

    def describe(self) -> dict[str, Any]:
        """Return name, size and true parameters as plain numbers, ready for JSON."""
        return {
            "name": self.name,
            "magnitude": self.magnitude,
            "in_catalogue": self.in_catalogue,
            "parameters": self.truth(),
        }

    def unit_vector(self) -> Array:
        """Draw a direction uniformly from the sphere."""
        vector = self.rng.normal(size=3)
        return np.asarray(vector / np.linalg.norm(vector))

    def surface_point(self, plant: Plant) -> Array:
        """Draw a point (3,) near the surface of the object, body frame, m."""
        corners = plant.model.corners
        low, high = corners.min(axis=0), corners.max(axis=0)
        share = 0.5 + self.rng.choice([-1, 1], size=3) * self.rng.uniform(0.2, 0.5, size=3)
        return np.asarray(low + share * (high - low))


def quantity(value: Any, unit: str) -> dict[str, Any]:
    """One true parameter for the reveal."""
    return {"value": np.asarray(value).tolist(), "unit": unit}


def place(pose: Array, point: Array) -> Array:
    """World coordinates of a body point."""
    return np.asarray(pose[:3, 3] + pose[:3, :3] @ point)


def point_velocity(plant: Plant, point: Array) -> Array:
    """World velocity of a body point."""
    angular, linear = plant.object_velocity()
    return np.asarray(linear + np.cross(angular, plant.object_pose()[:3, :3] @ point))
