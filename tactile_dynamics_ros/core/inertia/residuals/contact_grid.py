"""Contacts with their own rates, gaps and silences, read on the grid of the estimation."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.inertia.residuals.carried import CarriedPlace
from tactile_dynamics_ros.core.inertia.residuals.latent import LatentSignal
from tactile_dynamics_ros.core.numerics.local_polynomial import (
    LocalFunctional,
    Window,
    lagrange_weights,
    local_polynomial,
    typical_period,
)
from tactile_dynamics_ros.core.numerics.noise import (
    noise_along_axes,
    rounding_noise,
    white_noise_std,
)
from tactile_dynamics_ros.core.streams.streams import (
    ContactStream,
    Streams,
    between_turns,
    enclosing_steps,
    nearest_samples,
)

SYNCHRONOUS = 1e-4
"""Difference (s) of stamps that are the same. A force of 10 N at 4 Hz changes by 25 mN within it at
most; more would read one sample for another's time."""
MISSED_PERIODS = 1.5
"""Step, in periods, from which a sample is missing: midway between none and one. Jitter beyond half
a period reads as a loss. Nearer to 1 jitter reads as loss; at 2 and more single losses go
unseen."""
SILENCE_PERIODS = 2.5
"""Step between samples, in periods, from which a contact was silent: one lost sample makes a step
of 2, jitter included 2.5. Two lost samples make 3, which is no longer interpolated. Nearer to 2
jitter around a lost sample breaks a contact, above 3 gaps are bridged in which a finger can let
go."""
_BRIDGED = 0.025
"""Longest step (s) across a lost sample that is interpolated: a cubic is 0.2 % off at 4 Hz. Longer
bends forces that a hand makes, shorter loses the samples around each lost message."""
LOADED = 0.3
"""Share of the median load that a contact must bear before and after a silence for samples to count
as lost, not as a break of contact: fingers that let go unload first. At zero a grasp that opens
leaves false forces; at 1 half of all lost samples count as breaks."""
_RAGGED = 0.5
"""Longest difference (s) between the ends of streams that is no break of contact: recorders stop
streams one after the other. Longer silences at an end are a hand that let go. Shorter ends a
contact where a recorder stopped early, longer lets a hand that let go seem to hold."""
_EXTRAPOLATED = 0.1
"""Share of a period by which a stream may be read beyond its samples: stamps of one clock differ by
less. Forces of 4 Hz at 100 Hz then are off by at most 3 %, at the ends alone. At zero the first or
last sample is lost to jitter, at 1 forces are off by as much as they change in a period."""
_SLOWER = 0.9
"""Period over that of the grid above which forces are interpolated; below, several samples fall
into a step of the grid and are averaged. 0.9 leaves room for jitter of clocks of equal rate. The
live estimator's bound is 0.6 (`live/contact_queue.py`). Lower interpolates fast streams, whose
noise then folds into the grid; at 1 equal rates switch by jitter."""
_AVERAGED = 1.5
"""Half width, in periods of the grid, of the tapered window by which fast forces are read: what the
grid cannot show is mostly averaged away. Narrower lets noise in, wider cuts quick forces. The live
estimator uses 1.25, since it takes noise to be white."""
_PER_MOTION_SAMPLE = 4.0
"""Grid times per sample of the motion, at most: between its samples motion is a polynomial, so that
more tell nothing, while the covariance of residuals becomes as wide. 40 s of 100 Hz forces with 5
Hz poses take two minutes at 20; at 2 a lag or an offset of clocks is read from half the forces."""
_CUBIC = 4
"""Samples that an interpolating polynomial goes through: a cubic. A line would cut the peaks of a
force of 4 Hz at 100 Hz by 0.5 %. Six follow noise and reach across more samples for less than
that."""
EMPTY = 1e-9
"""|force| + |torque|, N and N m, up to which nothing is transmitted: zero and rounding. Fingertips
send exactly zero while untouched. Larger takes light touches for none; at zero rounding counts as a
touch."""
_FALLBACK_FORCE_STD = 0.03
"""Standard deviation of a force axis, N, where none is stated and the samples show none (fewer than
20, or without noise): the white noise at 100 Hz that the hardware facts suggest for a BioTac. It
only scales how forces weigh against the motion. Larger trusts forces less and poses more, and the
other way round; intervals without stated noise grow in proportion."""
_FALLBACK_TORQUE_STD = 1e-3
"""Standard deviation of a torque axis, N m, in the same case: about that of `_FALLBACK_FORCE_STD`
at a lever of 3 cm. Larger lets forces at their points decide the centre of mass, smaller the
torques of the sensors."""
UNMEASURED_TORQUE_STD = 1e4
"""Standard deviation of a torque, N m, that was not measured: a thousand times those of robots, so
that it tells nothing. Larger is no more, and costs digits."""
_NOISELESS = 0.01
"""Scatter, over the fallback, up to which samples show no noise: 0.3 mN and 0.01 N mm, a tenth of
what the finest force/torque sensors resolve. Computed forces and torques scatter less, by rounding
and by their motion; believed, they would have all the weight. Higher replaces honest noise of fine
sensors, lower believes rounding."""
POINT_STD_FLOOR = 1e-5
"""Scatter of contact points, m, up to which they count as exact: one step of a hand's encoder (89
urad) at 0.1 m. Points that are noisier become unknowns of the fit, which costs time; a higher floor
leaves noise of points out of the intervals."""


@dataclass(frozen=True)
class ContactSignals:
    """One contact: raw world-frame samples and how the grid reads them.

    Attributes:
        name: name of the contact.
        force: (K, 3) N; torque: (K, 3) N m about the point; point: (M, 3) m; world axes.
        rotation: (N, 3, 3) contact frame on the grid.
        in_contact: (N,).
        valid: (N,) False where loaded samples were dropped.
        signals: latent signals force, and torque and point where they are noisy.
        point_functional: functional of the contact point.
        carried: whether point and rotation are in the body frame, free of the noise of the pose.
        carries_torque: whether its torque is measured; that of one force alone is an unknown.
    """

    name: str
    force: Array
    torque: Array
    point: Array
    rotation: Array
    in_contact: NDArray[np.bool_]
    valid: NDArray[np.bool_]
    signals: dict[str, LatentSignal]
    point_functional: LocalFunctional
    carried: bool = False
    carries_torque: bool = True

    def corrected(self, corrections: dict[str, Array]) -> ContactSignals:
        """Return the signals moved by corrections (K, 3) by name."""
        return replace(self, **{name: getattr(self, name) + d for name, d in corrections.items()})

    def evaluate(self) -> tuple[Array, Array, Array]:
        """Force, torque and point (N, 3) each on the grid; zero without contact.

        World axes; the point of a carried contact is in the body frame.
        """
        functional = self.signals["force"].functional
        loaded = self.in_contact[:, None]
        force = functional.apply(self.force, 0) * loaded
        torque = functional.apply(self.torque, 0) * loaded
        return force, torque, self.point_functional.apply(self.point, 0)


def choose_grid(streams: Streams, maximum_rate: float) -> Array:
    """Grid times: the contacts' own stamps if they share them, else a uniform grid.

    A motion that is sampled far more slowly than the forces bounds the rate of the grid.

    Raises:
        BadInputError: no contacts, or contacts and kinematics do not overlap in time.
    """
    contacts = [c for c in streams.contacts.values() if len(c.time) > 1]
    if not contacts:
        raise BadInputError("no contact forces: expected at least one /contact/<name>/force")
    first, last = _kinematic_span(streams)
    periods = [typical_period(c.time) for c in contacts]
    shortest = max(1.0 / maximum_rate, _motion_period(streams) / _PER_MOTION_SAMPLE)
    period = max(*periods, shortest)
    stamps = np.unique(np.round(np.concatenate([c.time for c in contacts]) / SYNCHRONOUS))
    shared = len(stamps) <= 1.05 * max(len(c.time) for c in contacts)
    if shared and max(periods) < 1.5 * min(periods) and min(periods) >= 0.99 * shortest:
        grid = stamps * SYNCHRONOUS
    else:
        start = max(first, min(c.time[0] for c in contacts))
        end = min(last, max(c.time[-1] for c in contacts))
        grid = np.arange(start, end, period)
    grid = grid[(grid >= first - SYNCHRONOUS) & (grid <= last + SYNCHRONOUS)]
    if len(grid) < 2:
        raise BadInputError(
            f"contacts and object pose do not overlap in time: pose covers {first:.3f} to "
            f"{last:.3f} s, contacts {stamps[0] * SYNCHRONOUS:.3f} to "
            f"{stamps[-1] * SYNCHRONOUS:.3f} s; check the stamps"
        )
    return np.asarray(grid)


def _motion_period(streams: Streams) -> float:
    """Period of the fastest stream of the motion, s; 0 if there is none."""
    stamps = [s.time for s in (streams.pose, streams.imu) if s is not None and len(s.time) > 1]
    return min((typical_period(time) for time in stamps), default=0.0)


def _kinematic_span(streams: Streams) -> tuple[float, float]:
    spans = [s.time for s in (streams.pose, streams.imu) if s is not None]
    if not spans or min(len(time) for time in spans) < 7:
        raise BadInputError("no motion of the object: expected /object/pose or /object/imu samples")
    return max(float(t[0]) for t in spans), min(float(t[-1]) for t in spans)


def contact_signals(
    contact: ContactStream, grid: Array, place: CarriedPlace | None = None, alone: bool = False
) -> ContactSignals:
    """Read one contact on the grid.

    Points of fingers carry no torque worth speaking of. One contact alone that holds a body has to,
    so that a torque of zero is one that was not measured.

    Args:
        contact: its stream.
        grid: (N,) s.
        place: where it is on the object, if it carries the noise of the tracked pose.
        alone: whether nothing else touches the body.
    """
    shown = contact if place is None else place
    period = typical_period(contact.time)
    nearest = nearest_samples(contact.time, grid)
    distance = np.abs(contact.time[nearest] - grid)
    present = distance < max(0.75 * period, 0.75 * _grid_period(grid))
    magnitude = np.linalg.norm(contact.force, axis=1) + np.linalg.norm(contact.torque, axis=1)
    loaded = magnitude > EMPTY
    functional = _force_functional(contact.time, grid, period, loaded)
    bridged, doubtful = _short_silences(contact.time, grid, period, loaded)
    in_contact = (present & loaded[nearest]) | bridged
    weights = functional.weights * in_contact[:, None, None]
    functional = replace(functional, weights=weights)
    signals = {"force": LatentSignal(functional, _force_noise(contact))}
    if contact.carries_torque:
        factor = _seen_noise(contact, contact.torque, _FALLBACK_TORQUE_STD)
        signals["torque"] = LatentSignal(functional, factor)
    elif alone:
        unknown = UNMEASURED_TORQUE_STD * np.eye(3)
        factor = np.broadcast_to(unknown, (len(contact.time), 3, 3))
        signals["torque"] = LatentSignal(functional, factor)
    point_std = white_noise_std(contact.pose_time, shown.position)
    point_functional = _point_functional(contact.pose_time, grid, point_std)
    if point_std > POINT_STD_FLOOR:
        loaded = replace(
            point_functional, weights=point_functional.weights * in_contact[:, None, None]
        )
        factor = np.broadcast_to(point_std * np.eye(3), (len(contact.pose_time), 3, 3))
        signals["point"] = LatentSignal(loaded, factor)
    return ContactSignals(
        name=contact.name,
        force=contact.force,
        torque=contact.torque,
        point=shown.position,
        rotation=between_turns(contact.pose_time, shown.rotation, grid),
        in_contact=in_contact,
        valid=~_dropped(contact.time, magnitude, period, grid)
        & ~(doubtful & ~present)
        & (functional.valid & point_functional.valid | ~in_contact),
        signals=signals,
        point_functional=point_functional,
        carried=place is not None,
        carries_torque=contact.carries_torque,
    )


def _grid_period(grid: Array) -> float:
    return float(np.median(np.diff(grid)))


def _identity(time: Array, grid: Array) -> LocalFunctional | None:
    """One sample per grid time where stamps coincide (or the contact is silent for long)."""
    if _misses_samples(time) or not _coincide(time, grid):
        return None
    count = len(grid)
    nearest = nearest_samples(time, grid)
    return LocalFunctional(nearest, np.ones((count, 1, 1)), np.ones(count, dtype=bool))


def _coincide(time: Array, grid: Array) -> bool:
    """Whether all samples near a grid time have its stamp."""
    distance = np.abs(time[nearest_samples(time, grid)] - grid)
    return not np.any((distance > 2 * SYNCHRONOUS) & (distance < 0.75 * _grid_period(grid)))


def _misses_samples(time: Array) -> bool:
    """Whether single samples of an even stream are missing."""
    if len(time) < 2:
        return False
    steps, period = np.diff(time), typical_period(time)
    return bool(np.any((steps > MISSED_PERIODS * period) & (steps < SILENCE_PERIODS * period)))


def _short_silences(
    time: Array, grid: Array, period: float, loaded: NDArray[np.bool_]
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Grid times (N,) between neighbouring samples: both loaded, and one of them only."""
    left, step = enclosing_steps(time, grid)
    near = step < SILENCE_PERIODS * period
    near &= (grid >= time[left]) & (grid <= time[left + 1])
    before, after = loaded[left], loaded[left + 1]
    return near & before & after, near & (before != after)


def _force_functional(
    time: Array, grid: Array, period: float, loaded: NDArray[np.bool_]
) -> LocalFunctional:
    """The sample itself, interpolation, or a polynomial through samples faster than the grid.

    Not valid where contact begins or ends within those samples. A mean over a grid period of 8 ms
    instead of a polynomial would make forces of 5 Hz 0.3 % too small, and so the inertia.
    """
    same = _identity(time, grid)
    if same is not None:
        return same
    grid_period = _grid_period(grid)
    if period > _SLOWER * grid_period:
        return _interpolation(time, grid, period, loaded)
    window = Window(_AVERAGED * grid_period, 2, tapered=True)
    functional = local_polynomial(time, grid, window, orders=1)
    held = loaded[functional.indices]
    even = held.all(axis=1) | ~held.any(axis=1)
    return replace(functional, valid=functional.valid & even)


def _interpolation(
    time: Array, grid: Array, period: float, loaded: NDArray[np.bool_]
) -> LocalFunctional:
    """Cubic through four loaded samples in a row (fewer if there are), else linear.

    Not valid beyond the ends, inside gaps, and where a sample of a slow stream is missing. A line
    would cut the peaks of a force of 4 Hz that is sampled at 100 Hz by 0.5 %.
    """
    left, step = enclosing_steps(time, grid)
    share = (grid - time[left]) / step
    reach = _EXTRAPOLATED * period / step
    inside = (share > -reach) & (share < 1.0 + reach)
    near = step < np.clip(_BRIDGED, MISSED_PERIODS * period, SILENCE_PERIODS * period)
    bridged = near | (np.minimum(share, 1.0 - share) < reach)
    clipped = np.clip(share, 0.0, 1.0)
    clipped = np.where(near, clipped, np.round(clipped))
    width = min(_CUBIC, len(time))
    start = np.clip(left - 1, 0, len(time) - width)
    index = start[:, None] + np.arange(width)
    weights = np.zeros((len(grid), width))
    rows = np.arange(len(grid))
    weights[rows, left - start] = 1.0 - clipped
    weights[rows, left - start + 1] = clipped
    even = (np.diff(time[index], axis=1) < SILENCE_PERIODS * period).all(axis=1)
    smooth = even & loaded[index].all(axis=1) & (share >= 0.0) & (share <= 1.0)
    weights[smooth] = lagrange_weights(time[index[smooth]], grid[smooth])
    return LocalFunctional(start.astype(np.int64), weights[:, None], inside & bridged)


def _point_functional(time: Array, grid: Array, std: float) -> LocalFunctional:
    """The sample itself, interpolation of precise points, or a mean of noisy ones."""
    same = _identity(time, grid)
    if same is not None:
        return same
    period = typical_period(time)
    if std <= POINT_STD_FLOOR or _coincide(time, grid):
        return _interpolation(time, grid, period, np.ones(len(time), dtype=bool))
    return local_polynomial(time, grid, Window(1.5 * period, 2), orders=1)


def _force_noise(contact: ContactStream) -> Array:
    """Noise factors (K, 3, 3): the stated standard deviations, or the scatter of the samples."""
    if contact.own_axes or contact.force_std is None or not np.all(contact.force_std > 0):
        return _seen_noise(contact, contact.force, _FALLBACK_FORCE_STD)
    return np.asarray(contact.force_std[:, :, None] * np.eye(3))


def _seen_noise(contact: ContactStream, values: Array, fallback: float) -> Array:
    """Noise factors (K, 3, 3) of forces or torques: their scatter, and at least their steps."""
    least, rounding = _NOISELESS * fallback, rounding_noise(contact, values)
    if not contact.own_axes and not np.any(rounding > least):
        seen = white_noise_std(contact.time, values)
        std = seen if seen > least else fallback
        return np.broadcast_to(std * np.eye(3), (len(contact.time), 3, 3))
    axes = contact.rotation[nearest_samples(contact.pose_time, contact.time)]
    stds = np.maximum(noise_along_axes(contact, values), rounding)
    return np.asarray(axes * np.where(stds > least, stds, fallback))


def _dropped(time: Array, magnitude: Array, period: float, grid: Array) -> NDArray[np.bool_]:
    """Grid times inside a silence that begins and ends under load: samples lost, not a break.

    So is a short silence before the first or after the last sample: streams that are cut, or that
    are still under way, do not end together.
    """
    dropped = np.zeros(len(grid), dtype=bool)
    gaps = np.flatnonzero(np.diff(time) > SILENCE_PERIODS * period)
    threshold = LOADED * float(np.median(magnitude))
    for k in gaps:
        if min(magnitude[k], magnitude[k + 1]) > threshold > 0:
            dropped |= (grid > time[k] + 0.5 * period) & (grid < time[k + 1] - 0.5 * period)
    if magnitude[0] > threshold > 0 and time[0] - grid[0] < _RAGGED:
        dropped |= grid < time[0] - 0.5 * period
    if magnitude[-1] > threshold > 0 and grid[-1] - time[-1] < _RAGGED:
        dropped |= grid > time[-1] + 0.5 * period
    return dropped
