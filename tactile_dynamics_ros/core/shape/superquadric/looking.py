"""Depth images of an object on a table, one after the other until another would add little."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.configuration import check_ranges, parameter
from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.shape.superquadric.parts import TableObject
from tactile_dynamics_ros.core.shape.superquadric.scene import Scene, read_scene
from tactile_dynamics_ros.core.shape.superquadric.views import View, ViewConfig

_REACH = 3.0
"""Distance, in pixels at the point's depth, within which neighbours count: 29 pixels on a face that
is looked at straight, half as many where it is seen at 60 deg."""
_LEAST_NEIGHBOURS = 6
"""Neighbours below which a point is a stray of the stereo matching. With 3 a tenth of the strays
stays, with 12 faces that are seen at a flat angle go."""
_BESIDE = 0.04
"""Distance from what is known of the object within which later looks may show more of it, m. Less
cuts off sides that were not seen yet, more takes in neighbours that stand 3 cm away."""


@dataclass(frozen=True)
class LookingConfig:
    """Which object is looked at, how often, and what of the images is used."""

    object: int = parameter(1, "the K-th largest of those that the first look shows", "", 1, 20)
    most_looks: int = parameter(6, "looks after which the shape is reported anyway", "", 1, 20)
    most_points: int = parameter(1500, "of each look that are used", "", 100, 10_000)
    align: bool = parameter(
        False, "align looks to each other: only where camera/pose is off by millimetres"
    )
    clearance: float = parameter(
        0.004, "height over the table below which points are the table's", "m", 0.0, 0.05
    )

    def __post_init__(self) -> None:
        """Check ranges."""
        check_ranges(self)


@dataclass(frozen=True)
class Sight:
    """What the looks so far tell.

    Attributes:
        scene: everything that they show.
        chosen: index of the object in it.
        view: from where to look next; None where the shape is known well enough.
    """

    scene: Scene
    chosen: int
    view: View | None


@dataclass
class Looks:
    """Points of several looks at one object.

    Attributes:
        config: which object, and when to stop.
        views: where the camera may look from.
        support: height of the table, m.
        clouds: (N, 3) of each look, world, m. depths: (N,) of each, along the camera's axis, m.
        box: (2, 3) lowest and highest corner around the chosen object; None before it is chosen.
        neighbours: what the first look told of other objects.
    """

    config: LookingConfig
    views: ViewConfig
    support: float
    clouds: list[Array] = field(default_factory=list)
    depths: list[Array] = field(default_factory=list)
    box: Array | None = None
    neighbours: tuple[str, ...] = ()

    def add(self, depth: NDArray[np.float32], intrinsics: Array, pose: Array) -> None:
        """Keep a share of the points that an image shows of the object.

        Args:
            depth: (H, W) m, NaN where it is unknown.
            intrinsics: (3, 3).
            pose: (4, 4) X_WC of the optical frame.

        Raises:
            BadInputError: nothing stands on the table there.
        """
        points, far = cloud_of(depth, intrinsics, pose)
        kept = points[:, 2] > self.support + self.config.clearance
        if self.box is not None:
            kept &= np.all((points > self.box[0]) & (points < self.box[1]), axis=1)
        points, far = points[kept], far[kept]
        kept = has_neighbours(points, far / intrinsics[0, 0])
        points, far = points[kept], far[kept]
        if len(points) == 0:
            raise BadInputError("the camera sees nothing on the table: /camera/target turns it")
        rng = np.random.default_rng(len(self.clouds))
        some = rng.permutation(len(points))[: self.config.most_points]
        self.clouds.append(points[some])
        self.depths.append(far[some])

    def take(self, sight: Sight) -> None:
        """Keep to the object that was chosen from now on."""
        found = sight.scene.objects[sight.chosen]
        if self.box is None:
            self.neighbours = tuple(sight.scene.neighbours(sight.chosen))
        corners = _corners(found)
        self.box = np.stack([corners.min(axis=0) - _BESIDE, corners.max(axis=0) + _BESIDE])

    def to_json(self, sight: Sight) -> dict[str, Any]:
        """Return what was found, for programs, with the number of looks."""
        told = sight.scene.to_json(sight.chosen)
        if self.box is not None:
            own = set(sight.scene.neighbours(sight.chosen))
            remarks = [text for text in told["remarks"] if text not in own]
            told["remarks"] = [*self.neighbours, *remarks]
        return {**told, "looks": len(self.clouds)}

    def nearest(self, scene: Scene) -> int:
        """Return the object of a scene that is in the middle of the box around the chosen one."""
        assert self.box is not None
        middle = self.box.mean(axis=0)
        away = [np.linalg.norm(_middle(found) - middle) for found in scene.objects]
        return int(np.argmin(away))

    @property
    def finished(self) -> bool:
        """Whether no more looks are allowed."""
        return len(self.clouds) >= self.config.most_looks


def _corners(found: TableObject) -> Array:
    """Return points (N, 3) that reach as far as an object does, seen or not."""
    shown = [part.shape.mesh().vertices for part in found.parts]
    return np.concatenate([found.points, *shown])


def _middle(found: TableObject) -> Array:
    corners = _corners(found)
    return np.asarray(0.5 * (corners.min(axis=0) + corners.max(axis=0)))


def judge(looks: Looks) -> Sight:
    """Fit the object to all looks and choose the next view.

    Raises:
        BadInputError: there is no object, or not as many as the number that was asked for.
    """
    numbers = np.repeat(np.arange(len(looks.clouds)), [len(cloud) for cloud in looks.clouds])
    scene = read_scene(
        np.concatenate(looks.clouds),
        looks.support,
        looks.views,
        np.concatenate(looks.depths),
        numbers if looks.config.align and len(looks.clouds) > 1 else None,
    )
    chosen = looks.config.object - 1 if looks.box is None else looks.nearest(scene)
    if chosen >= len(scene.objects):
        raise BadInputError(
            f"object {looks.config.object}: {len(scene.objects)} objects were found, "
            "the largest is 1"
        )
    view = None if looks.finished else scene.next_views[chosen]
    return Sight(scene, chosen, view)


def cloud_of(depth: NDArray[np.float32], intrinsics: Array, pose: Array) -> tuple[Array, Array]:
    """Return the points (N, 3) of a depth image (H, W) in the world and their depths (N,), m."""
    row, column = np.nonzero(np.isfinite(depth) & (depth > 0.0))
    far = depth[row, column].astype(float)
    ray = np.stack([column, row, np.ones(len(row))], axis=1) @ np.linalg.inv(intrinsics).T
    return (ray * far[:, None]) @ pose[:3, :3].T + pose[:3, 3], far


def has_neighbours(points: Array, pixel: Array) -> NDArray[np.bool_]:
    """Whether points (N, 3) have others about them, given the widths (N,) of their pixels, m."""
    count = cKDTree(points).query_ball_point(points, _REACH * pixel, return_length=True)
    return np.asarray(count > _LEAST_NEIGHBOURS)
