"""Depth cameras, structured light or stereo: rendering by Bullet and their errors."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import pybullet
from numpy.typing import NDArray

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.configuration import check_ranges, parameter
from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.rigid_body.rotation import exp_so3

Image = NDArray[np.float32]

BASELINES = {"xtion": 0.075, "zed2i": 0.12}
"""Distance between projector or second camera and camera, m, by model."""
STEREO_FOCAL = 530.0
"""Focal length of a Zed2i at 1280 columns, px, to which its `disparity_noise` belongs."""
MISMATCH = 0.1
"""Largest error of a stray pixel over its depth: windows are matched within some pixels."""
DISPARITY_STEPS = 8.0
NATIVE_WIDTH = 640
NEAR, FAR = 0.05, 10.0
"""What Bullet draws lies between, m."""


@dataclass(frozen=True)
class DepthCameraConfig:
    """Optics, range and noise.

    Source of xtion: Nguyen, Izadi and Lovell, 2012 (axial and lateral noise); disparity in eighths
    of a pixel and a baseline of 75 mm as in public structured-light simulators. A zed2i's noise
    grows with the square of the distance; users report 0.1 to 0.25 pixels of disparity.
    """

    model: str = parameter("xtion", "xtion (structured light) or zed2i (stereo)")
    width: int = parameter(320, "columns", "px", 16, 1280)
    height: int = parameter(240, "rows", "px", 16, 1024)
    horizontal_view_deg: float = parameter(58.0, "horizontal field of view", "deg", 10.0, 120.0)
    nearest: float = parameter(0.45, "shortest range", "m", 0.05, 2.0)
    farthest: float = parameter(3.5, "longest range", "m", 0.5, 20.0)
    noise_scale: float = parameter(1.0, "factor on axial and lateral noise", "", 0.0, 10.0)
    disparity_noise: float = parameter(
        0.15, "of zed2i: standard deviation of disparity, of 1280 columns", "px", 0.0, 5.0
    )
    stray_share: float = parameter(
        0.1, "of zed2i: share of pixels that are matched wrongly", "", 0.0, 0.9
    )
    shadows: bool = parameter(True, "leave out what projector or second camera cannot see")
    edge_loss: float = parameter(0.5, "share of pixels lost at depth edges", "", 0.0, 1.0)
    pose_bias: float = parameter(2e-4, "std of the calibrated position's error", "m", 0.0, 0.1)
    pose_bias_deg: float = parameter(0.02, "std of the calibrated rotation's error", "deg", 0, 45)

    def __post_init__(self) -> None:
        check_ranges(self)
        if self.model not in BASELINES:
            raise BadInputError(
                f"camera model '{self.model}': expected one of {', '.join(BASELINES)}"
            )

    @property
    def baseline(self) -> float:
        """Distance between projector or second camera and camera, m."""
        return BASELINES[self.model]

    @property
    def focal_length(self) -> float:
        """Focal length in pixels, the same for rows and columns."""
        return 0.5 * self.width / float(np.tan(0.5 * np.deg2rad(self.horizontal_view_deg)))

    @property
    def intrinsics(self) -> Array:
        """Camera matrix K (3, 3)."""
        f = self.focal_length
        cx, cy = 0.5 * (self.width - 1), 0.5 * (self.height - 1)
        return np.array([[f, 0.0, cx], [0.0, f, cy], [0.0, 0.0, 1.0]])


class _Backdrop(NamedTuple):
    """What never moves, from X_WC (4, 4): depth buffer of Bullet (H, W), and depth (H, W) in m."""

    pose: Array
    window: Image
    depth: Image


class DepthCamera:
    """Renders depth images and gives them the errors of structured light or stereo.

    Camera frame: z forward, x right, y down. Invalid pixels are NaN.

    Args:
        config: optics and noise.
        seed: of the noise.
    """

    def __init__(self, config: DepthCameraConfig | None = None, seed: int = 0) -> None:
        self.config = config or DepthCameraConfig()
        self._rng = np.random.default_rng([seed, 19])
        turn = np.deg2rad(self.config.pose_bias_deg) * self._rng.standard_normal(3)
        self._misplacement = np.eye(4)
        self._misplacement[:3, :3] = exp_so3(turn)
        self._misplacement[:3, 3] = self.config.pose_bias * self._rng.standard_normal(3)
        self._spawn_backdrop: Callable[[int], object] | None = None
        self._seen_backdrop: _Backdrop | None = None

    def render(self, client: int, pose: Array) -> Image:
        """Return the true depth image (H, W) in m of a Bullet world, before the backdrop if any.

        Args:
            client: Bullet client.
            pose: (4, 4) X_WC.
        """
        window = self._draw(client, pose)
        if self._spawn_backdrop is None:
            return _to_depth(window)
        seen = self._backdrop(pose)
        depth = seen.depth.copy()
        nearer = np.flatnonzero(window < seen.window)
        depth.ravel()[nearer] = _to_depth(window.ravel()[nearer])
        return depth

    def place_backdrop(self, spawn: Callable[[int], object]) -> None:
        """Draw what never moves once per camera pose instead of with each image.

        What is spawned must be invisible in the world, or it would be drawn with each image too.

        Args:
            spawn: creates it in a Bullet client.
        """
        self._spawn_backdrop, self._seen_backdrop = spawn, None

    def _backdrop(self, pose: Array) -> _Backdrop:
        """Return what is seen of the backdrop from X_WC (4, 4)."""
        seen = self._seen_backdrop
        if seen is None or not np.array_equal(seen.pose, pose):
            assert self._spawn_backdrop is not None
            client = pybullet.connect(pybullet.DIRECT)
            self._spawn_backdrop(client)
            window = self._draw(client, pose)
            pybullet.disconnect(client)
            seen = self._seen_backdrop = _Backdrop(pose.copy(), window, _to_depth(window))
        return seen

    def _draw(self, client: int, pose: Array) -> Image:
        """Return Bullet's depth buffer (H, W).

        Bullet's CPU renderer samples half a pixel to the left and below the pixel's centre; the
        projection is shifted so that ``intrinsics`` hold.
        """
        config = self.config
        view = np.linalg.inv(pose @ np.diag([1.0, -1.0, -1.0, 1.0]))
        f = config.focal_length
        projection = np.array(
            [
                [2.0 * f / config.width, 0.0, 1.0 / config.width, 0.0],
                [0.0, 2.0 * f / config.height, 1.0 / config.height, 0.0],
                [0.0, 0.0, -(FAR + NEAR) / (FAR - NEAR), -2.0 * FAR * NEAR / (FAR - NEAR)],
                [0.0, 0.0, -1.0, 0.0],
            ]
        )
        buffer = pybullet.getCameraImage(
            config.width,
            config.height,
            viewMatrix=view.T.ravel().tolist(),
            projectionMatrix=projection.T.ravel().tolist(),
            renderer=pybullet.ER_TINY_RENDERER,
            flags=pybullet.ER_NO_SEGMENTATION_MASK,
            physicsClientId=client,
        )[3]
        return np.asarray(buffer, dtype=np.float32).reshape(config.height, config.width)

    def degrade(self, depth: Image) -> Image:
        """Return a measured depth image (H, W) for a true one: noise, holes, what is lost."""
        config = self.config
        depth = np.asarray(depth, dtype=np.float32)
        if config.model == "zed2i":
            measured = self._stereo(depth)
        else:
            depth = self._jitter(depth, self._tilt(depth))
            measured = self._structured(depth)
        lost = (measured < config.nearest) | (measured > config.farthest)
        lost |= self._edges(depth)
        if config.shadows:
            lost |= self._shadowed(depth)
        measured[lost] = np.nan
        return measured

    def _stereo(self, depth: Image) -> Image:
        """Return depth as matched windows tell it.

        sigma_z = z^2 sigma_d / (f b); some windows are matched wrongly.
        """
        config = self.config
        noise = config.disparity_noise / (STEREO_FOCAL * config.baseline)
        error = self._rng.standard_normal(depth.shape, dtype=np.float32)
        measured = depth + depth * depth * np.float32(noise) * error
        stray = self._rng.random(depth.shape, dtype=np.float32) < config.stray_share
        wrong = self._rng.uniform(1.0 - MISMATCH, 1.0 + MISMATCH, int(stray.sum()))
        measured[stray] *= wrong.astype(np.float32)
        return np.asarray(measured)

    def _structured(self, depth: Image) -> Image:
        """Return depth as structured light tells it, whose edges wander by about a pixel.

        sigma_z = 1.2 mm + 1.9 mm/m^2 (z - 0.4 m)^2, more at grazing angles; disparity is rounded to
        an eighth of a pixel.
        """
        config = self.config
        sigma = self._axial_noise(depth, self._tilt(depth))
        measured = self._rng.standard_normal(depth.shape, dtype=np.float32)
        sigma *= config.noise_scale
        measured *= sigma
        measured += depth
        scale = DISPARITY_STEPS * config.baseline * config.focal_length
        scale *= NATIVE_WIDTH / config.width
        np.maximum(measured, 0.05, out=measured)
        np.rint(np.divide(scale, measured, out=measured), out=measured)
        np.divide(scale, np.maximum(measured, 1.0, out=measured), out=measured)
        return measured

    def _axial_noise(self, depth: Image, tilt: Image) -> Image:
        """Return the standard deviation (H, W) of depth, m, at a tilt of the surface, rad."""
        sigma = depth - np.float32(0.4)
        sigma *= sigma
        sigma *= np.float32(1.9e-3)
        sigma += np.float32(1.2e-3)
        oblique = np.flatnonzero(tilt > np.float32(np.deg2rad(60.0)))
        grazing = np.minimum(tilt.ravel()[oblique], 1.5)
        extra = 1e-4 / np.sqrt(depth.ravel()[oblique])
        sigma.ravel()[oblique] += extra * grazing**2 / (np.pi / 2 - grazing) ** 2
        return sigma

    def measure(self, client: int, pose: Array) -> Image:
        """Render and degrade; the camera stands a little off its calibrated pose (4, 4) X_WC."""
        return self.degrade(self.render(client, pose @ self._misplacement))

    def _jitter(self, depth: Image, tilt: Image) -> Image:
        """Sample each pixel from a place shifted by the lateral noise, in native pixels.

        sigma_L = 0.8 + 0.035 tilt / (pi/2 - tilt); jumps of depth have no tilt.
        """
        config = self.config
        tilt = np.where(tilt < 1.4, tilt, np.float32(0.0))
        native = 0.8 + 0.035 * tilt / (np.float32(np.pi / 2) - tilt)
        spread = np.float32(config.noise_scale * config.width / NATIVE_WIDTH) * native
        shift = self._rng.standard_normal((2, *depth.shape), dtype=np.float32)
        shift *= spread
        row, column = np.rint(shift, out=shift).astype(np.int32)
        row += np.arange(config.height, dtype=np.int32)[:, None]
        column += np.arange(config.width, dtype=np.int32)
        np.clip(row, 0, config.height - 1, out=row)
        np.clip(column, 0, config.width - 1, out=column)
        row *= config.width
        row += column
        return np.take(depth, row)

    def _tilt(self, depth: Image) -> Image:
        """Return the angle between the surface normal and the optical axis, rad."""
        down, right = np.gradient(depth)
        slope = np.sqrt(down * down + right * right)
        slope *= self.config.focal_length / np.maximum(depth, 0.05)
        return np.arctan(slope).astype(np.float32)

    def _edges(self, depth: Image) -> NDArray[np.bool_]:
        """Return pixels beside jumps of more than 2 % of depth, a share of which is lost."""
        jump = np.zeros(depth.shape, dtype=bool)
        limit = 0.02 * depth
        step = np.abs(np.diff(depth, axis=1)) > limit[:, 1:]
        jump[:, 1:] |= step
        jump[:, :-1] |= step
        step = np.abs(np.diff(depth, axis=0)) > limit[1:]
        jump[1:] |= step
        jump[:-1] |= step
        return jump & (self._rng.random(depth.shape, dtype=np.float32) < self.config.edge_loss)

    def _shadowed(self, depth: Image) -> NDArray[np.bool_]:
        """Return pixels whose line to the projector or second camera, to the right, is blocked."""
        config = self.config
        reach = int(config.baseline * config.focal_length / config.nearest) + 2
        wide = config.width + reach
        shift = config.baseline * config.focal_length
        seen = np.arange(config.width, dtype=np.float32) - shift / depth
        place = np.clip(np.rint(seen).astype(np.int32) + reach, 0, wide - 1)
        place += wide * np.arange(config.height, dtype=np.int32)[:, None]
        nearest = np.full(config.height * wide, np.inf, dtype=np.float32)
        np.minimum.at(nearest, place.ravel(), depth.ravel())
        return depth > np.float32(1.02) * nearest[place]


def _to_depth(window: Image) -> Image:
    """Return depth in m of values of Bullet's depth buffer, any shape."""
    scale = FAR - (FAR - NEAR) * window.astype(np.float64)
    return np.asarray(FAR * NEAR / scale, dtype=np.float32)


def look_at(position: Array, target: Array) -> Array:
    """Return X_WC (4, 4) of a camera at ``position`` that looks at ``target`` with y down."""
    forward = np.asarray(target, dtype=float) - position
    forward /= np.linalg.norm(forward)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    if np.linalg.norm(right) < 1e-6:
        right = np.array([0.0, -1.0, 0.0])
    right /= np.linalg.norm(right)
    pose = np.eye(4)
    pose[:3, :3] = np.column_stack([right, np.cross(forward, right), forward])
    pose[:3, 3] = position
    return pose
