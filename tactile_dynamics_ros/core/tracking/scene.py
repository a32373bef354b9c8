"""Labels of the pixels around an object: robot, support, or free for the object."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.tracking.depth_image import (
    DepthNoiseConfig,
    Image,
    PinholeCamera,
    Window,
    grow_cross,
    window_around,
)
from tactile_dynamics_ros.core.tracking.robot_volume import Volume

Mask = NDArray[np.bool_]

ROBOT_TOLERANCE = 5e-3
"""Depth, m, by which a pixel may lie before the robot's drawn surface and still show the robot:
three standard deviations of the camera at 0.8 m, and what joints are off by. Less leaves a rim of
fingers that is taken for the object, more takes away the object's surface behind a finger. Tests of
the tracker pass at half and twice as much."""
SUPPORT_TOLERANCE = 6e-3
"""Height, m, above the support up to which a pixel shows it: four standard deviations of the camera
at 0.8 m. At half of it patches of the table are left and a box that lies on it was not found
(test_vision_tracker.py); twice as much passes those tests and cuts more of the object's foot."""


@dataclass(frozen=True)
class Scene:
    """A window of a depth image of which the robot and the support are known.

    Attributes:
        camera: that took it. window: the pixels. noise: their axial standard deviation (P,), m.
        free: (P,) pixels that show neither robot nor support and have a depth.
        bare: (P,) pixels that do not show the robot and have a depth.
        support: z of the horizontal plane on which objects stand, world, m; None if there is none.
    """

    camera: PinholeCamera
    window: Window
    noise: Array
    free: Mask
    bare: Mask
    support: float | None

    @cached_property
    def nearest(self) -> Array:
        """Smallest depth (P,) of each pixel and its eight neighbours, m, NaN where invalid."""
        depth = self.window.depth
        filled = np.where(np.isfinite(depth), depth, np.inf).reshape(self.window.shape)
        smallest = ndimage.minimum_filter(filled, 3, mode="nearest").ravel()
        return np.where(np.isfinite(depth), smallest, np.nan)

    @cached_property
    def free_points(self) -> Array:
        """Measured points (N, 3) of the free pixels, camera frame, m."""
        index = np.flatnonzero(self.free)
        return np.asarray(self.window.rays[index] * self.window.depth[index, None])

    def sunk(self, points: Array) -> float:
        """Return how far the lowest of points (N, 3), camera frame, is inside the support, m."""
        if self.support is None:
            return 0.0
        pose = self.camera.pose
        lowest = float(np.min(points @ pose[2, :3]) + pose[2, 3])
        return max(0.0, self.support - lowest)


def label_scene(
    camera: PinholeCamera,
    window: Window,
    volume: Volume | None,
    positions: Array | None,
    noise: DepthNoiseConfig,
    support_height: float | None,
) -> Scene:
    """Take robot and support out of a window.

    A pixel shows the robot where it is as far as the robot's surface along its ray, or farther.

    Args:
        camera: camera of the window.
        window: pixels.
        volume: of the robot, None if there is none in sight.
        positions: (J,) joint positions at the time of the image, rad.
        noise: noise of depths.
        support_height: z of the horizontal plane on which objects stand, world, m; None if none.
    """
    depth = window.depth
    valid = np.isfinite(depth)
    safe = np.where(valid, depth, 1.0)
    robot = np.full(len(depth), np.inf)
    if volume is not None and positions is not None:
        grid = window.rays.reshape(*window.shape, 3)
        robot = volume.depth(positions, camera.pose, grid).ravel()
    shows_robot = np.isfinite(robot) & (safe > robot - ROBOT_TOLERANCE)
    shows_robot = grow_cross(shows_robot.reshape(window.shape)).ravel()
    bare = valid & ~shows_robot
    free = bare.copy()
    if support_height is not None:
        height = (window.rays * safe[:, None]) @ camera.pose[2, :3] + camera.pose[2, 3]
        free &= height > support_height + SUPPORT_TOLERANCE
    return Scene(camera, window, noise.axial_std(safe), free, bare, support_height)


def view_sphere(
    camera: PinholeCamera,
    depth: Image,
    centre: Array,
    radius: float,
    volume: Volume | None,
    positions: Array | None,
    noise: DepthNoiseConfig,
    support_height: float | None,
) -> Scene | None:
    """Return the scene around a sphere (camera frame, m), or None where it is out of sight."""
    window = window_around(camera, depth, centre, radius)
    if window is None:
        return None
    return label_scene(camera, window, volume, positions, noise, support_height)


def crop_scene(scene: Scene, centre: Array, radius: float) -> Scene | None:
    """Return the part of a scene around a sphere (camera frame, m), or None out of sight."""
    rows, columns = scene.window.shape
    top, left = scene.window.origin
    image = np.full((scene.camera.height, scene.camera.width), np.nan)
    image[top : top + rows, left : left + columns] = scene.window.depth.reshape(rows, columns)
    window = window_around(scene.camera, image, centre, radius)
    if window is None:
        return None
    chosen = scene.window.lookup(window.pixels)
    inside = chosen >= 0
    free, bare = scene.free[chosen] & inside, scene.bare[chosen] & inside
    return Scene(scene.camera, window, scene.noise[chosen], free, bare, scene.support)
