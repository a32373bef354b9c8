"""A straight push by targets of the pusher, each an answer to where it is."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from geometry_msgs.msg import PoseStamped
from rclpy.node import Node
from std_msgs.msg import Bool, Float64

from tactile_dynamics_ros.core.planar.actions.straight import (
    StraightAction,
    StraightConfig,
    Travel,
    straight_action,
)
from tactile_dynamics_ros.ros.conversions import pose_to_core, pose_to_message, to_seconds
from tactile_dynamics_ros.ros.names import (
    EMERGENCY_STOP,
    GRIPPER_TARGET,
    PUSHER_POSE,
    PUSHER_TARGET,
    SUPPORT_POSE,
)
from tactile_dynamics_ros.ros.shell import LATCHED, STREAM
from tactile_dynamics_ros.ros.wire import decode_stamped

WORLD = "world"
SETTLING = 0.3
"""Time after the last target for which the tip is watched, s: twice the delay of an arm."""


class StraightMotion:
    """Answers each `pusher/pose` with the target of that time.

    An emergency stop ends the answers: the arm stays where it was last told to be.

    Args:
        node: to talk with.
        namespace: of the robot.

    Attributes:
        heard: poses of the pusher so far. stopped: whether the emergency stop is on, or came.
        finished: whether the motion has ended. error: m, by which the tip missed the goal.
        duration: s, from the first target to the last. pose_topic: that is answered.
    """

    def __init__(self, node: Node, namespace: str = "") -> None:
        def name(topic: str) -> str:
            return f"{namespace}/{topic}" if namespace else topic

        self.heard, self.stopped, self.finished = 0, False, False
        self.error, self.duration = np.inf, 0.0
        self.pose_topic = name(PUSHER_POSE)
        self._support = 0.0
        self._pose, self._action = np.eye(4), StraightAction(())
        self._began: float | None = None
        self._goal = np.zeros(2)
        self._busy = False
        self._target = node.create_publisher(PoseStamped, name(PUSHER_TARGET), 10)
        self._jaws = node.create_publisher(Float64, name(GRIPPER_TARGET), 10)
        self._width: float | None = None
        node.create_subscription(PoseStamped, self.pose_topic, self._on_pose, STREAM, raw=True)
        node.create_subscription(
            PoseStamped, name(SUPPORT_POSE), self._on_support, LATCHED, raw=True
        )
        for profile in (LATCHED, STREAM):
            node.create_subscription(Bool, EMERGENCY_STOP, self._on_stop, profile)

    def begin(
        self,
        start: Sequence[float],
        end: Sequence[float],
        speed: float,
        config: StraightConfig,
        pull: bool,
    ) -> None:
        """Plan from where the tip is, and go.

        Raises:
            BadInputError: there is no such push.
        """
        turn = float(np.arctan2(self._pose[1, 0], self._pose[0, 0]))
        now = np.array([*self._pose[:3, 3], turn])
        self._goal = np.array(end, dtype=float)
        travel = Travel(speed, config.acceleration)
        self._action = straight_action(
            now, np.array(start), self._goal, travel, config, self._support, pull
        )
        self._busy, self._began = True, None

    def _on_pose(self, data: bytes) -> None:
        message = decode_stamped(data, 7)
        self._pose = pose_to_core(message, self.pose_topic, WORLD)
        self.heard += 1
        if not self._busy:
            return
        stamp = to_seconds(message.stamp)
        self._began = stamp if self._began is None else self._began
        self.duration = stamp - self._began
        moment = self._action.at(self.duration)
        if moment.leg in ("push", "pull"):
            self.error = float(np.linalg.norm(self._pose[:2, 3] - self._goal))
        if moment.width != self._width:
            self._width = moment.width
            self._jaws.publish(Float64(data=moment.width))
        self._target.publish(pose_to_message(moment.pose, message.stamp, WORLD))
        if self.duration > self._action.duration + SETTLING:
            self._end()

    def _on_support(self, data: bytes) -> None:
        self._support = float(decode_stamped(data, 7).values[2])

    def _on_stop(self, message: Bool) -> None:
        self.stopped = bool(message.data) or (self.stopped and self.finished)
        if message.data and self._busy:
            self._end()

    def _end(self) -> None:
        self._busy, self.finished = False, True
