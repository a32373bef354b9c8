"""`tactile-dynamics push`: what stands on a table, along a straight line or to a pose."""

from __future__ import annotations

import json
import time
from argparse import Namespace, _SubParsersAction
from dataclasses import fields, replace
from typing import TYPE_CHECKING, Any

from tactile_dynamics_ros.cli.bringup import read_namespace
from tactile_dynamics_ros.cli.push_goal import push_to_goal
from tactile_dynamics_ros.cli.topics import short_lived_node, spin_until
from tactile_dynamics_ros.core.errors import BadInputError, TactileDynamicsError
from tactile_dynamics_ros.core.options import FINITE, POSITIVE
from tactile_dynamics_ros.core.planar.actions.straight import StraightConfig

if TYPE_CHECKING:
    from rclpy.node import Node

    from tactile_dynamics_ros.ros.straight_motion import StraightMotion

PATIENCE = 3.0
"""Real time without a pose of the pusher after which it is given up, s: thirty messages of the
slowest Cartesian controllers, 10 Hz."""
DISCOVERY = 0.7
"""Real time for which others are listened to before anything moves, s: a latched emergency stop is
heard by then (DDS finds its publishers within 0.3 s on one host)."""
NEAR = 2e-3
"""Distance from its goal within which the tip has reached it, m: what arms miss under load."""


def add_parser(verbs: _SubParsersAction[Any]) -> None:
    """Add the verb."""
    parser = verbs.add_parser("push")
    parser.add_argument(
        "--goal",
        nargs=3,
        type=FINITE,
        metavar=("X", "Y", "YAW_DEG"),
        help="where the object's frame should come to, world, m and deg; push_controller does it",
    )
    parser.add_argument(
        "--explore",
        type=POSITIVE,
        metavar="M",
        help="with --goal: explore first, but only until pushes are expected to end so near to it",
    )
    place = {"nargs": 2, "type": FINITE, "metavar": ("X", "Y")}
    parser.add_argument("--from", dest="start", help="where the tip comes down, world, m", **place)
    parser.add_argument("--to", dest="end", help="where it stops, world, m", **place)
    parser.add_argument("--speed", type=POSITIVE, metavar="S", help="on the way, m/s")
    parser.add_argument("--pull", action="store_true", help="grip at the start, open at the end")
    about = {option.name: option.metadata["description"] for option in fields(StraightConfig)}
    for name, metavar in (("height", "M"), ("retreat", "M"), ("acceleration", "A")):
        parser.add_argument(f"--{name}", type=POSITIVE, metavar=metavar, help=about[name])
    parser.add_argument("--namespace", default="", metavar="NS", help="of the robot, as left")
    parser.set_defaults(run=run)


def run(args: Namespace) -> int:
    """Move the tip by `pusher/target`; nothing moves unless this is called.

    Ends with 0 where tip or object came to where it was sent, 1 where not or it was stopped.
    """
    line = (args.start, args.end, args.speed)
    if args.goal is not None:
        if any(given is not None for given in line) or args.pull:
            raise BadInputError("push: --goal goes without --from, --to, --speed and --pull")
        return push_to_goal(args)
    if args.explore is not None:
        raise BadInputError("push: --explore goes with --goal")
    if any(given is None for given in line):
        raise BadInputError("push: give --goal X Y YAW_DEG, or --from, --to and --speed")
    return _push_straight(args)


def _push_straight(args: Namespace) -> int:
    """Move the tip along a line."""
    from tactile_dynamics_ros.ros.straight_motion import StraightMotion

    given = {name: getattr(args, name) for name in ("height", "retreat", "acceleration")}
    config = replace(StraightConfig(), **{k: v for k, v in given.items() if v is not None})
    with short_lived_node() as node:
        motion = StraightMotion(node, read_namespace(args.namespace))
        _wait_for_robot(node, motion)
        motion.begin(args.start, args.end, args.speed, config, args.pull)
        while not motion.finished:
            heard = motion.heard
            spin_until(node, lambda heard=heard: motion.heard > heard, PATIENCE)
            if motion.heard == heard:
                raise TactileDynamicsError(f"no {motion.pose_topic} for {PATIENCE:g} s")
    if motion.stopped:
        raise TactileDynamicsError("stopped: the emergency stop is on; the arm stays where it is")
    error = float(motion.error)
    told = {"reached": error < NEAR, "error_m": error, "duration_s": motion.duration}
    if args.json:
        print(json.dumps(told))
    else:
        word = "reached" if told["reached"] else "not reached (/diagnostics may say why)"
        print(f"{word}: {1e3 * error:.1f} mm from the goal after {motion.duration:.1f} s")
    return 0 if told["reached"] else 1


def _wait_for_robot(node: Node, motion: StraightMotion) -> None:
    """Wait until the pusher is heard, and for word of an emergency stop.

    Raises:
        BadInputError: nobody publishes where the pusher is.
        TactileDynamicsError: the emergency stop is on.
    """
    if not spin_until(node, lambda: motion.heard > 0, 2.0 * PATIENCE):
        raise BadInputError(
            f"{motion.pose_topic} is not published; start the robot: tactile-dynamics sim --scene "
            "table"
        )
    end = time.monotonic() + DISCOVERY
    spin_until(node, lambda: time.monotonic() > end, 2.0 * DISCOVERY)
    if motion.stopped:
        raise TactileDynamicsError(
            "the emergency stop is on; publish false on /emergency_stop to release it"
        )
