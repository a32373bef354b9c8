"""Follow an object of known shape through depth images, and notice when it is lost.

Each image is aligned from the likeliest of several predictions: moved with the palm, left where it
was, or as others predict. The share of the visible model that is seen where it should be is the
score; where it is low, or too little is visible, the image yields no pose. When that lasts, the
object is searched in the whole image, and a pose that was found so must prove itself in further
images before it is reported.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.rigid_body.rotation import skew, twice
from tactile_dynamics_ros.core.robot.hand_kinematics import HandKinematics
from tactile_dynamics_ros.core.shape.object_shape import ObjectShape
from tactile_dynamics_ros.core.tracking.depth_image import Image, PinholeCamera, cut_window
from tactile_dynamics_ros.core.tracking.fit import Fit, judge
from tactile_dynamics_ros.core.tracking.registration import Registration
from tactile_dynamics_ros.core.tracking.relocalisation import Relocalisation, turned_about_vertical
from tactile_dynamics_ros.core.tracking.robot_volume import RobotVolume
from tactile_dynamics_ros.core.tracking.scene import Scene, label_scene, view_sphere
from tactile_dynamics_ros.core.tracking.watch import (
    NEAR,
    SYMMETRIC_STD,
    Sighting,
    TrackingState,
    VisionTrackerConfig,
    Watch,
)


class VisionTracker:
    """Pose of an object from depth images and joint positions.

    Args:
        shape: shape of the object. kinematics: kinematic model of the robot in front of the camera.
        config: thresholds, weights, camera noise.
    """

    def __init__(
        self,
        shape: ObjectShape,
        kinematics: HandKinematics | None = None,
        config: VisionTrackerConfig | None = None,
    ) -> None:
        self.config = config or VisionTrackerConfig()
        self.shape = shape
        self._kinematics = kinematics or HandKinematics()
        self._volume = RobotVolume(self._kinematics, self.config.robot_margin)
        self._registration = Registration(shape, self.config.registration, self.config.noise)
        self._search = Relocalisation(
            self._registration, self.config.relocalisation, self.config.noise
        )
        self._watch = Watch(self.config)
        self.reset()

    @property
    def state(self) -> TrackingState:
        """What is known now."""
        return self._watch.state

    @property
    def score(self) -> float:
        """Score of the last image, 0 where nothing was seen."""
        return self._watch.score

    @property
    def visible(self) -> float:
        """Share of the near side that nothing hides in the last image."""
        return self._watch.visible

    def reset(self, pose: Array | None = None) -> None:
        """Forget where the object is, or start from X_WO (4, 4)."""
        self._watch.reset(known=pose is not None)
        self._pose = None if pose is None else np.array(pose, dtype=float)
        self._palm: Array | None = None

    def update(
        self,
        depth: Image,
        camera: PinholeCamera,
        positions: Array,
        time: float,
        predictions: Sequence[Array] = (),
    ) -> Sighting | None:
        """Take an image; return the object's pose, or None where it is not known for sure.

        Args:
            depth: (H, W) m, NaN where invalid.
            camera: that took it, with its calibrated pose.
            positions: (J,) joint positions at the time of the image, rad.
            time: s, of the image.
            predictions: (4, 4) X_WO at that time, by others.

        Raises:
            BadInputError: the image has another size than the camera says.
        """
        camera.check(depth)
        palm = self._kinematics.locate(positions).palm
        seeds = [*self._own_predictions(palm), *predictions]
        fit = self._align_best(depth, camera, positions, seeds) if seeds else None
        self._watch.note(fit)
        if fit is None or not self._watch.believes(fit):
            fit = self._recover(depth, camera, positions, time, seeds)
        if fit is None:
            self._carry(palm)
            return None
        self._accept(fit, camera, palm, time)
        if self.state is not TrackingState.TRACKING:
            return None
        assert self._pose is not None
        return Sighting(self._pose, self._covariance(fit, camera), fit.score, fit.visible)

    def _own_predictions(self, palm: Array) -> list[Array]:
        """Return where the object is if it moved with the palm, and if it stayed."""
        if self._pose is None:
            return []
        if self._palm is None or np.allclose(palm, self._palm, atol=1e-6):
            return [self._pose]
        return [palm @ np.linalg.inv(self._palm) @ self._pose, self._pose]

    def _scene(
        self, depth: Image, camera: PinholeCamera, positions: Array, poses: Sequence[Array]
    ) -> Scene | None:
        """Return the labelled pixels around the object at all of the poses X_CO."""
        centres = np.stack([pose[:3, :3] @ self.shape.centre + pose[:3, 3] for pose in poses])
        centre = centres.mean(axis=0)
        spread = float(np.linalg.norm(centres - centre, axis=1).max())
        radius = self.shape.radius + self.config.registration.coarse_reach + spread
        return view_sphere(
            camera, depth, centre, radius, self._volume, positions, self.config.noise,
            self._support,
        )  # fmt: skip

    @property
    def _support(self) -> float | None:
        return self.config.support_height if self.config.support else None

    def _align_best(
        self, depth: Image, camera: PinholeCamera, positions: Array, seeds: Sequence[Array]
    ) -> Fit | None:
        """Return the alignment from the prediction that agrees best with the image."""
        poses = list(np.linalg.inv(camera.pose) @ np.stack(seeds))
        scene = self._scene(depth, camera, positions, poses)
        if scene is None:
            return None
        judged = [judge(self.shape, scene, pose) for pose in poses]
        best = max(judged, key=lambda fit: fit.agreement)
        return self._registration.align(scene, best.pose, near=best.score > NEAR)

    def _recover(
        self,
        depth: Image,
        camera: PinholeCamera,
        positions: Array,
        time: float,
        seeds: Sequence[Array],
    ) -> Fit | None:
        """Wait for a better image, or search; return a pose that is to be checked."""
        if not self._watch.miss(time):
            return None
        window = cut_window(camera, depth, slice(0, camera.height), slice(0, camera.width))
        scene = label_scene(
            camera, window, self._volume, positions, self.config.noise, self._support
        )
        expected = [seed[:3, :3] for seed in seeds[:1]]
        expected += turned_about_vertical(self.shape.expected, 8)
        tips = self._kinematics.locate(positions).sensors[:, :3, 3].mean(axis=0)
        fit = self._search.search(scene, expected, tips)
        self._watch.note(fit)
        if fit is None or not self._watch.believes(fit):
            return None
        return fit

    def _accept(self, fit: Fit, camera: PinholeCamera, palm: Array, time: float) -> None:
        self._pose, self._palm = camera.pose @ fit.pose, palm
        self._watch.accept(time)

    def _carry(self, palm: Array) -> None:
        """Let the unseen object move with the palm."""
        if self._pose is not None and self._palm is not None:
            self._pose = palm @ np.linalg.inv(self._palm) @ self._pose
        self._palm = palm

    def _covariance(self, fit: Fit, camera: PinholeCamera) -> Array:
        """Return the covariance (6, 6) [rotation, position of the origin], world axes."""
        config, radius = self.config, self.shape.radius
        scale = np.array([radius] * 3 + [1.0] * 3)
        axes = fit.pose[:3, :3] @ self.shape.symmetry_axes.T
        seen = np.eye(6)
        seen[:3, :3] -= axes @ axes.T
        shown = seen @ fit.information @ seen
        information = config.information_share * shown / np.outer(scale, scale)
        value, basis = np.linalg.eigh(information)
        unknown = (3.0 * radius) ** 2
        known = value > config.blind_std**-2
        variance = np.where(known, 1.0 / np.maximum(value, 1e-12), unknown)
        spread = (basis * variance) @ basis.T / np.outer(scale, scale)
        spread[:3, :3] += SYMMETRIC_STD**2 * axes @ axes.T
        turn = np.deg2rad(config.bias_rotation_deg)
        spread += np.diag([turn**2] * 3 + [config.bias_position**2] * 3)
        lever = np.eye(6)
        lever[3:, :3] = -skew(fit.pose[:3, 3] - fit.pivot)
        lever = twice(camera.pose[:3, :3]) @ lever
        return np.asarray(lever @ spread @ lever.T)
