"""A calibrated depth camera: rays, projection, trust in its depths, sets of pixels."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.configuration import check_ranges, parameter
from tactile_dynamics_ros.core.errors import BadInputError

Mask = NDArray[np.bool_]


def grow(mask: Mask, reach: int = 1) -> Mask:
    """Return the pixels (H, W) with one of the set at most `reach` rows and columns away."""
    return _spread(_spread(mask, reach).T, reach).T


def shrink(mask: Mask, reach: int = 1) -> Mask:
    """Return the pixels (H, W) with all at most `reach` rows and columns away in the set.

    Nothing outside of the image belongs to it.
    """
    beside = np.ones((mask.shape[0] + 2, mask.shape[1] + 2), dtype=bool)
    np.logical_not(mask, out=beside[1:-1, 1:-1])
    return ~grow(beside, reach)[1:-1, 1:-1]


def grow_cross(mask: Mask) -> Mask:
    """Return a set (H, W) and the pixels above, below, left and right of its pixels."""
    grown = mask.copy()
    grown[1:] |= mask[:-1]
    grown[:-1] |= mask[1:]
    grown[:, 1:] |= mask[:, :-1]
    grown[:, :-1] |= mask[:, 1:]
    return grown


def _spread(mask: Mask, reach: int) -> Mask:
    """Return a set (H, W) and what is at most `reach` rows above or below it.

    Each pass adds what the ones before have spread, so that the reach triples.
    """
    spread, done, reach = mask.copy(), 0, min(reach, len(mask) - 1)
    while done < reach:
        step = min(2 * done + 1, reach - done)
        before = spread.copy()
        spread[step:] |= before[:-step]
        spread[:-step] |= before[step:]
        done += step
    return spread


Image = NDArray[np.float32]

SPECK_STEP = 0.01
"""Difference in depth, m, within which neighbouring pixels support each other: six standard
deviations of a stereo camera at 0.7 m, and what a surface at 70 deg changes from pixel to pixel.
Less tears steep faces to pieces, more keeps stray pixels in front of an object."""
SPECK_NEIGHBOURS = 3
"""Neighbours of eight that a pixel needs: one at the corner of an object has three. With one
less, pairs of strays support each other; with one more, corners are lost."""


@dataclass(frozen=True)
class DepthNoiseConfig:
    """Errors of a structured-light depth camera.

    Source: Nguyen, Izadi and Lovell, 2012 (axial, lateral); disparity in eighths of a pixel.
    """

    axial_floor: float = parameter(1.2e-3, "axial noise at 0.4 m", "m", 1e-5, 0.1)
    axial_growth: float = parameter(1.9e-3, "its growth with (z - 0.4 m)^2", "1/m", 0.0, 0.1)
    lateral: float = parameter(0.8, "lateral noise in pixels of an image of native width", "px", 0)
    native_width: int = parameter(640, "columns of the sensor's full image", "px", 16, 10_000)
    baseline: float = parameter(0.075, "projector to camera", "m", 1e-3, 1.0)
    disparity_steps: float = parameter(8.0, "disparity steps per native pixel", "", 0.1, 1000.0)

    def __post_init__(self) -> None:
        check_ranges(self)

    def axial_std(self, depth: Array) -> Array:
        """Return the standard deviation of depths (N,), m, quantisation included."""
        noise = self.axial_floor + self.axial_growth * (depth - 0.4) ** 2
        return np.asarray(noise)


@dataclass(frozen=True)
class PinholeCamera:
    """Where a depth camera is and how it projects; x right, y down, z forward.

    Attributes:
        intrinsics: (3, 3) camera matrix of the image as it is.
        width, height: size of the image, px.
        pose: (4, 4) X_WC.
    """

    intrinsics: Array
    width: int
    height: int
    pose: Array

    @property
    def focal_length(self) -> float:
        """Mean focal length, px."""
        return float(0.5 * (self.intrinsics[0, 0] + self.intrinsics[1, 1]))

    def rays(self, rows: Array, columns: Array) -> Array:
        """Return directions (N, 3) with z = 1 of pixels, camera frame."""
        k = self.intrinsics
        x, y = (columns - k[0, 2]) / k[0, 0], (rows - k[1, 2]) / k[1, 1]
        return np.stack([x, y, np.ones_like(x)], axis=-1)

    def project(self, points: Array) -> Array:
        """Return (column, row) (N, 2) in px of points (N, 3), camera frame, in front of it."""
        k = self.intrinsics
        scaled = points[:, :2] / points[:, 2:]
        return np.asarray(scaled * [k[0, 0], k[1, 1]] + [k[0, 2], k[1, 2]])

    def check(self, depth: Image) -> None:
        """Refuse an image of another size.

        Raises:
            BadInputError: the size differs from the camera's.
        """
        if depth.shape != (self.height, self.width):
            raise BadInputError(
                f"depth image: {depth.shape[1]} x {depth.shape[0]} pixels, camera_info says "
                f"{self.width} x {self.height}"
            )


@dataclass(frozen=True)
class Window:
    """A rectangle of a depth image, flattened.

    Attributes:
        shape: (rows, columns) of the window. origin: row and column of its first pixel.
        depth: (P,) m, NaN where invalid.
        rays: (P, 3) with z = 1, camera frame.
        pixels: (P, 2) column and row in the image.
    """

    shape: tuple[int, int]
    origin: tuple[int, int]
    depth: Array
    rays: Array
    pixels: Array

    @property
    def points(self) -> Array:
        """Measured points (P, 3), camera frame, NaN where invalid."""
        return np.asarray(self.rays * self.depth[:, None])

    def lookup(self, pixels: Array) -> NDArray[np.intp]:
        """Return indices (N,) into the window of image positions (N, 2), -1 outside of it."""
        column = np.rint(pixels[:, 0]).astype(np.intp) - self.origin[1]
        row = np.rint(pixels[:, 1]).astype(np.intp) - self.origin[0]
        inside = (row >= 0) & (row < self.shape[0]) & (column >= 0) & (column < self.shape[1])
        return np.where(inside, row * self.shape[1] + column, -1)


def without_specks(window: Window) -> Window:
    """Return a window whose lonely depths are NaN.

    A depth stays if at least `SPECK_NEIGHBOURS` of the eight around it differ by less than
    `SPECK_STEP`.
    """
    depth = window.depth.reshape(window.shape)
    padded = np.pad(depth, 1, constant_values=np.nan)
    rows, columns = window.shape
    alike = np.zeros(window.shape, dtype=np.int8)
    for row, column in product(range(3), range(3)):
        if (row, column) != (1, 1):
            beside = padded[row : row + rows, column : column + columns]
            alike += np.abs(beside - depth) < SPECK_STEP
    kept = np.where(alike >= SPECK_NEIGHBOURS, depth, np.nan)
    return replace(window, depth=kept.ravel())


def cut_window(camera: PinholeCamera, depth: Image, rows: slice, columns: slice) -> Window:
    """Return a rectangle of an image."""
    row, column = np.mgrid[rows.start : rows.stop, columns.start : columns.stop].astype(float)
    part = np.asarray(depth[rows, columns], dtype=float)
    pixels = np.stack([column.ravel(), row.ravel()], axis=-1)
    rays = camera.rays(pixels[:, 1], pixels[:, 0])
    return Window(
        (part.shape[0], part.shape[1]), (rows.start, columns.start), part.ravel(), rays, pixels
    )


def window_around(
    camera: PinholeCamera, depth: Image, centre: Array, radius: float, margin: int = 6
) -> Window | None:
    """Return the part of an image that a sphere covers; None where it lies outside.

    Args:
        camera: camera of the image.
        depth: (H, W) m.
        centre: (3,) centre of the sphere, camera frame, m.
        radius: m.
        margin: px around it.
    """
    if centre[2] < radius + 0.05:
        return None
    middle = camera.project(centre[None])[0]
    reach = camera.focal_length * radius / (centre[2] - radius) + margin
    low = np.floor(middle - reach).astype(int)
    high = np.ceil(middle + reach).astype(int) + 1
    left, top = max(low[0], 0), max(low[1], 0)
    right, bottom = min(high[0], camera.width), min(high[1], camera.height)
    if right - left < 4 or bottom - top < 4:
        return None
    return cut_window(camera, depth, slice(top, bottom), slice(left, right))
