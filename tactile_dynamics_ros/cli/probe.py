"""`tactile-dynamics probe`: let a finger measure friction, and watch it."""

from __future__ import annotations

import json
import sys
from argparse import Namespace, _SubParsersAction
from typing import TYPE_CHECKING, Any

from tactile_dynamics_ros.cli.bringup import read_namespace
from tactile_dynamics_ros.cli.goals import try_goal
from tactile_dynamics_ros.cli.topics import call_trigger, short_lived_node, spin_until
from tactile_dynamics_ros.core.errors import TactileDynamicsError
from tactile_dynamics_ros.core.options import POSITIVE

if TYPE_CHECKING:
    from rclpy.node import Node


def add_parser(verbs: _SubParsersAction[Any]) -> None:
    """Add the verb."""
    probe = verbs.add_parser("probe")
    probe.add_argument(
        "--timeout", type=POSITIVE, default=120.0, metavar="S", help="wait this long for the result"
    )
    probe.add_argument(
        "--reference",
        type=POSITIVE,
        metavar="MU",
        help="known static coefficient of what is probed; also print the gain of the finger",
    )
    probe.add_argument("--namespace", default="", metavar="NS", help="of the hand, as left")
    probe.set_defaults(run=run_probe)


def run_probe(args: Namespace) -> int:
    """Start a probe, print what it does, and print its estimate when it has ended.

    Ends with 0 where there is an estimate, 3 where the probe was refused or ended without one.
    """
    from tactile_dynamics_ros.ros.names import PROBE

    hand = read_namespace(args.namespace)
    with short_lived_node() as node:
        found = try_goal(node, "Probe", f"{hand}/{PROBE}", args.timeout, True)
        if found is None:
            document = _by_service(node, hand, args.timeout)
        else:
            refused = {"started": False, "message": found.message}
            document = json.loads(found.json) if found.json else refused
    if document["started"] and args.reference is not None and document["regions"]:
        document["gain"] = finger_gain(document["regions"], args.reference)
        document["message"] += f"; estimate.gain: {document['gain']['value']:.4f}"
    print(json.dumps(document) if args.json else document["message"])
    return 0 if document.get("regions") else 3


def _by_service(node: Node, hand: str, timeout: float) -> dict[str, Any]:
    """Start a probe by its service, and follow its topics to the end."""
    from diagnostic_msgs.msg import DiagnosticStatus

    from tactile_dynamics_ros.ros.diagnostics import status_values
    from tactile_dynamics_ros.ros.friction_messages import estimate_document
    from tactile_dynamics_ros.ros.names import PROBE, PROBE_ESTIMATE, PROBE_PROGRESS
    from tactile_dynamics_ros.ros.shell import LATCHED

    started, answer = call_trigger(node, f"{hand}/{PROBE}", 5.0)
    if not started:
        return {"started": False, "message": answer}
    estimates: list[dict[str, str]] = []
    sentences: list[str] = []

    def take_estimate(message: DiagnosticStatus) -> None:
        estimates.append(status_values(message))
        sentences.append(message.message)

    def take_progress(message: DiagnosticStatus) -> None:
        values = status_values(message)
        text = f"  {values['phase']:<8} {values['slips']} slips"
        print(f"{text}  {sentences[-1] if sentences else ''}", file=sys.stderr)

    for name, take in ((PROBE_ESTIMATE, take_estimate), (PROBE_PROGRESS, take_progress)):
        node.create_subscription(DiagnosticStatus, f"{hand}/{name}", take, LATCHED)
    if not spin_until(node, lambda: _final(estimates), timeout):
        raise TactileDynamicsError(f"friction probe: no result within {timeout} s")
    return estimate_document(estimates[-1], sentences[-1])


def _final(estimates: list[dict[str, str]]) -> bool:
    return bool(estimates) and estimates[-1].get("final") == "True"


def finger_gain(regions: dict[str, Any], reference: float) -> dict[str, float]:
    """Return what `estimate.gain` has to be multiplied by, from the region with most slips."""
    best = max(regions.values(), key=lambda region: region["slips"])
    value = reference / best["static"]
    return {"value": value, "std": value * best["std"] / best["static"]}
