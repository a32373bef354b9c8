"""A picture of arm, hand and object, drawn in a process of its own: poses in, PNG out.

python -m tactile_dynamics_ros.sim.portrait ROBOT OBJECT POSES.npz PICTURE.png
"""

from __future__ import annotations

import sys
from pathlib import Path

import matplotlib as mpl
import numpy as np
import pybullet
from matplotlib.image import imsave
from numpy.typing import NDArray

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.robot.robot_file import load_robot
from tactile_dynamics_ros.sim.sensors.depth_camera import look_at
from tactile_dynamics_ros.sim.world import HandWorld, WorldConfig

SIZE = (960, 720)
FIELD_OF_VIEW_DEG = 30.0
VIEW_OFFSET = np.array([0.75, -0.45, 0.2])


def draw_portrait(
    robot: str, object_name: str, positions: Array, object_pose: Array
) -> NDArray[np.uint8]:
    """Return a picture (H, W, 3) of the hand holding the object.

    Args:
        robot: in config/robots.
        object_name: in config/objects.
        positions: (J,) joint positions, rad.
        object_pose: (4, 4) X_WO.
    """
    config = WorldConfig(object_name=object_name, arm_meshes=True)
    with HandWorld(config, machine=load_robot(robot)) as world:
        world.reset(positions, object_pose)
        target = 0.5 * (world.link_pose(world.machine.palm)[:3, 3] + object_pose[:3, 3])
        camera = look_at(target + VIEW_OFFSET, target)
        view = np.linalg.inv(camera @ np.diag([1.0, -1.0, -1.0, 1.0]))
        projection = pybullet.computeProjectionMatrixFOV(
            FIELD_OF_VIEW_DEG, SIZE[0] / SIZE[1], 0.1, 5.0
        )
        pixels = pybullet.getCameraImage(
            *SIZE,
            viewMatrix=view.T.ravel().tolist(),
            projectionMatrix=projection,
            lightDirection=[1.0, -1.5, 2.0],
            shadow=1,
            renderer=pybullet.ER_TINY_RENDERER,
            physicsClientId=world.client,
        )[2]
    return np.reshape(np.asarray(pixels, dtype=np.uint8), (SIZE[1], SIZE[0], 4))[:, :, :3]


def main(arguments: list[str]) -> int:
    """Draw the picture that the command line describes."""
    mpl.use("Agg")
    robot, name, poses, picture = arguments
    with np.load(Path(poses)) as given:
        image = draw_portrait(robot, name, given["positions"], given["object_pose"])
    imsave(picture, image)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
