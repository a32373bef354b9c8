"""What happens to a load at one time: something is added to it, or it slips in the grasp."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from tactile_dynamics_ros.synthetic import randomness
from tactile_dynamics_ros.synthetic.effects.base import HiddenEffect, Quantity, force_at_point
from tactile_dynamics_ros.synthetic.objects import HeldObject
from tactile_dynamics_ros.synthetic.scenario import Scenario, Scene


@dataclass(frozen=True)
class PayloadChange(HiddenEffect):
    """A small heavy thing is put on the object, and moves with it from then on."""

    name = "payload_change"
    added: float
    place: np.ndarray
    at: float

    @property
    def parameters(self) -> dict[str, Quantity]:
        """True values by name."""
        return {
            "dm": Quantity(self.added, "kg"),
            "place": Quantity(self.place.tolist(), "m"),
            "t": Quantity(self.at, "s"),
        }

    def wrench(self, scene: Scene) -> np.ndarray:
        """Minus the force that carries it, after it was put there."""
        carried = -self.added * (scene.motion.point_acceleration(self.place) - scene.gravity)
        there = scene.time - scene.time[0] >= self.at
        return there[:, None] * force_at_point(scene, self.place, carried)

    @classmethod
    def draw(cls, rng: np.random.Generator, magnitude: float, scenario: Scenario) -> PayloadChange:
        """A third to two thirds of the object's mass, somewhere on it, in the middle part."""
        body, duration = scenario.body, scenario.options.duration
        added = magnitude * body.mass * rng.uniform(0.33, 0.67)
        place = body.com + rng.uniform(-0.3, 0.3, 3) * body.size
        return cls(magnitude, float(added), place, duration * float(rng.uniform(0.3, 0.7)))


@dataclass(frozen=True)
class GraspShift(HiddenEffect):
    """The object slips on the sensor: it is carried at another place and turned."""

    name = "grasp_shift"
    before: HeldObject
    shift: np.ndarray
    turn: np.ndarray
    at: float

    @property
    def after(self) -> HeldObject:
        """The object after it slipped."""
        turn = Rotation.from_rotvec(self.turn).as_matrix()
        inertia = turn @ self.before.inertia_com @ turn.T
        return replace(self.before, com=self.before.com + self.shift, inertia_com=inertia)

    @property
    def parameters(self) -> dict[str, Quantity]:
        """True values by name."""
        return {"d": Quantity(self.shift.tolist(), "m"), "t": Quantity(self.at, "s")}

    def wrench(self, scene: Scene) -> np.ndarray:
        """What carries it where it was less what carries it where it is."""
        was, now = (
            body.inertial_wrench(scene.motion, scene.gravity) for body in (self.before, self.after)
        )
        return np.asarray((scene.time - scene.time[0] >= self.at)[:, None] * (was - now))

    @classmethod
    def draw(cls, rng: np.random.Generator, magnitude: float, scenario: Scenario) -> GraspShift:
        """A centimetre and a few degrees, in the middle part."""
        shift = 0.01 * magnitude * randomness.unit_vector(rng)
        turn = 0.1 * magnitude * randomness.unit_vector(rng)
        at = scenario.options.duration * float(rng.uniform(0.3, 0.7))
        return cls(magnitude, scenario.body, shift, turn, at)
