"""Footprints of two parts that are one rigid body, as one patch."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.planar.mechanics.support import SupportPatch

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False, kw_only=True)
class PairPatch(SupportPatch):
    """Points of two footprints that one plane presses on the support.

    Attributes:
        points: (n, 2) m, frame of the first part. shares: (n,) of the area.
    """

    points: Array
    shares: Array

    @cached_property
    def _points(self) -> tuple[Array, Array]:
        return self.points, self.shares

    @cached_property
    def centroid(self) -> Array:
        """(2,) m, of both."""
        return np.asarray(self.shares @ self.points)
