"""Disturbances of the object that the product's catalogue does not know."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tactile_dynamics_ros.synthetic import randomness
from tactile_dynamics_ros.synthetic.effects.base import (
    HiddenEffect,
    force_at_origin,
    force_at_point,
)
from tactile_dynamics_ros.synthetic.effects.external import draw_body_point
from tactile_dynamics_ros.synthetic.scenario import Scenario, Scene

_BY_POSITION: dict[str, object] = {
    "correlates_with": "position",
    "frame": "world",
    "channels": ["force", "torque"],
}
"""Signature of a force at a point that depends on where it is, no number."""


@dataclass(frozen=True)
class MotorVibration(HiddenEffect):
    """An unbalanced motor inside the object shakes it along one body axis."""

    name = "motor_vibration"
    frequency_hz: float
    phase: float
    direction: np.ndarray
    point: np.ndarray

    @property
    def signature(self) -> dict[str, object]:
        """A tone that is constant in the body frame."""
        return {"frequency_hz": self.frequency_hz, "frame": "body", "channels": ["force", "torque"]}

    def wrench(self, scene: Scene) -> np.ndarray:
        """A sinusoidal force at a point of the body."""
        tone = np.sin(2 * np.pi * self.frequency_hz * scene.time + self.phase)
        force = 0.3 * self.magnitude * scene.motion.to_world(self.direction)
        return force_at_point(scene, self.point, tone[:, None] * force)

    @classmethod
    def draw(cls, rng: np.random.Generator, magnitude: float, scenario: Scenario) -> MotorVibration:
        """4 to 12 Hz, any axis."""
        frequency, phase = rng.uniform(4.0, 12.0), rng.uniform(0, 2 * np.pi)
        direction = randomness.unit_vector(rng)
        return cls(magnitude, frequency, phase, direction, draw_body_point(rng, scenario))


@dataclass(frozen=True)
class MagneticPull(HiddenEffect):
    """A magnet at a fixed place attracts a point of the object: force ~ distance^-4."""

    name = "magnetic_pull"
    power = 4
    magnet: np.ndarray
    point: np.ndarray

    @property
    def signature(self) -> dict[str, object]:
        """A force that depends on the position alone."""
        return _BY_POSITION

    def wrench(self, scene: Scene) -> np.ndarray:
        """0.5 N at 10 cm."""
        gap = self.magnet - scene.motion.point(self.point)
        distance = np.sqrt((gap**2).sum(1, keepdims=True) + 0.03**2)
        return force_at_point(
            scene,
            self.point,
            0.5 * self.magnitude * (0.1 / distance) ** self.power * gap / distance,
        )

    @classmethod
    def draw(cls, rng: np.random.Generator, magnitude: float, scenario: Scenario) -> MagneticPull:
        """A magnet 8 to 15 cm from the mean position."""
        magnet = scenario.motion.centre + rng.uniform(0.08, 0.15) * randomness.unit_vector(rng)
        return cls(magnitude, magnet, draw_body_point(rng, scenario))


@dataclass(frozen=True)
class DipolePull(MagneticPull):
    """A magnet that pulls at an iron part: force ~ distance^-3."""

    name = "dipole_pull"
    power = 3


@dataclass(frozen=True)
class ChargePull(MagneticPull):
    """A charge that attracts a point of the object: force ~ distance^-2."""

    name = "charge_pull"
    power = 2


@dataclass(frozen=True)
class StiffeningSpring(HiddenEffect):
    """A spring that grows stiffer: force ~ elongation^3 from where a point rests."""

    name = "stiffening_spring"
    rest: np.ndarray
    point: np.ndarray

    @property
    def signature(self) -> dict[str, object]:
        """A force that depends on the position alone."""
        return _BY_POSITION

    def wrench(self, scene: Scene) -> np.ndarray:
        """0.5 N at 10 cm."""
        gap = self.rest - scene.motion.point(self.point)
        square = (gap**2).sum(1, keepdims=True)
        return force_at_point(scene, self.point, 500.0 * self.magnitude * square * gap)

    @classmethod
    def draw(
        cls, rng: np.random.Generator, magnitude: float, scenario: Scenario
    ) -> StiffeningSpring:
        """Slack up to 5 cm from the mean position."""
        rest = scenario.motion.centre + rng.uniform(0.0, 0.05) * randomness.unit_vector(rng)
        return cls(magnitude, rest, draw_body_point(rng, scenario))


@dataclass(frozen=True)
class CableStickSlip(HiddenEffect):
    """A cable that rubs through a guide: it sticks, stretches, lets go and sticks again."""

    name = "cable_stick_slip"
    point: np.ndarray
    stiffness: float = 30.0
    kept: float = 0.3

    @property
    def signature(self) -> dict[str, object]:
        """A sawtooth over the displacement."""
        return _BY_POSITION

    def wrench(self, scene: Scene) -> np.ndarray:
        """Spring to where the cable sticks; beyond the limit it slips and keeps a part."""
        limit = 0.6 * self.magnitude
        path = scene.motion.point(self.point)
        force = np.empty_like(path)
        stuck = path[0].copy()
        for n, place in enumerate(path):
            pull = self.stiffness * (stuck - place)
            size = np.sqrt(pull @ pull)
            if size > limit:
                pull *= self.kept * limit / size
                stuck = place + pull / self.stiffness
            force[n] = pull
        return force_at_point(scene, self.point, force)

    @classmethod
    def draw(cls, rng: np.random.Generator, magnitude: float, scenario: Scenario) -> CableStickSlip:
        """The cable is tied to a random point."""
        return cls(magnitude, draw_body_point(rng, scenario))


@dataclass(frozen=True)
class DryRubbing(HiddenEffect):
    """Dry friction of constant size against the velocity of the body origin."""

    name = "dry_rubbing"

    @property
    def signature(self) -> dict[str, object]:
        """Depends on the direction of motion, not on the speed."""
        return {"correlates_with": "velocity", "frame": "world", "channels": ["force"]}

    def wrench(self, scene: Scene) -> np.ndarray:
        """-F v / |v|, smooth below 5 mm/s."""
        velocity = scene.motion.velocity
        speed = np.sqrt((velocity**2).sum(1, keepdims=True) + 0.005**2)
        return force_at_origin(-0.2 * self.magnitude * velocity / speed)

    @classmethod
    def draw(cls, rng: np.random.Generator, magnitude: float, scenario: Scenario) -> DryRubbing:
        """Nothing but the size is free."""
        return cls(magnitude)


@dataclass(frozen=True)
class AerodynamicLift(HiddenEffect):
    """A spinning body that moves is pushed sideways: force c w x v at the body origin."""

    name = "aerodynamic_lift"

    @property
    def signature(self) -> dict[str, object]:
        """Perpendicular to the velocity."""
        return {"correlates_with": "angular_velocity", "frame": "world", "channels": ["force"]}

    def wrench(self, scene: Scene) -> np.ndarray:
        """Side force with c = 0.3 N s^2/(m rad)."""
        motion = scene.motion
        push = np.cross(motion.angular_velocity, motion.velocity)
        return force_at_origin(0.3 * self.magnitude * push)

    @classmethod
    def draw(
        cls, rng: np.random.Generator, magnitude: float, scenario: Scenario
    ) -> AerodynamicLift:
        """Nothing but the size is free."""
        return cls(magnitude)


@dataclass(frozen=True)
class ExternalTaps(HiddenEffect):
    """Somebody taps the object now and then."""

    name = "external_taps"
    start: np.ndarray
    length: np.ndarray
    force: np.ndarray
    point: np.ndarray

    @property
    def signature(self) -> dict[str, object]:
        """Short events at random times."""
        return {"intermittent": True, "frame": "none", "channels": ["force", "torque"]}

    def wrench(self, scene: Scene) -> np.ndarray:
        """Half-sine pushes at points of the body."""
        total = np.zeros((len(scene.time), 6))
        for start, length, force, point in zip(
            self.start, self.length, self.force, self.point, strict=True
        ):
            phase = (scene.time - start) / length
            pulse = np.where((phase > 0) & (phase < 1), np.sin(np.pi * phase), 0.0)
            push = self.magnitude * pulse[:, None] * scene.motion.to_world(force)
            total += force_at_point(scene, point, push)
        return total

    @classmethod
    def draw(cls, rng: np.random.Generator, magnitude: float, scenario: Scenario) -> ExternalTaps:
        """About one tap every two seconds, 40 to 120 ms long, around 1.5 N."""
        count = max(3, round(scenario.options.duration / 2))
        start = np.sort(rng.uniform(0, scenario.options.duration - 0.2, size=count))
        force = np.stack([rng.uniform(1, 2) * randomness.unit_vector(rng) for _ in range(count)])
        point = np.stack([draw_body_point(rng, scenario) for _ in range(count)])
        return cls(magnitude, start, rng.uniform(0.04, 0.12, size=count), force, point)


@dataclass(frozen=True)
class WallContact(HiddenEffect):
    """The object now and then presses a point against a soft wall that stands in its way."""

    name = "wall_contact"
    normal: np.ndarray
    point: np.ndarray
    reach: float

    @property
    def signature(self) -> dict[str, object]:
        """Zero on one side of a plane, linear in the depth on the other."""
        return {
            "intermittent": True,
            "correlates_with": "position",
            "frame": "world",
            "channels": ["force", "torque"],
        }

    def wrench(self, scene: Scene) -> np.ndarray:
        """30 N/m against the depth behind the wall."""
        depth = (scene.motion.point(self.point) @ -self.normal) - self.reach
        push = 30.0 * self.magnitude * np.maximum(depth, 0.0)
        return force_at_point(scene, self.point, push[:, None] * self.normal)

    @classmethod
    def draw(cls, rng: np.random.Generator, magnitude: float, scenario: Scenario) -> WallContact:
        """The wall is reached in a quarter of the time."""
        normal, point = randomness.unit_vector(rng), draw_body_point(rng, scenario)
        path = scenario.motion.evaluate(scenario.clock(20)).point(point)
        return cls(magnitude, normal, point, float(np.quantile(path @ -normal, 0.75)))
