"""The robot of a node: its file by a parameter, its URDF also as robots publish it."""

from __future__ import annotations

from dataclasses import dataclass

from rclpy.node import Node
from rclpy.wait_for_message import wait_for_message
from std_msgs.msg import String

from tactile_dynamics_ros.core.configuration import check_ranges, parameter
from tactile_dynamics_ros.core.errors import NotIdentifiableError
from tactile_dynamics_ros.core.robot.robot import Robot
from tactile_dynamics_ros.core.robot.robot_file import (
    DEFAULT_ROBOT,
    description_topic,
    load_robot,
)
from tactile_dynamics_ros.ros.parameters import declare_config
from tactile_dynamics_ros.ros.shell import LATCHED

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
