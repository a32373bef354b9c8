"""A pushed object that is known beforehand, from earlier recordings."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

KNOWN_NAMES = ("ln_friction_force", "ln_mass", "com_x", "com_y")
"""What is remembered, in the order of covariances of estimates; files have these names, so that
another order reads old files wrongly."""


@dataclass(frozen=True, eq=False)
class KnownPushed:
    """Four numbers of an object on a support, in its frame.

    Attributes:
        values: (4,) of KNOWN_NAMES: ln N, ln kg, m, m.
        covariance: (4, 4) of them.
        name: where it comes from.
        undetermined: names of an estimate that nothing has told yet.
        recordings: number of recordings that it comes from.
    """

    values: Array
    covariance: Array
    name: str
    undetermined: tuple[str, ...] = ()
    recordings: int = 1
