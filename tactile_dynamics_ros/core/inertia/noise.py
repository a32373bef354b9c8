"""White-noise level of a sampled signal, read from the signal itself."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.rigid_body.rotation import accumulated_rotation
from tactile_dynamics_ros.core.streams import ContactStream, nearest_samples

Array = NDArray[np.float64]

_ORDER = 6
_MINIMUM_SAMPLES = 20


def white_noise_std(time: Array, values: Array) -> float:
    """Standard deviation of the white part, from sixth differences of the samples.

    std = 1.4826 median|D^6 x| / sqrt(binomial(12, 6)); smooth motion vanishes under D^6 and the
    median ignores gaps and spikes.

    Args:
        time: (N,) s; only steps close to the median period are used.
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
    """Sixth differences (n, d) of evenly spaced samples, and the sample (n,) in the middle."""
    if len(time) < _MINIMUM_SAMPLES:
        return values[:0], np.zeros(0, dtype=np.intp)
    steps = np.diff(time)
    regular = np.abs(steps - np.median(steps)) < 0.2 * np.median(steps)
    complete = np.lib.stride_tricks.sliding_window_view(regular, _ORDER).all(axis=1)
    return np.diff(values, _ORDER, axis=0)[complete], np.flatnonzero(complete) + _ORDER // 2


def _spread(differences: Array) -> float:
    """Standard deviation of the samples behind sixth differences; 0 if there are none."""
    if len(differences) == 0:
        return 0.0
    scale = math.sqrt(math.comb(2 * _ORDER, _ORDER))
    return float(1.4826 * np.median(np.abs(differences)) / scale)


def white_pose_noise_std(time: Array, rotation: Array, position: Array) -> tuple[float, float]:
    """`white_noise_std` of the orientation (rad) and of the position (m) of a stream of poses.

    Args:
        time: (N,) s.
        rotation: (N, 3, 3).
        position: (N, 3) m.
    """
    return white_noise_std(time, accumulated_rotation(rotation)), white_noise_std(time, position)
