"""Drift of each electrode of one fingertip with temperature, from frames without contact."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tactile_dynamics_ros.core.errors import NotIdentifiableError
from tactile_dynamics_ros.core.tactile.electrodes import ELECTRODES, PDC, TDC
from tactile_dynamics_ros.core.tactile.signal_change import (
    COUNTS_PER_KELVIN,
    check_frame,
    temperature,
)

Array = NDArray[np.float64]

USUAL_SPREAD = 3.0
"""How far electrodes differ, counts/K. Source: fits of one sensor, 27 to 38 counts/K. It is the
prior's standard deviation: larger believes short warm-ups more, smaller keeps electrodes at the
mean."""
LEAST_SPAN = 1.0
"""Warming below which nothing is learnt, K: the prior's 3 counts/K then are 3 counts, no more than
electrodes wander. A core warms by some 10 K after switching on. Lower learns slopes of noise,
higher refuses warm-ups that tell something."""

_TOUCH = 10.0
"""Deviation of PDC from its median, counts, from which a frame shows a touch and is left out: that
from which the LL4MA driver calls it a contact too, and twenty times the noise of PDC. Lower throws
away frames at rest whose pressure drifts, higher takes light touches for warmth."""
_STRETCHES = 60
"""Means to which frames are averaged before lines are fitted. In a warm-up of ten minutes each is
of 10 s, longer than the seconds within which electrodes wander; their scatter then tells the
standard deviation. Ten frames each are asked for. More stretches are shorter than what is common to
neighbours, and standard deviations become too small; fewer scatter."""


@dataclass(frozen=True)
class ThermalDrift:
    """Drift of one unit, for `FingertipConfig.drift`.

    Attributes:
        slope: (19,) counts per kelvin. std: (19,) their standard deviations.
        span: K, between the coldest and the warmest stretch. frames: that it rests on.
    """

    slope: Array
    std: Array
    span: float
    frames: int


def fit_thermal_drift(raw: ArrayLike) -> ThermalDrift:
    """Fit E_k = a_k + s_k T to frames in which nothing is touched, s_k ~ N(31.7, 3^2) before.

    Electrodes wander by a count within seconds, so that neighbouring frames say the same: means of
    sixty stretches are fitted, whose scatter, and how alike neighbours are, tell the standard
    deviation.

    Args:
        raw: (N, 44) counts in order of time; frames whose PDC is 10 counts off the usual are left
            out.

    Raises:
        BadInputError: the frames are malformed.
        NotIdentifiableError: too few frames, or the temperature hardly changes.
    """
    counts = np.atleast_2d(check_frame(raw))
    free = counts[np.abs(counts[:, PDC] - np.median(counts[:, PDC])) < _TOUCH]
    if len(free) < 10 * _STRETCHES:
        raise NotIdentifiableError(
            f"drift: {len(free)} frames without contact, expected at least {10 * _STRETCHES}"
        )
    means = np.array([part.mean(axis=0) for part in np.array_split(free, _STRETCHES)])
    warmth = temperature(means[:, TDC])
    span = float(np.ptp(warmth))
    if span < LEAST_SPAN:
        raise NotIdentifiableError(
            f"drift: the temperature changes by {span:.2f} K, expected at least {LEAST_SPAN} K; "
            "record for ten minutes from switching the sensors on"
        )
    slope, std = _fit_lines(warmth - warmth.mean(), means[:, ELECTRODES])
    return ThermalDrift(slope, std, span, len(free))


def _fit_lines(warmth: Array, electrodes: Array) -> tuple[Array, Array]:
    """Return slopes and standard deviations (19,) with the usual spread as prior."""
    level = electrodes - electrodes.mean(axis=0)
    squares = float(warmth @ warmth)
    plain = warmth @ level / squares
    left = level - np.outer(warmth, plain)
    alike = np.clip(np.sum(left[1:] * left[:-1]) / np.sum(left**2), 0.0, 0.9)
    scatter = np.sum(left**2, axis=0) / (len(warmth) - 2) * (1.0 + alike) / (1.0 - alike)
    share = USUAL_SPREAD**2 / (USUAL_SPREAD**2 + scatter / squares)
    slope = COUNTS_PER_KELVIN + share * (plain - COUNTS_PER_KELVIN)
    return np.asarray(slope), np.asarray(USUAL_SPREAD * np.sqrt(1.0 - share))
