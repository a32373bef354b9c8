"""A pose held against an image: which share of the model is where it should be."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.shape.object_shape import ObjectShape
from tactile_dynamics_ros.core.tracking.scene import Scene

Array = NDArray[np.float64]

JUDGED = 2000
"""Samples of the surface that are compared with an image: shares are known to 1 % (1 / sqrt(2000) =
2 % of one half). More cost time. Fewer let scores scatter about their thresholds."""
GRAZING = 0.25
"""Cosine between view and normal, below which a surface is seen too flatly (75 deg) to be compared
in depth: a pixel then spans four times its width in depth. Higher loses the sides of round objects;
lower lets in what the camera's noise makes of edges. Tests of the tracker pass at half and twice as
much."""
_NEARBY = 1000
"""Pixels near an object that are held against its surface: what they do not explain is known to 1 %
where it is a tenth. More cost time for each pose, fewer let scores scatter."""
STRANGE = 0.01
"""Distance from the surface, m, beyond which a pixel near the object is not explained by it: more
than the camera's noise and the error of a pose that is followed. Less lowers the score of good
poses; more lets a shape that is a centimetre too small pass."""
SUNK = 0.03
"""Depth inside the support, m, at which a pose is impossible: a model error or a wrong height of
the support accounts for a few mm. Less refuses objects on a support whose height is off, more lets
poses in that are turned and sunk (a box seen from its end was, in one of nine searches)."""


@dataclass(frozen=True)
class Fit:
    """A pose with what the image says about it.

    Attributes:
        pose: (4, 4) X_CO, camera frame.
        information: (6, 6) [rotation, position], camera axes, about ``pivot`` (3,) in the camera
            frame.
        pivot: point about which rotations are counted.
        stretch: (6, 3) pull on the pose per metre by which the half extents of the object are
            larger than the model's, object axes.
        matched: model samples that are seen where they should be. refuted: whose place shows
            something else, or nothing. facing: that face the camera.
        strange: share of the pixels near the object that its surface does not explain.
        sunk: how far the model reaches into the support, m.
        misfit: root of the mean squared whitened distance of the pixels used.
    """

    pose: Array
    information: Array
    pivot: Array
    stretch: Array
    matched: int
    refuted: int
    facing: int
    strange: float
    sunk: float
    misfit: float

    @property
    def score(self) -> float:
        """Share of the visible model that is seen, times that of the pixels that it explains.

        Less, by (sunk / SUNK)^2, where the support would have to be in its place.
        """
        possible = 1.0 - min(1.0, self.sunk / SUNK) ** 2
        return possible * (1.0 - self.strange) * self.share_seen

    @property
    def share_seen(self) -> float:
        """Share of the visible model that is seen where it should be, 0 to 1."""
        seen = self.matched + self.refuted
        return self.matched / seen if seen else 0.0

    @property
    def agreement(self) -> float:
        """Matched less refuted samples, as a share of the near side."""
        return (self.matched - self.refuted) / max(self.facing, 1)

    @property
    def visible(self) -> float:
        """Share of the model's near side that nothing hides, 0 to 1."""
        return (self.matched + self.refuted) / max(self.facing, 1)


def pivot_of(shape: ObjectShape, pose: Array) -> Array:
    """Return the middle (3,) of a shape at X_CO (4, 4), about which rotations are counted."""
    return np.asarray(pose[:3, :3] @ shape.centre + pose[:3, 3])


def judge(
    shape: ObjectShape,
    scene: Scene,
    pose: Array,
    information: Array | None = None,
    stretch: Array | None = None,
    misfit: float = np.inf,
) -> Fit:
    """Compare the model's near side with the image, sample by sample.

    Args:
        shape: shape of the object.
        scene: labelled pixels.
        pose: (4, 4) X_CO.
        information: (6, 6) that is handed on.
        stretch: (6, 3) that is handed on.
        misfit: that is handed on.
    """
    points = shape.points[:JUDGED] @ pose[:3, :3].T + pose[:3, 3]
    normals = shape.normals[:JUDGED] @ pose[:3, :3].T
    cosine = -np.einsum("ij,ij->i", normals, points) / np.linalg.norm(points, axis=1)
    sunk = scene.sunk(points)
    points, near = points[cosine > GRAZING], cosine[cosine > GRAZING]
    place = scene.window.lookup(scene.camera.project(points))
    seen = place >= 0
    place, depth, near = place[seen], points[seen, 2], near[seen]
    measured = scene.window.depth[place]
    pixel = depth / scene.camera.focal_length
    slope = np.sqrt(1.0 - near**2) / near
    tolerance = 3.0 * np.hypot(scene.noise[place], 0.7 * pixel * slope) + 1e-3
    known = scene.free[place] & (measured > depth - np.maximum(0.015, tolerance))
    matched = known & (np.abs(measured - depth) < tolerance)
    passed = scene.nearest[place] > depth + tolerance
    return Fit(
        pose,
        np.zeros((6, 6)) if information is None else information,
        pivot_of(shape, pose),
        np.zeros((6, 3)) if stretch is None else stretch,
        int(matched.sum()),
        int((known & ~matched | passed).sum()),
        len(points),
        _strange(shape, scene, pose),
        sunk,
        misfit,
    )


def _strange(shape: ObjectShape, scene: Scene, pose: Array) -> float:
    """Return the share of pixels near the object that its surface does not explain."""
    arm = scene.free_points - pivot_of(shape, pose)
    points = scene.free_points[np.einsum("ij,ij->i", arm, arm) < shape.radius**2]
    if not len(points):
        return 0.0
    some = points[:: 1 + len(points) // _NEARBY]
    distance, _ = shape.distance((some - pose[:3, 3]) @ pose[:3, :3])
    return float(np.mean(distance > STRANGE))
