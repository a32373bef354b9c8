"""Things that move inside the object: a rotor, a sloshing mass."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.contact.wrench_samples import WrenchSamples, latest_per_motion
from tactile_dynamics_ros.core.effects.effect import Effect, LinearEffect
from tactile_dynamics_ros.core.effects.filters import (
    discretise,
    evenly_filled,
    integrate_linear,
    local_cubic,
    pushed,
    spectral_peaks,
    stretches,
    taylor,
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
from tactile_dynamics_ros.core.effects.parameter import EffectParameter
from tactile_dynamics_ros.core.effects.registry import register_effect
from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.rigid_body.rotation import skew

_SCREENED_HZ = (0.5, 0.7, 1.0, 1.4, 1.9, 2.6, 3.5, 4.8, 6.5)
"""Natural frequencies that are tried before a refit, Hz, a factor of 1.35 apart: that is the width
of a resonance of damping 0.1 to 0.2. Between them (2.2 Hz, damping 0.1) a fifth of the energy
is left to the refit; with half as many a quarter, with twice as many a sixth at twice the cost."""
_SCREENED_DAMPING = 0.1
"""Damping ratio that is tried, and from which fits start. At 0.05 and 0.2 the family leaves up to
7 % of the energy more or less, of weakly and strongly damped masses alike."""
_RINGING_BAND = (0.5, 10.0)
"""Frequencies, Hz, of peaks of the residual that are tried: those of the screening and half as much
above, where water in a glass of 1 cm rings. Higher ones are vibrations of the robot."""
_RINGING_DAMPING = (0.005, 0.03)
"""Damping ratios that are tried there: of water, and of a part that is held loosely. A fit reaches
others within a factor of three from them."""
_PEAKS = 3
"""Peaks that are tried. The motion and its end make others beside that of the mass: of a glass of
water that a robot stops it was the first; one more costs a hundredth of a fit."""
_NO_RESIDUAL = 1e-12
"""Smallest norm that residuals are divided by, N and N m: below any sensor's resolution."""
_SLOWEST_HZ = 0.2
"""Lowest natural frequency that is evaluated, Hz, so that a fit that diverges stays finite: a
mass hangs g / w_n^2 below its rest point, 6 m at 0.2 Hz. The lowest that is tried is 0.5. Above 0.5
it would cut what is tried; lower lets such a fit go farther."""
_FASTEST_HZ = 15.0
"""Highest natural frequency that is evaluated, Hz, so that a fit that diverges stays within what
100 Hz show. The highest that is tried is 6.5. Below 6.5 it would cut what is tried; higher lets a
fit follow noise from sample to sample."""
_LEAST_DAMPING = 0.003
"""Smallest damping ratio that is evaluated: it rings for a minute at 1 Hz, longer than recordings
last; at zero and below it would ring for ever or grow. Larger: a mass that rings freely is given
too much damping."""
_MOST_DAMPING = 2.0
"""Largest damping ratio that is evaluated: far beyond critical, where mass and damper are a lag.
Lower cuts heavily damped masses short; higher lets fits wander where nothing changes."""
_STEP_DIGITS = 12
"""Decimals of steps in s by which they are told apart: those that differ by less than a picosecond
are the same but for rounding, and share a transition. More would make a transition of each
rounding, which costs time; six would move the motion by microseconds."""


@register_effect
class SpinningRotor(LinearEffect):
    """Gyroscopic torque of an internal angular momentum h, fixed in the body."""

    name = "spinning_rotor"
    family = "internal"
    linear = True
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
    """Motion of the mass relative to its rest point, world axes.

    Columns of the last axis: value, derivatives by f_n, by zeta and by the rest point (3).

    Attributes:
        displacement: (N, 3, 6) u.
        sliding: (N, 3, 6) u' - omega x u, the velocity seen from the body.
        acceleration: (N, 3, 6) u''.
    """

    displacement: Array
    sliding: Array
    acceleration: Array


@register_effect
class SloshingMass(Effect):
    """A point mass on an isotropic internal spring-damper about a rest point r of the body.

    With u the displacement from the rest point q = p_WO + R_WO r, world axes, w_n = 2 pi f_n:
    u'' + 2 zeta w_n (u' - omega x u) + w_n^2 u = g - q''; what the rigid model (which holds the
    mass at rest) lacks is the force -m_s u'' at r and, as the mass is not at r but displaced, the
    torque 2 m_s zeta w_n u x (u' - omega x u).
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
    rings = True

    reading_names = ("", "unsettled", "anchored", "anchored_unsettled")

    def __init__(self, reading: str = "", screened_hz: tuple[float, ...] = _SCREENED_HZ) -> None:
        """Choose the start and where the force acts.

        Args:
            reading: `unsettled` starts with the spring unstretched rather than hanging at rest,
                `anchored` lets the spring-damper push at r only (no torque of the damper).
            screened_hz: natural frequencies tried before a refit.
        """
        self.reading = reading
        self.screened_hz = screened_hz

    @property
    def screened_as(self) -> str:
        """The basis depends on the start only, and on the frequencies."""
        return f"{self.name}:{self._unsettled}:{self.screened_hz}"

    @property
    def _unsettled(self) -> bool:
        return self.reading.endswith("unsettled")

    def with_reading(self, reading: str) -> Effect:
        """Return the reading of that name."""
        if reading not in self.reading_names:
            raise BadInputError(
                f"effect '{self.name}' has no reading '{reading}': "
                f"{', '.join(self.reading_names[1:])}"
            )
        return SloshingMass(reading)

    def readings(self, samples: WrenchSamples) -> tuple[Effect, ...]:
        """All readings."""
        return tuple(SloshingMass(reading) for reading in self.reading_names)

    def restrictions(self, samples: WrenchSamples) -> tuple[tuple[Effect, tuple[int, ...]], ...]:
        """One screened frequency each."""
        if len(self.screened_hz) == 1:
            return ()
        return tuple(
            (SloshingMass(self.reading, (hz,)), tuple(range(4 * i, 4 * i + 4)))
            for i, hz in enumerate(self.screened_hz)
        )

    def parameters(self, samples: WrenchSamples) -> tuple[EffectParameter, ...]:
        """Mass, natural frequency, damping ratio, rest point (3)."""
        return (
            EffectParameter("m_s", "kg", 0.5, "moving mass", 0.05, least=0.0),
            EffectParameter("f_n", "Hz", 10.0, "natural frequency", 2.0, 0.0, _FASTEST_HZ),
            EffectParameter("zeta", "", 1.0, "damping ratio", 0.1, 0.0, _MOST_DAMPING),
            *vector_parameters("r", "m", 0.1, "rest point, body frame", 0.02),
        )

    def wrench(self, samples: WrenchSamples, inertia: Array, theta: Array) -> Array:
        """Force -m_s u'' at r and the torque of the damper."""
        response = self._respond(samples, theta)
        force = -theta[0] * to_body(samples, response.acceleration[..., 0])
        wrench = force_at(theta[3:], force)
        wrench[:, :3] += theta[0] * to_body(samples, self._damping(theta, response)[..., 0])
        return wrench

    def jacobian(self, samples: WrenchSamples, inertia: Array, theta: Array) -> Array:
        """By mass, frequency, damping and rest point."""
        mass, point = theta[0], theta[3:]
        response = self._respond(samples, theta)
        world = body_from_world(samples)
        force, torque = -world @ response.acceleration, world @ self._damping(theta, response)
        columns = force_columns(point, force) + torque_columns(torque)
        columns[..., 1:] *= mass
        columns[..., 3:] += point_columns(mass * force[..., 0])
        return columns

    def screening_basis(self, samples: WrenchSamples, inertia: Array) -> Array:
        """Responses of a filter bank over natural frequencies: force and arms."""
        drive = samples.gravity - samples.acceleration
        responses = _filtered(
            samples.time, drive, self.screened_hz, _SCREENED_DAMPING, self._unsettled
        )
        return np.concatenate([_pushes(samples, response) for response in responses], axis=2)

    def initial_guess(
        self, samples: WrenchSamples, inertia: Array, coefficients: Array, residual: Array
    ) -> Array:
        """The best of the screened frequency with the largest mass and of masses that ring.

        These answer at one frequency only, which no bank of filters meets: peaks of the spectrum.
        """
        table = coefficients.reshape(-1, 4)
        screened = self.screened_hz[int(np.argmax(table[:, 0]))]
        peaks = spectral_peaks(samples.time, residual[:, 3:], _RINGING_BAND, _PEAKS)
        shapes = [(screened, _SCREENED_DAMPING)]
        shapes += [(hz, damping) for hz in peaks.tolist() for damping in _RINGING_DAMPING]
        starts = [self._start(samples, residual, *shape) for shape in shapes]
        return min(starts, key=lambda start: start[0])[1]

    def _start(
        self, samples: WrenchSamples, residual: Array, hz: float, damping: float
    ) -> tuple[float, Array]:
        """Squares that a mass of that shape leaves, beside a load and constant wrenches; theta."""
        drive = samples.gravity - samples.acceleration
        response = _filtered(samples.time, drive, (hz,), damping, self._unsettled)[0]
        constant = np.broadcast_to(np.eye(6), (len(drive), 6, 6))
        parts = [_pushes(samples, response), _pushes(samples, drive), constant]
        columns = np.concatenate(parts, axis=2)
        scale = np.repeat([np.linalg.norm(residual[:, :3]), np.linalg.norm(residual[:, 3:])], 3)
        weight = 1.0 / np.maximum(scale, _NO_RESIDUAL)
        rows = (columns * weight[:, None]).reshape(-1, columns.shape[2])
        target = (residual * weight).reshape(-1)
        solution = np.linalg.lstsq(rows, target, rcond=None)[0]
        left = target - rows @ solution if solution[0] > 0.0 else target
        mass = max(float(solution[0]), 1e-3)
        point = np.clip(solution[1:4] / mass, -0.05, 0.05)
        return float(left @ left), np.concatenate([[mass, hz, damping], point])

    def _respond(self, samples: WrenchSamples, theta: Array) -> _Response:
        return _respond(samples, self.reading, np.asarray(theta, dtype=float).tobytes())

    def _damping(self, theta: Array, response: _Response) -> Array:
        """2 zeta w_n u x (u' - omega x u) per kg and its derivatives, world axes, (N, 3, 6)."""
        u, v = response.displacement, response.sliding
        if self.reading.startswith("anchored"):
            return np.zeros_like(u)
        hz, damping = _used_shape(theta)
        rate = 4.0 * np.pi * hz * damping
        product = np.cross(u[..., 0], v[..., 0])
        columns = np.cross(u, v[..., :1], axis=1) + np.cross(u[..., :1], v, axis=1)
        columns[..., 0] = product
        columns *= rate
        columns[..., 1] += 4.0 * np.pi * damping * product
        columns[..., 2] += 4.0 * np.pi * hz * product
        return columns


def _pushes(samples: WrenchSamples, acceleration: Array) -> Array:
    """Wrenches (N, 6, 4) of a unit mass with that acceleration (N, 3), world: force and arms."""
    force = -to_body(samples, acceleration)
    return np.concatenate(
        [force_at(np.zeros(3), force)[..., None], torque_columns(-skew(force))], axis=2
    )


@latest_per_motion
def _respond(samples: WrenchSamples, reading: str, parameters: bytes) -> _Response:
    """Response to the motion for parameters theta, given as bytes."""
    theta = np.frombuffer(parameters)
    hz, damping = _used_shape(theta)
    settled = not reading.endswith("unsettled")
    parts = [
        _respond_stretch(samples, part, 2.0 * np.pi * hz, damping, theta[3:], settled)
        for part in stretches(samples.time)
    ]
    stacked = np.concatenate(parts, axis=1)
    stacked[..., 1] *= 2.0 * np.pi
    return _Response(*stacked)


def _respond_stretch(
    samples: WrenchSamples,
    part: slice,
    omega_n: float,
    damping: float,
    point: Array,
    settled: bool,
) -> Array:
    """Displacement, sliding and acceleration of one gap-free stretch, (3, n, 3, 6)."""
    spin = samples.rotation[part] @ samples.angular_velocity[part][..., None]
    omega = skew(samples.angular_velocity[part])
    turn = samples.rotation[part] @ (skew(samples.angular_acceleration[part]) + omega @ omega)
    offset = (turn @ point[:, None])[..., 0]
    drive = (samples.gravity - samples.acceleration[part] - offset)[..., None]
    drive = np.concatenate([drive, -turn], axis=2)
    time, read = evenly_filled(samples.time[part])
    if len(time) > len(read):
        spin, drive = (local_cubic(time[read], values)(time) for values in (spin, drive))
    system = _system(spin[..., 0], omega_n, damping)
    middle = 0.5 * (system[1:] + system[:-1])
    fastest = omega_n * max(1.0, 2.0 * damping)
    transition, pushes = discretise(middle, np.diff(time), fastest)
    start = np.zeros((6, 4))
    if settled:
        start[:3] = drive[0] / omega_n**2
    states = integrate_linear(transition, pushed(pushes, taylor(time, drive)), start)
    found = np.empty((3, *drive.shape[:2], 6))
    found[..., [0, 3, 4, 5]] = _motion(system, states, drive, spin)
    shape = _shape_drive(found[..., :1], omega_n, damping)
    by_shape = np.zeros((6, 2))
    by_shape[:, 0] = -2.0 / omega_n * start[:, 0]
    states = integrate_linear(transition, pushed(pushes, taylor(time, shape)), by_shape)
    found[..., 1:3] = _motion(system, states, shape, spin)
    return found[:, read]


def _used_shape(theta: Array) -> tuple[float, float]:
    """Natural frequency and damping ratio, kept where the response is defined."""
    hz = float(np.clip(theta[1], _SLOWEST_HZ, _FASTEST_HZ))
    return hz, float(np.clip(theta[2], _LEAST_DAMPING, _MOST_DAMPING))


def _shape_drive(motion: Array, omega_n: float, damping: float) -> Array:
    """Drives (n, 3, 2) of the derivatives by w_n and zeta."""
    displacement, sliding = motion[0], motion[1]
    by_frequency = -2.0 * damping * sliding - 2.0 * omega_n * displacement
    return np.concatenate([by_frequency, -2.0 * omega_n * sliding], axis=2)


def _motion(system: Array, states: Array, drive: Array, spin: Array) -> Array:
    """Displacement, sliding and acceleration (3, n, 3, m) of states [u, u']."""
    displacement, velocity = states[:, :3], states[:, 3:]
    sliding = velocity - skew(spin[..., 0]) @ displacement
    return np.stack([displacement, sliding, system[:, 3:] @ states + drive])


def _system(spin: Array, omega_n: float, damping: float) -> Array:
    """State matrices (n, 6, 6) of [u, u'] with the damper turning with the body."""
    matrix = np.zeros((len(spin), 6, 6))
    matrix[:, :3, 3:] = np.eye(3)
    matrix[:, 3:, :3] = -(omega_n**2) * np.eye(3) + 2.0 * damping * omega_n * skew(spin)
    matrix[:, 3:, 3:] = -2.0 * damping * omega_n * np.eye(3)
    return matrix


def _filtered(
    time: Array, drive: Array, frequencies: Sequence[float], damping: float, unsettled: bool
) -> list[Array]:
    """Accelerations u'' (N, 3) at each natural frequency, with the damper fixed in the world.

    Args:
        time: (N,) s.
        drive: (N, 3) specific force on the mass, m/s^2.
        frequencies: Hz.
        damping: ratio.
        unsettled: start unstretched rather than hanging.
    """
    found = [np.empty_like(drive) for _ in frequencies]
    for part in stretches(time):
        filled, read = evenly_filled(time[part])
        pushing = drive[part]
        if len(filled) > len(read):
            pushing = local_cubic(time[part], pushing)(filled)
        rises = taylor(filled, pushing)[:, :, None]
        for response, hz in zip(found, frequencies, strict=True):
            followed = _followed(filled, pushing, rises, 2.0 * np.pi * hz, damping, unsettled)
            response[part] = followed[read]
    return found


def _followed(
    time: Array, drive: Array, rises: Array, omega_n: float, damping: float, unsettled: bool
) -> Array:
    """`_filtered` of one stretch without gaps; `rises` (4, n - 1, 1, 3) of its drive."""
    system = _system(np.zeros((1, 3)), omega_n, damping)[:, [0, 3]][:, :, [0, 3]]
    steps, which = np.unique(np.round(np.diff(time), _STEP_DIGITS), return_inverse=True)
    transition, pushes = discretise(np.repeat(system, len(steps), axis=0), steps, omega_n)
    start = np.zeros((2, drive.shape[1]))
    if not unsettled:
        start[0] = drive[0] / omega_n**2
    states = integrate_linear(transition[which], pushed(pushes[:, which], rises), start)
    damped = 2.0 * damping * omega_n * states[:, 1]
    return np.asarray(drive - omega_n**2 * states[:, 0] - damped)
