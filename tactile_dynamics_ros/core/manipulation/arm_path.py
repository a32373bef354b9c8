"""Paths of the arm through time, within joint limits and joint speeds."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.errors import NotIdentifiableError
from tactile_dynamics_ros.core.manipulation.excitation import CartesianOffsets
from tactile_dynamics_ros.core.manipulation.inverse_kinematics import solve_arm
from tactile_dynamics_ros.core.rigid_body.rotation import exp_so3, log_so3
from tactile_dynamics_ros.core.robot.hand_kinematics import HandKinematics
from tactile_dynamics_ros.core.robot.robot import Robot, column

SPEED_SHARE = 0.9
"""Share of each arm joint's speed limit that paths may use, so that following a path never
saturates a drive. The tenth that is left is for the controller's corrections; less makes motions
slower and excites less, 1 lets a drive that corrects itself saturate and the arm leave its path."""
NODE_RATE_HZ = 20.0
"""Nodes of a path per second, between which it is a cubic spline. A spline of 20 Hz follows the
motions (up to 2.5 Hz) to a thousandth; more nodes take longer to solve. At 5 Hz there are two nodes
per period of the fastest motion, which cut its peaks."""


@dataclass(frozen=True)
class ArmPath:
    """Arm joint positions as a spline of time that starts at zero.

    Attributes:
        duration: s.
        spline: time (s) -> (A,) rad.
        scale: share of the wanted amplitude that limits allowed (1 = all).
    """

    duration: float
    spline: CubicSpline
    scale: float = 1.0

    def __call__(self, time: float) -> Array:
        """Return the arm's joint positions (A,) at ``time`` (s), held at both ends."""
        return np.asarray(self.spline(float(np.clip(time, 0.0, self.duration))))


def speed_limit(robot: Robot) -> Array:
    """Return the speeds (A,) of the arm's joints that paths may use, rad/s."""
    return SPEED_SHARE * column(robot.arm, "velocity")


def join_joints(robot: Robot, start: Array, goal: Array, speed: float = 0.5) -> ArmPath:
    """Return the minimum-jerk path between two joint positions (A,) of the arm.

    Args:
        robot: whose arm moves.
        start: rad.
        goal: rad.
        speed: share of the joints' speed limits.
    """
    longest = float(np.max(np.abs(goal - start) / (speed * speed_limit(robot))))
    duration = max(1.0, 1.875 * longest)
    time = np.linspace(0.0, duration, 2 + int(NODE_RATE_HZ * duration))
    nodes = start + minimum_jerk(time / duration)[:, None] * (goal - start)
    return ArmPath(duration, CubicSpline(time, nodes, bc_type="clamped"))


def join_poses(
    kinematics: HandKinematics, positions: Array, goal: Array, speed: float = 0.1
) -> ArmPath:
    """Return the straight minimum-jerk path of the palm from where it is to ``goal``.

    Args:
        kinematics: kinematic model of the robot.
        positions: (J,) rad at the start.
        goal: (4, 4) X_WP.
        speed: greatest speed of the palm, m/s (and rad/s times 0.2 m).
    """
    start = kinematics.locate(positions).palm
    turn = log_so3(goal[:3, :3] @ start[:3, :3].T)
    shift = goal[:3, 3] - start[:3, 3]
    length = max(float(np.linalg.norm(shift)), 0.2 * float(np.linalg.norm(turn)))
    duration = max(0.5, 1.875 * length / speed)

    def palm(time: float) -> Array:
        along = float(minimum_jerk(np.array(time / duration)))
        pose = np.eye(4)
        pose[:3, :3] = exp_so3(along * turn) @ start[:3, :3]
        pose[:3, 3] = start[:3, 3] + along * shift
        return pose

    return _follow(kinematics, positions, palm, duration)


def excite(
    kinematics: HandKinematics,
    positions: Array,
    pivot: Array,
    offsets: CartesianOffsets,
    duration: float,
) -> ArmPath:
    """Return the path that moves the palm by Cartesian offsets about where it is.

    X_WP(t) = [exp(phi(t)) about the pivot, shifted by d(t)] X_WP(0). The offsets are scaled down
    as far as joint limits and speeds demand.

    Args:
        kinematics: kinematic model of the robot.
        positions: (J,) rad at the start.
        pivot: (3,) point of the palm's body about which it turns, m, world.
        offsets: time -> (6,) [rotation vector, translation].
        duration: s.

    Raises:
        NotIdentifiableError: not even a tenth of the motion is possible here.
    """
    start = kinematics.locate(positions).palm
    for scale in (1.0, 0.85, 0.7, 0.55, 0.4, 0.25, 0.1):

        def palm(time: float, scale: float = scale) -> Array:
            return _move_about(start, pivot, scale * offsets(time))

        try:
            return _follow(kinematics, positions, palm, duration, scale)
        except NotIdentifiableError:
            continue
    raise NotIdentifiableError(
        "excitation: the arm cannot make even a tenth of the motion here; lift to another place"
    )


def _move_about(palm: Array, pivot: Array, offset: Array) -> Array:
    """Turn a pose (4, 4) about a pivot (3,) and shift it by offset (6,) [rotation, translation]."""
    turn = exp_so3(offset[:3])
    pose = np.eye(4)
    pose[:3, :3] = turn @ palm[:3, :3]
    pose[:3, 3] = pivot + turn @ (palm[:3, 3] - pivot) + offset[3:]
    return pose


def minimum_jerk(fraction: Array) -> Array:
    """Quintic step from 0 to 1 over fraction 0 to 1."""
    x = np.clip(fraction, 0.0, 1.0)
    return np.asarray(x**3 * (10.0 - 15.0 * x + 6.0 * x * x))


def _follow(
    kinematics: HandKinematics,
    positions: Array,
    palm: Callable[[float], Array],
    duration: float,
    scale: float = 1.0,
) -> ArmPath:
    """Solve the arm along palm(t) and check errors and speeds."""
    time = np.linspace(0.0, duration, 2 + int(NODE_RATE_HZ * duration))
    count = kinematics.robot.arm_dof
    nodes = np.empty((len(time), count))
    posture = positions[:count].copy()
    current = np.array(positions, dtype=float)
    for k, instant in enumerate(time):
        current, error = solve_arm(kinematics, current, palm(float(instant)), posture, 15)
        if error > 1e-3:
            raise NotIdentifiableError(
                f"arm path: the arm misses the palm's pose by {error:.3f} (m, rad) after "
                f"{instant:.2f} s; joint limits or reach"
            )
        nodes[k] = current[:count]
    spline = CubicSpline(time, nodes, bc_type="clamped")
    speed = np.abs(spline(time, 1)) / speed_limit(kinematics.robot)
    if float(speed.max()) > 1.0:
        joint = kinematics.robot.arm[int(speed.max(axis=0).argmax())].name
        raise NotIdentifiableError(
            f"arm path: {joint} would exceed its speed {speed.max():.2f}-fold"
        )
    return ArmPath(duration, spline, scale)
