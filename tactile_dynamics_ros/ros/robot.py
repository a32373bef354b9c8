"""The robot of a node: its file and URDF, its latest joints, the error of its hand."""

from __future__ import annotations

from bisect import bisect_left
from collections import deque
from dataclasses import dataclass
from itertools import islice
from operator import itemgetter

import numpy as np
from geometry_msgs.msg import PoseWithCovarianceStamped
from rclpy.node import Node
from rclpy.wait_for_message import wait_for_message
from std_msgs.msg import String

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.configuration import check_ranges, parameter
from tactile_dynamics_ros.core.errors import NotIdentifiableError
from tactile_dynamics_ros.core.robot.robot import Robot
from tactile_dynamics_ros.core.robot.robot_file import (
    DEFAULT_ROBOT,
    description_topic,
    load_robot,
)
from tactile_dynamics_ros.core.tracking.hand_error import LASTING, SAME_TIME, hand_motions
from tactile_dynamics_ros.ros.conversions import (
    RESTART_AFTER,
    to_seconds,
    uncertain_pose_to_core,
)
from tactile_dynamics_ros.ros.names import HAND_POSE
from tactile_dynamics_ros.ros.parameters import declare_config
from tactile_dynamics_ros.ros.shell import LATCHED, Shell
from tactile_dynamics_ros.ros.wire import Stamped


class JointHistory:
    """Interpolates joint positions between messages.

    Args:
        length: number of messages kept.
    """

    def __init__(self, length: int = 100) -> None:
        self._samples: deque[tuple[float, Array]] = deque(maxlen=length)

    @property
    def newest(self) -> float:
        """Time of the newest positions, s; minus infinity if there are none."""
        return self._samples[-1][0] if self._samples else -np.inf

    def add(self, time: float, positions: Array) -> None:
        """Keep positions at a time that is later than all before."""
        self._samples.append((time, positions))

    def clear(self) -> None:
        """Forget everything."""
        self._samples.clear()

    def at(self, time: float) -> Array | None:
        """Return positions at `time`, interpolated linearly; None outside what is kept."""
        if not self._samples or not self._samples[0][0] <= time <= self.newest:
            return None
        later = self._samples[-1]
        for earlier in reversed(self._samples):
            if earlier[0] <= time:
                break
            later = earlier
        span = later[0] - earlier[0]
        if span <= 0.0:
            return earlier[1]
        share = (time - earlier[0]) / span
        return np.asarray(earlier[1] + share * (later[1] - earlier[1]))


KEPT = 200
_STILL = np.eye(4)

_Timed = deque[tuple[float, Array]]


class HandError:
    """Motion that carries contacts to where vision shows the object (`core.tracking.hand_error`).

    Args:
        node: that subscribes. Where nobody publishes the hand's pose, contacts stay.
    """

    def __init__(self, node: Shell) -> None:
        self.clear()
        node.listen(PoseWithCovarianceStamped, HAND_POSE, self._on_hand)

    def clear(self) -> None:
        """Forget what was measured."""
        self._told: _Timed = deque(maxlen=KEPT)
        self._shown: _Timed = deque(maxlen=KEPT)
        self._motions: _Timed = deque(maxlen=KEPT)

    def add_fused(self, time: float, pose: Array) -> None:
        """Take the fused pose (4, 4) of a time, s."""
        _append(self._shown, time, pose)
        hand = _at(self._told, time, SAME_TIME)
        if hand is not None:
            self._add_motion(time, pose, hand)

    def at(self, time: float) -> Array:
        """Return the motion (4, 4) for contacts of a time, s."""
        found = _at(self._motions, time, LASTING)
        return _STILL if found is None else found

    def _on_hand(self, message: Stamped) -> None:
        hand, _ = uncertain_pose_to_core(message, HAND_POSE, "world")
        time = to_seconds(message.stamp)
        _append(self._told, time, hand)
        fused = _at(self._shown, time, SAME_TIME)
        if fused is not None:
            self._add_motion(time, fused, hand)

    def _add_motion(self, time: float, fused: Array, hand: Array) -> None:
        _append(self._motions, time, hand_motions(fused[None], hand[None])[0])


def _append(entries: _Timed, time: float, value: Array) -> None:
    """Append what comes in the order of time; a clock that was restarted makes the past void."""
    if entries and time < entries[-1][0] - RESTART_AFTER:
        entries.clear()
    if not entries or time > entries[-1][0]:
        entries.append((time, value))


def _at(entries: _Timed, time: float, tolerance: float) -> Array | None:
    """The value nearest to a time, or None if it is further than the tolerance."""
    after = bisect_left(entries, time, key=itemgetter(0))
    around = islice(entries, max(after - 1, 0), after + 1)
    near = [entry for entry in around if abs(entry[0] - time) <= tolerance]
    return min(near, key=lambda entry: abs(entry[0] - time))[1] if near else None


PATIENCE = 15.0
"""How long a node waits for the description of its robot, s of real time: whoever publishes it is
started together with the nodes; a simulator takes a few seconds. Then the node ends with one line,
and a launch starts it again."""


@dataclass(frozen=True)
class RobotConfig:
    """Which robot this is."""

    robot: str = parameter(DEFAULT_ROBOT, "file in config/robots, or path of a yaml file")

    def __post_init__(self) -> None:
        check_ranges(self)


def declare_robot(node: Node) -> Robot:
    """Declare the parameter `robot` and return the robot that it names.

    Raises:
        BadInputError: there is no such robot, or its file is wrong.
        NotIdentifiableError: nobody publishes its URDF.
    """
    name = declare_config(node, RobotConfig).robot
    topic = description_topic(name)
    return load_robot(name, None if topic is None else _hear(node, topic))


def _hear(node: Node, topic: str) -> str:
    heard, message = wait_for_message(
        String, node, topic, qos_profile=LATCHED, time_to_wait=PATIENCE
    )
    if not heard:
        raise NotIdentifiableError(
            f"node {node.get_name()}: no URDF on {topic} within {PATIENCE:g} s; "
            "start what publishes it (robot_state_publisher), or name a file in the robot's yaml"
        )
    return str(message.data)
