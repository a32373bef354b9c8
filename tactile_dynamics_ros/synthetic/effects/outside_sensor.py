"""Faults of the sensors that the product's catalogue does not know."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np

from tactile_dynamics_ros.synthetic import randomness
from tactile_dynamics_ros.synthetic.effects.base import HiddenEffect
from tactile_dynamics_ros.synthetic.effects.measurement import low_pass
from tactile_dynamics_ros.synthetic.scenario import FINGERS, Scenario
from tactile_dynamics_ros.synthetic.sensors import Readings


@dataclass(frozen=True)
class SkinCreep(HiddenEffect):
    """Under load the soft skin's reading relaxes with the logarithm of time, and recovers later.

    reading = f - strength * mean of lagged f over time constants evenly spaced in log time.
    """

    name = "skin_creep"
    time_constants: tuple[float, ...] = (0.3, 1.0, 3.0, 10.0, 30.0)

    @property
    def signature(self) -> dict[str, object]:
        """A slow memory of the force."""
        return {"correlates_with": "force", "frame": "sensor", "channels": ["force", "torque"]}

    def transduce(self, readings: Readings) -> Readings:
        """Subtract the relaxed part; the skin is fresh when the recording starts."""
        fresh = np.concatenate([np.zeros_like(readings.force[:1]), readings.force])
        lagged = [low_pass(fresh, tau, readings.period)[1:] for tau in self.time_constants]
        relaxed = 0.3 * self.magnitude * np.mean(lagged, axis=0)
        return dataclasses.replace(readings, force=readings.force - relaxed)

    @classmethod
    def draw(cls, rng: np.random.Generator, magnitude: float, scenario: Scenario) -> SkinCreep:
        """Nothing but the size is free."""
        return cls(magnitude)


@dataclass(frozen=True)
class TemperatureStep(HiddenEffect):
    """The fingertips warm up at some moment and all zeros move to a new value within seconds."""

    name = "temperature_step"
    start: float
    time_constant: float
    direction: np.ndarray

    @property
    def signature(self) -> dict[str, object]:
        """An exponential step in time."""
        return {"correlates_with": "time", "frame": "sensor", "channels": ["force", "torque"]}

    def transduce(self, readings: Readings) -> Readings:
        """Add a step that settles exponentially."""
        elapsed = np.maximum(readings.time - self.start, 0.0)
        rise = 1 - np.exp(-elapsed / self.time_constant)
        step = 0.3 * self.magnitude * rise[:, None, None] * self.direction
        return dataclasses.replace(readings, force=readings.force + step)

    @classmethod
    def draw(
        cls, rng: np.random.Generator, magnitude: float, scenario: Scenario
    ) -> TemperatureStep:
        """In the middle third of the recording."""
        start = rng.uniform(0.33, 0.67) * scenario.options.duration
        direction = np.stack([randomness.unit_vector(rng) for _ in FINGERS])
        return cls(magnitude, start, rng.uniform(0.5, 2.0), direction)


@dataclass(frozen=True)
class DeadZone(HiddenEffect):
    """Each axis of each sensor ignores the first part of the force."""

    name = "dead_zone"

    @property
    def signature(self) -> dict[str, object]:
        """Depends on the sign of the force."""
        return {"correlates_with": "force", "frame": "sensor", "channels": ["force", "torque"]}

    def transduce(self, readings: Readings) -> Readings:
        """Shrink every axis towards zero by 0.2 N."""
        rest = np.maximum(np.abs(readings.force) - 0.2 * self.magnitude, 0.0)
        return dataclasses.replace(readings, force=np.sign(readings.force) * rest)

    @classmethod
    def draw(cls, rng: np.random.Generator, magnitude: float, scenario: Scenario) -> DeadZone:
        """Nothing but the size is free."""
        return cls(magnitude)


@dataclass(frozen=True)
class CrossTalk(HiddenEffect):
    """Each sensor also reads a part of another finger's force."""

    name = "cross_talk"
    partner: tuple[int, ...]

    @property
    def signature(self) -> dict[str, object]:
        """Follows another finger."""
        return {"correlates_with": "force", "frame": "sensor", "channels": ["force", "torque"]}

    def transduce(self, readings: Readings) -> Readings:
        """Add a tenth of the partner's force, axis by axis."""
        mixed = readings.force + 0.1 * self.magnitude * readings.force[:, list(self.partner)]
        return dataclasses.replace(readings, force=mixed)

    @classmethod
    def draw(cls, rng: np.random.Generator, magnitude: float, scenario: Scenario) -> CrossTalk:
        """Each finger listens to one other."""
        shift = int(rng.integers(1, len(FINGERS)))
        return cls(magnitude, tuple((k + shift) % len(FINGERS) for k in range(len(FINGERS))))


@dataclass(frozen=True)
class PoseBacklash(HiddenEffect):
    """The reported position has play: it stays put until the object has moved by half the play."""

    name = "pose_backlash"

    @property
    def signature(self) -> dict[str, object]:
        """Jumps where the motion reverses."""
        return {"correlates_with": "velocity", "frame": "world", "channels": ["force", "torque"]}

    def transduce(self, readings: Readings) -> Readings:
        """Apply 2 mm of play to every axis of the position."""
        return dataclasses.replace(
            readings, position=play(readings.position, 0.001 * self.magnitude)
        )

    @classmethod
    def draw(cls, rng: np.random.Generator, magnitude: float, scenario: Scenario) -> PoseBacklash:
        """Nothing but the size is free."""
        return cls(magnitude)


@dataclass(frozen=True)
class ForceHysteresis(HiddenEffect):
    """Part of the reading sticks: it follows the force only outside a band."""

    name = "force_hysteresis"

    @property
    def signature(self) -> dict[str, object]:
        """Depends on whether the force rises or falls."""
        return {"correlates_with": "force", "frame": "sensor", "channels": ["force", "torque"]}

    def transduce(self, readings: Readings) -> Readings:
        """Apply a band of 0.2 N half-width to every axis."""
        return dataclasses.replace(readings, force=play(readings.force, 0.2 * self.magnitude))

    @classmethod
    def draw(
        cls, rng: np.random.Generator, magnitude: float, scenario: Scenario
    ) -> ForceHysteresis:
        """Nothing but the size is free."""
        return cls(magnitude)


@dataclass(frozen=True)
class SaturatingSensor(HiddenEffect):
    """The normal force of every finger is clipped below its highest value."""

    name = "saturating_sensor"

    @property
    def signature(self) -> dict[str, object]:
        """Only at high grip."""
        return {"correlates_with": "force", "frame": "sensor", "channels": ["force", "torque"]}

    @property
    def maximal_magnitude(self) -> float:
        """Something stays readable."""
        return 9.0

    def output(self, readings: Readings) -> Readings:
        """Clip at a tenth of the span below the maximum."""
        normal = readings.force[..., 2]
        top, bottom = normal.max(axis=0), normal.min(axis=0)
        clipped = np.minimum(normal, top - 0.1 * self.magnitude * (top - bottom))
        force = np.concatenate([readings.force[..., :2], clipped[..., None]], axis=-1)
        return dataclasses.replace(readings, force=force)

    @classmethod
    def draw(
        cls, rng: np.random.Generator, magnitude: float, scenario: Scenario
    ) -> SaturatingSensor:
        """Nothing but the size is free."""
        return cls(magnitude)


@dataclass(frozen=True)
class ElectricHum(HiddenEffect):
    """One sensor picks up a tone from the electronics."""

    name = "electric_hum"
    finger: int
    frequency_hz: float
    phase: float
    direction: np.ndarray

    @property
    def signature(self) -> dict[str, object]:
        """A tone in one finger."""
        return {
            "frequency_hz": self.frequency_hz,
            "finger": FINGERS[self.finger],
            "frame": "sensor",
            "channels": ["force", "torque"],
        }

    def output(self, readings: Readings) -> Readings:
        """Add a tone of 0.2 N to one finger."""
        tone = np.sin(2 * np.pi * self.frequency_hz * readings.time + self.phase)
        force = readings.force.copy()
        force[:, self.finger] += 0.2 * self.magnitude * tone[:, None] * self.direction
        return dataclasses.replace(readings, force=force)

    @classmethod
    def draw(cls, rng: np.random.Generator, magnitude: float, scenario: Scenario) -> ElectricHum:
        """4 to 20 Hz in any finger and direction."""
        finger, frequency = int(rng.integers(len(FINGERS))), rng.uniform(4.0, 20.0)
        phase, direction = rng.uniform(0, 2 * np.pi), randomness.unit_vector(rng)
        return cls(magnitude, finger, frequency, phase, direction)


@dataclass(frozen=True)
class NonlinearGain(HiddenEffect):
    """One sensor's gain grows with the force."""

    name = "nonlinear_gain"
    finger: int

    @property
    def signature(self) -> dict[str, object]:
        """Quadratic in one finger's force."""
        return {
            "correlates_with": "force",
            "finger": FINGERS[self.finger],
            "frame": "sensor",
            "channels": ["force", "torque"],
        }

    def transduce(self, readings: Readings) -> Readings:
        """Multiply one finger's force by 1 + 0.05 |f| / N."""
        force = readings.force.copy()
        size = np.linalg.norm(force[:, self.finger], axis=-1, keepdims=True)
        force[:, self.finger] *= 1 + 0.05 * self.magnitude * size
        return dataclasses.replace(readings, force=force)

    @classmethod
    def draw(cls, rng: np.random.Generator, magnitude: float, scenario: Scenario) -> NonlinearGain:
        """Any finger."""
        return cls(magnitude, int(rng.integers(len(FINGERS))))


def play(signal: np.ndarray, half_width: float) -> np.ndarray:
    """Backlash along axis 0: the output moves only when the input pushes an edge of the play."""
    output = np.empty_like(signal)
    held = signal[0]
    for n, value in enumerate(signal):
        held = np.minimum(np.maximum(held, value - half_width), value + half_width)
        output[n] = held
    return output
