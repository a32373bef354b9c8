"""A cloud of a table scene to objects, parts and the next view."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.shape.superquadric.clustering import (
    camera_noise,
    clusters,
    into,
    own_frame,
)
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
from tactile_dynamics_ros.core.shape.superquadric.views import SurfaceEntropy, View, ViewConfig
from tactile_dynamics_ros.core.shape.superquadric.words import describe, remarks_of

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
_CUT_OUT = 5e-3
"""Standard deviation of a foot that nobody saw, m: who cuts a table out of a cloud cuts 3 to 10 mm
above it. Smaller calls heights exact that are short by as much, larger says little of flat
objects."""
_MIDDLE, _SHOWN = 0.7, 0.2
"""Share of the half width within which points of the lowest layer lie under a part, and share of
that layer from which they show its bottom: half of a layer that has one, none of a wall that was
cut off. Strays are a tenth at most."""


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
            "remarks": [*self.remarks, *self.neighbours(k), *remarks_of(found)],
        }

    def neighbours(self, k: int) -> list[str]:
        """Say which other objects stand beside object k, if any."""
        if len(self.objects) == 1:
            return []
        others = "; ".join(
            f"{n + 1} at x {x:.0f}, y {y:.0f} mm"
            for n, other in enumerate(self.objects)
            if n != k
            for x, y in [1e3 * other.parts[0].shape.pose[:2, 3]]
        )
        return [f"{len(self.objects)} objects: this is {k + 1}, by points seen; {others}"]


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
    guessed = False
    if support is not None:
        told = None if support == "auto" else float(support)
        above, support = above_table(points, told)
        guessed = told is None and bool(above.all())
        points, scale = points[above], scale[above]
        look = None if look is None else look[above]
    if look is not None:
        points = _aligned(points, look)
    if len(points) > _MANY:
        some = _thinned(points, _MANY)
        points, scale = points[some], scale[some]
        remarks.append(f"{_MANY} of the points are used")
    objects = find_objects(points, support, scale)
    if guessed and support is not None:
        objects = [_with_unseen_foot(found, support) for found in objects]
    if any(part.foot_std for found in objects for part in found.parts):
        remarks.append(
            "no table in the points: it is taken to be at their foot; where they were cut off "
            "above it, objects are higher by as much (`--support` tells where it is)"
        )
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


def _with_unseen_foot(found: TableObject, support: float) -> TableObject:
    """The object with parts whose height is unsure, unless points show its bottom."""
    lowest = found.points[found.points[:, 2] < support + 2.0 * _LAYER * found.floor]
    under = np.zeros(len(lowest), dtype=bool)
    for part in found.parts:
        flat = part.shape.to_body(lowest) * [1.0, 1.0, 0.0]
        under |= part.shape.gauge(flat) < _MIDDLE
    if len(lowest) and under.mean() > _SHOWN:
        return found
    parts = tuple(replace(part, foot_std=_CUT_OUT) for part in found.parts)
    return replace(found, parts=parts)


def _thinned(points: Array, count: int) -> NDArray[np.intp]:
    """Return indices of about `count` points, in even steps along a diagonal of the cloud."""
    return even_choice(into(own_frame(points, upright=False), points) @ _DIAGONAL, count)


def part_json(part: Recovery) -> dict[str, Any]:
    """Return a part for programs."""
    shape, std = part.shape, part.std
    return {
        "semi_axes_m": shape.semi_axes.tolist(),
        "extents_m": shape.extents().tolist(),
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
