"""`tactile-dynamics push --goal`: ask push_controller, and wait for what becomes of it."""

from __future__ import annotations

import json
import math
from argparse import Namespace
from typing import Any

import numpy as np

from tactile_dynamics_ros.cli.bringup import read_namespace
from tactile_dynamics_ros.cli.explore import ask as explore
from tactile_dynamics_ros.cli.goals import DISCOVERY, try_goal
from tactile_dynamics_ros.cli.topics import set_parameter, short_lived_node, spin_until
from tactile_dynamics_ros.core.errors import BadInputError, TactileDynamicsError

PATIENCE = 30.0
"""Real time without a word of the controller after which it is given up, s: it speaks five times a
second, but a plan takes ten on a machine that does twenty other things."""


def push_to_goal(args: Namespace) -> int:
    """Publish the goal and print how it ended; 0 if the object is there, 1 if not."""
    if not np.all(np.isfinite(args.goal)):
        raise BadInputError(f"push: --goal {args.goal}: expected X Y YAW_DEG as numbers")
    space = read_namespace(args.namespace)
    with short_lived_node() as node:
        explored = {} if args.explore is None else _explored(node, args, space)
        outcome = ask(node, args.goal, space, args.json) | explored
    if args.json:
        print(json.dumps(outcome))
    else:
        word = "reached" if outcome["reached"] else "not reached"
        print(
            f"{word}: {1e3 * outcome['error_m']:.1f} mm and "
            f"{np.rad2deg(outcome['error_rad']):.1f} deg from the goal after "
            f"{outcome['pushes']} pushes and {outcome['duration_s']:.0f} s "
            f"({outcome['stopped_because']})"
        )
    return 0 if outcome["reached"] else 1


def _explored(node: Any, args: Namespace, space: str) -> dict[str, Any]:
    """Let the explorer make the pushes that the goal needs; what was done goes into the outcome."""
    target = f"{space}/explorer"
    set_parameter(node, target, "goal", [float(each) for each in args.goal], DISCOVERY)
    set_parameter(node, target, "goal_error", args.explore, DISCOVERY)
    try:
        _, told = explore(node, space, math.inf, args.json)
    finally:
        set_parameter(node, target, "goal_error", 0.0, DISCOVERY)
    if not args.json:
        print(f"explored by {len(told['actions'])} pushes: {told['stopped_because']}", flush=True)
    return {"explored": len(told["actions"]), "explored_until": told["stopped_because"]}


def ask(node: Any, goal: Any, namespace: str = "", quiet: bool = True) -> dict[str, Any]:
    """Send a goal and return what the controller says in the end.

    Args:
        node: to talk with.
        goal: x, y (m) and yaw (deg).
        namespace: of the controller.
        quiet: print nothing on the way.

    Raises:
        BadInputError: there is no controller.
        TactileDynamicsError: it refuses, or falls silent.
    """
    from diagnostic_msgs.msg import DiagnosticStatus
    from geometry_msgs.msg import PoseStamped

    from tactile_dynamics_ros.ros.diagnostics import status_values
    from tactile_dynamics_ros.ros.names import GOAL_POSE, PUSH, PUSH_PROGRESS
    from tactile_dynamics_ros.ros.shell import LATCHED

    def name(topic: str) -> str:
        return f"{namespace}/{topic}" if namespace else f"/{topic}"

    pose = _pose(goal)
    found = try_goal(node, "Push", name(PUSH), math.inf, not quiet, PATIENCE, pose=pose)
    if found is not None and not found.json:
        raise TactileDynamicsError(found.message)
    if found is not None:
        return dict(json.loads(found.json))
    heard: list[Any] = []
    node.create_subscription(DiagnosticStatus, name(PUSH_PROGRESS), heard.append, LATCHED)
    publisher = node.create_publisher(PoseStamped, name(GOAL_POSE), 10)
    if not spin_until(node, lambda: publisher.get_subscription_count() > 0, DISCOVERY):
        raise BadInputError("nobody takes goal_pose; start the node push_controller")
    spin_until(node, lambda: bool(heard), 0.5)  # what was said of an earlier goal
    heard.clear()
    publisher.publish(pose)
    while True:
        count = len(heard)
        if not spin_until(node, lambda count=count: len(heard) > count, PATIENCE):
            raise TactileDynamicsError(f"push_controller says nothing for {PATIENCE:g} s")
        status = heard[-1]
        values = status_values(status)
        if values.get("state") == "refused":
            raise TactileDynamicsError(status.message)
        if values.get("state") == "finished":
            outcome: dict[str, Any] = json.loads(values["result"])
            return outcome
        if not quiet and "error_m" in values:
            away = 1e3 * float(values["error_m"])
            print(f"  push {values['pushes']}: {away:.1f} mm to go", flush=True)


def _pose(goal: Any) -> Any:
    """Return the PoseStamped of x, y (m) and yaw (deg) in the world."""
    from geometry_msgs.msg import PoseStamped

    message = PoseStamped()
    message.header.frame_id = "world"
    message.pose.position.x, message.pose.position.y = float(goal[0]), float(goal[1])
    half = 0.5 * np.deg2rad(float(goal[2]))
    message.pose.orientation.z, message.pose.orientation.w = (
        float(np.sin(half)),
        float(np.cos(half)),
    )
    return message
