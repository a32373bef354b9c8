"""What poses that are too far apart do not show of a motion counts as their noise."""

from __future__ import annotations

import numpy as np

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.numerics.local_polynomial import (
    Window,
    local_polynomial,
    typical_period,
)

_SLOW = 1.0 / 15.0
"""Period, s, above which it is asked whether poses follow the motion: a hand moves at up to about 2
Hz, of which 15 Hz have seven samples. Shorter would take vibrations of faster recordings, which the
diagnosis describes, for noise. Longer asks of slower poses alone and lets motion between 10 Hz
poses count as seen."""
_BY_CHANCE = 1.5
"""RMS deviation of the poses around a sample from their polynomial, over what noise leaves there,
up to which they follow it. Of the 11 poses with three degrees of freedom a window has, white noise
exceeds it in one of a thousand; at 2 motion of four samples per period still passes."""
_AROUND = 5
"""Poses at either side over which the deviation is averaged: those that share the polynomial. Fewer
scatter more than `_BY_CHANCE` allows, more smear a short jolt over poses that do follow the
motion."""


def unfollowed_scale(time: Array, values: Array, std: float, window: Window) -> Array:
    """Factors (K,) by which the noise of samples grows where polynomials do not follow them.

    A sample deviates from the polynomial p_k through its neighbours (itself included, weight w_kk)
    by noise of variance 1 - 2 w_kk + sum_j w_kj^2. What is left beyond that is motion between the
    samples: accelerations read there are as wrong as if the samples were so much noisier.

    Args:
        time: (K,) s, increasing.
        values: (K, 3).
        std: noise of a sample.
        window: of the polynomials by which the motion is read.

    Returns:
        Ones where the samples are frequent, or follow each other as noise and polynomial allow.
    """
    if len(time) <= 2 * _AROUND or typical_period(time) < _SLOW or std <= 0.0:
        return np.ones(len(time))
    functional = local_polynomial(time, time, window, orders=1)
    weights = functional.weights[:, 0]
    own = weights[np.arange(len(time)), np.arange(len(time)) - functional.start]
    expected = 1.0 - 2.0 * own + np.sum(weights**2, axis=1)
    square = np.mean((values - functional.apply(values, 0)) ** 2, axis=1)
    near = np.ones(2 * _AROUND + 1)
    known = np.where(functional.valid, expected, 0.0)
    seen = np.convolve(np.where(functional.valid, square, 0.0), near, mode="same")
    by_noise = np.convolve(known, near, mode="same")
    ratio = np.sqrt(seen / np.maximum(by_noise, 1e-12)) / std
    return np.asarray(np.where((ratio > _BY_CHANCE) & (by_noise > 0.0), ratio, 1.0))
