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

from tactile_dynamics_ros.core.configuration import check_ranges, parameter
from tactile_dynamics_ros.core.rigid_body.rotation import cross, exp_so3
from tactile_dynamics_ros.core.shape.object_shape import ObjectShape
from tactile_dynamics_ros.core.tracking.depth_image import DepthNoiseConfig
from tactile_dynamics_ros.core.tracking.drawing import (
    Drawing,
    Outline,
    draw,
    draw_outline,
    keep_contested,
    trace,
)
from tactile_dynamics_ros.core.tracking.scene import Scene

Array = NDArray[np.float64]
Selection = TypeVar("Selection", NDArray[np.float64], NDArray[np.intp])

JUDGED = 2000
"""Samples of the surface that are compared with an image: shares are known to 1 % (1 / sqrt(2000) =
2 % of one half). More cost time."""
BLUR = (4.0, 2.0, 1.0)
"""Blur of the outline in the first fine steps, over `outline_std`: a border that is pixels away is
still felt. Without it fits end where edges do not meet yet."""
GRAZING = 0.25
"""Cosine between view and normal, below which a surface is seen too flatly (75 deg) to be compared
in depth: a pixel then spans four times its width in depth. Higher loses the sides of round objects;
lower lets in what the camera's noise makes of edges. Tests of the tracker pass at half and twice as
much."""
OBJECT_TOLERANCE = 0.012
"""Difference in depth, m, within which a pixel beside the outline shows the object: eight standard
deviations of the camera at 0.8 m (1.5 mm). At half of it a box seen from its end is taken for one
that sinks into the table (test_vision_tracker.py); at twice as much those tests pass too, but a
finger behind the border may count as the object."""
EMPTY_TOLERANCE = 0.02
"""Depth behind the object, m, from which a pixel beside the outline sees past it. Between the two
it counts as neither, since an edge mixes both. At twice as much a box seen from its end is taken
for one that sinks into the table (test_vision_tracker.py)."""
STRANGE = 0.01
"""Distance from the surface, m, beyond which a pixel near the object is not explained by it: more
than the camera's noise and the error of a pose that is followed. Less lowers the score of good
poses; more lets a shape that is a centimetre too small pass."""
SUNK = 0.03
"""Depth inside the support, m, at which a pose is impossible: a model error or a wrong height of
the support accounts for a few mm. Less refuses objects on a support whose height is off, more lets
poses in that are turned and sunk (a box seen from its end was, in one of nine searches)."""


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


@dataclass(frozen=True)
class Fit:
    """A pose with what the image says about it.

    Attributes:
        pose: (4, 4) X_CO, camera frame.
        information: (6, 6) [rotation, position], camera axes, about ``pivot`` (3,) in the camera
            frame.
        pivot: point about which rotations are counted.
        matched: model samples that are seen where they should be. refuted: whose place shows
            something else, or nothing. facing: that face the camera.
        strange: share of the pixels near the object that its surface does not explain.
        sunk: how far the model reaches into the support, m.
        misfit: root of the mean squared whitened distance of the pixels used.
    """

    pose: Array
    information: Array
    pivot: Array
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
        seen = self.matched + self.refuted
        possible = 1.0 - min(1.0, self.sunk / SUNK) ** 2
        return possible * (1.0 - self.strange) * self.matched / seen if seen else 0.0

    @property
    def agreement(self) -> float:
        """Matched less refuted samples, as a share of the near side."""
        return (self.matched - self.refuted) / max(self.facing, 1)

    @property
    def visible(self) -> float:
        """Share of the model's near side that nothing hides, 0 to 1."""
        return (self.matched + self.refuted) / max(self.facing, 1)


class Registration:
    """Finds the pose of one shape in depth images.

    Args:
        shape: shape of the object.
        config: weights. noise: of the camera.
    """

    def __init__(
        self,
        shape: ObjectShape,
        config: RegistrationConfig | None = None,
        noise: DepthNoiseConfig | None = None,
    ) -> None:
        self.shape = shape
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
            pose = self._step(pose, system.information, system.gradient, turns)
        for k in range(1 if near else 0, config.fine_steps):
            blur = BLUR[min(k, len(BLUR) - 1)]
            if k < len(BLUR):
                drawing = draw(self.shape, scene, pose, blur * config.outline_band)
                surface, label = self._facing_pixels(scene, drawing), _label_border(scene, drawing)
            system = self._ray_terms(scene, pose, drawing, surface)
            added, pull = self._outline_terms(scene, pose, drawing, label, blur)
            information = system.information + added
            pose = self._step(pose, information, system.gradient + pull)
        return self.judge(scene, pose, information, system.misfit)

    def _step(self, pose: Array, information: Array, gradient: Array, turns: float = 1.0) -> Array:
        """Return the pose after a damped Newton step; turns is 0 where it may only shift."""
        turn, shift = np.deg2rad(self.config.damping_rotation_deg), self.config.damping_position
        damping = np.diag([turn**-2.0] * 3 + [shift**-2.0] * 3)
        free = np.diag([turns] * 3 + [1.0] * 3)
        step = np.linalg.solve(free @ information @ free + damping, free @ gradient)
        pivot = self._pivot(pose)
        moved = pose.copy()
        turned = exp_so3(np.asarray(step[:3], dtype=float))
        moved[:3, :3] = turned @ pose[:3, :3]
        moved[:3, 3] = turned @ (pose[:3, 3] - pivot) + pivot + step[3:]
        return moved

    def _pivot(self, pose: Array) -> Array:
        return np.asarray(pose[:3, :3] @ self.shape.centre + pose[:3, 3])

    def _nearest_terms(self, scene: Scene, pose: Array) -> _System:
        """Return the normal equations of pixels drawn to the nearest surface, from afar."""
        window, reach = scene.window, self.config.coarse_reach
        index, points = np.flatnonzero(scene.free), scene.free_points
        near = np.sum((points - self._pivot(pose)) ** 2, axis=1) < (self.shape.radius + reach) ** 2
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
            return _System(np.zeros((6, 6)), np.zeros(6), np.inf)
        distance = pixels.distance
        std = self._distance_std(scene, pixels)
        limit = 3.0 * np.maximum(3.0 * std, reach / 3.0)
        weight = np.maximum(0.0, 1.0 - (distance / limit) ** 2) ** 2 / std**2
        arm = pixels.foot - self._pivot(pose)
        jacobian = np.hstack([cross(arm, pixels.normal), pixels.normal])
        weighted = jacobian * weight[:, None]
        used = np.abs(distance) < 3.0 * std
        misfit = np.sqrt(np.mean((distance[used] / std[used]) ** 2)) if used.any() else np.inf
        return _System(weighted.T @ jacobian, weighted.T @ distance, float(misfit))

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
    ) -> tuple[Array, Array]:
        """Return information and gradient of the probit model of the border's pixels.

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
            return np.zeros((6, 6)), np.zeros(6)
        distance, nearest = _distance_to(outline, scene.window.pixels[index])
        band = np.abs(distance) < blur * self.config.outline_band
        index, distance, nearest = index[band], distance[band], nearest[band]
        jacobian = self._outline_jacobian(scene, outline, pose)[nearest]
        sign, sigma = label[index].astype(float), blur * self.config.outline_std
        outliers = self.config.outline_outliers
        level = -sign * distance / sigma
        density = (1.0 - 2.0 * outliers) * np.exp(-0.5 * level**2) / np.sqrt(2.0 * np.pi)
        chance = outliers + (1.0 - 2.0 * outliers) * ndtr(level)
        fisher = density**2 / (chance * (1.0 - chance)) / sigma**2
        pull = sign * density / chance / sigma
        weighted = jacobian * fisher[:, None]
        return weighted.T @ jacobian, jacobian.T @ pull

    def _outline_jacobian(self, scene: Scene, outline: Outline, pose: Array) -> Array:
        """Return by how many px each point of the outline moves outwards per unit of motion."""
        x, y, z = outline.points.T
        f = scene.camera.intrinsics
        across = np.zeros((len(x), 3))
        across[:, 0] = outline.normals[:, 0] * f[0, 0] / z
        across[:, 1] = outline.normals[:, 1] * f[1, 1] / z
        across[:, 2] = -(across[:, 0] * x + across[:, 1] * y) / z
        arm = outline.points - self._pivot(pose)
        return np.hstack([cross(arm, across), across])

    def judge(
        self,
        scene: Scene,
        pose: Array,
        information: Array | None = None,
        misfit: float = np.inf,
    ) -> Fit:
        """Compare the model's near side with the image, sample by sample.

        Args:
            scene: labelled pixels.
            pose: (4, 4) X_CO.
            information: (6, 6) that is handed on.
            misfit: that is handed on.
        """
        points = self.shape.points[:JUDGED] @ pose[:3, :3].T + pose[:3, 3]
        normals = self.shape.normals[:JUDGED] @ pose[:3, :3].T
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
            self._pivot(pose),
            int(matched.sum()),
            int((known & ~matched | passed).sum()),
            len(points),
            self._strange(scene, pose),
            sunk,
            misfit,
        )

    def _strange(self, scene: Scene, pose: Array) -> float:
        """Return the share of pixels near the object that its surface does not explain."""
        arm = scene.free_points - self._pivot(pose)
        points = scene.free_points[np.einsum("ij,ij->i", arm, arm) < self.shape.radius**2]
        if not len(points):
            return 0.0
        distance, _ = self.shape.distance((points - pose[:3, 3]) @ pose[:3, :3])
        return float(np.mean(distance > STRANGE))


@dataclass(frozen=True)
class _System:
    """Normal equations of one step."""

    information: Array
    gradient: Array
    misfit: float


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


def _label_border(scene: Scene, drawing: Drawing) -> NDArray[np.int8]:
    """Return +1 where a pixel shows the object, -1 where it sees past it, 0 where unknown.

    Only pixels near both kinds count: elsewhere one side of the border is hidden.
    """
    depth = scene.window.depth
    label = np.zeros(len(depth), dtype=np.int8)
    near = scene.free & drawing.band
    label[near & (np.abs(depth - drawing.depth) < OBJECT_TOLERANCE)] = 1
    label[near & (depth > drawing.depth + EMPTY_TOLERANCE)] = -1
    return keep_contested(label.reshape(scene.window.shape), drawing.reach).ravel()


def _distance_to(outline: Outline, pixels: Array) -> tuple[Array, NDArray[np.intp]]:
    """Return how far pixels lie outside of the outline, px, and the nearest outline points."""
    _, nearest = cKDTree(outline.pixels).query(pixels)
    offset = pixels - outline.pixels[nearest]
    return np.einsum("ij,ij->i", offset, outline.normals[nearest]), nearest
