"""A table with an object, a gripper and a stereo camera, drawn by Bullet."""

from __future__ import annotations

from typing import Any

import numpy as np
import pybullet
from numpy.typing import NDArray

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.rigid_body.rotation import exp_so3, matrix_to_quaternion
from tactile_dynamics_ros.sim.sensors.depth_camera import DepthCamera, DepthCameraConfig

Image = NDArray[np.float32]

LENS = DepthCameraConfig(
    width=320, height=240, horizontal_view_deg=50.0, pose_bias=0.0, pose_bias_deg=0.0
)
STEREO_STD = 0.15 / (530.0 * 0.12)
"""Standard deviation of depth over its square, 1/m: 0.15 pixels of disparity at the focal length
(1280 columns) and the baseline of a Zed2i. Source: user reports, 0.1 to 0.25."""
JITTER = 0.5
"""Pixels by which borders are displaced, standard deviation."""
STRAYS, STRAY_REACH = 0.1, 0.1
"""Share of pixels whose depth is anything up to so many metres off."""
POSE_BIAS, POSE_BIAS_DEG = 2e-4, 0.02
"""Standard deviations of the camera's calibration, as of `DepthCameraConfig`."""
GRIPPER = np.array([0.05, 0.05, 0.16])
"""Edges of the gripper, m."""
FAR = [0.0, 0.0, -5.0]


class Stage:
    """Bodies that are placed and drawn.

    Args:
        solids: parts of the object, base at z = 0.
        seed: of noise and calibration.

    Attributes:
        corners: (K, 2) of each part in its own frame, m.
    """

    def __init__(self, solids: list[Any], seed: int) -> None:
        self.client = pybullet.connect(pybullet.DIRECT)
        self.corners = [np.asarray(solid.vertices)[:, :2] for solid in solids]
        self._rng = np.random.default_rng([seed, 5])
        self._camera = DepthCamera(LENS)
        turn = np.deg2rad(POSE_BIAS_DEG) * self._rng.standard_normal(3)
        self._bias = np.eye(4)
        self._bias[:3, :3] = exp_so3(turn)
        self._bias[:3, 3] = POSE_BIAS * self._rng.standard_normal(3)
        self._parts = [self._solid(solid) for solid in solids]
        self._gripper = self._box(0.5 * GRIPPER)
        table = self._box([1.0, 1.0, 0.05])
        self._put(table, [0.5, 0.0, -0.05])

    def close(self) -> None:
        """End the engine."""
        pybullet.disconnect(self.client)

    def place(self, parts: tuple[Array, ...], gripper: Array | None) -> None:
        """Put parts and gripper where they are; without a pose, out of sight.

        Args:
            parts: poses (4, 4) of the parts, or nothing.
            gripper: pose (4, 4) of the gripper's middle.
        """
        for body, pose in zip(self._parts, parts or [None] * len(self._parts), strict=True):
            self._put(body, FAR if pose is None else pose[:3, 3], pose)
        self._put(self._gripper, FAR if gripper is None else gripper[:3, 3], gripper)

    def render(self, pose: Array) -> Image:
        """Return the depth image from X_WC without noise."""
        return self._camera.render(self.client, pose @ self._bias)

    def measure(self, pose: Array) -> Image:
        """Return the depth image of a stereo camera that is believed to be at X_WC."""
        depth, rng = self.render(pose), self._rng
        rows, columns = np.indices(depth.shape)
        rows = rows + np.rint(JITTER * rng.standard_normal(depth.shape)).astype(int)
        columns = columns + np.rint(JITTER * rng.standard_normal(depth.shape)).astype(int)
        rows, columns = (np.clip(rows, 0, LENS.height - 1), np.clip(columns, 0, LENS.width - 1))
        depth = depth[rows, columns].astype(float)
        noisy = depth + STEREO_STD * depth**2 * rng.standard_normal(depth.shape)
        stray = rng.random(depth.shape) < STRAYS
        noisy[stray] = depth[stray] + rng.uniform(-STRAY_REACH, STRAY_REACH, int(stray.sum()))
        return noisy.astype(np.float32)

    def hidden(self, pose: Array, parts: tuple[Array, ...], gripper: Array) -> float:
        """Return the share of the object's pixels that the gripper hides."""
        images = []
        for these, that in ((parts, None), (parts, gripper), ((), None)):
            self.place(these, that)
            images.append(self.render(pose))
        shown, covered, bare = images
        own = shown < bare - 1e-3
        return float(np.mean(covered[own] < shown[own] - 1e-3))

    def _solid(self, solid: Any) -> int:
        shape = pybullet.createVisualShape(
            pybullet.GEOM_MESH,
            vertices=solid.vertices.tolist(),
            indices=solid.faces.ravel().tolist(),
            physicsClientId=self.client,
        )
        return int(pybullet.createMultiBody(0, -1, shape, physicsClientId=self.client))

    def _box(self, half: Any) -> int:
        shape = pybullet.createVisualShape(
            pybullet.GEOM_BOX, halfExtents=list(half), physicsClientId=self.client
        )
        return int(pybullet.createMultiBody(0, -1, shape, physicsClientId=self.client))

    def _put(self, body: int, position: Any, pose: Array | None = None) -> None:
        turn = [0, 0, 0, 1] if pose is None else matrix_to_quaternion(pose[:3, :3]).tolist()
        pybullet.resetBasePositionAndOrientation(
            body, list(position), turn, physicsClientId=self.client
        )
