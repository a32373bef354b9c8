"""`tactile-dynamics weigh`: an arm weighs its tool and what it carries."""

from __future__ import annotations

import json
import sys
from argparse import Namespace, _SubParsersAction
from collections.abc import Callable
from pathlib import Path
from threading import Thread
from typing import TYPE_CHECKING, Any

from tactile_dynamics_ros.api.result import align_rows
from tactile_dynamics_ros.cli.bringup import read_namespace
from tactile_dynamics_ros.cli.goals import try_goal
from tactile_dynamics_ros.cli.topics import short_lived_node
from tactile_dynamics_ros.core.errors import (
    BadInputError,
    NotIdentifiableError,
    TactileDynamicsError,
)
from tactile_dynamics_ros.core.options import POSITIVE, Number

if TYPE_CHECKING:
    from rclpy.node import Node

SHARE = Number(0.01, 1.0)
"""Range of the node's parameter `motion.speed_share`."""
CHANGES = ("attach", "detach")
"""Phases in which somebody has to change what the arm carries."""


def add_parser(verbs: _SubParsersAction[Any]) -> None:
    """Add the verb."""
    parser = verbs.add_parser("weigh")
    parser.add_argument(
        "--dry-run", action="store_true", help="plan and show the motion, move nothing"
    )
    parser.add_argument(
        "--apply", action="store_true", help="hand the payload to the controller, if in no doubt"
    )
    parser.add_argument(
        "--tool",
        default="",
        metavar="measure|none|FILE",
        help="weigh the tool first; there is none; or its file (estimate --save)",
    )
    parser.add_argument(
        "--speed-share", type=SHARE, metavar="S", help="of the joints' largest speeds"
    )
    parser.add_argument(
        "--timeout", type=POSITIVE, default=1800.0, metavar="S", help="cancel it after S seconds"
    )
    parser.add_argument("--namespace", default="", metavar="NS", help="of the arm, as left")
    parser.set_defaults(run=run)


def run(args: Namespace) -> int:
    """Ask the weigher; 0 if all is known, 3 if something is in doubt."""
    namespace = read_namespace(args.namespace)
    with short_lived_node() as node:
        wait_for_person(node, namespace)
        found = ask(node, args, namespace)
    print(json.dumps(found) if args.json else describe(found))
    if found.get("doubts"):
        raise NotIdentifiableError("; ".join(found["doubts"]))
    if args.apply and not found.get("handed_over"):
        raise NotIdentifiableError(found["message"])
    return 0


def ask(node: Node, args: Namespace, namespace: str = "") -> dict[str, Any]:
    """Send the goal and return the document of its result.

    Args:
        node: to talk with.
        args: of the verb.
        namespace: of the arm.

    Raises:
        BadInputError: there is no weigher.
        TactileDynamicsError: it refuses, or was stopped.
    """
    from tactile_dynamics_ros.ros.names import WEIGH

    tool = args.tool
    if tool not in ("", "measure", "none"):
        tool = str(Path(tool).absolute())
    fields = {"apply": args.apply, "dry_run": args.dry_run, "tool": tool}
    found = try_goal(
        node,
        "Weigh",
        f"{namespace}/{WEIGH}",
        args.timeout,
        not args.json,
        speed_share=args.speed_share or 0.0,
        **fields,
    )
    if found is None:
        raise BadInputError(
            f"action '{namespace}/{WEIGH}' is not offered; start it: tactile-dynamics run weigher "
            "(tactile_dynamics_msgs has to be there, too)"
        )
    if not found.success:
        raise TactileDynamicsError(found.message)
    document: dict[str, Any] = json.loads(found.json)
    return document | {"message": found.message}


def on_change(node: Node, namespace: str, act: Callable[[str, Callable[[], None]], None]) -> None:
    """Call back when the arm waits for its load to be attached or taken off.

    Args:
        node: that listens.
        namespace: of the arm.
        act: gets "attach" or "detach", and what to call when that is done.
    """
    from diagnostic_msgs.msg import DiagnosticStatus
    from std_srvs.srv import Trigger

    from tactile_dynamics_ros.ros.diagnostics import status_values
    from tactile_dynamics_ros.ros.names import WEIGH_PROCEED, WEIGH_PROGRESS

    proceed = node.create_client(Trigger, f"{namespace}/{WEIGH_PROCEED}")
    last = ""

    def take(message: DiagnosticStatus) -> None:
        nonlocal last
        phase = status_values(message)["phase"]
        if phase in CHANGES and phase != last:
            act(phase, lambda: proceed.call_async(Trigger.Request()))
        last = phase

    node.create_subscription(DiagnosticStatus, f"{namespace}/{WEIGH_PROGRESS}", take, 10)


def wait_for_person(node: Node, namespace: str) -> None:
    """Go on when the Enter key is pressed, where there is a terminal."""

    def act(phase: str, go_on: Callable[[], None]) -> None:
        if not sys.stdin.isatty():
            return
        what = {"attach": "attach the load", "detach": "take the load off"}[phase]
        print(f"{what}, then press Enter", file=sys.stderr, flush=True)

        def read() -> None:
            if sys.stdin.readline():
                go_on()

        Thread(target=read, daemon=True).start()

    on_change(node, namespace, act)


def describe(found: dict[str, Any]) -> str:
    """Return the result in lines for people."""
    if "largest_turn_rad" in found:
        turns = zip(found["joints"], found["largest_turn_rad"], strict=True)
        rows = [("joint", "largest turn, rad"), *((name, f"{turn:.2f}") for name, turn in turns)]
        near = found["nearest"]["what"]
        std = 1e3 * found["expected_std"]["mass"]
        return "\n".join(
            [
                align_rows(rows),
                f"{found['duration_s']:.0f} s, nearest: {near}; expected: mass to {std:.1g} g",
            ]
        )
    lines = [align_rows(body_rows(found))]
    lines += [f"doubt: {doubt}" for doubt in found["doubts"]]
    lines += [f"to know more: {sentence}" for sentence in found["advice"]]
    return "\n".join([*lines, found["message"], f"recordings: {found['folder']}"])


def body_rows(found: dict[str, Any]) -> list[tuple[str, ...]]:
    """Return a table of mass (kg), centre (mm) and moments of inertia (kg mm^2)."""
    rows: list[tuple[str, ...]] = [("", "mass, kg", "centre, mm", "inertia xx, yy, zz, kg mm²")]
    for name in ("tool", "load"):
        body = found[name]
        if body is None:
            continue
        mass, com = body["mass"], body["com"]
        centre = ", ".join(
            f"{1e3 * v:.1f} ± {1e3 * s:.1g}" for v, s in zip(com["value"], com["std"], strict=True)
        )
        inertia = body["inertia_com"]
        moments = ", ".join(
            f"{1e6 * inertia['value'][k][k]:.0f} ± {1e6 * inertia['std'][k][k]:.0f}"
            for k in range(3)
        )
        rows.append((name, f"{mass['value']:.4f} ± {mass['std']:.1g}", centre, moments))
    return rows
