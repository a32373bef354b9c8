"""A pose held against an image: the object drawn into it, and which share fits."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.shape.object_shape import Edges, ObjectShape
from tactile_dynamics_ros.core.tracking.depth_image import grow, shrink
from tactile_dynamics_ros.core.tracking.scene import Scene

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


Mask = NDArray[np.bool_]

_PROBE = 1.5
"""Distance, pixels, outside of a rim point at which the drawing must be empty for the point to
count as outline: more than rounding to pixels (0.7), less than the band of the outline (2.5). A
larger one drops the rim of thin parts, a smaller one takes inner edges for outline."""
_NEWTON_STEPS = 2
"""Steps from the drawn depth to the surface along a ray. A step is exact on a plane and limited to
1 cm; rays that have not met the surface before the last one (see `_HIT`) are left out: one of a
thousand, and the others end within 3 um of where a third step takes them (parts of the planar
object 145). With one, curved surfaces lose points; more cost an evaluation of all rays each."""
_HIT = 3e-4
"""Distance to the surface, m, from which a ray has met it: the model's own error
(`RegistrationConfig.model_std`). Less leaves out curved parts, more takes grazing rays in."""


@dataclass(frozen=True)
class Drawing:
    """Picture of an object in a window, as if nothing hid it.

    Attributes:
        mask: (H, W) pixels that the object covers.
        depth: (P,) depth of the object, or of its nearest part, m.
        inner: (P,) covered pixels that do not touch the border.
        band: (P,) pixels near the border. reach: how near, px.
    """

    mask: Mask
    depth: Array
    inner: Mask
    band: Mask
    reach: int


@dataclass(frozen=True)
class Outline:
    """Where the object ends in the image, to a fraction of a pixel.

    Attributes:
        points: (K, 3) on the object's rim, camera frame, m.
        pixels: (K, 2) column and row of them.
        normals: (K, 2) unit, outwards.
    """

    points: Array
    pixels: Array
    normals: Array


def draw(shape: ObjectShape, scene: Scene, pose: Array, band: float) -> Drawing:
    """Draw the near side of a shape from its samples.

    Args:
        shape: shape of the object.
        scene: into which it is drawn.
        pose: (4, 4) X_CO.
        band: width of the border's band to each side, px.
    """
    reach = int(np.ceil(band))
    window = scene.window
    facing = shape.planes + shape.normals @ (pose[:3, :3].T @ pose[:3, 3]) < 0.0
    points = shape.points[facing] @ pose[:3, :3].T + pose[:3, 3]
    place = window.lookup(scene.camera.project(points))
    inside = place >= 0
    depth = np.full(window.shape[0] * window.shape[1], np.inf)
    np.minimum.at(depth, place[inside], points[inside, 2])
    image = depth.reshape(window.shape)
    drawn = np.isfinite(image)
    mask = shrink(grow(drawn))
    border = grow(mask, reach) & ~shrink(mask, reach)
    filled = _filled(image, drawn, reach + 1)
    return Drawing(mask, filled.ravel(), shrink(mask).ravel(), border.ravel(), reach)


def _filled(image: Array, drawn: Mask, reach: int) -> Array:
    """Return an image (H, W) whose empty pixels near drawn ones have the nearest one's value."""
    filled = image.copy()
    rows, columns = (np.flatnonzero(drawn.any(axis=axis)) for axis in (1, 0))
    if len(rows) == 0:
        return filled
    near = tuple(slice(max(k[0] - reach, 0), k[-1] + reach + 1) for k in (rows, columns))
    row, column = ndimage.distance_transform_edt(
        ~drawn[near], return_distances=False, return_indices=True
    )
    filled[near] = image[near][row, column]
    return filled


def trace(shape: ObjectShape, rays: Array, depth: Array, pose: Array) -> tuple[Array, Array, Mask]:
    """Return where rays meet the surface near given depths.

    Args:
        shape: shape of the object.
        rays: (N, 3) with z = 1, camera frame.
        depth: (N,) to start, m.
        pose: (4, 4) X_CO.

    Returns:
        Depths (N,), outward normals (N, 3) in the camera frame, and which rays meet it.
    """
    direction, start = rays @ pose[:3, :3], -pose[:3, :3].T @ pose[:3, 3]
    for _ in range(_NEWTON_STEPS):
        distance, normal = shape.distance(start + depth[:, None] * direction)
        slope = np.minimum(np.einsum("ij,ij->i", normal, direction), -0.1)
        depth = depth - np.clip(distance / slope, -0.01, 0.01)
    return depth, normal @ pose[:3, :3].T, np.abs(distance) < _HIT


def draw_outline(shape: ObjectShape, scene: Scene, pose: Array, drawing: Drawing) -> Outline | None:
    """Return the outline of a shape at X_CO (4, 4), or None where it is out of sight."""
    edges = shape.edges
    eye = -pose[:3, :3].T @ pose[:3, 3]
    facing = edges.face_normals @ eye - edges.face_planes
    front = facing > 0.0
    rim = np.flatnonzero((front[edges.faces[:, 0]] != front[edges.faces[:, 1]])[edges.edge])
    points = edges.points[rim] @ pose[:3, :3].T + pose[:3, 3]
    if len(points) < 4 or points[:, 2].min() < 0.05:
        return None
    pixels, normals = _image_normals(edges, scene, pose, points, rim, np.abs(facing))
    outside = scene.window.lookup(pixels + _PROBE * normals)
    border = (outside >= 0) & ~drawing.mask.ravel()[outside]
    if border.sum() < 4:
        return None
    return Outline(points[border], pixels[border], normals[border])


def keep_contested(label: NDArray[np.int8], reach: int) -> NDArray[np.int8]:
    """Return labels (H, W) of +1 and -1 with those set to 0 that have no opposite nearby."""
    near_object, near_empty = grow(label == 1, reach), grow(label == -1, reach)
    return np.where(np.where(label == 1, near_empty, near_object), label, 0).astype(np.int8)


def _image_normals(
    edges: Edges,
    scene: Scene,
    pose: Array,
    points: Array,
    rim: NDArray[np.intp],
    facing: Array,
) -> tuple[Array, Array]:
    """Return image positions of rim points and the outward normals of the outline there.

    Of the two triangles at a rim, n = |f_b| n_a + |f_a| n_b is perpendicular to the ray and
    points outwards.
    """
    camera = scene.camera
    pixels = camera.project(points)
    tangents = edges.tangents[rim] @ pose[:3, :3].T
    line = camera.project(points + 1e-3 * tangents) - pixels
    one, other = edges.faces[edges.edge[rim]].T
    outward = facing[other, None] * edges.face_normals[one]
    outward += facing[one, None] * edges.face_normals[other]
    outward = outward @ pose[:3, :3].T
    outward /= np.maximum(np.linalg.norm(outward, axis=1), 1e-12)[:, None]
    away = camera.project(points + 1e-3 * outward) - pixels
    normals = np.stack([line[:, 1], -line[:, 0]], axis=1)
    normals /= np.maximum(np.linalg.norm(normals, axis=1), 1e-12)[:, None]
    sign = np.sign(np.einsum("ij,ij->i", normals, away))
    return pixels, normals * sign[:, None]
