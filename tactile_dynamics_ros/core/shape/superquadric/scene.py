"""A cloud of a table scene to objects, parts, the next view, and words for them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.shape.superquadric.clustering import camera_noise, clusters
from tactile_dynamics_ros.core.shape.superquadric.own_frame import into, own_frame
from tactile_dynamics_ros.core.shape.superquadric.parts import (
    TableObject,
    find_objects,
)
from tactile_dynamics_ros.core.shape.superquadric.recovery import (
    Recovery,
    check_points,
    even_choice,
)
from tactile_dynamics_ros.core.shape.superquadric.registration import registered
from tactile_dynamics_ros.core.shape.superquadric.superquadric import Superquadric
from tactile_dynamics_ros.core.shape.superquadric.views import SurfaceEntropy, View, ViewConfig

Array = NDArray[np.float64]

_MANY = 4000
"""Points that are used of a larger cloud: fits take time in proportion, and with 4000 the surface
is already known to a fiftieth of the camera's noise."""
_DIAGONAL = np.array([0.61, 0.37, 0.70])
"""Direction in a cloud's own frame along which points are thinned: along none of its faces, so that
no face falls into one step. Any other such direction does as well."""
_LAYER = 4.0
"""Height, in standard deviations of the camera's noise, up to which points belong to the table.
Lower leaves specks of the table to be taken for objects, higher cuts the foot off flat ones."""
_TABLE_SHARE = 0.3
"""Share of all points in the lowest layer from which they are a table and no object's foot. Lower
takes the foot of a wide object for a table and cuts it off, higher takes a table for an object
where clutter covers it."""
_MISFIT = 0.015
"""Misfit, as a share of the size, from which it is said that no superquadric describes an object.
Lower remarks on objects that are described well enough to grasp, higher keeps quiet about ones that
are not."""
_INSIDE = 0.05
"""Share of points inside the surface from which an object is said to look open or hollow. Strays
alone put some there; lower remarks on them, higher overlooks the inside of a cup seen from the
side."""


@dataclass(frozen=True)
class Scene:
    """What stands on the table, as far as it was seen.

    Attributes:
        objects: found objects, the one with the most points first.
        support: height of the table, m, or None.
        entropies: of each object's surface.
        next_views: for each object, None where another look would add little.
        remarks: plain sentences.
    """

    objects: tuple[TableObject, ...]
    support: float | None
    entropies: tuple[SurfaceEntropy, ...]
    next_views: tuple[View | None, ...]
    remarks: tuple[str, ...]

    def to_json(self, k: int = 0) -> dict[str, Any]:
        """Return object k for programs."""
        found, view = self.objects[k], self.next_views[k]
        return {
            "parts": [part_json(part) for part in found.parts],
            "noise_m": found.parts[0].mixture.noise,
            "outliers": found.strays,
            "entropy": self.entropies[k].mean,
            "next_view": None if view is None else view_json(view),
            "support_m": self.support,
            "objects": len(self.objects),
            "remarks": [*self.remarks, *remarks_of(found)],
        }


def read_scene(
    points: Array,
    support: float | str | None = "auto",
    config: ViewConfig | None = None,
    depth: Array | None = None,
    look: NDArray[np.intp] | None = None,
) -> Scene:
    """Find what stands on a table.

    Args:
        points: (N, 3) world, z up, m.
        support: height of the table, m; "auto" takes it from the points, None knows nothing of it.
        config: of the next view.
        depth: (N,) m, of the points along the axis of the camera that saw them; their noise then
            grows with its square, as that of stereo does. None where it is not known.
        look: (N,) number of the look that each point is from; looks are aligned to each other. None
            where the camera's poses are exact.

    Raises:
        BadInputError: there is no object.
    """
    remarks: list[str] = []
    check_points(points)
    scale = np.ones(len(points)) if depth is None else (depth / np.median(depth)) ** 2
    if support is not None:
        above, support = above_table(points, None if support == "auto" else float(support))
        points, scale = points[above], scale[above]
        look = None if look is None else look[above]
    if look is not None:
        points = _aligned(points, look)
    if len(points) > _MANY:
        some = _thinned(points, _MANY)
        points, scale = points[some], scale[some]
        remarks.append(f"{_MANY} of the points are used")
    objects = find_objects(points, support, scale)
    entropies = tuple(
        SurfaceEntropy.of_parts([part.shape for part in found.parts], found.points)
        for found in objects
    )
    views = tuple(entropy.next_view(config) for entropy in entropies)
    return Scene(tuple(objects), support, entropies, views, tuple(remarks))


def _aligned(points: Array, look: NDArray[np.intp]) -> Array:
    """Return points (N, 3) with the looks (N,) aligned."""
    numbers = np.unique(look)
    moved = points.copy()
    clouds = registered([points[look == number] for number in numbers])
    for number, cloud in zip(numbers, clouds, strict=True):
        moved[look == number] = cloud
    return moved


def above_table(points: Array, support: float | None) -> tuple[NDArray[np.bool_], float]:
    """Return which points (N,) are above the table, and its height, m.

    A height that is not known is that of the lowest level layer if many points lie in it, else that
    of the foot of the largest cluster.
    """
    thin = points[_thinned(points, _MANY)]
    noise = camera_noise(thin)
    if support is not None:
        return points[:, 2] > support + _LAYER * noise, support
    low = float(np.quantile(points[:, 2], 0.01))
    layer = np.abs(points[:, 2] - low) < 2.0 * _LAYER * noise
    if layer.mean() > _TABLE_SHARE:
        level = float(np.median(points[layer, 2]))
        return points[:, 2] > level + _LAYER * noise, level
    found = clusters(thin)
    body = thin[found[0]] if found else thin
    return np.ones(len(points), dtype=bool), float(np.quantile(body[:, 2], 0.01))


def _thinned(points: Array, count: int) -> NDArray[np.intp]:
    """Return indices of about `count` points, in even steps along a diagonal of the cloud."""
    return even_choice(into(own_frame(points, upright=False), points) @ _DIAGONAL, count)


def part_json(part: Recovery) -> dict[str, Any]:
    """Return a part for programs."""
    shape, std = part.shape, part.std
    return {
        "semi_axes_m": shape.semi_axes.tolist(),
        "exponents": shape.exponents.tolist(),
        "taper": shape.taper.tolist(),
        "x": float(shape.pose[0, 3]),
        "y": float(shape.pose[1, 3]),
        "yaw_rad": float(np.arctan2(shape.pose[1, 0], shape.pose[0, 0])),
        "pose": shape.pose.tolist(),
        "std": std,
        "footprint": shape.footprint().tolist(),
        "words": describe(part),
    }


def view_json(view: View) -> dict[str, Any]:
    """Return a camera pose for programs; the quaternion is x, y, z, w."""
    from scipy.spatial.transform import Rotation

    return {
        "position": view.pose[:3, 3].tolist(),
        "quaternion": Rotation.from_matrix(view.pose[:3, :3]).as_quat().tolist(),
        "gain": view.gain,
    }


def describe(part: Recovery) -> str:
    """Return a part in plain words, with its size in mm."""
    size = 2e3 * part.shape.semi_axes
    spread = 2e3 * max(part.std[f"a{axis}"] for axis in "xyz")
    lengths = " x ".join(f"{value:.0f}" for value in size)
    return f"{kind(part.shape)} {lengths} mm, +- {max(spread, 0.1):.1f}"


def kind(shape: Superquadric) -> str:
    """Return the name of a kind of shape."""
    (e1, e2), (k1, k2) = shape.exponents, shape.taper
    upright = e1 < 0.5
    if abs(k1) > 0.6:
        return "a wedge" if upright else "a rounded wedge"
    if k2 < -0.3:
        return "a body with a six-sided outline" if e2 < 0.5 else "a body with pointed ends"
    if k2 > 0.3:
        return "a waisted body"
    round_section = 0.7 < e2 < 1.4
    even = abs(np.log(shape.semi_axes[0] / shape.semi_axes[1])) < 0.1
    if upright:
        if round_section:
            return "a cylinder" if even else "an elliptic cylinder"
        return "a box" if e2 <= 0.7 else "a prism"
    if round_section:
        return "a ball" if even and e1 > 0.7 else "a rounded body"
    return "a rounded box"


def remarks_of(found: TableObject) -> list[str]:
    """Return what a fit cannot say, in plain sentences."""
    size = float(np.ptp(found.points, axis=0).max())
    remarks = []
    if len(found.parts) > 1:
        remarks.append(
            "nothing was seen where its parts meet: their lengths toward each other are the least "
            "that explain the points"
        )
    if found.misfit > _MISFIT * size:
        remarks.append(
            f"no superquadric describes it: surfaces are {1e3 * found.misfit:.1f} mm off (RMS) "
            "beyond the camera's noise"
        )
    inside = share_inside(found)
    if inside > _INSIDE:
        remarks.append(
            f"{100 * inside:.0f} % of its points lie inside the surface: it may be open, hollow or "
            "deformed"
        )
    return remarks


def share_inside(found: TableObject) -> float:
    """Return the share of points that lie deep inside of a part, not on any surface."""
    deep = np.zeros(len(found.points), dtype=bool)
    for part in found.parts:
        distance = part.mixture.chart.distance(part.shape, found.points)
        deep |= distance < -5.0 * part.mixture.noise
    return float(deep.mean())
