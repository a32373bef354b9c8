"""Errors of time: lag of the force sensors, clocks that differ."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from scipy.interpolate import CubicSpline

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.contact.wrench_samples import (
    WrenchSamples,
    latest_per_samples,
    once_per_motion,
)
from tactile_dynamics_ros.core.effects.effect import Effect
from tactile_dynamics_ros.core.effects.filters import FirstOrderLag
from tactile_dynamics_ros.core.effects.geometry import contact_point_rate, contact_rate
from tactile_dynamics_ros.core.effects.held.gravity import load_regressor
from tactile_dynamics_ros.core.effects.parameter import EffectParameter
from tactile_dynamics_ros.core.effects.registry import register_effect
from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.streams.streams import nearest_samples

_SHORTEST_LAG = 2e-3
"""Time constant of a lag, s, below which it is linear: its exponential would decay within a sample.
There the law is linear to 1e-4, at half and twice the value as well."""
_LONGEST_SHIFT = 0.5
"""Largest offset of clocks that is evaluated, s; delays beyond a quarter of a second are not found,
since the motion is another by then. It bounds how much of a recording's ends is lost. Longer loses
more of them, below a quarter of a second offsets that are found would be cut."""
_SHIFTS_KEPT = 3
"""Shifted motions that are kept: those of the present offset and of the two last tries of a fit,
which all readings share. Fewer are computed again for each reading; more only take memory."""


class _ReadingEffect(Effect):
    """An effect of one parameter whose name leaves open in which frame it happens.

    Attributes:
        reading_names: the frames, the default first.
        nodes: values theta_k whose Delta(theta_k) / theta_k make the screening basis with the
            slope at zero: far from zero Delta is not linear, but near a mixture of them.
    """

    external = False
    delays = True
    reading_names: ClassVar[tuple[str, ...]] = ()
    nodes: ClassVar[tuple[float, ...]] = ()

    def __init__(self, reading: str = "") -> None:
        """Choose the reading.

        Args:
            reading: one of `reading_names`; the first by default.
        """
        self.frame = reading or self.reading_names[0]
        self.reading = "" if self.frame == self.reading_names[0] else self.frame

    def with_reading(self, reading: str) -> Effect:
        """Return the reading of that name."""
        if reading not in self.reading_names:
            raise BadInputError(
                f"effect '{self.name}' has no reading '{reading}': {', '.join(self.reading_names)}"
            )
        return type(self)(reading)

    def readings(self, samples: WrenchSamples) -> tuple[Effect, ...]:
        """All readings."""
        return tuple(type(self)(reading) for reading in self.reading_names)

    def screening_basis(self, samples: WrenchSamples, inertia: Array) -> Array:
        """Slope at zero and secants to the nodes."""
        slope = self.jacobian(samples, inertia, self.zero(samples))
        secants = [self.wrench(samples, inertia, np.array([node])) / node for node in self.nodes]
        return np.concatenate([slope, np.stack(secants, axis=2)], axis=2)

    def initial_guess(
        self, samples: WrenchSamples, inertia: Array, coefficients: Array, residual: Array
    ) -> Array:
        """Every column is the effect per unit of its parameter, so that the sum counts."""
        return np.array([np.sum(coefficients)])


@register_effect
class SensorLag(_ReadingEffect):
    """First-order lag of the measured forces z_i in the body, contact or world frame.

    In a frame that turns with w_F, tau (z' + (w - w_F) x z) + z = true force (body axes), so the
    measured wrench W z is L [S - tau Q] with L the lag, S = Y phi - w_ext what the contacts bear
    (w_ext other external wrenches), Q = sum W_i ((w - w_F) x z_i) - [sum p_i' x z_i, 0], and
    Delta = S - L [S - tau Q]. Forces that lead (tau < 0) are no lag: Delta = 0 there.
    """

    name = "sensor_lag"
    family = "timing"
    formula = "tau f' + f = true force, f the measured force (body, contact or world frame)"
    looks_like = "A residual that follows the change of the forces: sensors answer late."
    sentence = "the force sensors answer with a lag"
    remedy = "Reduce the filtering of the sensors, move more slowly, or add the lag to the model."
    reading_names = ("body", "sensor", "world")
    nodes = (0.05, 0.2)

    def parameters(self, samples: WrenchSamples) -> tuple[EffectParameter, ...]:
        """The time constant."""
        return (EffectParameter("tau", "s", 0.2, "time constant", 0.04),)

    def wrench(self, samples: WrenchSamples, inertia: Array, theta: Array) -> Array:
        """Delta; linear below a lag of 2 ms."""
        used, share = _usable_lag(float(theta[0]))
        signal, lag = _late_signals(samples, self.frame, inertia.tobytes(), used)
        return np.asarray(share * (signal - lag.response[..., 0] + used * lag.response[..., 1]))

    def jacobian(self, samples: WrenchSamples, inertia: Array, theta: Array) -> Array:
        """By tau."""
        used, share = _usable_lag(float(theta[0]))
        signal, lag = _late_signals(samples, self.frame, inertia.tobytes(), used)
        late = lag.response
        if share != 1.0:
            return np.asarray((signal - late[..., 0]) / used + late[..., 1])[..., None]
        by_tau = late[..., 1] + used * lag.change[..., 1] - lag.change[..., 0]
        return np.asarray(by_tau)[..., None]

    def inertia_jacobian(self, samples: WrenchSamples, inertia: Array, theta: Array) -> Array:
        """Y - L Y."""
        used, share = _usable_lag(float(theta[0]))
        matrix = load_regressor(samples)
        return np.asarray(share * (matrix - FirstOrderLag(samples.time, matrix, used).response))

    def delayed(self, samples: WrenchSamples, theta: Array, columns: Array) -> Array:
        """L of the columns."""
        used, share = _usable_lag(float(theta[0]))
        late = FirstOrderLag(samples.time, columns, used).response
        return np.asarray(columns + share * (late - columns))

    def signals(self, samples: WrenchSamples, inertia: Array) -> tuple[Array, Array]:
        """S and Q, both (N, 6)."""
        force = np.cross(self._turning(samples), samples.contact_force)
        torque = np.cross(samples.contact_point, force)
        torque = torque + np.cross(self._turning(samples), samples.contact_torque)
        torque = torque - np.cross(contact_point_rate(samples), samples.contact_force)
        turned = np.concatenate([torque.sum(axis=1), force.sum(axis=1)], axis=1)
        return _borne(samples, inertia), turned

    def _turning(self, samples: WrenchSamples) -> Array:
        """Angular velocity of the body relative to the frame of the lag, (N, C, 3)."""
        spin = np.broadcast_to(samples.angular_velocity[:, None], samples.contact_force.shape)
        if self.frame == "body":
            return np.zeros_like(spin)
        return spin - contact_rate(samples) if self.frame == "sensor" else np.asarray(spin)


@latest_per_samples
def _late_signals(
    samples: WrenchSamples, frame: str, parameters: bytes, tau: float
) -> tuple[Array, FirstOrderLag]:
    """S (N, 6), and the lag of [S, Q] (N, 6, 2), for phi given as bytes."""
    signal, turned = SensorLag(frame).signals(samples, np.frombuffer(parameters))
    return signal, FirstOrderLag(samples.time, np.stack([signal, turned], -1), tau)


def _borne(samples: WrenchSamples, inertia: Array) -> Array:
    """Wrench (N, 6) that the contacts bear: that of the load without known external ones."""
    load = np.asarray(load_regressor(samples) @ inertia)
    return load if samples.external is None else load - samples.external


def _usable_lag(tau: float) -> tuple[float, float]:
    """Time constant that the filter uses and the share of its effect that counts, 0 to 1."""
    if tau >= _SHORTEST_LAG:
        return tau, 1.0
    return _SHORTEST_LAG, max(tau, 0.0) / _SHORTEST_LAG


@register_effect
class TimeOffset(_ReadingEffect):
    """Forces stamped late by a constant: measured f(t) = f(t - offset).

    `force`: world-frame forces are late, contact poses are not. `contact`: forces and contact
    poses are late against the object's pose. `body` and `sensor`: forces are late in the body or
    contact frame and are turned into the world by the pose of now.
    """

    name = "time_offset"
    family = "timing"
    formula = "measured forces at t belong to the motion at t - offset"
    looks_like = "A residual that follows the rate of change of the predicted wrench, like a delay."
    sentence = "forces and poses are stamped by clocks that differ"
    remedy = "Synchronise the clocks, or add the offset to the model."
    reading_names = ("force", "contact", "body", "sensor")
    nodes = (-0.05, 0.05)

    def parameters(self, samples: WrenchSamples) -> tuple[EffectParameter, ...]:
        """The offset, positive where forces come late."""
        return (EffectParameter("offset", "s", 0.2, "lateness of the forces", 0.03),)

    def whole_samples_late(self, theta: Array, period: float) -> tuple[int, Array]:
        """The offset, rounded."""
        count = round(float(theta[0]) / period)
        return count, np.array([count * period])

    def wrench(self, samples: WrenchSamples, inertia: Array, theta: Array) -> Array:
        """Change of Y phi and of the body-frame measured wrench when motion is read earlier.

        Readings of a motion that is not recorded, as in gaps, tell nothing: they count as right.
        """
        then = _shifted(samples, float(theta[0]))
        now = _borne(samples, inertia) - samples.measured_wrench
        return np.asarray(now + then.share[:, None] * self._excess(samples, then, inertia))

    def _excess(self, samples: WrenchSamples, then: _Shifted, inertia: Array) -> Array:
        """Measured wrench (N, 6) in the body frame of then, beyond what the contacts bore then."""
        excess = self._measured(samples, then) - then.regressor @ inertia
        return excess if samples.external is None else excess + then.at(samples, samples.external)

    def jacobian(self, samples: WrenchSamples, inertia: Array, theta: Array) -> Array:
        """By the offset."""
        then = _shifted(samples, float(theta[0]))
        change = self._measured_change(samples, then) - then.regressor_change @ inertia
        if samples.external is not None:
            change = change - then.at(samples, samples.external, 1)
        fading = then.share_change[:, None] * self._excess(samples, then, inertia)
        return np.asarray((then.share[:, None] * change + fading)[..., None])

    def inertia_jacobian(self, samples: WrenchSamples, inertia: Array, theta: Array) -> Array:
        """Y(t) - Y(t - offset); Y(t) where the motion at t - offset was not recorded."""
        then = _shifted(samples, float(theta[0]))
        return load_regressor(samples) - then.share[:, None, None] * then.regressor

    def delayed(self, samples: WrenchSamples, theta: Array, columns: Array) -> Array:
        """The columns of then; none where the motion at t - offset was not recorded."""
        then = _shifted(samples, float(theta[0]))
        share = then.share.reshape(-1, *[1] * (columns.ndim - 1))
        return np.asarray(share * then.at(samples, columns))

    def _measured(self, samples: WrenchSamples, then: _Shifted) -> Array:
        """Contact wrench (N, 6) with the forces of now in the body frame of then."""
        place = then.place(samples, self.frame)
        force, torque = place.turned(samples)
        moment = np.cross(place.point, force) + torque
        return np.concatenate([moment.sum(axis=1), force.sum(axis=1)], axis=1)

    def _measured_change(self, samples: WrenchSamples, then: _Shifted) -> Array:
        """Derivative of `_measured` by the offset."""
        place = then.place(samples, self.frame)
        force, _ = place.turned(samples)
        force_change, torque_change = place.turned_change(samples)
        moment = np.cross(place.point_change, force) + np.cross(place.point, force_change)
        moment = moment + torque_change
        return np.concatenate([moment.sum(axis=1), force_change.sum(axis=1)], axis=1)


def _apply(turn: Array, vectors: Array) -> Array:
    """Matrices (N, C, 3, 3) times vectors (N, C, 3)."""
    return np.asarray((turn @ vectors[..., None])[..., 0])


@once_per_motion
def _motion_spline(samples: WrenchSamples) -> CubicSpline:
    """Spline through all that moves: columns as in `_Shifted`."""
    parts = (
        load_regressor(samples),
        samples.rotation,
        samples.position,
        samples.contact_point,
        samples.contact_rotation,
    )
    count = len(samples.time)
    return CubicSpline(samples.time, np.concatenate([p.reshape(count, -1) for p in parts], axis=1))


@once_per_motion
def _latest_shifts(_: WrenchSamples) -> dict[float, _Shifted]:
    return {}


def _shifted(samples: WrenchSamples, offset: float) -> _Shifted:
    """The motion at t - offset; the latest ones are kept, so that readings share them."""
    kept = _latest_shifts(samples)
    found = kept.pop(offset, None) or _Shifted(samples, offset)
    kept[offset] = found
    if len(kept) > _SHIFTS_KEPT:
        kept.pop(next(iter(kept)), None)
    return found


@dataclass(frozen=True)
class _Place:
    """Where readings of now act in the body frame of then, with derivatives by the offset.

    Attributes:
        turn: (N, C or 1, 3, 3) from the body frame of now, or None where readings stay in it.
        point: (N, C, 3) of contact, m.
    """

    turn: Array | None
    turn_change: Array | None
    point: Array
    point_change: Array

    def turned(self, samples: WrenchSamples) -> tuple[Array, Array]:
        """Forces and torques (N, C, 3)."""
        if self.turn is None:
            return samples.contact_force, samples.contact_torque
        return _turned(self.turn, samples)

    def turned_change(self, samples: WrenchSamples) -> tuple[Array, Array]:
        """Derivative of `turned`."""
        if self.turn_change is None:
            return np.zeros_like(samples.contact_force), np.zeros_like(samples.contact_torque)
        return _turned(self.turn_change, samples)


def _turned(turn: Array, samples: WrenchSamples) -> tuple[Array, Array]:
    torque = samples.contact_torque
    return _apply(turn, samples.contact_force), _apply(turn, torque) if torque.any() else torque


class _Shifted:
    """Motion of the object at t - offset on a spline, with derivatives by the offset.

    Attributes:
        share: (N,) 1 where a sample at most one period from t - offset is recorded, fading to 0
            within one period more; its derivative share_change.
    """

    def __init__(self, samples: WrenchSamples, offset: float) -> None:
        offset = float(np.clip(offset, -_LONGEST_SHIFT, _LONGEST_SHIFT))
        spline, then = _motion_spline(samples), samples.time - offset
        self._time = then
        slope = 1.0 / float(np.median(np.diff(samples.time)))
        beyond = slope * (then - samples.time[nearest_samples(samples.time, then)])
        fade = np.clip(2.0 - np.abs(beyond), 0.0, 1.0)
        self.share = fade**2 * (3.0 - 2.0 * fade)
        self.share_change = 6.0 * fade * (1.0 - fade) * np.sign(beyond) * slope
        shapes = (
            (6, 10),
            (3, 3),
            (3,),
            samples.contact_point.shape[1:],
            samples.contact_rotation.shape[1:],
        )
        values, changes = _split(spline(then), shapes), _split(-spline(then, 1), shapes)
        self.regressor, rotation, self.position, self.point, self.contact_rotation = values
        (
            self.regressor_change,
            rotation_change,
            position_change,
            self.point_change,
            self.contact_rotation_change,
        ) = changes
        self.to_body = np.swapaxes(rotation, 1, 2)
        self.to_body_change = np.swapaxes(rotation_change, 1, 2)
        self.origin_change = np.einsum("nij,nj->ni", self.to_body_change, self.position) + (
            np.einsum("nij,nj->ni", self.to_body, position_change)
        )
        self._places: dict[str, _Place] = {}

    def at(self, samples: WrenchSamples, values: Array, order: int = 0) -> Array:
        """Values (N, ...) of every instant, or their derivative in time, at t - offset."""
        return np.asarray(CubicSpline(samples.time, values)(self._time, order))

    def place(self, samples: WrenchSamples, frame: str) -> _Place:
        """Where the readings of a time offset act; `samples` of the same motion."""
        if frame not in self._places:
            turn, change = self._turn(samples, frame)
            point, point_change = self.point, self.point_change
            if frame == "contact":
                assert turn is not None and change is not None
                point, point_change = self._points(samples, turn, change)
            self._places[frame] = _Place(turn, change, point, point_change)
        return self._places[frame]

    def _turn(self, samples: WrenchSamples, frame: str) -> tuple[Array | None, Array | None]:
        """Rotation of readings into the body frame of then, and its derivative."""
        if frame == "body":
            return None, None
        if frame == "sensor":
            back = np.swapaxes(samples.contact_rotation, 2, 3)
            return self.contact_rotation @ back, self.contact_rotation_change @ back
        turn, change = self.to_body @ samples.rotation, self.to_body_change @ samples.rotation
        return turn[:, None], change[:, None]

    def _points(self, samples: WrenchSamples, turn: Array, change: Array) -> tuple[Array, Array]:
        """Contact points of now in the body frame of then, and their derivative."""
        shift = np.einsum("nij,nj->ni", self.to_body, samples.position - self.position)
        shift_change = np.einsum("nij,nj->ni", self.to_body_change, samples.position)
        shift_change = shift_change - self.origin_change
        moved = _apply(turn, samples.contact_point) + shift[:, None]
        return moved, _apply(change, samples.contact_point) + shift_change[:, None]


def _split(values: Array, shapes: Sequence[tuple[int, ...]]) -> list[Array]:
    """Columns (N, k) as arrays (N, *shape)."""
    ends = np.cumsum([np.prod(shape, dtype=int) for shape in shapes])
    parts = np.split(values, ends[:-1], axis=1)
    return [part.reshape(-1, *shape) for part, shape in zip(parts, shapes, strict=True)]
