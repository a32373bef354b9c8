"""One link of an object on a table: aligned with an image, filtered, and watched."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.rigid_body.rotation import log_so3, skew, turned_by, twice
from tactile_dynamics_ros.core.shape.object_shape import ObjectShape
from tactile_dynamics_ros.core.shape.superquadric.superquadric import Superquadric, tracked_shape
from tactile_dynamics_ros.core.tracking.fit import Fit, judge, pivot_of
from tactile_dynamics_ros.core.tracking.links.motion import LinkMotion
from tactile_dynamics_ros.core.tracking.registration import PLANAR, Registration
from tactile_dynamics_ros.core.tracking.relocalisation import (
    Relocalisation,
    turn_alike,
    turned_about_vertical,
)
from tactile_dynamics_ros.core.tracking.scene import Scene
from tactile_dynamics_ros.core.tracking.watch import (
    NEAR,
    SYMMETRIC_STD,
    Sighting,
    TrackingState,
    VisionTrackerConfig,
    Watch,
)

_TURNS = 12
"""Turns about the vertical, 30 deg apart, that a search tries: alignments find back from half of
it. Twice as many take twice as long; with 8 long boxes were found a quarter turn off."""
_MOST_TURN = 0.25
"""Turn, rad, from the prediction to the alignment beyond which an image is not believed: four times
what a push at 1 rad/s turns between images. Larger lets a hidden hexagon jump to its next corner,
smaller loses links that are knocked about."""
_OTHER_TURN = 0.15
"""Turn, rad, from which two alignments of the same image are different answers (half a step of a
search). Smaller counts what is within the errors of one, larger overlooks neighbours."""
_EXPECTED_MISS = 0.01
"""Share of the visible surface that is missed by a good model and pose, by stray pixels. Less makes
covariances of good models larger than their errors, more hides faults of the model."""


@dataclass(frozen=True)
class Link:
    """A rigid part of an object, and where it is at first.

    Attributes:
        name: link_1, link_2, ...
        shape: its surface in its own frame.
        pose: (4, 4) X_WO.
        extent_std: (3,) standard deviation of its half extents, m.
        covariance: (6, 6) of the pose, [rotation, position], world axes.
    """

    name: str
    shape: ObjectShape
    pose: Array
    extent_std: Array = field(default_factory=lambda: np.zeros(3))
    covariance: Array = field(default_factory=lambda: np.diag([0.05**2] * 3 + [5e-3**2] * 3))

    @classmethod
    def of_superquadric(cls, name: str, shape: Superquadric, std: Mapping[str, float]) -> Link:
        """Return a link with a recovered surface.

        Args:
            name: of the link.
            shape: surface, posed in the world.
            std: standard deviations as `Recovery.std` names them.
        """
        turn, place = std.get("yaw", 0.0), [std.get(axis, 0.0) for axis in "xyz"]
        return cls(
            name,
            tracked_shape(shape),
            shape.pose,
            np.array([std[f"a{axis}"] for axis in "xyz"]),
            np.diag(np.square([turn] * 3 + place)),
        )


class LinkTracker:
    """Follows one link.

    Args:
        link: what is followed, from where.
        config: thresholds, weights, camera noise.

    Attributes:
        watch: what is known of it. motion: pose and velocity.
    """

    def __init__(self, link: Link, config: VisionTrackerConfig) -> None:
        self.link, self.config = link, config
        self.registration = Registration(
            link.shape, config.registration, config.noise, config.planar
        )
        self._search = Relocalisation(self.registration, config.relocalisation, config.noise)
        self.watch = Watch(config)
        self.watch.reset(known=True)
        free = PLANAR if config.planar else tuple(range(6))
        self.motion = LinkMotion(link.pose, link.covariance, link.shape.centre, free, config.motion)
        self._last = link.pose
        self._doubt = np.zeros((6, 6))

    @property
    def followed(self) -> bool:
        """Whether its place is known well enough that what is there counts as this link."""
        return self.watch.state is not TrackingState.SEARCHING

    def seeds(self, time: float) -> list[Array]:
        """Return where it is if it moved on, and if it stayed."""
        moved = self.motion.predicted(time)
        return [moved] if np.allclose(moved, self._last, atol=1e-5) else [moved, self._last]

    def align(self, scene: Scene, seeds: Sequence[Array]) -> Fit:
        """Return the alignment from the seed X_WO (4, 4) that agrees best with the image."""
        poses = np.linalg.inv(scene.camera.pose) @ np.stack(seeds)
        judged = [judge(self.link.shape, scene, pose) for pose in poses]
        best = max(judged, key=lambda fit: fit.agreement)
        return self.registration.align(scene, best.pose, near=best.share_seen > NEAR)

    def search(self, scene: Scene) -> Fit | None:
        """Look for it in the whole image, turned about the vertical."""
        expected = turned_about_vertical(self._last[:3, :3], _TURNS)
        height = float(self.link.pose[2, 3]) if self.config.planar else None
        return self._search.search(scene, expected, None, height)

    def jumped(self, fit: Fit, seeds: Sequence[Array], camera: Array) -> bool:
        """Whether an alignment is turned farther from all seeds X_WO than a link turns.

        Args:
            fit: in the camera frame.
            seeds: (4, 4) each.
            camera: (4, 4) X_WC.
        """
        if len(self.link.shape.symmetry_axes):
            return False
        likely = [camera[:3, :3].T @ seed[:3, :3] for seed in seeds]
        return all(self._turned(fit, rotation) > _MOST_TURN for rotation in likely)

    def _turned(self, fit: Fit, likely: Array) -> float:
        """Return the smallest turn, rad, from a rotation R_CO to one that looks as the fit does."""
        alike = turn_alike(self.link.shape, fit, likely).pose[:3, :3]
        return turned_by(alike @ likely.T)

    def _compare(self, scene: Scene, found: Fit) -> Array:
        """Return the covariance (6, 6) of an equal choice among all turns that are as believable.

        Other turns about the vertical are aligned; [rotation, shift of the middle], world axes.
        """
        shape, camera = self.link.shape, scene.camera.pose
        if len(shape.symmetry_axes):
            return np.zeros((6, 6))
        middle = pivot_of(shape, found.pose)
        differences = [np.zeros(6)]
        for rotation in turned_about_vertical(camera[:3, :3] @ found.pose[:3, :3], _TURNS)[1:]:
            seed = np.eye(4)
            seed[:3, :3] = camera[:3, :3].T @ rotation
            seed[:3, 3] = middle - seed[:3, :3] @ shape.centre
            rival = self.registration.align(scene, seed)
            if not self.watch.believes(rival):
                continue
            if self._turned(rival, found.pose[:3, :3]) < _OTHER_TURN:
                continue
            rival = turn_alike(shape, rival, found.pose[:3, :3])
            turn = log_so3(rival.pose[:3, :3] @ found.pose[:3, :3].T)
            shift = pivot_of(shape, rival.pose) - middle
            differences.append(np.concatenate([camera[:3, :3] @ turn, camera[:3, :3] @ shift]))
        return np.asarray(np.mean([np.outer(each, each) for each in differences], axis=0))

    def carry(self, motion: Array) -> None:
        """Let the unseen link move with another one, by X (4, 4) in the world."""
        self._last = motion @ self._last

    def accept(self, fit: Fit, scene: Scene, time: float) -> Sighting | None:
        """Take an alignment; return the pose if it may be reported."""
        camera = scene.camera.pose
        if not self.followed:
            self._doubt = self._compare(scene, fit)
            self.motion = LinkMotion(
                camera @ fit.pose,
                np.diag([SYMMETRIC_STD**2] * 3 + [1.0] * 3),
                self.link.shape.centre,
                tuple(self.motion.free),
                self.config.motion,
            )
        information, stretch = self._weigh(fit, camera)
        random = self.motion.correct(camera @ fit.pose, information, time)
        self._last = self.motion.pose
        self.watch.accept(time)
        if self.watch.state is not TrackingState.TRACKING:
            return None
        missed = max(0.0, 1.0 - fit.share_seen - _EXPECTED_MISS)
        covariance = self._covariance(random, random @ stretch, missed)
        reach = np.linalg.norm(scene.free_points - fit.pivot, axis=1)
        points = int(np.count_nonzero(reach < self.link.shape.radius))
        return Sighting(
            self.motion.pose, covariance, fit.share_seen, fit.visible, points, fit.misfit
        )

    def _weigh(self, fit: Fit, camera: Array) -> tuple[Array, Array]:
        """Return information (K, K) of the possible motions and what the extents pull (K, 3).

        Pixels count less where they miss the surface by more than their noise.
        """
        turn = twice(camera[:3, :3])
        axes = fit.pose[:3, :3] @ self.link.shape.symmetry_axes.T
        seen = np.eye(6)
        seen[:3, :3] -= axes @ axes.T
        share = self.config.information_share / max(fit.misfit, 1.0) ** 2
        information = share * (turn @ seen @ fit.information @ seen @ turn.T)
        pull = share * (turn @ seen @ fit.stretch)
        free = self.motion.free
        return information[np.ix_(free, free)], pull[free]

    def _covariance(self, random: Array, stretched: Array, missed: float) -> Array:
        """Return the covariance (6, 6) [rotation, position of the origin], world axes.

        Args:
            random: (K, K) by the camera's noise.
            stretched: (K, 3) error by that of the half extents.
            missed: share of the visible surface that is not where it should be; a shift of the
                same share of the half extents explains it, or a turn by that share.
        """
        config, free = self.config, self.motion.free
        turn = np.deg2rad(config.bias_rotation_deg)
        spread = np.diag([turn**2] * 3 + [config.bias_position**2] * 3)
        extent = np.hypot(self.link.extent_std, config.registration.model_std)
        spread[5, 5] += extent[2] ** 2
        level = missed * float(np.mean(self.link.shape.half[:2])) * np.ones(3)
        wrong = np.diag(np.concatenate([missed * np.ones(3), level]) ** 2) + self._doubt
        spread[np.ix_(free, free)] += random + (stretched * extent**2) @ stretched.T
        spread[np.ix_(free, free)] += wrong[np.ix_(free, free)]
        pose = self.motion.pose
        lever = np.eye(6)
        lever[3:, :3] = skew(pose[:3, :3] @ self.link.shape.centre)
        return np.asarray(lever @ spread @ lever.T)
