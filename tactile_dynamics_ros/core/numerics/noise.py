"""White-noise level of a sampled signal, read from the signal itself."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.rigid_body.rotation import accumulated_rotation
from tactile_dynamics_ros.core.streams.streams import ContactStream, nearest_samples

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
