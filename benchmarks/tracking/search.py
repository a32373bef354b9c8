"""Searches from nothing: the pose that is told first of an object that stands on the table."""

from __future__ import annotations

from typing import Any

import numpy as np

from benchmarks.tracking.scores import compare_poses, nearest_symmetry
from tactile_dynamics_ros.core.robot.hand_kinematics import HandKinematics
from tactile_dynamics_ros.core.shape.object_shape import ObjectShape
from tactile_dynamics_ros.core.tracking.depth_image import PinholeCamera
from tactile_dynamics_ros.core.tracking.vision_tracker import VisionTracker
from tactile_dynamics_ros.sim.simulated_robot import SimulatedRobot, SimulatedRobotConfig
from tactile_dynamics_ros.sim.world import WorldConfig

RATE_HZ = 10.0
PERIOD_S = 0.01
WRONG_M, WRONG_RAD = 5e-3, np.deg2rad(10.0)
PATIENCE = 30
"""Images after which a search has failed."""


def search_on_table(name: str, seed: int, shape: ObjectShape, searches: int) -> dict[str, Any]:
    """Search an object again and again, each time from the image after the pose was told.

    Args:
        name: of the object.
        seed: of its place and of the camera's noise.
        shape: of the object.
        searches: how many.
    """
    world = WorldConfig(object_name=name)
    config = SimulatedRobotConfig(seed=seed, depth_rate_hz=RATE_HZ, vision_rate_hz=0.0, world=world)
    robot = SimulatedRobot(config, PERIOD_S)
    settings = robot.camera.config
    camera = PinholeCamera(settings.intrinsics, settings.width, settings.height, robot.camera_pose)
    tracker = VisionTracker(shape, HandKinematics())
    errors, images, failed = [], 0, 0
    while len(errors) + failed < searches:
        readings = robot.advance()
        if readings.depth is None:
            continue
        images += 1
        told = tracker.update(readings.depth, camera, readings.position, readings.time)
        if told is None and images < PATIENCE:
            continue
        if told is None:
            failed += 1
        else:
            truth = robot.world.object_pose()
            turn = nearest_symmetry(shape, truth[:3, :3], told.pose[:3, :3])
            errors.append(compare_poses(shape, truth, told.pose, None, turn)[:2])
        tracker.reset()
        images = 0
    position, rotation = np.array(errors).reshape(-1, 2).T
    return {
        "object": name,
        "seed": seed,
        "searches": searches,
        "failed": failed,
        "wrong": int(np.sum((position > WRONG_M) | (rotation > WRONG_RAD))),
        "median_mm": 1e3 * float(np.median(position)) if errors else None,
        "largest_mm": 1e3 * float(np.max(position)) if errors else None,
    }
