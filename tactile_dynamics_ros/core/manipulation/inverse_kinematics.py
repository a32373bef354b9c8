"""Joint positions that bring the palm or the fingertips to a place (damped least squares)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.rigid_body.rotation import cross, log_so3
from tactile_dynamics_ros.core.robot.hand_kinematics import HandKinematics
from tactile_dynamics_ros.core.robot.kinematic_tree import coupling
from tactile_dynamics_ros.core.robot.robot import Joint, Robot, column

LIMIT_MARGIN = 0.02
"""Distance from the limits of joints that turn, rad, that solutions keep: 1.1 deg, more than the
offsets of an encoder (0.2 deg) and the error of a drive. Less lets joints meet their stops, whose
forces the hand takes for the object's; more gives up poses that are in reach."""
SLIDE_MARGIN = 5e-4
"""Distance from the limits of joints that slide, m: half a millimetre, as the jaws of a gripper are
known to; it is lost from their opening. Less lets jaws meet their stops, more gives up wide
objects."""


def joint_limits(joints: Sequence[Joint]) -> tuple[Array, Array]:
    """Return lower and upper limits of joints with the margins that solutions keep."""
    margin = np.where(column(joints, "slides") > 0.0, SLIDE_MARGIN, LIMIT_MARGIN)
    return column(joints, "lower") + margin, column(joints, "upper") - margin


def pose_error(target: Array, pose: Array) -> Array:
    """Twist (6,) [rotation vector, translation] in world axes that turns ``pose`` into ``target``.

    Args:
        target: (4, 4).
        pose: (4, 4).
    """
    rotation = log_so3(target[:3, :3] @ pose[:3, :3].T)
    return np.concatenate([rotation, target[:3, 3] - pose[:3, 3]])


def solve_arm(
    kinematics: HandKinematics,
    positions: Array,
    palm: Array,
    posture: Array | None = None,
    iterations: int = 60,
    tolerance: float = 1e-5,
) -> tuple[Array, float]:
    """Return joint positions whose palm pose is ``palm``, and the remaining error.

    dq = J^T (J J^T + lambda^2)^-1 e + (1 - J^+ J) k (q_posture - q), clipped to the limits.

    Args:
        kinematics: kinematic model of the robot.
        positions: (J,) start; only the arm's change.
        palm: (4, 4) wanted X_WP.
        posture: (A,) what the free degree of freedom should come near; the start if None.
        iterations: at most.
        tolerance: norm of the error (rad and m) at which to stop.
    """
    positions = np.array(positions, dtype=float)
    count = kinematics.robot.arm_dof
    lower, upper = joint_limits(kinematics.robot.arm)
    posture = positions[:count].copy() if posture is None else posture
    error = np.inf
    for _ in range(iterations):
        where = kinematics.locate(positions)
        twist = pose_error(palm, where.palm)
        error = float(np.linalg.norm(twist))
        if error < tolerance:
            break
        jacobian = kinematics.palm_jacobian(positions, where.palm[:3, 3])
        twist *= min(1.0, 0.3 / error)
        damping = min(1e-4, 1e-2 * error**2) + 1e-9
        inverse = jacobian.T @ np.linalg.inv(jacobian @ jacobian.T + damping * np.eye(6))
        free = np.eye(count) - inverse @ jacobian
        step = inverse @ twist + 0.1 * free @ (posture - positions[:count])
        positions[:count] = np.clip(positions[:count] + step, lower, upper)
    return positions, error


def solve_fingers(
    kinematics: HandKinematics,
    positions: Array,
    tips: Array,
    directions: Array,
    preferred: Array,
    iterations: int = 40,
) -> tuple[Array, Array]:
    """Return joint positions that bring the F sensor origins to points, and the errors (F,).

    What freedom is left to a finger turns the sensor so that ``directions`` point, in the sensor's
    frame, as near to ``preferred`` as they can.

    Args:
        kinematics: kinematic model of the robot.
        positions: (J,) start; only the hand's change.
        tips: (F, 3) wanted sensor origins, m, world.
        directions: (F, 3) unit vectors into the object, world.
        preferred: (F, 3) unit vectors in the sensor frames.
        iterations: number of steps.
    """
    positions = np.array(positions, dtype=float)
    errors = np.full(len(kinematics.fingers), np.inf)
    table = _finger_table(kinematics.robot)
    for _ in range(iterations):
        where = kinematics.locate(positions)
        axes = where.axes[table.joint] * table.there[..., None]
        turning = np.where(table.slides[..., None], 0.0, axes)
        origin = where.sensors[:, :3, 3]
        shift = cross(turning, origin[:, None] - where.centres[table.joint])
        shift = np.where(table.slides[..., None], axes, shift)
        gap = tips - origin
        errors = np.linalg.norm(gap, axis=1)
        gap *= np.minimum(1.0, 0.02 / np.maximum(errors, 1e-12))[:, None]
        rotation = where.sensors[:, :3, :3]
        turn = cross(directions[:, None], turning) @ rotation
        missing = preferred - np.einsum("fji,fj->fi", rotation, directions)
        pad = np.einsum("fki,fi->fk", turn, missing)
        jacobian = np.swapaxes(shift, 1, 2) @ table.coupling
        pad = np.einsum("fk,fkl->fl", pad, table.coupling)
        free = _step_fingers(table, positions[table.joint], jacobian, gap, pad)
        moved = np.einsum("fkl,fl->fk", table.coupling, free) + table.offset
        positions[table.joint[table.there]] = moved[table.there]
    return positions, errors


@dataclass(frozen=True, eq=False)
class _FingerTable:
    """Joints of F fingers side by side (F, K); fingers with fewer than K have fillers.

    Attributes:
        joint: number in the vector of joints. there: whether it is a joint; false for fillers.
        slides: whether it slides. lower, upper: limits with margin.
        coupling, offset: (F, K, K) and (F, K), positions of all from those of the free joints.
        free: whether it follows no other joint of the finger; false for fillers.
    """

    joint: NDArray[np.intp]
    there: NDArray[np.bool_]
    slides: NDArray[np.bool_]
    lower: Array
    upper: Array
    coupling: Array
    offset: Array
    free: NDArray[np.bool_]


@lru_cache(maxsize=16)
def _finger_table(robot: Robot) -> _FingerTable:
    lengths = np.array([len(finger.joints) for finger in robot.hand])
    there = np.arange(lengths.max()) < lengths[:, None]
    joint = np.zeros(there.shape, dtype=np.intp)
    joint[there] = np.arange(robot.arm_dof, robot.dof)
    slides = np.array([each.slides for each in robot.joints])
    lower, upper = joint_limits(robot.joints)
    pairs, offset = np.zeros((*there.shape, there.shape[1])), np.zeros(there.shape)
    for row, finger in enumerate(robot.hand):
        own = slice(len(finger.joints))
        pairs[row, own, own], offset[row, own] = coupling(finger.joints)
    free = np.einsum("fkk->fk", pairs) > 0.0
    slides = slides[joint] & there
    return _FingerTable(joint, there, slides, lower[joint], upper[joint], pairs, offset, free)


def _step_fingers(
    table: _FingerTable, hand: Array, jacobian: Array, gap: Array, pad: Array
) -> Array:
    """Close the gap (F, 3), turn the pads along (F, K) with what is left; joints stay in limits."""
    lower, upper = table.lower, table.upper
    free = table.free.astype(float)
    step = np.zeros(hand.shape)
    for _ in range(3):
        moving = jacobian * free[:, None, :]
        gram = moving @ np.swapaxes(moving, 1, 2) + 1e-7 * np.eye(3)
        inverse = np.swapaxes(moving, 1, 2) @ np.linalg.inv(gram)
        spare = np.einsum("fk,kl->fkl", free, np.eye(hand.shape[1])) - inverse @ moving
        step = np.einsum("fki,fi->fk", inverse, gap) + 0.5 * np.einsum("fkl,fl->fk", spare, pad)
        step = np.clip(step, -0.2, 0.2)
        outward = ((hand + step < lower) & (step < 0)) | ((hand + step > upper) & (step > 0))
        if not (outward & (free > 0)).any():
            break
        free = np.where(outward, 0.0, free)
    return np.clip(hand + step, lower, upper)
