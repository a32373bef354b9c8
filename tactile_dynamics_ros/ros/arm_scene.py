"""Topics of a simulated arm that carries a tool and a load: trajectory controller and sensor."""

from __future__ import annotations

import importlib
from typing import Any, Protocol

import numpy as np
from geometry_msgs.msg import WrenchStamped
from sensor_msgs.msg import JointState
from std_msgs.msg import String
from trajectory_msgs.msg import JointTrajectory

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.ros.conversions import joints_to_message, wrench_to_message
from tactile_dynamics_ros.ros.names import (
    ATTACH,
    DETACH,
    JOINT_STATES,
    JOINT_TRAJECTORY,
    ROBOT_DESCRIPTION,
    SET_PAYLOAD,
    WRIST_WRENCH,
)
from tactile_dynamics_ros.ros.shell import Shell

FRAME = "wrist_sensor"
"""Frame of the sensor, a link of the arm's URDF."""


class SimulatedArm(Protocol):
    """What is simulated (`sim.carrying_arm.CarryingArm`)."""

    time: float
    names: tuple[str, ...]
    urdf: str

    def advance(self) -> Any:
        """Simulate one period and return what the sensors read."""

    def follow(self, names: list[str], time: Array, position: Array, velocity: Array) -> None:
        """Follow a trajectory."""

    def set_load(self, attached: bool) -> None:
        """Attach the load, or take it off."""

    def set_payload(self, mass: float, com: Array, inertia_com: Array) -> None:
        """Tell the controller what is carried."""

    def reveal(self) -> dict[str, Any]:
        """Return the truth as plain numbers."""


class ArmScene:
    """An arm without a hand: it follows trajectories, and a gripper takes and leaves a load.

    Args:
        node: that publishes.
        arm: that is simulated.
    """

    def __init__(self, node: Shell, arm: SimulatedArm) -> None:
        self.node, self.arm, self.reveal = node, arm, arm.reveal
        self._joints = node.stream(JointState, JOINT_STATES)
        self._wrench = node.stream(WrenchStamped, WRIST_WRENCH)
        node.latched(String, ROBOT_DESCRIPTION).publish(String(data=arm.urdf))
        node.listen(JointTrajectory, JOINT_TRAJECTORY, self._on_trajectory)
        node.serve(ATTACH, lambda: self._carry(True))
        node.serve(DETACH, lambda: self._carry(False))
        if (kind := _payload_service()) is not None:
            node.create_service(kind, SET_PAYLOAD, self._on_payload)

    @property
    def time(self) -> float:
        """Simulated time, s."""
        return self.arm.time

    def advance(self) -> Any:
        """Simulate one period and return what the sensors read then."""
        return self.arm.advance()

    def publish(self, readings: Any) -> None:
        """Publish what the sensors read, as drivers do: the load's wrench on the sensor."""
        names, stamp = self.arm.names, readings.time
        self._joints.publish(
            joints_to_message(names, stamp, readings.position, readings.velocity, readings.effort)
        )
        self._wrench.publish(wrench_to_message(readings.wrist, stamp, FRAME))

    def _carry(self, attached: bool) -> str:
        self.arm.set_load(attached)
        return "the load is attached" if attached else "the load is taken off"

    def _on_trajectory(self, message: JointTrajectory) -> None:
        """Follow it; an empty one is thrown away, as joint_trajectory_controller does."""
        points = message.points
        if not points:
            raise BadInputError(f"{JOINT_TRAJECTORY}: no points; nothing is changed")
        count = len(message.joint_names)
        if any(len(p.positions) != count or len(p.velocities) not in (0, count) for p in points):
            raise BadInputError(f"{JOINT_TRAJECTORY}: expected {count} positions in each point")
        since = [p.time_from_start.sec + 1e-9 * p.time_from_start.nanosec for p in points]
        rates = [list(p.velocities) or [0.0] * count for p in points]
        positions = np.array([list(p.positions) for p in points])
        if not (np.isfinite(positions).all() and np.isfinite(rates).all()):
            raise BadInputError(f"{JOINT_TRAJECTORY}: a position or velocity is not finite")
        self.arm.follow(list(message.joint_names), np.array(since), positions, np.array(rates))

    def _on_payload(self, request: Any, response: Any) -> Any:
        told = request.payload
        centre = np.array([told.com.x, told.com.y, told.com.z])
        rows = [[told.ixx, told.ixy, told.ixz], [told.ixy, told.iyy, told.iyz],
                [told.ixz, told.iyz, told.izz]]  # fmt: skip
        self.arm.set_payload(told.m, centre, np.array(rows))
        response.success, response.message = True, f"{told.m:.3f} kg"
        return response


def _payload_service() -> type[Any] | None:
    """Return the type of the service that takes a payload; None where it is not installed."""
    try:
        found: type[Any] = importlib.import_module("tactile_dynamics_msgs.srv").SetPayload
    except ImportError:
        return None
    return found
