"""Start all nodes of a robot with the parameters of one yaml file.

ros2 launch tactile_dynamics_ros bringup.launch.py
ros2 launch tactile_dynamics_ros bringup.launch.py simulate:=false config:=/path/to/robot.yaml
"""

from pathlib import Path

import yaml
from ament_index_python.packages import get_package_share_directory
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

from launch import LaunchDescription

PACKAGE = "tactile_dynamics_ros"


def start_nodes(context):
    """Return one action per node that the configuration lists."""
    config = Path(LaunchConfiguration("config").perform(context))
    simulate = LaunchConfiguration("simulate").perform(context).lower() in ("true", "1", "yes")
    names = list(yaml.safe_load(config.read_text()))
    if not simulate:
        names.remove("robot_sim")
    parameters = [str(config), {"use_sim_time": simulate}]
    return [
        Node(
            package=PACKAGE,
            executable=name,
            name=name,
            parameters=[str(config)] if name == "robot_sim" else parameters,
            output="screen",
            respawn=True,
        )
        for name in names
    ]


def generate_launch_description():
    """Describe the launch."""
    default = str(Path(get_package_share_directory(PACKAGE)) / "config" / "allegro_iiwa.yaml")
    return LaunchDescription(
        [
            DeclareLaunchArgument("config", default_value=default, description="nodes, parameters"),
            DeclareLaunchArgument("simulate", default_value="true", description="run robot_sim"),
            OpaqueFunction(function=start_nodes),
        ]
    )
