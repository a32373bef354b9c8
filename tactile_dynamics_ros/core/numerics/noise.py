"""White-noise level of a sampled signal, read from the signal itself."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.rigid_body.rotation import accumulated_rotation
from tactile_dynamics_ros.core.streams.streams import (
    ContactStream,
    between_turns,
    nearest_samples,
)

Array = NDArray[np.float64]

_ORDER = 6
"""Order of the differences in which noise is seen. Of a force of 4 Hz at 100 Hz sixth differences
leave 8e-6, of 10 Hz 0.2 %, so that motion does not count as noise. Lower orders leave motion in,
higher ones need longer runs without a gap."""
_MINIMUM_SAMPLES = 20
"""Samples from which noise is read: it is then known to 26 %. Below, what is stated or a fallback
is used. Fewer would trust noise that is known to no more than a half, more leaves short recordings
to fallbacks."""
_SHORTEST, _LONGEST = 0.3, 1.7
"""Steps between samples, in periods, that are no gap and no burst: jitter of a third of a period
and more passes, a lost sample (2) does not. Divided differences of shorter steps see little but
those. Wider bounds let noise be read across gaps, narrower ones leave jittery streams without
samples."""

_ON_STEPS = 0.95
"""Share of the samples that lie on multiples of a step from which a signal is quantised: the others
were interpolated or made up by a driver. Of a fine signal 0.2 % lie on any step by chance."""
_OFF_STEP = 1e-3
"""Distance, in steps, from such a multiple that rounding of printed or stored numbers leaves."""
_MOST_LOOKED_AT = 3000
"""Samples, spread evenly, in which steps are looked for: a signal of 20 bits that turns has as many
levels in them."""


def white_noise_std(time: Array, values: Array) -> float:
    """Standard deviation of the white part, from sixth differences of the samples.

    std = 1.4826 median|D^6 x|, D^6 being divided differences of unit noise: smooth motion vanishes
    under them however unevenly it is sampled, and the median ignores gaps and spikes.

    Args:
        time: (N,) s; windows with gaps are left out.
        values: (N, d).

    Returns:
        One standard deviation for all columns; 0 if there are fewer than 20 samples.
    """
    differences, _ = _differences(time, values)
    return _spread(differences)


def noise_along_axes(contact: ContactStream, values: Array) -> Array:
    """`white_noise_std` (3,) of forces or torques (N, 3) along each axis of the contact frame.

    Args:
        contact: whose frame turns with the sensor.
        values: world axes, at the times of the contact's forces.
    """
    differences, middle = _differences(contact.time, values)
    axes = contact.rotation[nearest_samples(contact.pose_time, contact.time[middle])]
    along = np.einsum("nji,nj->ni", axes, differences)
    return np.array([_spread(along[:, [k]]) for k in range(3)])


def quantisation_step(values: Array) -> float:
    """Step of a signal (N,) all of whose values are multiples of it, but for a constant; else 0."""
    known = values[np.isfinite(values)]
    scale = float(np.ptp(known)) if len(known) else 0.0
    if scale == 0.0:
        return 0.0
    levels, counts = np.unique(np.round(known / scale, 9), return_counts=True)
    step = float(np.quantile(np.diff(levels), 0.1))
    steps = (levels - levels[np.argmax(counts)]) / step
    on_steps = np.abs(steps - np.round(steps)) < _OFF_STEP
    return scale * step if counts[on_steps].sum() >= _ON_STEPS * len(known) else 0.0


def rounding_noise(contact: ContactStream, values: Array) -> Array:
    """Standard deviation (3,) that coarse steps of a sensor add along each axis of its frame.

    std = step / sqrt(12): the error is spread evenly over one step.

    Args:
        contact: whose frame turns with the sensor.
        values: forces or torques (N, 3) in world axes, at the times of the contact's forces.
    """
    looked = np.linspace(0, len(values) - 1, min(len(values), _MOST_LOOKED_AT)).astype(int)
    turned = between_turns(contact.pose_time, contact.rotation, contact.time[looked])
    along = np.einsum("nji,nj->ni", turned, values[looked])
    return np.array([quantisation_step(axis) / math.sqrt(12.0) for axis in along.T])


def _differences(time: Array, values: Array) -> tuple[Array, NDArray[np.intp]]:
    """Sixth divided differences (n, d) of unit noise, and the sample (n,) in the middle.

    sum_k w_k x_k, w_k ~ 1 / prod_(j != k) (t_k - t_j), sum_k w_k^2 = 1.
    """
    if len(time) < _MINIMUM_SAMPLES:
        return values[:0], np.zeros(0, dtype=np.intp)
    steps = np.diff(time) / np.median(np.diff(time))
    regular = (steps > _SHORTEST) & (steps < _LONGEST)
    complete = np.lib.stride_tricks.sliding_window_view(regular, _ORDER).all(axis=1)
    start = np.flatnonzero(complete)
    window = start[:, None] + np.arange(_ORDER + 1)
    place = np.concatenate([[0.0], np.cumsum(steps)])[window]
    between = place[:, :, None] - place[:, None, :] + np.eye(_ORDER + 1)
    weights = 1.0 / np.prod(between, axis=2)
    weights /= np.linalg.norm(weights, axis=1, keepdims=True)
    change = values[window] - values[start][:, None]
    return np.einsum("nk,nkd->nd", weights, change), start + _ORDER // 2


def _spread(differences: Array) -> float:
    """Standard deviation of the samples behind differences; 0 if there are none."""
    return float(1.4826 * np.median(np.abs(differences))) if len(differences) else 0.0


def white_pose_noise_std(time: Array, rotation: Array, position: Array) -> tuple[float, float]:
    """`white_noise_std` of the orientation (rad) and of the position (m) of a stream of poses.

    Args:
        time: (N,) s.
        rotation: (N, 3, 3).
        position: (N, 3) m.
    """
    return white_noise_std(time, accumulated_rotation(rotation)), white_noise_std(time, position)
