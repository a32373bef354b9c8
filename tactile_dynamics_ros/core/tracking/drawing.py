"""A posed object drawn into an image: the pixels it covers, its near surface and its outline."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from tactile_dynamics_ros.core.shape.object_shape import Edges, ObjectShape
from tactile_dynamics_ros.core.tracking.depth_image import grow, shrink
from tactile_dynamics_ros.core.tracking.scene import Scene

Array = NDArray[np.float64]
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
