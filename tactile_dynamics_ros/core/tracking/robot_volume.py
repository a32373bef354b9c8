"""The robot as a camera sees it: depth of its links along rays, from joint positions alone."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.robot.enclosure import Box, boxes_around, enclosing_boxes
from tactile_dynamics_ros.core.robot.hand_kinematics import HandConfiguration, HandKinematics
from tactile_dynamics_ros.core.robot.kinematic_tree import (
    chain,
    independent,
    placed,
    position_of,
    read_tree,
)

_TIP_CENTRES = np.array([[0.0, 0.0, 0.0], [-0.007, 0.0, 0.0], [-0.014, 0.0, 0.0]])
"""Centres of the spheres that enclose a round fingertip, m, sensor frame: from the tip's to the end
of a BioTac's core behind it (14 mm), half that apart. Fewer leave gaps that show fingertip as
object; farther back they cover the finger's link, which is drawn anyway."""
_ARM_SPHERES = 4
"""Spheres per link of the arm; at 54 mm between them (the longest link has 0.216 m) neighbours
overlap. Fewer leave gaps in which the arm counts as object, more cost time."""


class Volume(Protocol):
    """Something that moves with joints and hides what is behind it."""

    def depth(self, positions: Array, camera: Array, rays: Array) -> Array:
        """Return at which depth rays (H, W, 3) meet it: (H, W) m, infinite where they do not."""


class RobotVolume:
    """Boxes and spheres that enclose the links of hand and arm.

    Links are as large as the shapes with which they collide; an arm without shapes is enclosed by
    spheres of the robot's `arm_radius` from joint to joint.

    Args:
        kinematics: kinematic model of the robot.
        margin: by which every shape is larger than the link, m.
    """

    def __init__(self, kinematics: HandKinematics, margin: float = 0.003) -> None:
        self._kinematics = kinematics
        self._margin = margin
        boxes = [box for box in enclosing_boxes(kinematics.robot) if box.link in self._carried()]
        self._carriers = [self._carrier(box)[0] for box in boxes]
        offsets = [self._carrier(box)[1] @ box.pose for box in boxes]
        self._offsets = np.array(offsets).reshape(-1, 4, 4)
        self._halves = 0.5 * np.array([box.size for box in boxes]).reshape(-1, 3) + margin
        inside = {k for k in self._carriers if 0 <= k < kinematics.robot.arm_dof - 1}
        self._bare_arm = not inside and kinematics.robot.arm_dof > 0

    def _carried(self) -> set[str]:
        """Return the links whose place the robot's joints tell; others have joints of their own."""
        robot = self._kinematics.robot
        known = {robot.base}
        for joint in robot.tree:
            if joint.parent in known and (joint.axis is None or joint.name in robot.joint_names):
                known.add(joint.child)
        return known

    def _carrier(self, box: Box) -> tuple[int, Array]:
        """Return the number of the joint that moves a box's link (-1: none), and the offset."""
        robot = self._kinematics.robot
        offset = np.eye(4)
        for joint in reversed(chain(robot.tree, robot.base, box.link)):
            if joint.name in robot.joint_names:
                return robot.joint_names.index(joint.name), offset
            offset = joint.origin @ offset
        return -1, offset

    def depth(self, positions: Array, camera: Array, rays: Array) -> Array:
        """Return at which depth rays meet the robot.

        Args:
            positions: (J,) joint positions, rad.
            camera: (4, 4) X_WC.
            rays: (H, W, 3) with z = 1 of a rectangle of pixels, camera frame.

        Returns:
            (H, W) m, infinite where a ray meets nothing.
        """
        where = self._kinematics.locate(positions)
        return _depth_of(self._boxes(where), self._halves, *self._spheres(where), camera, rays)

    def _boxes(self, where: HandConfiguration) -> Array:
        """Return the poses (B, 4, 4) of the boxes in the world."""
        base = self._kinematics.base
        frames = [base if k < 0 else where.frames[k] for k in self._carriers]
        return np.asarray(np.array(frames).reshape(-1, 4, 4) @ self._offsets)

    def _spheres(self, where: HandConfiguration) -> tuple[Array, Array]:
        robot = self._kinematics.robot
        centres, radii = [np.empty((0, 3))], [np.empty(0)]
        if robot.tips.radius > 0.0:
            turned = np.einsum("fij,kj->fki", where.sensors[:, :3, :3], _TIP_CENTRES)
            tips = (where.sensors[:, None, :3, 3] + turned).reshape(-1, 3)
            centres.append(tips)
            radii.append(np.full(len(tips), robot.tips.radius + self._margin))
        if self._bare_arm:
            joints = where.centres[: robot.arm_dof]
            share = np.linspace(0.0, 1.0, _ARM_SPHERES, endpoint=False)[:, None, None]
            arm = ((1.0 - share) * joints[:-1] + share * joints[1:]).reshape(-1, 3)
            centres.append(arm)
            radii.append(np.full(len(arm), robot.arm_radius))
        return np.vstack(centres), np.concatenate(radii)


class TreeVolume:
    """Boxes that enclose the links of any robot, moved by the joints of its URDF.

    Args:
        urdf: text of the URDF. folder: where its relative files lie, or "".
        base_pose: (4, 4) pose of the root link in the world.
        margin: by which every shape is larger than the link, m.

    Attributes:
        joint_names: joints that move, parents first; those that mimic others are not among them.

    Raises:
        BadInputError: it is no URDF, or none of its links has a shape.
    """

    def __init__(
        self, urdf: str, folder: str = "", base_pose: Array | None = None, margin: float = 0.003
    ) -> None:
        self._tree = read_tree(urdf, "robot")
        children = {joint.child for joint in self._tree}
        boxes = boxes_around(urdf, folder)
        if not boxes:
            raise BadInputError("robot: no link has a shape with which it collides")
        self._base = np.eye(4) if base_pose is None else np.asarray(base_pose, dtype=float)
        roots = {joint.parent for joint in self._tree} - children or {boxes[0].link}
        self._frames = dict.fromkeys(roots, self._base)
        self._boxes = boxes
        self._halves = 0.5 * np.array([box.size for box in boxes]) + margin
        self.joint_names = tuple(joint.name for joint in independent(self._tree))

    def depth(self, positions: Array, camera: Array, rays: Array) -> Array:
        """Return at which depth rays meet the robot.

        Args:
            positions: (J,) of `joint_names`, rad or m.
            camera: (4, 4) X_WC.
            rays: (H, W, 3) with z = 1 of a rectangle of pixels, camera frame.

        Returns:
            (H, W) m, infinite where a ray meets nothing.
        """
        value = dict(zip(self.joint_names, positions, strict=True))
        frames = dict(self._frames)
        for joint in self._tree:
            position = 0.0 if joint.axis is None else position_of(joint, value)
            frames[joint.child] = frames[joint.parent] @ placed(joint, position)
        poses = np.array([frames[box.link] @ box.pose for box in self._boxes])
        return _depth_of(poses, self._halves, np.empty((0, 3)), np.empty(0), camera, rays)


def _depth_of(
    boxes: Array, halves: Array, centres: Array, radii: Array, camera: Array, rays: Array
) -> Array:
    """Return at which depth rays meet boxes and spheres of the world.

    Args:
        boxes: (B, 4, 4) poses.
        halves: (B, 3) half edges, m.
        centres: (S, 3) of spheres, m.
        radii: (S,) m.
        camera: (4, 4) X_WC.
        rays: (H, W, 3) with z = 1, camera frame.
    """
    to_camera = np.linalg.inv(camera)
    height, width = rays.shape[:2]
    nearest = np.full(height * width, np.inf)
    across = rays[0, :, 0].copy(), rays[:, 0, 1].copy()
    rays = rays.reshape(-1, 3)
    poses, reach = to_camera @ boxes, np.linalg.norm(halves, axis=1)
    for k in _in_sight(poses[:, :3, 3], reach, across):
        index = _near(poses[k, :3, 3], reach[k], across)
        _meet_box(poses[k], halves[k], rays, index, nearest)
    centres = centres @ to_camera[:3, :3].T + to_camera[:3, 3]
    for k in _in_sight(centres, radii, across):
        index = _near(centres[k], radii[k], across)
        _meet_sphere(centres[k], radii[k], rays, index, nearest)
    return nearest.reshape(height, width)


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
