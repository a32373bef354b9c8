"""Gain of one fingertip, a number and a matrix, from presses against a known force."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.errors import BadInputError, NotIdentifiableError

Array = NDArray[np.float64]

_STRETCHES = 10
"""Parts of a recording whose spread tells the standard deviation of the gain, since errors of
neighbouring frames are alike: it is known to a quarter then (nine degrees of freedom). More parts
are shorter than a press and their errors alike, so that the standard deviation becomes too small;
fewer make it chance."""
_RIDGE = 10.0
"""Weight that holds the gain matrix at the identity, a quarter of what one frame of 1 N weighs.
Directions that presses contain have thousands of frames and ignore it; others stay at one. With
none, presses along one direction leave the matrix undetermined; a thousand times more would pull
gains to one."""


@dataclass(frozen=True)
class UnitGain:
    """Gain that a unit's force estimates need, for `FingertipConfig.gain`.

    Attributes:
        scale: the best number. std: its standard deviation. samples: frames it rests on.
        matrix: (3, 3) the best matrix, which turns the force too. matrix_std: (3, 3).
    """

    scale: float
    std: float
    samples: int
    matrix: Array
    matrix_std: Array


def fit_unit_gain(estimated: Array, reference: Array, weakest: float = 0.1) -> UnitGain:
    """Fit f_reference = s f_estimated and f_reference = G f_estimated, frames with a clear force.

    G is kept at the identity where no press tells otherwise. Errors of neighbouring frames are
    alike, so standard deviations are taken from the spread between ten stretches of the recording.

    Args:
        estimated: (N, 3) forces of the unit with scale 1, N.
        reference: (N, 3) known forces in the same frame, N.
        weakest: references below this are left out, N.

    Raises:
        BadInputError: the two have different shapes.
        NotIdentifiableError: fewer than 20 frames have a clear force.
    """
    estimated, reference = np.asarray(estimated, float), np.asarray(reference, float)
    if estimated.shape != reference.shape or estimated.ndim != 2 or estimated.shape[1] != 3:
        raise BadInputError(
            f"unit gain: estimated forces {estimated.shape} and known forces {reference.shape}; "
            "expected two arrays (N, 3)"
        )
    clear = np.linalg.norm(reference, axis=1) > weakest
    count = int(clear.sum())
    if count < 20:
        raise NotIdentifiableError(
            f"unit gain: {count} frames with more than {weakest} N, expected at least 20; "
            "press harder or longer"
        )
    estimated, reference = estimated[clear], reference[clear]
    weight = 1.0 / (0.05 + 0.1 * np.linalg.norm(reference, axis=1)) ** 2
    across = weight * np.sum(estimated * reference, axis=1)
    along = weight * np.sum(estimated**2, axis=1)
    stretches = np.array_split(np.arange(count), _STRETCHES)
    factors = np.array([across[rows].sum() / along[rows].sum() for rows in stretches])
    matrices = [_fit_matrix(estimated[r], reference[r], weight[r]) for r in stretches]
    return UnitGain(
        float(across.sum() / along.sum()),
        float(factors.std(ddof=1) / np.sqrt(_STRETCHES)),
        count,
        _fit_matrix(estimated, reference, weight),
        np.asarray(np.std(matrices, axis=0, ddof=1) / np.sqrt(_STRETCHES)),
    )


def _fit_matrix(estimated: Array, reference: Array, weight: Array) -> Array:
    """Weighted ridge fit of G (3, 3) towards the identity."""
    weighted = weight[:, None] * estimated
    gram = weighted.T @ estimated + _RIDGE * np.eye(3)
    return np.asarray(np.eye(3) + np.linalg.solve(gram, weighted.T @ (reference - estimated)).T)
