"""Where an object can be taken, and from there to palm pose, joint positions and squeeze."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.configuration import check_ranges, parameter
from tactile_dynamics_ros.core.errors import BadInputError, NotIdentifiableError
from tactile_dynamics_ros.core.manipulation.inverse_kinematics import solve_arm, solve_fingers
from tactile_dynamics_ros.core.reading import read_yaml
from tactile_dynamics_ros.core.rigid_body.rotation import skew
from tactile_dynamics_ros.core.robot.hand_kinematics import HandKinematics
from tactile_dynamics_ros.core.robot.robot import Robot


@dataclass(frozen=True)
class GraspSite:
    """Two opposing faces of an object and the direction to come from, all in the object frame.

    Attributes:
        centre: (3,) m, midway between the two faces, where the middle finger and the thumb press.
        pinch: (3,) unit vector from the thumb's face to the fingers' face.
        approach: (3,) unit vector along which the open hand comes, normal to ``pinch``.
        width: distance of the faces, m.
        spread: distance of neighbouring fingers on one face, m.
        radius: radius of a round object whose axis is ``approach``, m; zero for flat faces.
        stagger: how much deeper the middle finger presses than index and ring, m.
        depth: depth of the grasp centre beyond the palm of a hand along the approach, m; None
            leaves it to the robot. Less depth lets the thumb press harder (heavier objects) but
            more with its very tip.
        thumb: place of the thumb's tip behind the knuckles along the pinch, m; None leaves it to
            the robot.
    """

    centre: Array
    pinch: Array
    approach: Array
    width: float
    spread: float = 0.04
    radius: float = 0.0
    stagger: float = 0.015
    depth: float | None = None
    thumb: float | None = None

    def __post_init__(self) -> None:
        for name in ("centre", "pinch", "approach"):
            vector = np.asarray(getattr(self, name), dtype=float)
            if vector.shape != (3,):
                raise BadInputError(f"grasp site: {name} has shape {vector.shape}, expected (3,)")
            object.__setattr__(self, name, vector)
        for name in ("pinch", "approach"):
            object.__setattr__(self, name, _unit(getattr(self, name), name))
        if abs(self.pinch @ self.approach) > 1e-6:
            raise BadInputError("grasp site: pinch and approach must be perpendicular")
        if not 0.005 < self.width < 0.12:
            raise BadInputError(f"grasp site: width = {self.width} m, expected 0.005 to 0.12")

    @classmethod
    def from_file(cls, path: Path) -> GraspSite:
        """Read the ``grasp`` section of an object's yaml file.

        Raises:
            BadInputError: it cannot be read, or see `from_mapping`.
        """
        values = read_yaml(path, "a yaml file of an object")
        section = values.get("grasp") if isinstance(values, Mapping) else None
        if not isinstance(section, Mapping):
            raise BadInputError(f"{path}: no section 'grasp', expected an object with one")
        try:
            return cls.from_mapping(section)
        except (BadInputError, TypeError, ValueError) as error:
            raise BadInputError(f"{path}: {error}") from error

    @classmethod
    def from_mapping(cls, values: Mapping[str, Any]) -> GraspSite:
        """Build a site from the ``grasp`` section of an object's yaml file.

        Raises:
            BadInputError: a key is unknown, missing or has the wrong shape.
        """
        known = {field.name for field in fields(cls)}
        unknown = sorted(set(values) - known)
        missing = sorted({"centre", "pinch", "approach", "width"} - set(values))
        if unknown or missing:
            raise BadInputError(
                f"grasp site: unknown keys {unknown}, missing keys {missing}; "
                f"the keys are {sorted(known)}"
            )
        return cls(**values)

    def frame(self) -> Array:
        """Pose X_OG (4, 4) of the grasp frame: x = -pinch, z = approach, origin at the centre."""
        pose = np.eye(4)
        pose[:3, 0], pose[:3, 2] = -self.pinch, self.approach
        pose[:3, 1] = np.cross(self.approach, -self.pinch)
        pose[:3, 3] = self.centre
        return pose

    def face_offset(self, lateral: float) -> tuple[float, Array]:
        """Distance of a face from the mid-plane and its outward normal, (x, y) of the grasp frame.

        Args:
            lateral: position along the row of fingers (y of the grasp frame), m.
        """
        if self.radius == 0.0:
            return 0.5 * self.width, np.array([1.0, 0.0])
        sine = float(np.clip(lateral / self.radius, -0.9, 0.9))
        cosine = float(np.sqrt(1.0 - sine**2))
        return self.radius * cosine, np.array([cosine, sine])


def _unit(vector: Array, name: str) -> Array:
    length = float(np.linalg.norm(vector))
    if length < 1e-9:
        raise BadInputError(f"grasp site: {name} is a zero vector")
    return np.asarray(vector / length)


_TURNED_APART, _SLID_APART = 0.02, 0.002
"""Distance by which a joint of a plan may miss what it follows, rad and m: fingers are placed to
2 mm, and joints that carry links of 0.1 m turn by that. At half of it, jaws that stand in the
middle are refused for what is left of the search."""


@dataclass(frozen=True)
class GraspGeometry:
    """How the fingers stand about the grasp site; the palm is the robot's habit."""

    thumb_lateral: float = parameter(0.0, "thumb beside the middle finger", "m", -0.03, 0.03)
    opening: float = parameter(0.022, "gap of each fingertip before closing", "m", 0.005, 0.05)

    def __post_init__(self) -> None:
        check_ranges(self)


@dataclass(frozen=True)
class GraspPlan:
    """Where palm and fingertips have to be to take the object.

    Attributes:
        palm: (4, 4) X_WP at the grasp.
        arm: (A,) rad at the grasp.
        touch: (H,) hand joints with the skins touching the faces.
        open: (H,) hand joints with the skins off the faces.
        closed: (H,) hand joints with the skins pressed 8 mm into the faces.
        points: (F, 3) contact points, normals: (F, 3) into the object, both in the palm frame.
    """

    palm: Array
    arm: Array
    touch: Array
    open: Array
    closed: Array
    points: Array
    normals: Array


def plan_grasp(
    kinematics: HandKinematics,
    site: GraspSite,
    object_pose: Array,
    geometry: GraspGeometry | None = None,
) -> GraspPlan:
    """Plan the grasp from the two mirrored ways to take it, preferring the lesser arm rotation.

    Args:
        kinematics: kinematic model of the robot.
        site: grasp site of the object.
        object_pose: (4, 4) X_WO.
        geometry: how the hand stands about the site.

    Raises:
        NotIdentifiableError: arm or fingers cannot reach the site.
    """
    geometry, robot = geometry or GraspGeometry(), kinematics.robot
    frame_palm = _palm_in_grasp_frame(robot, geometry, site)
    ways = []
    for flip in (np.eye(3), np.diag([-1.0, -1.0, 1.0])):
        grasp = object_pose @ site.frame()
        grasp[:3, :3] = grasp[:3, :3] @ flip
        palm = grasp @ frame_palm
        start = robot.start.copy()
        start[0] = np.arctan2(palm[1, 3], palm[0, 3])
        positions, error = solve_arm(kinematics, start, palm, robot.home)
        if error < 1e-3:
            moved = np.abs(positions[: robot.arm_dof] - robot.home).max()
            ways.append((float(moved), palm, positions))
    if not ways:
        where = np.round(object_pose[:3, 3], 3).tolist()
        raise NotIdentifiableError(
            f"grasp plan: the arm cannot reach the object at {where} m; "
            "move it to the middle of the table"
        )
    _, palm, positions = min(ways, key=lambda way: way[0])
    return _plan_fingers(kinematics, site, geometry, palm, positions)


def _palm_in_grasp_frame(robot: Robot, geometry: GraspGeometry, site: GraspSite) -> Array:
    """Pose X_GP (4, 4): grasp frame x = -pinch, z = approach.

    The fingertip of side 1 touches ``thumb`` behind the palm's origin; a gripper stands in the
    middle.
    """
    habit, pose = robot.grasp, np.eye(4)
    pose[:3, :3] = habit.palm_rotation
    if habit.thumb is None:
        pose[2, 3] = -habit.depth
        return pose
    thumb = habit.thumb if site.thumb is None else site.thumb
    depth = habit.depth if site.depth is None else site.depth
    along = 0.5 * site.width + robot.tips.radius - thumb
    pose[:3, 3] = [along, -0.5 * geometry.thumb_lateral, -depth]
    return pose


def contact_layout(robot: Robot, site: GraspSite, geometry: GraspGeometry) -> tuple[Array, Array]:
    """Contact points (F, 3) and normals into the object (F, 3) in the grasp frame.

    x runs from the face of the fingers with side -1 to that of side 1, y along the row of fingers,
    z along the approach.
    """
    half, hand = 0.5 * geometry.thumb_lateral, robot.hand
    points, normals = np.zeros((len(hand), 3)), np.zeros((len(hand), 3))
    for k, finger in enumerate(hand):
        lateral = site.spread * finger.lateral + (half if finger.side > 0 else -half)
        same = [other.stagger for other in hand if other.side == finger.side]
        height = site.stagger * (finger.stagger - sum(same) / len(same))
        offset, outward = site.face_offset(lateral)
        points[k] = [finger.side * offset, lateral, height]
        normals[k] = [-finger.side * outward[0], -outward[1], 0.0]
    return points, normals


def _plan_fingers(
    kinematics: HandKinematics,
    site: GraspSite,
    geometry: GraspGeometry,
    palm: Array,
    start: Array,
) -> GraspPlan:
    robot = kinematics.robot
    points, normals = contact_layout(robot, site, geometry)
    grasp = palm @ np.linalg.inv(_palm_in_grasp_frame(robot, geometry, site))
    world_points = points @ grasp[:3, :3].T + grasp[:3, 3]
    world_normals = normals @ grasp[:3, :3].T
    joints: dict[str, Array] = {}
    depths = {"touch": (0.0,), "closed": (0.008, 0.004)}
    depths["open"] = tuple(-share * geometry.opening for share in (1.0, 0.75, 0.5, 0.25))
    for name in ("touch", "closed", "open"):
        start = joints.get("touch", start)
        joints[name], missed = _reach(kinematics, start, world_points, world_normals, depths[name])
        if missed is not None:
            raise NotIdentifiableError(
                f"grasp plan ({name}): the {missed} cannot get to its place; "
                f"a width of {site.width * 1e3:.0f} mm there does not suit the hand"
            )
        _refuse_apart(robot, name, joints[name])
    rotation, count = palm[:3, :3], robot.arm_dof
    return GraspPlan(
        palm=palm,
        arm=joints["touch"][:count],
        touch=joints["touch"][count:],
        open=joints["open"][count:],
        closed=joints["closed"][count:],
        points=(world_points - palm[:3, 3]) @ rotation,
        normals=world_normals @ rotation,
    )


def _refuse_apart(robot: Robot, name: str, positions: Array) -> None:
    """Check that joints which follow others do so in a plan.

    Args:
        robot: whose joints they are.
        name: of the plan.
        positions: (J,) rad or m.

    Raises:
        NotIdentifiableError: fingers that move together would have to stand elsewhere.
    """
    known = dict(zip(robot.joint_names, positions.tolist(), strict=True))
    slides = {joint.name: joint.slides for joint in robot.joints}
    for follower, follows in robot.followers.items():
        if follows.leader not in known:
            continue
        apart = known[follower] - follows.factor * known[follows.leader] - follows.offset
        if abs(apart) > (_SLID_APART if slides[follower] else _TURNED_APART):
            raise NotIdentifiableError(
                f"grasp plan ({name}): joint {follower} mimics {follows.leader}, so that their "
                f"fingers move together, but the object needs {follower} {apart:.3f} (rad or m) "
                "elsewhere; choose a grasp site about which the fingers close alike"
            )


def _reach(
    kinematics: HandKinematics,
    start: Array,
    points: Array,
    normals: Array,
    depths: tuple[float, ...],
) -> tuple[Array, str | None]:
    """Joint positions with the skins at the first depth behind the faces that can be reached.

    Returns also the name of the finger that reaches none, or None.
    """
    robot = kinematics.robot
    positions, errors = start, np.full(len(robot.hand), np.inf)
    preferred = np.array([finger.pad for finger in robot.hand])
    for depth in depths:
        tips = points + (depth - robot.tips.radius) * normals
        positions, errors = solve_fingers(kinematics, start, tips, normals, preferred, 60)
        if float(errors.max()) < 2e-3:
            return positions, None
    return positions, robot.fingers[int(errors.argmax())]


def squeeze_forces(points: Array, normals: Array, sides: Array, most: float) -> Array:
    """Forces (F, 3) on the object that balance each other and press mostly along the normals.

    min |f - f_wanted|^2 with tangential parts weighted 4-fold, subject to zero net wrench.

    Args:
        points: (F, 3) m, any frame.
        normals: (F, 3) into the object, same frame.
        sides: (F,) -1 or 1, the face on which each finger presses.
        most: sum of the normal forces on the face of side 1, N; those of the other share its
            reaction.
    """
    count = len(points)
    share = most / np.array([np.sum(sides == side) for side in sides])
    wanted = (share[:, None] * normals).reshape(-1)
    across = np.eye(3) - normals[:, :, None] * normals[:, None, :]
    weight = np.zeros((3 * count, 3 * count))
    for k in range(count):
        weight[3 * k : 3 * k + 3, 3 * k : 3 * k + 3] = np.eye(3) + 4.0 * across[k]
    centre = points.mean(axis=0)
    grasp = np.concatenate(
        [np.concatenate([10.0 * skew(point - centre), np.eye(3)]) for point in points], axis=1
    )
    system = np.block([[weight, grasp.T], [grasp, np.zeros((6, 6))]])
    told = np.concatenate([weight @ wanted, np.zeros(6)])
    if count > 2:
        solution = np.linalg.solve(system, told)
    else:  # two points cannot twist about their line: one of the six conditions is void
        solution = np.linalg.lstsq(system, told, rcond=None)[0]
    forces = solution[: 3 * count].reshape(count, 3)
    pressing = float(np.einsum("fi,fi->f", forces, normals)[sides > 0].sum())
    return np.asarray(forces * most / max(pressing, 1e-9))
