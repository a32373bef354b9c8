"""Joint positions that bring the palm or the fingertips to a place (damped least squares)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.rigid_body.rotation import cross, log_so3
from tactile_dynamics_ros.core.robot.hand_kinematics import ARM_DOF, HandKinematics
from tactile_dynamics_ros.core.robot.robot_description import ACTUATED_JOINTS, FINGERS

Array = NDArray[np.float64]

LIMIT_MARGIN = 0.02
"""Distance from the joints' limits, rad, that solutions keep: 1.1 deg, more than the offsets of an
encoder (0.2 deg) and the error of a drive."""
ARM_LOWER = np.array([joint.lower + LIMIT_MARGIN for joint in ACTUATED_JOINTS[:ARM_DOF]])
"""Lower limits of the arm's joints with that margin, rad."""
ARM_UPPER = np.array([joint.upper - LIMIT_MARGIN for joint in ACTUATED_JOINTS[:ARM_DOF]])
"""Upper limits of the arm's joints with that margin, rad."""
HAND_LOWER = np.array([joint.lower + LIMIT_MARGIN for joint in ACTUATED_JOINTS[ARM_DOF:]])
"""Lower limits of the hand's joints with that margin, rad."""
HAND_UPPER = np.array([joint.upper - LIMIT_MARGIN for joint in ACTUATED_JOINTS[ARM_DOF:]])
"""Upper limits of the hand's joints with that margin, rad."""


def arm_jacobian(axes: Array, centres: Array, point: Array) -> Array:
    """Jacobian (6, 7) [angular velocity, velocity] of a point (3,) that moves with the palm."""
    arm_axes = axes[:ARM_DOF]
    return np.concatenate([arm_axes, cross(arm_axes, point - centres[:ARM_DOF])], axis=1).T


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
        positions: (23,) start; only the arm's seven change.
        palm: (4, 4) wanted X_WP.
        posture: (7,) what the free degree of freedom should come near; the start if None.
        iterations: at most.
        tolerance: norm of the error (rad and m) at which to stop.
    """
    positions = np.array(positions, dtype=float)
    posture = positions[:ARM_DOF].copy() if posture is None else posture
    error = np.inf
    for _ in range(iterations):
        where = kinematics.locate(positions)
        twist = pose_error(palm, where.palm)
        error = float(np.linalg.norm(twist))
        if error < tolerance:
            break
        jacobian = arm_jacobian(where.axes, where.centres, where.palm[:3, 3])
        twist *= min(1.0, 0.3 / error)
        damping = min(1e-4, 1e-2 * error**2) + 1e-9
        inverse = jacobian.T @ np.linalg.inv(jacobian @ jacobian.T + damping * np.eye(6))
        free = np.eye(ARM_DOF) - inverse @ jacobian
        step = inverse @ twist + 0.1 * free @ (posture - positions[:ARM_DOF])
        positions[:ARM_DOF] = np.clip(positions[:ARM_DOF] + step, ARM_LOWER, ARM_UPPER)
    return positions, error


def solve_fingers(
    kinematics: HandKinematics,
    positions: Array,
    tips: Array,
    directions: Array,
    preferred: Array,
    iterations: int = 40,
) -> tuple[Array, Array]:
    """Return joint positions that bring the four sensor origins to points, and the errors (4,).

    The fourth joint of each finger turns the sensor so that ``directions`` point, in the sensor's
    frame, as near to ``preferred`` as they can.

    Args:
        kinematics: kinematic model of the robot.
        positions: (23,) start; only the hand's sixteen change.
        tips: (4, 3) wanted sensor origins, m, world.
        directions: (4, 3) unit vectors into the object, world.
        preferred: (4, 3) unit vectors in the sensor frames.
        iterations: number of steps.
    """
    positions = np.array(positions, dtype=float)
    count = len(FINGERS)
    errors = np.full(count, np.inf)
    for _ in range(iterations):
        where = kinematics.locate(positions)
        axes = where.axes[ARM_DOF:].reshape(count, 4, 3)
        centres = where.centres[ARM_DOF:].reshape(count, 4, 3)
        origin = where.sensors[:, :3, 3]
        jacobian = np.swapaxes(cross(axes, origin[:, None] - centres), 1, 2)
        gap = tips - origin
        errors = np.linalg.norm(gap, axis=1)
        gap *= np.minimum(1.0, 0.02 / np.maximum(errors, 1e-12))[:, None]
        rotation = where.sensors[:, :3, :3]
        turn = cross(directions[:, None], axes) @ rotation
        missing = preferred - np.einsum("fji,fj->fi", rotation, directions)
        pad = np.einsum("fki,fi->fk", turn, missing)
        hand = positions[ARM_DOF:].reshape(count, 4)
        positions[ARM_DOF:] = _step_fingers(hand, jacobian, gap, pad).reshape(-1)
    return positions, errors


def _step_fingers(hand: Array, jacobian: Array, gap: Array, pad: Array) -> Array:
    """Close the gap (4, 3), turn the pads along (4, 4) with what is left; joints stay in limits."""
    lower, upper = HAND_LOWER.reshape(4, 4), HAND_UPPER.reshape(4, 4)
    free = np.ones((4, 4))
    step = np.zeros((4, 4))
    for _ in range(3):
        moving = jacobian * free[:, None, :]
        gram = moving @ np.swapaxes(moving, 1, 2) + 1e-7 * np.eye(3)
        inverse = np.swapaxes(moving, 1, 2) @ np.linalg.inv(gram)
        spare = np.einsum("fk,kl->fkl", free, np.eye(4)) - inverse @ moving
        step = np.einsum("fki,fi->fk", inverse, gap) + 0.5 * np.einsum("fkl,fl->fk", spare, pad)
        step = np.clip(step, -0.2, 0.2)
        outward = ((hand + step < lower) & (step < 0)) | ((hand + step > upper) & (step > 0))
        if not (outward & (free > 0)).any():
            break
        free = np.where(outward, 0.0, free)
    return np.clip(hand + step, lower, upper)
