"""Start all nodes of a robot with the parameters of one yaml file.

ros2 launch tactile_dynamics_ros bringup.launch.py config:=/path/to/robot.yaml
ros2 launch tactile_dynamics_ros bringup.launch.py simulate:=true
ros2 launch tactile_dynamics_ros bringup.launch.py without:="[friction_probe,vision_tracker]"
ros2 launch tactile_dynamics_ros bringup.launch.py namespace:=left
"""

import atexit
import shutil
import tempfile
import time
from pathlib import Path

from ament_index_python.packages import get_package_share_directory
from launch.actions import DeclareLaunchArgument, LogInfo, OpaqueFunction, TimerAction
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

from launch import LaunchDescription
from tactile_dynamics_ros.cli.bringup import (
    RESPAWN_DELAY,
    Respawns,
    read_names,
    read_namespace,
    read_switch,
    write_parameters,
)
from tactile_dynamics_ros.ros.names import enclave_of

PACKAGE = "tactile_dynamics_ros"


def start_nodes(context):
    """Return one action per node that the configuration lists."""

    def given(name):
        return LaunchConfiguration(name).perform(context)

    scratch = Path(tempfile.mkdtemp(prefix=f"{PACKAGE}_"))
    atexit.register(shutil.rmtree, scratch, ignore_errors=True)
    simulate = read_switch("simulate", given("simulate"))
    without = read_names(given("without"))
    files = write_parameters(Path(given("config")), scratch, simulate, without)
    namespace = read_namespace(given("namespace")) or None
    respawns = Respawns()

    def start(name):
        def on_exit(event, context):
            if context.is_shutdown:
                return None
            verdict = respawns.note_death(name, event.returncode, time.monotonic())
            report = LogInfo(msg=verdict.sentence)
            if not verdict.again:
                return [report]
            return [report, TimerAction(period=RESPAWN_DELAY, actions=[start(name)])]

        return Node(
            package=PACKAGE,
            executable=name,
            name=name,
            namespace=namespace,
            parameters=[str(files[name])],
            ros_arguments=enclave_of(name),
            output="screen",
            on_exit=on_exit,
        )

    return [start(name) for name in files]


def generate_launch_description():
    """Describe the launch."""
    default = str(Path(get_package_share_directory(PACKAGE)) / "config" / "allegro_iiwa.yaml")
    arguments = (
        ("config", default, "nodes, parameters"),
        ("simulate", "false", "run robot_sim, and read what config.simulated.yaml adds"),
        ("without", "[]", "nodes that are not started"),
        ("namespace", "", "of all nodes, so that several hands can live in one system"),
    )
    return LaunchDescription(
        [
            *(DeclareLaunchArgument(n, default_value=v, description=d) for n, v, d in arguments),
            OpaqueFunction(function=start_nodes),
        ]
    )
