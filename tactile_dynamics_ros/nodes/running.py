"""Start a node, spin it, and stop it cleanly on Ctrl-C, SIGTERM or an error of ours."""

from __future__ import annotations

import sys
from collections.abc import Callable

import rclpy
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node

from tactile_dynamics_ros.core.errors import TactileDynamicsError

Factory = Callable[[], Node]


def run_node(factory: Factory, arguments: list[str] | None = None) -> int:
    """Run one node until it is told to stop; return the exit code.

    Args:
        factory: makes the node.
        arguments: command line with ROS arguments, `sys.argv` if None.
    """
    rclpy.init(args=arguments)
    node: Node | None = None
    try:
        node = factory()
        executor = SingleThreadedExecutor()
        executor.add_node(node)
        executor.spin()
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    except TactileDynamicsError as error:
        print(f"error: {' '.join(str(error).split())}", file=sys.stderr)
        return error.exit_code
    finally:
        if node is not None:
            node.destroy_node()
        rclpy.try_shutdown()
    return 0
