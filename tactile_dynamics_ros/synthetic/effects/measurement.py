"""Hidden faults of the measurements: forces, contact points, clocks; and friction at the tips."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.signal import lfilter
from scipy.spatial.transform import Rotation

from tactile_dynamics_ros.synthetic import randomness
from tactile_dynamics_ros.synthetic.effects.base import HiddenEffect, Quantity
from tactile_dynamics_ros.synthetic.scenario import FINGERS, Scenario, Scene
from tactile_dynamics_ros.synthetic.sensors import Readings


def draw_affected(rng: np.random.Generator) -> np.ndarray:
    """Which fingers are faulty: one of them, or all to different degrees, (C,)."""
    if rng.uniform() < 0.5:
        return np.eye(len(FINGERS))[rng.integers(len(FINGERS))]
    return rng.uniform(0.4, 1.0, size=len(FINGERS))


def per_finger(values: np.ndarray, quantity: str, unit: str) -> dict[str, Quantity]:
    """One quantity for each finger, named `<finger>.<quantity>`."""
    rows = np.asarray(values).tolist()
    return {
        f"{finger}.{quantity}": Quantity(row, unit)
        for finger, row in zip(FINGERS, rows, strict=True)
    }


def to_frame(readings: Readings, frame: str) -> np.ndarray:
    """(N, C, 3, 3) rotations from contact axes to the axes of the named frame."""
    if frame == "contact":
        return np.broadcast_to(np.eye(3), readings.contact_rotation.shape)
    return readings.rotation.transpose(0, 2, 1)[:, None] @ readings.contact_rotation


def add_in_frame(readings: Readings, force: np.ndarray, frame: str) -> Readings:
    """Add forces (..., C, 3), given in the named frame, to the readings."""
    turn = to_frame(readings, frame)
    added = np.einsum("ncji,ncj->nci", turn, np.broadcast_to(force, readings.force.shape))
    return dataclasses.replace(readings, force=readings.force + added)


def draw_frame(rng: np.random.Generator) -> str:
    """A sensor that turns with its finger, or one that keeps its attitude to the object."""
    return str(rng.choice(["contact", "body"]))


@dataclass(frozen=True)
class ContactTorsion(HiddenEffect):
    """A soft fingertip resists spin about the normal with at most mu_t times its normal force.

    Either the fingers roll as the contact frames show, or they keep their attitude in the world and
    the whole rotation of the object is spin; the contact frames then show the normal only.
    """

    name = "contact_torsion"
    fingers_roll: bool = True
    regularisation: float = 0.05

    @property
    def reading(self) -> str:
        """What the object spins against."""
        return "finger" if self.fingers_roll else "world"

    @property
    def coefficient(self) -> float:
        """Torsional friction coefficient mu_t in m."""
        return 0.002 * self.magnitude

    @property
    def parameters(self) -> dict[str, Quantity]:
        """True values by name."""
        return {"mu_t": Quantity(self.coefficient, "m")}

    def contact_torque(self, scene: Scene) -> np.ndarray:
        """-mu_t tanh(spin / spin_0) n n^T: Coulomb friction that is smooth near rest."""
        normal, spin = scene.contacts.normal, scene.contacts.spin
        if not self.fingers_roll:
            omega = scene.motion.to_body(scene.motion.angular_velocity)
            spin = np.einsum("nci,ni->nc", normal, omega)
        strength = -self.coefficient * np.tanh(spin / self.regularisation)
        return strength[..., None, None] * normal[..., :, None] * normal[..., None, :]

    def transduce(self, readings: Readings) -> Readings:
        """Fingers that do not roll show no roll."""
        if self.fingers_roll:
            return readings
        return dataclasses.replace(readings, frames="normal")

    @classmethod
    def draw(cls, rng: np.random.Generator, magnitude: float, scenario: Scenario) -> ContactTorsion:
        """Rolling fingers, if they do roll, or fingers that keep their attitude."""
        return cls(magnitude, scenario.options.finger_roll and bool(rng.uniform() < 0.5))


@dataclass(frozen=True)
class ContactOffset(HiddenEffect):
    """Contact points are reported beside their true place by a constant in the object frame.

    Either all points are off alike (the object frame is not where the tracker says) or one finger's
    are (its geometry is wrong).
    """

    name = "contact_offset"
    direction: np.ndarray

    @property
    def offset(self) -> np.ndarray:
        """(C, 3) m, body axes."""
        return 0.005 * self.magnitude * self.direction

    @property
    def parameters(self) -> dict[str, Quantity]:
        """True values by name."""
        return per_finger(self.offset, "offset", "m")

    def transduce(self, readings: Readings) -> Readings:
        """Shift the contact points."""
        shift = np.einsum("nij,cj->nci", readings.rotation, self.offset)
        return dataclasses.replace(readings, contact_position=readings.contact_position + shift)

    @classmethod
    def draw(cls, rng: np.random.Generator, magnitude: float, scenario: Scenario) -> ContactOffset:
        """Any direction, for one finger or alike for all."""
        direction = randomness.unit_vector(rng)
        alone = np.eye(len(FINGERS))[rng.integers(len(FINGERS))]
        share = alone if rng.uniform() < 0.5 else np.ones(len(FINGERS))
        return cls(magnitude, np.outer(share, direction))


@dataclass(frozen=True)
class ForceBias(HiddenEffect):
    """A constant is added to the force in the sensor's axes."""

    name = "force_bias"
    direction: np.ndarray
    frame: str = "contact"

    @property
    def reading(self) -> str:
        """Frame in which the bias is constant."""
        return self.frame

    @property
    def bias(self) -> np.ndarray:
        """(C, 3) N, axes of the frame."""
        return 0.2 * self.magnitude * self.direction

    @property
    def parameters(self) -> dict[str, Quantity]:
        """True values by name."""
        return per_finger(self.bias, "bias", "N")

    def transduce(self, readings: Readings) -> Readings:
        """Add the offset."""
        return add_in_frame(readings, self.bias, self.frame)

    @classmethod
    def draw(cls, rng: np.random.Generator, magnitude: float, scenario: Scenario) -> ForceBias:
        """Any direction on one or all fingers."""
        return cls(magnitude, draw_affected(rng)[:, None] * _unit_rows(rng), draw_frame(rng))


@dataclass(frozen=True)
class ForceDrift(HiddenEffect):
    """The zero of the force sensor wanders linearly with time."""

    name = "force_drift"
    direction: np.ndarray
    frame: str = "contact"

    @property
    def reading(self) -> str:
        """Frame in which the rate is constant."""
        return self.frame

    @property
    def rate(self) -> np.ndarray:
        """(C, 3) N/s, axes of the frame."""
        return 0.02 * self.magnitude * self.direction

    @property
    def parameters(self) -> dict[str, Quantity]:
        """True values by name."""
        return per_finger(self.rate, "rate", "N/s")

    def transduce(self, readings: Readings) -> Readings:
        """Add rate times the time since the start."""
        elapsed = (readings.time - readings.time[0])[:, None, None]
        return add_in_frame(readings, elapsed * self.rate, self.frame)

    @classmethod
    def draw(cls, rng: np.random.Generator, magnitude: float, scenario: Scenario) -> ForceDrift:
        """Any direction on one or all fingers."""
        return cls(magnitude, draw_affected(rng)[:, None] * _unit_rows(rng), draw_frame(rng))


@dataclass(frozen=True)
class ForceScale(HiddenEffect):
    """The gain of some sensors is wrong."""

    name = "force_scale"
    weight: np.ndarray

    @property
    def excess(self) -> np.ndarray:
        """(C,) gain minus one."""
        return 0.1 * self.magnitude * self.weight

    @property
    def parameters(self) -> dict[str, Quantity]:
        """True values by name."""
        return per_finger(self.excess, "gain_error", "")

    @property
    def maximal_magnitude(self) -> float:
        """A gain stays positive."""
        return 9.0

    def transduce(self, readings: Readings) -> Readings:
        """Multiply the force."""
        return dataclasses.replace(readings, force=readings.force * (1 + self.excess[:, None]))

    @classmethod
    def draw(cls, rng: np.random.Generator, magnitude: float, scenario: Scenario) -> ForceScale:
        """One finger, or all by different amounts of either sign."""
        sign = rng.choice([-1.0, 1.0], size=len(FINGERS))
        return cls(magnitude, draw_affected(rng) * sign)


@dataclass(frozen=True)
class SensorRotation(HiddenEffect):
    """The sensor is mounted askew: it reports the force in axes that are turned."""

    name = "sensor_rotation"
    axis: np.ndarray

    @property
    def rotation_vector(self) -> np.ndarray:
        """(C, 3) rad, sensor axes."""
        return np.radians(5.0) * self.magnitude * self.axis

    @property
    def parameters(self) -> dict[str, Quantity]:
        """True values by name."""
        return per_finger(self.rotation_vector, "rotation", "rad")

    @property
    def maximal_magnitude(self) -> float:
        """At most 90 degrees."""
        return 18.0

    def transduce(self, readings: Readings) -> Readings:
        """Turn each finger's force."""
        turn = Rotation.from_rotvec(self.rotation_vector).as_matrix()
        return dataclasses.replace(readings, force=np.einsum("cij,ncj->nci", turn, readings.force))

    @classmethod
    def draw(cls, rng: np.random.Generator, magnitude: float, scenario: Scenario) -> SensorRotation:
        """Any axis on one or all fingers."""
        return cls(magnitude, draw_affected(rng)[:, None] * _unit_rows(rng))


@dataclass(frozen=True)
class SensorLag(HiddenEffect):
    """The force sensors answer with a first-order lag in their own axes."""

    name = "sensor_lag"
    frame: str = "contact"

    @property
    def reading(self) -> str:
        """Frame in which the force lags."""
        return self.frame

    @property
    def time_constant(self) -> float:
        """Time constant in s."""
        return 0.02 * self.magnitude

    @property
    def parameters(self) -> dict[str, Quantity]:
        """True values by name."""
        return {"time_constant": Quantity(self.time_constant, "s")}

    def transduce(self, readings: Readings) -> Readings:
        """Filter the force that the skin feels."""
        turn = to_frame(readings, self.frame)
        force = np.einsum("ncij,ncj->nci", turn, readings.force)
        late = low_pass(force, self.time_constant, readings.period)
        return dataclasses.replace(readings, force=np.einsum("ncji,ncj->nci", turn, late))

    @classmethod
    def draw(cls, rng: np.random.Generator, magnitude: float, scenario: Scenario) -> SensorLag:
        """Sensors that turn with the finger or keep their attitude to the object."""
        return cls(magnitude, draw_frame(rng))


@dataclass(frozen=True)
class TimeOffset(HiddenEffect):
    """The hand's clock differs from the clock of the object poses by a constant."""

    name = "time_offset"
    sign: float
    late: str

    @property
    def reading(self) -> str:
        """What is on the other clock."""
        return self.late

    @property
    def delay(self) -> float:
        """Stamp of the forces minus the time of the forces, in s."""
        return 0.01 * self.sign * self.magnitude

    @property
    def parameters(self) -> dict[str, Quantity]:
        """True values by name."""
        return {"offset": Quantity(self.delay, "s")}

    def transduce(self, readings: Readings) -> Readings:
        """Stamp the forces late or early, alone or with the contact poses.

        Where only the sensor is late, its old force is turned into the world by the pose of now.
        """
        if self.late == "sensor":
            then = np.clip(readings.time - self.delay, readings.time[0], readings.time[-1])
            old = CubicSpline(readings.time, readings.force, axis=0)(then)
            return dataclasses.replace(readings, force=old)
        contact_delay = readings.contact_delay + self.delay * (self.late == "contacts")
        return dataclasses.replace(
            readings, force_delay=readings.force_delay + self.delay, contact_delay=contact_delay
        )

    @classmethod
    def draw(cls, rng: np.random.Generator, magnitude: float, scenario: Scenario) -> TimeOffset:
        """Late or early; the forces, all of the contacts, or the sensors in the fingertips."""
        late = str(rng.choice(["forces", "contacts", "sensor"]))
        return cls(magnitude, float(rng.choice([-1.0, 1.0])), late)


def low_pass(signal: np.ndarray, time_constant: float, period: float) -> np.ndarray:
    """First-order lag of a signal along axis 0, exact for linear interpolation between samples."""
    if time_constant <= 0:
        return signal
    decay = np.exp(-period / time_constant)
    mean = (1 - decay) * time_constant / period
    newer, older = 1 - mean, mean - decay
    start = signal[:1] - newer * signal[:1]
    return lfilter([newer, older], [1, -decay], signal, axis=0, zi=start)[0]


def _unit_rows(rng: np.random.Generator) -> np.ndarray:
    rows = rng.normal(size=(len(FINGERS), 3))
    return rows / np.linalg.norm(rows, axis=1, keepdims=True)
