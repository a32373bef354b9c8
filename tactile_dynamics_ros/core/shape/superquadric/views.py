"""What of a shape has not been seen yet, and from where the next look would show most of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.configuration import check_ranges, parameter
from tactile_dynamics_ros.core.shape.superquadric.superquadric import Superquadric

_POINTS = 1500
"""Points on the surfaces of all parts: on an object of 10 cm one per 4 mm. Fewer make shares of
what is unseen coarse, more cost time for each view that is tried."""
_NEAR = 2.5
"""Distance from a measured point, in spacings of the points on the surface, within which a surface
point counts as seen (a standard deviation of the Gauss curve). Smaller lets gaps of the cloud look
unseen, larger sees round corners."""
_CELL = 1.5
"""Width of the cells of the depth buffer, in spacings of the points on the surface: each cell of a
closed surface holds at least one point. Larger hides what lies beside, smaller lets back sides
through."""
_GRAZING = 0.2
"""Least cosine between the normal of a surface and the direction to the camera at which it is seen:
78 deg. Depth cameras return little beyond. Lower counts on surfaces that a camera does not return,
higher asks for looks at what was seen well."""
_WITHIN = 0.1
"""Depth of the nearest point over the median one, below which a camera stands in or at the object
and shows nothing. Higher forbids close looks, at 0 the depth buffer has cells without end."""


@dataclass(frozen=True)
class ViewConfig:
    """Where the camera may be, and when to stop looking."""

    distance: float = parameter(0.5, "of the camera from the object", "m", 0.1, 3.0)
    least_elevation: float = parameter(20.0, "of the camera over the table", "deg", 0.0, 89.0)
    most_elevation: float = parameter(75.0, "of the camera over the table", "deg", 1.0, 90.0)
    candidates: int = parameter(60, "views that are compared", "", 4, 1000)
    threshold: float = parameter(
        0.04, "share of the surface's entropy that a view must promise", "", 0.0, 1.0
    )

    def __post_init__(self) -> None:
        """Check ranges."""
        check_ranges(self)


@dataclass(frozen=True)
class View:
    """A camera pose, x right, y down, z forward.

    Attributes:
        pose: (4, 4) X_WC.
        gain: entropy that it would show, over that of a surface of which nothing is seen.
    """

    pose: Array
    gain: float


@dataclass(frozen=True)
class SurfaceEntropy:
    """How uncertain the surfaces of parts are, from the points that lie on them.

    A point mu of a surface that is d from the nearest measured point is where it is believed to be
    with probability p = (1 + exp(-d^2 / 2 s^2)) / 2, 1 beside a measurement and 1/2 where nothing
    was seen; its entropy is -p ln p - (1 - p) ln(1 - p). Source: paper B, Eq. 10 and 11, where a
    distance stands for a probability.

    Attributes:
        points, normals: (M, 3) on the surfaces, evenly spread, world.
        entropy: (M,) over ln 2.
        spacing: m between neighbouring points.
    """

    points: Array
    normals: Array
    entropy: Array
    spacing: float

    @classmethod
    def of_parts(cls, parts: Sequence[Superquadric], cloud: Array) -> SurfaceEntropy:
        """Entropy of the surfaces of parts, given a cloud (N, 3) of the world.

        Points inside another part, or on the face on which a part stands, cannot be seen and are
        left out.
        """
        area = sum(part.area for part in parts)
        spacing = float(np.sqrt(area / _POINTS))
        found = [part.sample(max(int(_POINTS * part.area / area), 8), seed=0) for part in parts]
        points = np.concatenate([points for points, _ in found])
        normals = np.concatenate([normals for _, normals in found])
        owner = np.repeat(np.arange(len(parts)), [len(points) for points, _ in found])
        visible = normals[:, 2] > -0.9
        for k, part in enumerate(parts):
            visible &= (owner == k) | (part.gauge(part.to_body(points)) > 1.0)
        points, normals = points[visible], normals[visible]
        distance = cKDTree(cloud).query(points)[0]
        p = 0.5 * (1.0 + np.exp(-0.5 * (distance / (_NEAR * spacing)) ** 2))
        q = np.maximum(1.0 - p, 1e-12)
        return cls(points, normals, -(p * np.log(p) + q * np.log(q)) / np.log(2.0), spacing)

    @property
    def mean(self) -> float:
        """Mean entropy, 1 where nothing was seen and 0 where all was."""
        return float(self.entropy.mean())

    def gain(self, pose: Array) -> float:
        """Share of all entropy there could be that a camera at a pose (4, 4) would show.

        Points count that face the camera and that no other point hides (a depth buffer). Source:
        paper B, Eq. 14, which projects entropies instead of points.
        """
        ray = pose[:3, 3] - self.points
        distance = np.linalg.norm(ray, axis=1)
        facing = np.einsum("ij,ij->i", ray, self.normals) > _GRAZING * distance
        local = (self.points - pose[:3, 3]) @ pose[:3, :3]
        middle = float(np.median(local[:, 2]))
        if local[:, 2].min() < _WITHIN * middle:
            return 0.0
        cells = np.round(local[:, :2] / local[:, 2:] * middle / (_CELL * self.spacing)).astype(int)
        cells -= cells.min(axis=0)
        flat = cells[:, 0] * (cells[:, 1].max() + 1) + cells[:, 1]
        nearest = np.full(flat.max() + 1, np.inf)
        np.minimum.at(nearest, flat, local[:, 2])
        seen = facing & (local[:, 2] < nearest[flat] + 2.0 * _CELL * self.spacing)
        return float(self.entropy[seen].sum() / len(self.entropy))

    def next_view(self, config: ViewConfig | None = None) -> View | None:
        """Return the view with the largest gain; None where all promise less than the threshold."""
        config = config or ViewConfig()
        middle = 0.5 * (self.points.min(axis=0) + self.points.max(axis=0))
        views = [View(pose, self.gain(pose)) for pose in candidate_poses(middle, config)]
        best = max(views, key=lambda view: view.gain)
        return best if best.gain > config.threshold else None


def candidate_poses(target: Array, config: ViewConfig) -> list[Array]:
    """Return camera poses (4, 4) spread evenly over a band of the half sphere around a target.

    They lie on a spiral whose heights are even, which spreads points evenly over a sphere.
    """
    low, high = np.sin(np.deg2rad([config.least_elevation, config.most_elevation]))
    height = np.linspace(low, high, config.candidates)
    azimuth = np.pi * (3.0 - np.sqrt(5.0)) * np.arange(config.candidates)
    flat = np.sqrt(1.0 - height**2)
    away = np.stack([flat * np.cos(azimuth), flat * np.sin(azimuth), height], axis=1)
    return [looking_at(target + config.distance * d, target) for d in away]


def looking_at(position: Array, target: Array) -> Array:
    """Return the pose (4, 4) of a camera at a position that looks at a target, upright.

    Source: paper B, Eq. 12 and 13.
    """
    forward = (target - position) / np.linalg.norm(target - position)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    if np.linalg.norm(right) < 1e-6:
        right = np.array([1.0, 0.0, 0.0])
    right /= np.linalg.norm(right)
    pose = np.eye(4)
    pose[:3, :3] = np.stack([right, np.cross(forward, right), forward], axis=1)
    pose[:3, 3] = position
    return pose
