"""Align an object's surface with a depth image: distances inside, outline at the border.

Two kinds of measurements correct the pose, both from pixels that show neither robot nor support:

- a pixel that shows the object lies on its surface: sdf(X^-1 p) = 0, whitened by the noise of the
  depth along the surface's normal, with a redescending weight;
- near the outline a pixel shows the object with probability Phi(-s / sigma), where s is its
  distance outside of the outline; this is a probit regression, and where a border is hidden by a
  finger or lies in the projector's shadow it has no pixels to learn from and keeps quiet.

The information matrix of both is that of the pose; directions that nothing constrains (the axis of
a cylinder) are left alone by Levenberg-Marquardt steps and carry the covariance of not knowing.

Source: Fitzgibbon 2003 (distance fields in registration); Stoiber et al. 2022 (probabilistic
outlines); Levenberg-Marquardt.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from scipy.special import ndtr

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.configuration import check_ranges, parameter
from tactile_dynamics_ros.core.rigid_body.rotation import cross, exp_so3, twice
from tactile_dynamics_ros.core.shape.object_shape import ObjectShape
from tactile_dynamics_ros.core.tracking.depth_image import DepthNoiseConfig
from tactile_dynamics_ros.core.tracking.fit import (
    GRAZING,
    Drawing,
    Fit,
    Outline,
    draw,
    draw_outline,
    judge,
    keep_contested,
    pivot_of,
    trace,
)
from tactile_dynamics_ros.core.tracking.scene import Scene

Selection = TypeVar("Selection", NDArray[np.float64], NDArray[np.intp])

PLANAR = (2, 3, 4)
"""Of [rotation, position] in world axes, what is left on a level support: yaw, x, y. Fixed by that
order and by z being up; more coordinates let noise tilt an object off its support."""
BLUR = (4.0, 2.0, 1.0)
"""Blur of the outline in the first fine steps, over `outline_std`: a border that is pixels away is
still measured. Without it fits end where edges do not meet yet. Larger or more of them blur borders
of other things in, and each costs a step."""
OBJECT_TOLERANCE = 0.012
"""Difference in depth, m, within which a pixel beside the outline shows the object: eight standard
deviations of the camera at 0.8 m (1.5 mm). At half of it a box seen from its end is taken for one
that sinks into the table (test_vision_tracker.py); at twice as much those tests pass too, but a
finger behind the border may count as the object."""
EMPTY_TOLERANCE = 0.02
"""Depth behind the object, m, from which a pixel beside the outline sees past it. Between the two
it counts as neither, since an edge mixes both. At twice as much a box seen from its end is taken
for one that sinks into the table (test_vision_tracker.py)."""


@dataclass(frozen=True)
class RegistrationConfig:
    """How pixels are weighed against a model."""

    coarse_reach: float = parameter(0.02, "reach of the first steps", "m", 1e-3, 0.2)
    fine_reach: float = parameter(0.008, "reach of the last steps", "m", 1e-3, 0.2)
    shift_steps: int = parameter(0, "first steps, which do not turn the object", "", 0, 100)
    coarse_steps: int = parameter(3, "steps with the coarse reach", "", 0, 100)
    fine_steps: int = parameter(5, "steps with the fine reach and the outline", "", 1, 100)
    most_points: int = parameter(700, "pixels on the surface that are used", "", 50, 100_000)
    model_std: float = parameter(3e-4, "error of the model's surface", "m", 0.0, 0.05)
    outline_std: float = parameter(0.55, "blur of the outline", "px", 0.05, 10.0)
    outline_outliers: float = parameter(0.05, "share of mistaken pixels at the outline", "", 0, 0.5)
    outline_band: float = parameter(2.5, "width of the outline's band to each side", "px", 0.5, 20)
    damping_rotation_deg: float = parameter(3.0, "step in a blind direction", "deg", 1e-3, 90.0)
    damping_position: float = parameter(5e-3, "step in a blind direction", "m", 1e-6, 1.0)

    def __post_init__(self) -> None:
        check_ranges(self)


class Registration:
    """Finds the pose of one shape in depth images.

    Args:
        shape: shape of the object.
        config: weights. noise: of the camera.
        planar: whether the object only slides and turns on a level support.
    """

    def __init__(
        self,
        shape: ObjectShape,
        config: RegistrationConfig | None = None,
        noise: DepthNoiseConfig | None = None,
        planar: bool = False,
    ) -> None:
        self.shape = shape
        self.planar = planar
        self.config = config or RegistrationConfig()
        self.noise = noise or DepthNoiseConfig()

    def align(self, scene: Scene, seed: Array, near: bool = False) -> Fit:
        """Return the best pose near a seed.

        Args:
            scene: labelled pixels.
            seed: (4, 4) X_CO to start from.
            near: whether the image agrees with the seed, so that the steps from afar are left out.
        """
        config, pose = self.config, np.array(seed, dtype=float)
        for k in range(0 if near else config.shift_steps + config.coarse_steps):
            system = self._nearest_terms(scene, pose)
            turns = 0.0 if k < config.shift_steps else 1.0
            pose = self._step(scene, pose, system.information, system.gradient, turns)
        for k in range(1 if near else 0, config.fine_steps):
            blur = BLUR[min(k, len(BLUR) - 1)]
            if k < len(BLUR):
                drawing = draw(self.shape, scene, pose, blur * config.outline_band)
                surface, label = (
                    self._facing_pixels(scene, drawing),
                    _label_border(scene, drawing, self.planar),
                )
            system = self._ray_terms(scene, pose, drawing, surface)
            outline = self._outline_terms(scene, pose, drawing, label, blur)
            information = system.information + outline.information
            pose = self._step(scene, pose, information, system.gradient + outline.gradient)
        stretch = system.stretch + outline.stretch
        return judge(self.shape, scene, pose, information, stretch, system.misfit)

    def _step(
        self, scene: Scene, pose: Array, information: Array, gradient: Array, turns: float = 1.0
    ) -> Array:
        """Return the pose after a damped Newton step; turns is 0 where it may only shift."""
        turn, shift = np.deg2rad(self.config.damping_rotation_deg), self.config.damping_position
        damping = np.diag([turn**-2.0] * 3 + [shift**-2.0] * 3)
        free = np.diag([turns] * 3 + [1.0] * 3)
        basis = self._freedom(scene)
        system = basis.T @ (free @ information @ free + damping) @ basis
        step = basis @ np.linalg.solve(system, basis.T @ free @ gradient)
        pivot = pivot_of(self.shape, pose)
        moved = pose.copy()
        turned = exp_so3(np.asarray(step[:3], dtype=float))
        moved[:3, :3] = turned @ pose[:3, :3]
        moved[:3, 3] = turned @ (pose[:3, 3] - pivot) + pivot + step[3:]
        return moved

    def _freedom(self, scene: Scene) -> Array:
        """Return the motions (6, K) that are sought, camera axes."""
        if not self.planar:
            return np.eye(6)
        return twice(scene.camera.pose[:3, :3]).T[:, PLANAR]

    def _nearest_terms(self, scene: Scene, pose: Array) -> _System:
        """Return the normal equations of pixels drawn to the nearest surface, from afar."""
        window, reach = scene.window, self.config.coarse_reach
        index, points = np.flatnonzero(scene.free), scene.free_points
        near = (
            np.sum((points - pivot_of(self.shape, pose)) ** 2, axis=1)
            < (self.shape.radius + reach) ** 2
        )
        index, points = self._thin(index[near]), self._thin(points[near])
        distance, normal = self.shape.distance((points - pose[:3, 3]) @ pose[:3, :3])
        normal = normal @ pose[:3, :3].T
        cosine = _cosine(normal, window.rays[index])
        keep = (np.abs(distance) < reach) & (cosine > GRAZING)
        foot = points - distance[:, None] * normal
        found = _Pixels(index[keep], foot[keep], normal[keep], distance[keep], cosine[keep])
        return self._normal_equations(scene, pose, found, reach)

    def _facing_pixels(self, scene: Scene, drawing: Drawing) -> NDArray[np.intp]:
        """Return indices of pixels that show the near side, or what is close to it."""
        near = np.abs(scene.window.depth - drawing.depth) < 2.0 * self.config.fine_reach
        return self._thin(np.flatnonzero(scene.free & drawing.inner & near))

    def _ray_terms(
        self, scene: Scene, pose: Array, drawing: Drawing, index: NDArray[np.intp]
    ) -> _System:
        """Return the normal equations of pixels against the plane that their own rays meet."""
        window, reach = scene.window, self.config.fine_reach
        rays = window.rays[index]
        depth, normal, hit = trace(self.shape, rays, drawing.depth[index], pose)
        cosine = _cosine(normal, rays)
        distance = (window.depth[index] - depth) * np.einsum("ij,ij->i", normal, rays)
        keep = hit & (np.abs(distance) < reach) & (cosine > GRAZING)
        foot = rays * depth[:, None]
        found = _Pixels(index[keep], foot[keep], normal[keep], distance[keep], cosine[keep])
        return self._normal_equations(scene, pose, found, reach)

    def _thin(self, values: Selection) -> Selection:
        stride = 1 + len(values) // (2 * self.config.most_points)
        return values[::stride]

    def _normal_equations(
        self, scene: Scene, pose: Array, pixels: _Pixels, reach: float
    ) -> _System:
        if len(pixels.index) < 6:
            return _NOTHING
        distance = pixels.distance
        std = self._distance_std(scene, pixels)
        limit = 3.0 * np.maximum(3.0 * std, reach / 3.0)
        weight = np.maximum(0.0, 1.0 - (distance / limit) ** 2) ** 2 / std**2
        arm = pixels.foot - pivot_of(self.shape, pose)
        jacobian = np.hstack([cross(arm, pixels.normal), pixels.normal])
        weighted = jacobian * weight[:, None]
        used = np.abs(distance) < 3.0 * std
        misfit = np.sqrt(np.mean((distance[used] / std[used]) ** 2)) if used.any() else np.inf
        stretch = self._stretched(pose, pixels.foot, pixels.normal)
        return _System(
            weighted.T @ jacobian, weighted.T @ distance, weighted.T @ stretch, float(misfit)
        )

    def _stretched(self, pose: Array, points: Array, across: Array) -> Array:
        """Return how far points move along given directions as the half extents grow.

        Args:
            pose: (4, 4) X_CO.
            points: (N, 3) camera frame, m.
            across: (N, 3) directions, camera frame.

        Returns:
            (N, 3) by the half extents along the object's axes.
        """
        arm = (points - pivot_of(self.shape, pose)) @ pose[:3, :3]
        return np.asarray(arm / self.shape.half * (across @ pose[:3, :3]))

    def _distance_std(self, scene: Scene, pixels: _Pixels) -> Array:
        """Return the noise of distances along the normal (N,), m."""
        depth, cosine, axial = pixels.foot[:, 2], pixels.cosine, scene.noise[pixels.index]
        f = scene.camera.focal_length
        native = f * self.noise.native_width / scene.camera.width
        quantum = depth**2 / (self.noise.disparity_steps * native * self.noise.baseline)
        across = self.noise.lateral * depth / native
        along = axial**2 + quantum**2 / 12.0
        sine2 = 1.0 - cosine**2
        return np.asarray(np.sqrt(along * cosine**2 + across**2 * sine2 + self.config.model_std**2))

    def _outline_terms(
        self,
        scene: Scene,
        pose: Array,
        drawing: Drawing,
        label: NDArray[np.int8],
        blur: float,
    ) -> _System:
        """Return the normal equations of the probit model of the border's pixels.

        Args:
            scene: labelled pixels.
            pose: (4, 4) X_CO.
            drawing: drawing of the shape near that pose.
            label: (P,) what the border's pixels show.
            blur: factor on the blur of the outline, to catch borders that are far off.
        """
        outline = draw_outline(self.shape, scene, pose, drawing)
        index = np.flatnonzero(label)
        if outline is None or len(index) < 4:
            return _NOTHING
        distance, nearest = _distance_to(outline, scene.window.pixels[index])
        band = np.abs(distance) < blur * self.config.outline_band
        index, distance, nearest = index[band], distance[band], nearest[band]
        across = _outline_slope(scene, outline)[nearest]
        points = outline.points[nearest]
        jacobian = np.hstack([cross(points - pivot_of(self.shape, pose), across), across])
        sign, sigma = label[index].astype(float), blur * self.config.outline_std
        outliers = self.config.outline_outliers
        level = -sign * distance / sigma
        density = (1.0 - 2.0 * outliers) * np.exp(-0.5 * level**2) / np.sqrt(2.0 * np.pi)
        chance = outliers + (1.0 - 2.0 * outliers) * ndtr(level)
        fisher = density**2 / (chance * (1.0 - chance)) / sigma**2
        pull = sign * density / chance / sigma
        weighted = jacobian * fisher[:, None]
        stretch = weighted.T @ self._stretched(pose, points, across)
        return _System(weighted.T @ jacobian, jacobian.T @ pull, stretch, np.inf)


@dataclass(frozen=True)
class _System:
    """Normal equations of one step.

    Attributes:
        information: (6, 6) [rotation, position]. gradient: (6,) pull on the pose.
        stretch: (6, 3) pull on it per metre by which the half extents are larger.
        misfit: root of the mean squared whitened distance.
    """

    information: Array
    gradient: Array
    stretch: Array
    misfit: float


_NOTHING = _System(np.zeros((6, 6)), np.zeros(6), np.zeros((6, 3)), np.inf)
"""What too few pixels tell: no information, and a misfit without end from which no pose is
improved. A finite misfit would let views that show nothing look like good fits."""


@dataclass(frozen=True)
class _Pixels:
    """Pixels on the object: where the model is, its normal there, and how far it is missed."""

    index: NDArray[np.intp]
    foot: Array
    normal: Array
    distance: Array
    cosine: Array


def _cosine(normal: Array, rays: Array) -> Array:
    """Return the cosine (N,) between normals and the way back to the camera."""
    return np.asarray(-np.einsum("ij,ij->i", normal, rays) / np.linalg.norm(rays, axis=1))


def _label_border(scene: Scene, drawing: Drawing, standing: bool) -> NDArray[np.int8]:
    """Return +1 where a pixel shows the object, -1 where it sees past it, 0 where unknown.

    Only pixels near both kinds count: elsewhere one side of the border is hidden. Beside an object
    that stands on the support, the support is what is seen past it.
    """
    depth = scene.window.depth
    label = np.zeros(len(depth), dtype=np.int8)
    near = scene.free & drawing.band
    label[near & (np.abs(depth - drawing.depth) < OBJECT_TOLERANCE)] = 1
    past = (scene.bare if standing else scene.free) & drawing.band
    label[past & (depth > drawing.depth + EMPTY_TOLERANCE)] = -1
    return keep_contested(label.reshape(scene.window.shape), drawing.reach).ravel()


def _outline_slope(scene: Scene, outline: Outline) -> Array:
    """Return by how many px (K, 3) each point of the outline moves outwards per metre of shift."""
    x, y, z = outline.points.T
    f = scene.camera.intrinsics
    across = np.zeros((len(x), 3))
    across[:, 0] = outline.normals[:, 0] * f[0, 0] / z
    across[:, 1] = outline.normals[:, 1] * f[1, 1] / z
    across[:, 2] = -(across[:, 0] * x + across[:, 1] * y) / z
    return across


def _distance_to(outline: Outline, pixels: Array) -> tuple[Array, NDArray[np.intp]]:
    """Return how far pixels lie outside of the outline, px, and the nearest outline points."""
    _, nearest = cKDTree(outline.pixels).query(pixels)
    offset = pixels - outline.pixels[nearest]
    return np.einsum("ij,ij->i", offset, outline.normals[nearest]), nearest
