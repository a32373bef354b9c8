"""A camera above the table, whose 64 x 64 pixels a filter is given in place of registered poses."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.planar.filter.dual import DualFilter
from tactile_dynamics_ros.core.planar.filter.observation import (
    Observation,
    Pixels,
    coverage,
    pose_of_pixels,
)
from tactile_dynamics_ros.core.planar.mechanics.outline import convex_hull
from tactile_dynamics_ros.synthetic.pushed.sensed import POSE_STD, SensedStep

_SIDE, _PIXEL = 64, 0.004
"""Pixels of a side of the crop, as paper B has it, and m of each: 26 cm hold the largest object."""
_NOISE = 0.1
"""Standard deviation of a pixel's share of object: a depth camera whose noise is a tenth of the
object's height, 3 mm of 30."""
_SIZE = 3e-4
"""m, std of what each half of the outline is off by: a shape that was fitted to points."""
_FINER = 3
"""Points of a pixel's side at which the true outline is looked up: shares are right to a tenth."""
_REACH = np.array([2e-3, 2e-3, 0.03])
"""m and rad, how far a pose may be from where the filter expects it when pixels are made linear."""
NO_LASTING = np.array([1e-6, 1e-6, 1e-5])
"""m and rad, next to no error that pixels share: they count as independent, as in paper B."""
LASTING = POSE_STD
"""m and rad, an error that pixels share as large as that of a registered pose."""


class Camera:
    """What a filter is shown of each step; poses come from pixels.

    Args:
        scene: whose first link is seen.
        lasting: (3,) m and rad, error that the filter presumes of all pixels together.
        seed: of noise and of the shape's error.
    """

    def __init__(self, scene: Any, lasting: Array, seed: int) -> None:
        link = scene.thing.links[0]
        self._rng, self._lasting = np.random.default_rng([seed, 11]), lasting
        self._hull, reach = convex_hull(link.corners), np.abs(link.corners).max(axis=0)
        self._true = link.corners * (1.0 + _SIZE * self._rng.standard_normal(2) / reach)

    def __call__(self, belief: DualFilter, step: SensedStep) -> Observation:
        """Observation whose pose is that of the pixels."""
        mean, covariance = belief.state
        expected = mean[:3] + step.period * mean[3:6]
        places = (np.round(expected[:2] / _PIXEL) + _GRID) * _PIXEL
        pixels = Pixels(
            self._taken(step.truth[:3], places),
            np.full(len(places), _NOISE),
            lambda poses: coverage(self._hull, poses, places, _PIXEL),
            self._lasting,
        )
        wide = covariance[:3, :3] + np.diag(_REACH**2)
        return replace(step.usual, poses=(pose_of_pixels(pixels, expected, wide),))

    def _taken(self, pose: Array, places: Array) -> Array:
        """Share (m,) of each pixel that the true outline covers, with noise."""
        cos, sin = np.cos(pose[2]), np.sin(pose[2])
        corners = self._true @ np.array([[cos, sin], [-sin, cos]]) + pose[:2]
        points = (places[:, None] + _PIXEL * _FINE).reshape(-1, 2)
        share = _inside(corners, points).reshape(len(places), -1).mean(axis=1)
        return np.asarray(share + _NOISE * self._rng.standard_normal(len(share)))


def _raster(side: int, spacing: float) -> Array:
    """(side^2, 2) points around zero."""
    axis = spacing * (np.arange(side) - 0.5 * (side - 1))
    return np.stack(np.meshgrid(axis, axis), axis=-1).reshape(-1, 2)


_GRID = _raster(_SIDE, 1.0)
"""Centres of the pixels of the crop, in pixels from its middle, which rests on a fixed raster."""
_FINE = _raster(_FINER, 1.0 / _FINER)
"""Points of one pixel, in pixels from its centre, at which the true outline is looked up."""


def _inside(corners: Array, points: Array) -> NDArray[np.bool_]:
    """Whether (m,) points lie in a polygon: a ray to the right crosses it in odd number."""
    odd = np.zeros(len(points), dtype=bool)
    for start, end in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        between = (start[1] > points[:, 1]) != (end[1] > points[:, 1])
        rise = end[1] - start[1]
        if rise != 0.0:
            across = start[0] + (points[:, 1] - start[1]) * (end[0] - start[0]) / rise
            odd ^= between & (points[:, 0] < across)
    return odd
