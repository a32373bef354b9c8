"""Find an object in a depth image without knowing where it is.

Depths that are neither robot nor support are grouped by nearness; every group of a fitting size,
and what lies between the fingertips, is tried with many orientations. A short alignment of each,
a full one of the best. Where several poses fit equally well (a box turned by half a turn), the one
nearest to the expected orientation is taken: depth cannot tell them apart.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.configuration import check_ranges, parameter
from tactile_dynamics_ros.core.rigid_body.rotation import (
    exp_so3,
    quaternion_to_matrix,
    turned_by,
)
from tactile_dynamics_ros.core.shape.object_shape import ObjectShape
from tactile_dynamics_ros.core.tracking.depth_image import DepthNoiseConfig
from tactile_dynamics_ros.core.tracking.fit import Fit
from tactile_dynamics_ros.core.tracking.registration import Registration, RegistrationConfig
from tactile_dynamics_ros.core.tracking.scene import Scene, crop_scene

CELL = 0.015
"""Edge of the cells, m, by which points are joined to groups: points up to two cells apart belong
together. A pixel is 1.4 to 2.8 mm wide at 0.8 m, so that holes of a depth image do not split an
object; larger cells join the object with what stands beside it."""
LEAST_POINTS = 15
"""Points that a group needs: fewer are noise, or too little to align six coordinates to. At six a
patch of strays is searched as an object; more overlook objects that are small or mostly covered."""
ROUGH = RegistrationConfig(
    coarse_reach=0.04,
    fine_reach=0.02,
    shift_steps=3,
    coarse_steps=4,
    fine_steps=2,
    most_points=100,
)
"""Alignment of a candidate: reach of 4 cm, since orientations are tried in steps that leave the
surface centimetres off; few pixels and steps, since many candidates are tried and only the best are
aligned finely. A shorter reach misses surfaces that are far off, a longer one is drawn to the
neighbours'; more pixels or steps take time for each candidate."""


@dataclass(frozen=True)
class RelocalisationConfig:
    """Where and how thoroughly to search."""

    workspace_x: float = parameter(0.5, "centre of the workspace, world", "m", -10.0, 10.0)
    workspace_y: float = parameter(0.0, "centre of the workspace, world", "m", -10.0, 10.0)
    workspace_z: float = parameter(0.25, "centre of the workspace, world", "m", -10.0, 10.0)
    workspace_radius: float = parameter(0.5, "radius of the workspace", "m", 0.05, 10.0)
    orientations: int = parameter(24, "orientations tried besides those expected", "", 0, 1000)
    groups: int = parameter(3, "groups of points that are tried", "", 1, 100)
    refined: int = parameter(5, "candidates that are aligned fully", "", 1, 100)
    ambiguity: float = parameter(0.02, "poses whose quality differs by less are alike", "", 0, 1)

    def __post_init__(self) -> None:
        check_ranges(self)


class Relocalisation:
    """Global search for one shape.

    Args:
        registration: that aligns the best candidates.
        config: settings of the search. noise: noise of the camera.
    """

    def __init__(
        self,
        registration: Registration,
        config: RelocalisationConfig | None = None,
        noise: DepthNoiseConfig | None = None,
    ) -> None:
        self.config = config or RelocalisationConfig()
        self._fine = registration
        self._rough = Registration(registration.shape, ROUGH, noise, registration.planar)
        self._spread = _spread_orientations(self.config.orientations)

    def search(
        self,
        scene: Scene,
        expected: Sequence[Array],
        grasp_centre: Array | None,
        height: float | None = None,
    ) -> Fit | None:
        """Return the best pose of the object in an image, or None if nothing looks like it.

        Args:
            scene: scene of the whole image.
            expected: (3, 3) R_WO, likely orientations, the likeliest first.
            grasp_centre: (3,) midst of the fingertips, world, m; None without a hand.
            height: z of the object's origin in the world, m; None where it is not known.
        """
        pose = scene.camera.pose
        turn = pose[:3, :3].T
        rotations = [turn @ rotation for rotation in [*expected, *self._spread]]
        found: list[_Candidate] = []
        for points in self._group(scene, grasp_centre):
            part = crop_scene(scene, points.mean(axis=0), 2.0 * self._fine.shape.radius + 0.02)
            if part is None:
                continue
            for rotation in rotations:
                seed = _place(self._fine.shape, rotation, points)
                if height is not None:
                    seed[:3, 3] += (height - (pose @ seed)[2, 3]) * turn[:, 2]
                fit = self._rough.align(part, seed)
                found.append(_Candidate(self._quality(fit, points), fit, points, part))
        found.sort(key=lambda candidate: -candidate.quality)
        refined = []
        for rough in _distinct(found)[: self.config.refined]:
            fit = self._fine.align(rough.scene, rough.fit.pose)
            refined.append((self._quality(fit, rough.points), fit))
        return self._choose(refined, turn @ expected[0])

    def _choose(self, refined: list[tuple[float, Fit]], likely: Array) -> Fit | None:
        """Return the fit, among those that are alike, that is turned least from the likely."""
        if not refined:
            return None
        best = max(quality for quality, _ in refined)
        alike = [fit for quality, fit in refined if quality > best - self.config.ambiguity]
        turned = [turn_alike(self._fine.shape, fit, likely) for fit in alike]
        return min(turned, key=lambda fit: _angle(fit.pose[:3, :3], likely))

    def _quality(self, fit: Fit, points: Array) -> float:
        """Return how well the visible model and the group explain each other, 0 to 1.

        A point at d from the surface counts 1 - min(1, (d / 3 sigma)^2).
        """
        local = (points - fit.pose[:3, 3]) @ fit.pose[:3, :3]
        distance, _ = self._fine.shape.distance(local)
        std = np.hypot(self._fine.noise.axial_std(points[:, 2]), 1e-3)
        explained = np.mean(np.maximum(0.0, 1.0 - (distance / (3.0 * std)) ** 2))
        return float(fit.score * explained * min(1.0, fit.visible / 0.3))

    def _group(self, scene: Scene, grasp_centre: Array | None) -> list[Array]:
        """Return groups (N, 3) of points in the camera frame, the largest first."""
        config, pose = self.config, scene.camera.pose
        points = scene.window.points[scene.free]
        world = points @ pose[:3, :3].T + pose[:3, 3]
        centre = np.array([config.workspace_x, config.workspace_y, config.workspace_z])
        near = np.linalg.norm(world - centre, axis=1) < config.workspace_radius
        points, world = points[near], world[near]
        if len(points) < LEAST_POINTS:
            return []
        groups = [points[member] for member in _components(world)]
        size = 2.0 * self._fine.shape.radius + 0.03
        fitting = [g for g in groups if _extent(g) < size]
        fitting = sorted(fitting, key=len, reverse=True)[: config.groups]
        if grasp_centre is not None:
            reach = self._fine.shape.radius + 0.02
            held = points[np.linalg.norm(world - grasp_centre, axis=1) < reach]
            fitting.insert(0, held)
        return [group for group in fitting if len(group) >= LEAST_POINTS]


def _extent(points: Array) -> float:
    """Return the diagonal of the box around most of the points, m."""
    low, high = np.percentile(points, [3.0, 97.0], axis=0)
    return float(np.linalg.norm(high - low))


def _components(points: Array) -> list[NDArray[np.intp]]:
    """Return indices of points that are connected through neighbouring cells."""
    cell = np.floor((points - points.min(axis=0)) / CELL).astype(int)
    grid = np.zeros(cell.max(axis=0) + 1, dtype=bool)
    grid[tuple(cell.T)] = True
    label, count = ndimage.label(grid, np.ones((3, 3, 3)))
    own = label[tuple(cell.T)]
    order = np.argsort(own, kind="stable")
    bounds = np.searchsorted(own[order], np.arange(1, count + 2))
    return [order[a:b] for a, b in zip(bounds[:-1], bounds[1:], strict=True) if b > a]


def _place(shape: ObjectShape, rotation: Array, points: Array) -> Array:
    """Return a pose whose near side has the points' mean."""
    normals = shape.normals[:500] @ rotation.T
    middle = points.mean(axis=0)
    facing = normals @ (middle / np.linalg.norm(middle)) < -0.1
    near = shape.points[:500][facing] @ rotation.T
    pose = np.eye(4)
    pose[:3, :3] = rotation
    pose[:3, 3] = middle - (near.mean(axis=0) if len(near) else rotation @ shape.centre)
    return pose


@dataclass(frozen=True)
class _Candidate:
    """A rough pose, the group of points that it explains, and the scene around them."""

    quality: float
    fit: Fit
    points: Array
    scene: Scene


def _distinct(found: list[_Candidate]) -> list[_Candidate]:
    """Drop candidates that repeat a better one."""
    kept: list[_Candidate] = []
    for candidate in found:
        pose = candidate.fit.pose
        others = [other.fit.pose for other in kept]
        if not any(
            np.linalg.norm(pose[:3, 3] - other[:3, 3]) < 5e-3
            and _angle(pose[:3, :3], other[:3, :3]) < 0.15
            for other in others
        ):
            kept.append(candidate)
        if len(kept) == 20:
            break
    return kept


def turn_alike(shape: ObjectShape, fit: Fit, likely: Array) -> Fit:
    """Return a fit turned by the symmetry of the shape that brings it nearest to a rotation.

    Args:
        shape: shape of the object.
        fit: in the camera frame.
        likely: (3, 3) R_CO.
    """
    rotations = fit.pose[:3, :3] @ shape.symmetries
    best = rotations[np.argmax(np.einsum("ij,sij->s", likely, rotations))]
    pose = fit.pose.copy()
    pose[:3, 3] += (fit.pose[:3, :3] - best) @ shape.centre
    pose[:3, :3] = best
    return replace(fit, pose=pose)


def _angle(first: Array, second: Array) -> float:
    return turned_by(first @ second.T)


def _spread_orientations(count: int) -> list[Array]:
    """Return rotations spread evenly over all orientations.

    Source: Alexa, 2022 (super-Fibonacci spirals).
    """
    if count == 0:
        return []
    index = np.arange(count) + 0.5
    share, first, second = index / count, np.sqrt(2.0), 1.533751168755204288118041
    inner, outer = np.sqrt(share), np.sqrt(1.0 - share)
    alpha, beta = 2.0 * np.pi * index / first, 2.0 * np.pi * index / second
    quaternions = np.stack(
        [inner * np.sin(alpha), inner * np.cos(alpha), outer * np.sin(beta), outer * np.cos(beta)],
        axis=1,
    )
    return [quaternion_to_matrix(q) for q in quaternions]


def turned_about_vertical(rotation: Array, count: int) -> list[Array]:
    """Return R_WO (3, 3) turned about the world's vertical in even steps, itself first."""
    angles = 2.0 * np.pi / count * np.arange(count)
    return [exp_so3(np.array([0.0, 0.0, angle])) @ rotation for angle in angles]
