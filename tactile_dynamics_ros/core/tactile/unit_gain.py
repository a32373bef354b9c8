"""Gain of one fingertip from presses against a known force."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.errors import BadInputError, NotIdentifiableError

Array = NDArray[np.float64]


@dataclass(frozen=True)
class UnitGain:
    """Factor that a unit's force estimates need, for `FingertipConfig.force_scale`.

    Attributes:
        scale: the factor. std: its standard deviation. samples: frames it rests on.
    """

    scale: float
    std: float
    samples: int


def fit_unit_gain(estimated: Array, reference: Array, weakest: float = 0.1) -> UnitGain:
    """Fit f_reference = s f_estimated over frames with a clear force.

    Errors of neighbouring frames are alike, so the standard deviation is taken from the spread of
    the factor between ten stretches of the recording.

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
    stretches = np.array_split(np.arange(count), 10)
    factors = np.array([across[rows].sum() / along[rows].sum() for rows in stretches])
    return UnitGain(
        float(across.sum() / along.sum()), float(factors.std(ddof=1) / np.sqrt(10)), count
    )
