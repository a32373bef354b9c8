"""The robot as a camera sees it: depth of its links along rays, from joint positions alone."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.robot.hand_kinematics import (
    ARM_DOF,
    HandConfiguration,
    HandKinematics,
)
from tactile_dynamics_ros.core.robot.robot_description import (
    ACTUATED_JOINTS,
    LINKS,
    PALM_LINK,
    SKIN_RADIUS,
)

Array = NDArray[np.float64]

_TIP_CENTRES = np.array([[0.0, 0.0, 0.0], [-0.007, 0.0, 0.0], [-0.014, 0.0, 0.0]])
"""Centres of the spheres that enclose a fingertip, m, sensor frame: from the tip's to `CORE_LENGTH`
behind it, half that apart."""
_ARM_RADIUS = 0.085
"""Radius of the spheres that enclose the arm's links, m: large enough for an iiwa's housing.
Larger takes away more of the image than the arm hides, smaller leaves its rim, which looks like an
object."""
_ARM_SPHERES = 4
"""Spheres per link of the arm; at 54 mm between them (the longest link has 0.216 m) neighbours
overlap."""


class RobotVolume:
    """Boxes and spheres that enclose the links of hand and arm.

    Args:
        kinematics: kinematic model of the robot.
        margin: by which every shape is larger than the link, m.
    """

    def __init__(self, kinematics: HandKinematics, margin: float = 0.003) -> None:
        self._kinematics = kinematics
        self._margin = margin
        boxes = {link.name: link.boxes for link in LINKS if link.boxes}
        children = [joint.child for joint in ACTUATED_JOINTS]
        self._palm = boxes.pop(PALM_LINK)
        self._moving = [(children.index(n), box) for n, found in boxes.items() for box in found]

    def depth(self, positions: Array, camera: Array, rays: Array) -> Array:
        """Return at which depth rays meet the robot.

        Args:
            positions: (23,) joint positions, rad.
            camera: (4, 4) X_WC.
            rays: (H, W, 3) with z = 1 of a rectangle of pixels, camera frame.

        Returns:
            (H, W) m, infinite where a ray meets nothing.
        """
        where = self._kinematics.locate(positions)
        to_camera = np.linalg.inv(camera)
        height, width = rays.shape[:2]
        nearest = np.full(height * width, np.inf)
        across = rays[0, :, 0].copy(), rays[:, 0, 1].copy()
        rays = rays.reshape(-1, 3)
        poses, halves = self._boxes(where)
        poses = to_camera @ poses
        reach = np.linalg.norm(halves, axis=1)
        for k in _in_sight(poses[:, :3, 3], reach, across):
            index = _near(poses[k, :3, 3], reach[k], across)
            _meet_box(poses[k], halves[k], rays, index, nearest)
        centres, radii = self._spheres(where)
        centres = centres @ to_camera[:3, :3].T + to_camera[:3, 3]
        for k in _in_sight(centres, radii, across):
            index = _near(centres[k], radii[k], across)
            _meet_sphere(centres[k], radii[k], rays, index, nearest)
        return nearest.reshape(height, width)

    def _boxes(self, where: HandConfiguration) -> tuple[Array, Array]:
        """Return poses (B, 4, 4) in the world and half edges (B, 3)."""
        found = [(where.palm, box) for box in self._palm]
        found += [(where.frames[index], box) for index, box in self._moving]
        poses = np.array([frame for frame, _ in found])
        offsets = np.array([centre for _, (_, centre) in found])
        poses[:, :3, 3] += np.einsum("bij,bj->bi", poses[:, :3, :3], offsets)
        sizes = np.array([size for _, (size, _) in found])
        return poses, 0.5 * sizes + self._margin

    def _spheres(self, where: HandConfiguration) -> tuple[Array, Array]:
        tips = where.sensors[:, None, :3, 3] + np.einsum(
            "fij,kj->fki", where.sensors[:, :3, :3], _TIP_CENTRES
        )
        joints = np.vstack([where.centres[:ARM_DOF], where.palm[None, :3, 3]])
        share = np.linspace(0.0, 1.0, _ARM_SPHERES, endpoint=False)[:, None, None]
        arm = (1.0 - share) * joints[:-2] + share * joints[1:-1]
        centres = np.vstack([tips.reshape(-1, 3), arm.reshape(-1, 3)])
        radii = np.full(len(centres), _ARM_RADIUS)
        radii[: tips.shape[0] * tips.shape[1]] = SKIN_RADIUS + self._margin
        return centres, radii


def _cone(centre: Array, radius: Array) -> Array:
    """Return how far (x, y of rays with z = 1) spheres reach around the rays to their centres."""
    return np.asarray(1.3 * radius / np.maximum(centre[..., 2] - 0.9 * radius, 1e-3))


def _in_sight(centres: Array, radii: Array, across: tuple[Array, Array]) -> NDArray[np.intp]:
    """Return indices of spheres in front of the camera that a rectangle of rays may meet."""
    ahead = centres[:, 2] > radii
    middle = centres[:, :2] / np.where(ahead, centres[:, 2], 1.0)[:, None]
    reach = _cone(centres, radii)[:, None]
    low, high = ([f(side) for side in across] for f in (np.min, np.max))
    inside = (middle + reach > low) & (middle - reach < high)
    return np.flatnonzero(ahead & inside[:, 0] & inside[:, 1])


def _near(centre: Array, radius: float, across: tuple[Array, Array]) -> NDArray[np.intp]:
    """Return indices of rays that pass near a sphere.

    Args:
        centre: (3,) camera frame, m.
        radius: m.
        across: x (W,) of the columns and y (H,) of the rows of rays with z = 1.
    """
    reach = float(_cone(centre, np.asarray(radius)))
    x, y = centre[0] / centre[2], centre[1] / centre[2]
    columns = np.flatnonzero(np.abs(across[0] - x) < reach)
    rows = np.flatnonzero(np.abs(across[1] - y) < reach)
    return np.asarray(rows[:, None] * len(across[0]) + columns).ravel()


def _meet_sphere(
    centre: Array, radius: float, rays: Array, index: NDArray[np.intp], nearest: Array
) -> None:
    chosen = rays[index]
    square = np.einsum("ij,ij->i", chosen, chosen)
    along = chosen @ centre
    root = along**2 - square * (centre @ centre - radius**2)
    hit = root > 0.0
    depth = (along[hit] - np.sqrt(root[hit])) / square[hit]
    nearest[index[hit]] = np.minimum(nearest[index[hit]], depth)


def _meet_box(
    pose: Array, half: Array, rays: Array, index: NDArray[np.intp], nearest: Array
) -> None:
    """Intersect rays with a box by its slabs."""
    start = -pose[:3, :3].T @ pose[:3, 3]
    speed = pose[:3, :3].T @ rays[index].T
    speed[np.abs(speed) < 1e-9] = 1e-9
    low, high = (-half - start)[:, None] / speed, (half - start)[:, None] / speed
    enter, leave = np.minimum(low, high).max(axis=0), np.maximum(low, high).min(axis=0)
    hit = (leave > enter) & (enter > 0.0)
    nearest[index[hit]] = np.minimum(nearest[index[hit]], enter[hit])
