"""Things that move inside the object: a rotor, a sloshing mass."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from tactile_dynamics_ros.core.contact.wrench_samples import WrenchSamples
from tactile_dynamics_ros.core.effects.effect import Effect, EffectParameter, LinearEffect
from tactile_dynamics_ros.core.effects.filters import (
    integrate_linear,
    sample_period,
    uniform_segments,
)
from tactile_dynamics_ros.core.effects.geometry import (
    body_from_world,
    force_at,
    force_columns,
    point_columns,
    to_body,
    torque_columns,
    vector_parameters,
)
from tactile_dynamics_ros.core.effects.registry import register_effect
from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.rigid_body.rotation import skew

Array = NDArray[np.float64]

_SCREENED_HZ = (0.5, 0.7, 1.0, 1.4, 1.9, 2.6, 3.5, 4.8, 6.5)
_SCREENED_DAMPING = 0.1
_SLOWEST_HZ = 0.2
_LEAST_DAMPING = 0.003


@register_effect
class SpinningRotor(LinearEffect):
    """Gyroscopic torque of an internal angular momentum h, fixed in the body."""

    name = "spinning_rotor"
    family = "internal"
    formula = "tau = -omega x h"
    looks_like = (
        "A torque residual at right angles to the angular velocity that changes sign with it."
    )
    sentence = "something spins inside the object and resists being turned"
    remedy = "Stop the motor or fan inside the object, or add it to the model."

    def parameters(self, samples: WrenchSamples) -> tuple[EffectParameter, ...]:
        """Angular momentum h (3)."""
        unit, text = "kg m^2/s", "angular momentum, body frame"
        return vector_parameters("h", unit, 0.1, text, 0.008)

    def jacobian(self, samples: WrenchSamples, inertia: Array, theta: Array) -> Array:
        """Columns [-skew(omega), 0]."""
        return torque_columns(-skew(samples.angular_velocity))


@dataclass(frozen=True)
class _Response:
    """Acceleration u'' of the mass relative to its rest point, world axes, with derivatives.

    Attributes:
        value: (N, 3); by_hz: (N, 3); by_damping: (N, 3); by_point: (N, 3, 3).
    """

    value: Array
    by_hz: Array
    by_damping: Array
    by_point: Array


@register_effect
class SloshingMass(Effect):
    """A point mass on an isotropic internal spring-damper about a rest point r of the body.

    With u the displacement from the rest point q = p_WO + R_WO r, world axes, w_n = 2 pi f_n:
    u'' + 2 z w_n (u' - omega x u) + w_n^2 u = g - q''; what the rigid model (which holds the mass
    at rest) lacks is the force -m_s u'' at r.
    """

    name = "sloshing_mass"
    family = "internal"
    formula = (
        "f = -m_s u'' at r; u'' + 2 zeta w_n (u' - omega x u) + w_n^2 u = g - q'', w_n = 2 pi f_n"
    )
    looks_like = (
        "A force residual that rings at one frequency after every change of acceleration or tilt."
    )
    sentence = "part of the load swings inside the object"
    remedy = "Fill or empty the container, fix the loose part, or move more smoothly."

    def __init__(
        self, unsettled: bool = False, screened_hz: tuple[float, ...] = _SCREENED_HZ
    ) -> None:
        """Choose the state of the spring at the first sample.

        Args:
            unsettled: the spring starts unstretched; otherwise it hangs at rest.
            screened_hz: natural frequencies tried before a refit.
        """
        self.unsettled = unsettled
        self.screened_hz = screened_hz

    @property
    def variant(self) -> str:
        """Empty, or `unsettled`."""
        return "unsettled" if self.unsettled else ""

    def with_variant(self, variant: str) -> Effect:
        """`unsettled`."""
        if variant != "unsettled":
            raise BadInputError(f"effect '{self.name}' has no variant '{variant}': unsettled")
        return SloshingMass(unsettled=True)

    def variants(self, samples: WrenchSamples) -> tuple[Effect, ...]:
        """Hanging at rest, or unstretched, at the first sample."""
        return (SloshingMass(), SloshingMass(unsettled=True))

    def restrictions(self, samples: WrenchSamples) -> tuple[tuple[Effect, tuple[int, ...]], ...]:
        """One screened frequency each."""
        if len(self.screened_hz) == 1:
            return ()
        return tuple(
            (SloshingMass(self.unsettled, (hz,)), tuple(range(4 * i, 4 * i + 4)))
            for i, hz in enumerate(self.screened_hz)
        )

    def parameters(self, samples: WrenchSamples) -> tuple[EffectParameter, ...]:
        """Mass, natural frequency, damping ratio, rest point (3)."""
        return (
            EffectParameter("m_s", "kg", 0.5, "moving mass", 0.05),
            EffectParameter("f_n", "Hz", 10.0, "natural frequency", 2.0),
            EffectParameter("zeta", "", 1.0, "damping ratio", 0.1),
            *vector_parameters("r", "m", 0.1, "rest point, body frame", 0.02),
        )

    def wrench(self, samples: WrenchSamples, inertia: Array, theta: Array) -> Array:
        """Force -m_s u'' at r."""
        response = self._respond(samples, theta, derivatives=False)
        return force_at(theta[3:], -theta[0] * to_body(samples, response.value))

    def jacobian(self, samples: WrenchSamples, inertia: Array, theta: Array) -> Array:
        """By mass, frequency, damping and rest point."""
        mass, point = theta[0], theta[3:]
        response = self._respond(samples, theta, derivatives=True)
        unit_force = -to_body(samples, response.value)
        shape = [-mass * to_body(samples, d) for d in (response.by_hz, response.by_damping)]
        by_point = force_columns(point, -mass * body_from_world(samples) @ response.by_point)
        by_point = by_point + point_columns(mass * unit_force)
        columns = [force_at(point, f)[..., None] for f in (unit_force, *shape)]
        return np.concatenate([*columns, by_point], axis=2)

    def screening_basis(self, samples: WrenchSamples, inertia: Array) -> Array:
        """Responses of an filter bank over natural frequencies: force and arms."""
        acceleration = samples.acceleration - samples.gravity
        columns = []
        for hz in self.screened_hz:
            response = _filtered(samples.time, -acceleration, hz, self.unsettled)
            force = -to_body(samples, response)
            arms = torque_columns(-skew(force))
            columns += [force_at(np.zeros(3), force)[..., None], arms]
        return np.concatenate(columns, axis=2)

    def initial_guess(
        self, samples: WrenchSamples, inertia: Array, coefficients: Array, residual: Array
    ) -> Array:
        """The screened frequency with the largest mass; its point from the torques."""
        table = coefficients.reshape(-1, 4)
        best = int(np.argmax(table[:, 0]))
        mass = max(float(table[best, 0]), 1e-3)
        point = np.clip(table[best, 1:] / mass, -0.05, 0.05)
        return np.concatenate([[mass, self.screened_hz[best], _SCREENED_DAMPING], point])

    def _respond(self, samples: WrenchSamples, theta: Array, derivatives: bool) -> _Response:
        hz = max(float(theta[1]), _SLOWEST_HZ)
        damping = max(float(theta[2]), _LEAST_DAMPING)
        parts = [
            self._respond_segment(samples, part, 2.0 * np.pi * hz, damping, theta[3:], derivatives)
            for part in uniform_segments(samples.time)
        ]
        stacked = np.concatenate(parts)
        return _Response(
            stacked[:, :, 0],
            2.0 * np.pi * stacked[:, :, 1] * float(theta[1] > _SLOWEST_HZ),
            stacked[:, :, 2] * float(theta[2] > _LEAST_DAMPING),
            stacked[:, :, 3:],
        )

    def _respond_segment(
        self,
        samples: WrenchSamples,
        part: slice,
        omega_n: float,
        damping: float,
        point: Array,
        derivatives: bool,
    ) -> Array:
        """Columns [u'', d/dw_n, d/dzeta, d/dr (3)] of one gap-free stretch, (n, 3, 6)."""
        spin = samples.rotation[part] @ samples.angular_velocity[part][..., None]
        system = _system(spin[..., 0], omega_n, damping)
        turn = samples.rotation[part] @ (
            skew(samples.angular_acceleration[part])
            + skew(samples.angular_velocity[part]) @ skew(samples.angular_velocity[part])
        )
        offset = (turn @ point[:, None])[..., 0]
        drive = (samples.gravity - samples.acceleration[part] - offset)[..., None]
        if derivatives:
            drive = np.concatenate([drive, -turn], axis=2)
        middle = 0.5 * (system[1:] + system[:-1])
        transition, step = _discretise(middle, sample_period(samples.time))
        states = integrate_linear(
            transition, _trapezoid(step, drive), self._start(drive[0], omega_n)
        )
        second = _output(system, states, drive)
        if not derivatives:
            blank = np.zeros((*second.shape[:2], 5))
            return np.concatenate([second, blank], axis=2)
        shape = self._shape_derivatives(
            system, transition, step, states[..., :1], spin, omega_n, damping, drive[0]
        )
        return np.concatenate([second[..., :1], shape, second[..., 1:]], axis=2)

    def _shape_derivatives(
        self,
        system: Array,
        transition: Array,
        step: Array,
        states: Array,
        spin: Array,
        omega_n: float,
        damping: float,
        first_drive: Array,
    ) -> Array:
        """Derivatives of u'' by w_n and zeta, (n, 3, 2)."""
        displacement, velocity = states[:, :3], states[:, 3:]
        relative = velocity - skew(spin[..., 0]) @ displacement
        drive = np.concatenate(
            [
                -2.0 * damping * relative - 2.0 * omega_n * displacement,
                -2.0 * omega_n * relative,
            ],
            axis=2,
        )
        start = np.zeros((6, 2))
        if not self.unsettled:
            start[:3, 0] = -2.0 * first_drive[:, 0] / omega_n**3
        found = integrate_linear(transition, _trapezoid(step, drive), start)
        return _output(system, found, drive)

    def _start(self, first_drive: Array, omega_n: float) -> Array:
        start = np.zeros((6, first_drive.shape[1]))
        if not self.unsettled:
            start[:3] = first_drive / omega_n**2
        return start


def _system(spin: Array, omega_n: float, damping: float) -> Array:
    """State matrices (n, 6, 6) of [u, u'] with the damper turning with the body."""
    matrix = np.zeros((len(spin), 6, 6))
    matrix[:, :3, 3:] = np.eye(3)
    matrix[:, 3:, :3] = -(omega_n**2) * np.eye(3) + 2.0 * damping * omega_n * skew(spin)
    matrix[:, 3:, 3:] = -2.0 * damping * omega_n * np.eye(3)
    return matrix


def _discretise(matrix: Array, period: float) -> tuple[Array, Array]:
    """Transition exp(M h) and its integral over one step for matrices (n, S, S), by series."""
    scaled = matrix * period
    power = np.broadcast_to(np.eye(matrix.shape[-1]), scaled.shape)
    transition, step = power.copy(), power.copy()
    factorial = 1.0
    for order in range(1, 9):
        power = power @ scaled
        factorial *= order
        transition = transition + power / factorial
        step = step + power / (factorial * (order + 1))
    return transition, step * period


def _trapezoid(step: Array, drive: Array) -> Array:
    """Input of one step for the mean drive, (n - 1, 6, m)."""
    mean = 0.5 * (drive[1:] + drive[:-1])
    return np.asarray(step[:, :, 3:] @ mean)


def _output(system: Array, states: Array, drive: Array) -> Array:
    """Accelerations u'' (n, 3, m) of states [u, u']."""
    return np.asarray(system[:, 3:] @ states + drive)


def _filtered(time: Array, drive: Array, hz: float, unsettled: bool) -> Array:
    """Accelerations u'' (N, 3) with the damper fixed in the world.

    Args:
        time: (N,) s.
        drive: (N, 3) specific force on the mass, m/s^2.
        hz: natural frequency.
        unsettled: start unstretched rather than hanging.
    """
    period = sample_period(time)
    omega = 2.0 * np.pi * hz
    system = _system(np.zeros((2, 3)), omega, _SCREENED_DAMPING)[:, [0, 3]][:, :, [0, 3]]
    transition, step = (m[0] for m in _discretise(system[:1], period))
    trace, determinant = float(np.trace(transition)), float(np.linalg.det(transition))
    denominator = [1.0, -trace, determinant]
    gain = 0.5 * step[:, 1]
    cofactor = np.array(
        [[-transition[1, 1], transition[0, 1]], [transition[1, 0], -transition[0, 0]]]
    )
    response = np.empty_like(drive)
    for part in uniform_segments(time):
        u = drive[part] - (0.0 if unsettled else drive[part][:1])
        pair = u + np.concatenate([np.zeros_like(u[:1]), u[:-1]])
        numerators = np.stack([gain, cofactor @ gain], axis=1)
        states = [lfilter(n, denominator, pair, axis=0) for n in numerators]
        response[part] = u - omega**2 * states[0] - 2.0 * _SCREENED_DAMPING * omega * states[1]
    return response
