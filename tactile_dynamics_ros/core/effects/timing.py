"""Errors of time: lag of the force sensors, clocks that differ."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from tactile_dynamics_ros.core.contact.wrench_samples import WrenchSamples
from tactile_dynamics_ros.core.effects.effect import Effect, EffectParameter
from tactile_dynamics_ros.core.effects.filters import first_order_lag
from tactile_dynamics_ros.core.effects.gravity import load_regressor
from tactile_dynamics_ros.core.effects.registry import register_effect
from tactile_dynamics_ros.core.errors import BadInputError

Array = NDArray[np.float64]

_SHORTEST_LAG = 2e-3
_LONGEST_SHIFT = 0.3


class _ReadingEffect(Effect):
    """An effect of one parameter whose name leaves open in which frame it happens."""

    readings: ClassVar[tuple[str, ...]] = ()

    def __init__(self, reading: str = "") -> None:
        """Choose the reading.

        Args:
            reading: one of `readings`; the first by default.
        """
        self.reading = reading or self.readings[0]

    @property
    def variant(self) -> str:
        """The reading, empty for the default."""
        return "" if self.reading == self.readings[0] else self.reading

    def with_variant(self, variant: str) -> Effect:
        """Return the reading of that name."""
        if variant not in self.readings:
            raise BadInputError(
                f"effect '{self.name}' has no variant '{variant}': {', '.join(self.readings)}"
            )
        return type(self)(variant)

    def variants(self, samples: WrenchSamples) -> tuple[Effect, ...]:
        """All readings."""
        return tuple(type(self)(reading) for reading in self.readings)


@register_effect
class SensorLag(_ReadingEffect):
    """First-order lag of the measured forces, in the sensor or in the world frame.

    Sensor frame: the measured wrench is the lagged Y phi, so Delta = Y phi - L Y phi with L the
    lag. World frame: R turns while the sensor responds; measured z obeys
    z + tau (z' + w x z) = true, so Delta = Y phi - L [Y phi - tau W (w x z)].
    """

    name = "sensor_lag"
    family = "timing"
    formula = "tau f' + f = true force, f the measured force (sensor or world frame)"
    looks_like = "A residual that follows the change of the forces: sensors answer late."
    sentence = "the force sensors answer with a lag"
    remedy = "Reduce the filtering of the sensors, move more slowly, or add the lag to the model."
    readings = ("sensor", "world")

    def parameters(self, samples: WrenchSamples) -> tuple[EffectParameter, ...]:
        """The time constant."""
        return (EffectParameter("tau", "s", 0.2, "time constant", 0.04),)

    def wrench(self, samples: WrenchSamples, inertia: Array, theta: Array) -> Array:
        """Delta; odd and linear below a lag of 2 ms."""
        used, share = _usable_lag(float(theta[0]))
        signal, turned = self._signals(samples, inertia)
        lagged, _ = first_order_lag(samples.time, np.stack([signal, turned], -1), used)
        return share * (signal - lagged[..., 0] + used * lagged[..., 1])

    def jacobian(self, samples: WrenchSamples, inertia: Array, theta: Array) -> Array:
        """By tau."""
        used, share = _usable_lag(float(theta[0]))
        signal, turned = self._signals(samples, inertia)
        lagged, change = first_order_lag(samples.time, np.stack([signal, turned], -1), used)
        if share != 1.0:
            return ((signal - lagged[..., 0]) / used + lagged[..., 1])[..., None]
        return (lagged[..., 1] + used * change[..., 1] - change[..., 0])[..., None]

    def inertia_jacobian(self, samples: WrenchSamples, inertia: Array, theta: Array) -> Array:
        """Y - L Y."""
        used, share = _usable_lag(float(theta[0]))
        matrix = load_regressor(samples)
        return share * (matrix - first_order_lag(samples.time, matrix, used)[0])

    def _signals(self, samples: WrenchSamples, inertia: Array) -> tuple[Array, Array]:
        """Y phi and W (w x z), both (N, 6)."""
        signal = load_regressor(samples) @ inertia
        if self.reading == "sensor":
            return signal, np.zeros_like(signal)
        spin = samples.angular_velocity[:, None]
        force = np.cross(spin, samples.contact_force)
        torque = np.cross(samples.contact_point, force) + np.cross(spin, samples.contact_torque)
        return signal, np.concatenate([torque.sum(axis=1), force.sum(axis=1)], axis=1)


def _usable_lag(tau: float) -> tuple[float, float]:
    """Time constant that the filter uses and the share of its effect that counts."""
    if tau >= _SHORTEST_LAG:
        return tau, 1.0
    return _SHORTEST_LAG, tau / _SHORTEST_LAG


@register_effect
class TimeOffset(_ReadingEffect):
    """Forces stamped late by a constant: measured f(t) = f(t - offset).

    `force`: world-frame forces are late, contact poses are not. `contact`: forces and contact
    poses are late against the object's pose. `sensor`: forces are late in the sensor frame.
    """

    name = "time_offset"
    family = "timing"
    formula = "measured forces at t belong to the motion at t - offset"
    looks_like = "A residual that follows the rate of change of the predicted wrench, like a delay."
    sentence = "forces and poses are stamped by clocks that differ"
    remedy = "Synchronise the clocks, or add the offset to the model."
    readings = ("force", "contact", "sensor")

    def parameters(self, samples: WrenchSamples) -> tuple[EffectParameter, ...]:
        """The offset, positive where forces come late."""
        return (EffectParameter("offset", "s", 0.2, "lateness of the forces", 0.03),)

    def wrench(self, samples: WrenchSamples, inertia: Array, theta: Array) -> Array:
        """Change of Y phi and of the body-frame measured wrench when motion is read earlier."""
        then = _Shifted(samples, float(theta[0]))
        change = (load_regressor(samples) - then.regressor) @ inertia
        if self.reading == "sensor":
            return np.asarray(change)
        return np.asarray(change + self._measured(samples, then) - samples.measured_wrench)

    def jacobian(self, samples: WrenchSamples, inertia: Array, theta: Array) -> Array:
        """By the offset."""
        then = _Shifted(samples, float(theta[0]))
        change = -then.regressor_change @ inertia
        if self.reading != "sensor":
            change = change + self._measured_change(samples, then)
        return np.asarray(change[..., None])

    def inertia_jacobian(self, samples: WrenchSamples, inertia: Array, theta: Array) -> Array:
        """Y(t) - Y(t - offset)."""
        return load_regressor(samples) - _Shifted(samples, float(theta[0])).regressor

    def _measured(self, samples: WrenchSamples, then: _Shifted) -> Array:
        """Contact wrench (N, 6) with the forces of now in the body frame of then."""
        point, _ = self._points(samples, then)
        force, torque = then.turn(samples.contact_force), then.turn(samples.contact_torque)
        moment = np.cross(point, force) + torque
        return np.concatenate([moment.sum(axis=1), force.sum(axis=1)], axis=1)

    def _measured_change(self, samples: WrenchSamples, then: _Shifted) -> Array:
        """Derivative of `_measured` by the offset."""
        point, point_change = self._points(samples, then)
        force = then.turn(samples.contact_force)
        force_change = then.turn_change(samples.contact_force)
        moment = np.cross(point_change, force) + np.cross(point, force_change)
        moment = moment + then.turn_change(samples.contact_torque)
        return np.concatenate([moment.sum(axis=1), force_change.sum(axis=1)], axis=1)

    def _points(self, samples: WrenchSamples, then: _Shifted) -> tuple[Array, Array]:
        """Contact points in the body frame of then and their derivative by the offset."""
        if self.reading == "force":
            return then.point, then.point_change
        shift = np.einsum("nij,nj->ni", then.to_body, samples.position - then.position)
        moved = then.turn(samples.contact_point) + shift[:, None]
        shift_change = np.einsum("nij,nj->ni", then.to_body_change, samples.position) - (
            then.origin_change
        )
        return moved, then.turn_change(samples.contact_point) + shift_change[:, None]


class _Shifted:
    """Motion of the object at t - offset on a spline, with derivatives by the offset."""

    def __init__(self, samples: WrenchSamples, offset: float) -> None:
        offset = float(np.clip(offset, -_LONGEST_SHIFT, _LONGEST_SHIFT))
        matrix = load_regressor(samples)
        self.now = samples.rotation
        then = samples.time - offset

        def read(values: Array) -> tuple[Array, Array]:
            spline = CubicSpline(samples.time, values)
            return spline(then), -spline(then, 1)

        self.regressor, self.regressor_change = read(matrix)
        rotation, rotation_change = read(samples.rotation)
        self.to_body = np.swapaxes(rotation, 1, 2)
        self.to_body_change = np.swapaxes(rotation_change, 1, 2)
        self.position, position_change = read(samples.position)
        self.point, self.point_change = read(samples.contact_point)
        self.origin_change = np.einsum("nij,nj->ni", self.to_body_change, self.position) + (
            np.einsum("nij,nj->ni", self.to_body, position_change)
        )

    def turn(self, vectors: Array) -> Array:
        """Vectors (N, C, 3) of the body frame of now, in the body frame of then."""
        return np.asarray((self.to_body @ self.now)[:, None] @ vectors[..., None])[..., 0]

    def turn_change(self, vectors: Array) -> Array:
        """Derivative of `turn` by the offset."""
        return np.asarray((self.to_body_change @ self.now)[:, None] @ vectors[..., None])[..., 0]
