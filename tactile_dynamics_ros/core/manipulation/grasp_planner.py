"""From a grasp site and an object pose to palm pose, joint positions and squeeze forces."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.configuration import check_ranges, parameter
from tactile_dynamics_ros.core.errors import NotIdentifiableError
from tactile_dynamics_ros.core.manipulation.grasp_site import GraspSite
from tactile_dynamics_ros.core.manipulation.inverse_kinematics import solve_arm, solve_fingers
from tactile_dynamics_ros.core.rigid_body.rotation import skew
from tactile_dynamics_ros.core.robot.hand_kinematics import ARM_DOF, HandKinematics
from tactile_dynamics_ros.core.robot.robot_description import FINGERS, SKIN_RADIUS

Array = NDArray[np.float64]

ARM_HOME = np.array([0.0, 0.0, 0.0, -1.8, 0.0, 1.34, 0.0])
"""Joint positions of the arm, rad, from which a grasp is sought and which redundant motion keeps
near to. Another one may give another posture of the same grasp."""
HAND_SEED = np.array([0.0, 0.4, 0.5, 0.9] * 3 + [1.3, 0.45, 0.3, 0.6])
"""Joint positions of the hand, rad, from which fingertips are sought: half closed, the thumb
opposed. A seed elsewhere may end in another posture of the same grasp."""
PAD_DIRECTIONS = np.array([[0.35, 0.0, -0.94]] * 3 + [[0.5, -0.3, -0.81]])
"""Directions into the object that suit the pads best, in the sensor frames of index, middle, ring
and thumb: about -z, out of the pad. Others let the tip or the side of a pad touch, where few
electrodes are."""


@dataclass(frozen=True)
class GraspGeometry:
    """How the hand stands about the grasp site (palm frame tilted so that z is the approach)."""

    tilt_deg: float = parameter(20.0, "approach direction from the palm's normal", "deg", 0.0, 45.0)
    depth: float = parameter(
        0.12, "grasp centre beyond the palm along the approach", "m", 0.05, 0.2
    )
    thumb_lateral: float = parameter(0.0, "thumb beside the middle finger", "m", -0.03, 0.03)
    opening: float = parameter(0.022, "gap of each fingertip before closing", "m", 0.005, 0.05)

    def __post_init__(self) -> None:
        check_ranges(self)


@dataclass(frozen=True)
class GraspPlan:
    """Where palm and fingertips have to be to take the object.

    Attributes:
        palm: (4, 4) X_WP at the grasp.
        arm: (7,) rad at the grasp.
        touch: (16,) hand joints with the skins touching the faces.
        open: (16,) hand joints with the skins off the faces.
        closed: (16,) hand joints with the skins pressed 8 mm into the faces.
        points: (4, 3) contact points, normals: (4, 3) into the object, both in the palm frame.
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
    geometry = geometry or GraspGeometry()
    frame_palm = _palm_in_grasp_frame(geometry, site)
    ways = []
    for flip in (np.eye(3), np.diag([-1.0, -1.0, 1.0])):
        grasp = object_pose @ site.frame()
        grasp[:3, :3] = grasp[:3, :3] @ flip
        palm = grasp @ frame_palm
        start = np.concatenate([ARM_HOME, HAND_SEED])
        start[0] = np.arctan2(palm[1, 3], palm[0, 3])
        positions, error = solve_arm(kinematics, start, palm, ARM_HOME)
        if error < 1e-3:
            ways.append((float(np.abs(positions[:ARM_DOF] - ARM_HOME).max()), palm, positions))
    if not ways:
        where = np.round(object_pose[:3, 3], 3).tolist()
        raise NotIdentifiableError(
            f"grasp plan: the arm cannot reach the object at {where} m; "
            "move it to the middle of the table"
        )
    _, palm, positions = min(ways, key=lambda way: way[0])
    return _plan_fingers(kinematics, site, geometry, palm, positions)


def _palm_in_grasp_frame(geometry: GraspGeometry, site: GraspSite) -> Array:
    """Pose X_GP (4, 4): grasp frame x = -pinch, z = approach, as the flange's axes."""
    angle = np.deg2rad(geometry.tilt_deg)
    pinch = np.array([-np.sin(angle), 0.0, np.cos(angle)])
    approach = np.array([np.cos(angle), 0.0, np.sin(angle)])
    rotation = np.stack([-pinch, [0.0, 1.0, 0.0], approach])
    along = 0.5 * site.width + SKIN_RADIUS - site.thumb
    pose = np.eye(4)
    pose[:3, :3] = rotation
    pose[:3, 3] = [along, -0.5 * geometry.thumb_lateral, -site.depth]
    return pose


def contact_layout(site: GraspSite, geometry: GraspGeometry) -> tuple[Array, Array]:
    """Contact points (4, 3) and normals into the object (4, 3) in the grasp frame.

    x runs from the fingers' face to the thumb's, y along the row of fingers, z along the approach.
    """
    half = 0.5 * geometry.thumb_lateral
    laterals = np.array([site.spread, 0.0, -site.spread, 2 * half]) - half
    heights = site.stagger * np.array([-1 / 3, 2 / 3, -1 / 3, 0.0])
    sides = np.array([-1.0, -1.0, -1.0, 1.0])
    points, normals = np.zeros((4, 3)), np.zeros((4, 3))
    for k, lateral in enumerate(laterals):
        offset, outward = site.face_offset(float(lateral))
        points[k] = [sides[k] * offset, lateral, heights[k]]
        normals[k] = [-sides[k] * outward[0], -outward[1], 0.0]
    return points, normals


def _plan_fingers(
    kinematics: HandKinematics,
    site: GraspSite,
    geometry: GraspGeometry,
    palm: Array,
    start: Array,
) -> GraspPlan:
    points, normals = contact_layout(site, geometry)
    grasp = palm @ np.linalg.inv(_palm_in_grasp_frame(geometry, site))
    world_points = points @ grasp[:3, :3].T + grasp[:3, 3]
    world_normals = normals @ grasp[:3, :3].T
    joints: dict[str, Array] = {}
    depths = {"touch": (0.0,), "closed": (0.008, 0.004)}
    depths["open"] = tuple(-share * geometry.opening for share in (1.0, 0.75, 0.5))
    for name in ("touch", "closed", "open"):
        start = joints.get("touch", start)
        joints[name], missed = _reach(kinematics, start, world_points, world_normals, depths[name])
        if missed is not None:
            raise NotIdentifiableError(
                f"grasp plan ({name}): the {missed} cannot get to its place; "
                f"a width of {site.width * 1e3:.0f} mm there does not suit the hand"
            )
    rotation = palm[:3, :3]
    return GraspPlan(
        palm=palm,
        arm=joints["touch"][:ARM_DOF],
        touch=joints["touch"][ARM_DOF:],
        open=joints["open"][ARM_DOF:],
        closed=joints["closed"][ARM_DOF:],
        points=(world_points - palm[:3, 3]) @ rotation,
        normals=world_normals @ rotation,
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
    positions, errors = start, np.full(len(FINGERS), np.inf)
    for depth in depths:
        tips = points + (depth - SKIN_RADIUS) * normals
        positions, errors = solve_fingers(
            kinematics, start, tips, normals, PAD_DIRECTIONS, iterations=60
        )
        if float(errors.max()) < 2e-3:
            return positions, None
    return positions, FINGERS[int(errors.argmax())]


def squeeze_forces(points: Array, normals: Array, thumb_force: float) -> Array:
    """Forces (4, 3) on the object that balance each other and press mostly along the normals.

    min |f - f_wanted|^2 with tangential parts weighted 4-fold, subject to zero net wrench.

    Args:
        points: (4, 3) m, any frame.
        normals: (4, 3) into the object, same frame.
        thumb_force: normal force of the thumb, N; the fingers share its reaction.
    """
    share = np.array([thumb_force / 3.0] * 3 + [thumb_force])
    wanted = (share[:, None] * normals).reshape(-1)
    across = np.eye(3) - normals[:, :, None] * normals[:, None, :]
    weight = np.zeros((12, 12))
    for k in range(4):
        weight[3 * k : 3 * k + 3, 3 * k : 3 * k + 3] = np.eye(3) + 4.0 * across[k]
    centre = points.mean(axis=0)
    grasp = np.concatenate(
        [np.concatenate([10.0 * skew(points[k] - centre), np.eye(3)]) for k in range(4)], axis=1
    )
    system = np.block([[weight, grasp.T], [grasp, np.zeros((6, 6))]])
    solution = np.linalg.solve(system, np.concatenate([weight @ wanted, np.zeros(6)]))
    forces = solution[:12].reshape(4, 3)
    return np.asarray(forces * thumb_force / max(float(forces[3] @ normals[3]), 1e-9))
