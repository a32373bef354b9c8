"""`tactile-dynamics explore`: the explorer pushes an object until it is known."""

from __future__ import annotations

import json
from argparse import Namespace, _SubParsersAction
from typing import Any

from tactile_dynamics_ros.cli.bringup import read_namespace
from tactile_dynamics_ros.cli.goals import try_goal
from tactile_dynamics_ros.cli.topics import call_trigger, short_lived_node
from tactile_dynamics_ros.core.errors import NotIdentifiableError, TactileDynamicsError
from tactile_dynamics_ros.core.options import POSITIVE
from tactile_dynamics_ros.core.planar.properties.push_model import ASTRAY

REMARKS = ("stopped", "jerked", "missed", "late")
"""Entries of an action that say what went wrong with it, as they are reported to people."""


def add_parser(verbs: _SubParsersAction[Any]) -> None:
    """Add the verb."""
    parser = verbs.add_parser("explore")
    parser.add_argument(
        "--timeout",
        type=POSITIVE,
        default=300.0,
        metavar="S",
        help="real time until it is given up",
    )
    parser.add_argument("--namespace", default="", metavar="NS", help="of the robot, as left")
    parser.set_defaults(run=run)


def run(args: Namespace) -> int:
    """Ask the explorer; 0 if it ended by itself, 1 if it was stopped, 3 if little is known."""
    with short_lived_node() as node:
        success, outcome = ask(node, read_namespace(args.namespace), args.timeout, args.json)
    print(json.dumps(outcome) if args.json else describe(outcome))
    if not success:
        raise TactileDynamicsError(outcome["stopped_because"])
    if "friction_force_n" in outcome["properties"]["undetermined"]:
        raise NotIdentifiableError("the friction force is not known")
    return 0


def ask(node: Any, namespace: str, timeout: float, quiet: bool) -> tuple[bool, dict[str, Any]]:
    """Let the explorer explore; return whether it ended by itself, and what it says in the end.

    Raises:
        TactileDynamicsError: it refuses, or there is none.
    """
    from tactile_dynamics_ros.ros.names import EXPLORE

    name = f"{namespace}/{EXPLORE}"
    found = try_goal(node, "Explore", name, timeout, not quiet)
    if found is None:
        success, message = call_trigger(node, name, timeout)
    else:
        success, message = found.success, found.json or found.message
    try:
        return success, json.loads(message)
    except ValueError:
        raise TactileDynamicsError(message) from None


def describe(outcome: dict[str, Any]) -> str:
    """Return what was done and found, in lines for people."""
    lines = []
    for k, action in enumerate(outcome["actions"], 1):
        x, y = action["point"]
        lines.append(
            f"{k}. {action['chosen_because']}; at ({x:.3f}, {y:.3f}) m, {action['speed']:g} m/s"
            + "".join(f"; {key}: {action[key]}" for key in REMARKS if key in action)
        )
    unknown = outcome["properties"]["undetermined"]
    lines += outcome["properties"].get("said") or _numbers(outcome["properties"]["links"], unknown)
    why = why_unknown(outcome["properties"])
    return "\n".join([*lines, *why, f"stopped: {outcome['stopped_because']}"])


def _numbers(links: list[dict[str, Any]], unknown: list[str]) -> list[str]:
    """One line for each number of a single part."""
    lines = []
    for link in links:
        for name, entry in link.items():
            value, std = entry["value"], entry["std"]
            pairs = zip(value, std, strict=True) if isinstance(value, list) else [(value, std)]
            words = ", ".join(f"{v:.4g} ± {s:.2g}" for v, s in pairs)
            lines.append(f"{name}: {words}{' (undetermined)' if name in unknown else ''}")
    return lines


def why_unknown(properties: dict[str, Any]) -> list[str]:
    """Return sentences on why numbers are missing; none where nothing is.

    Args:
        properties: links, undetermined and, where they are known, error, refused and structure, as
            `explore` tells them.
    """
    links, unknown, said = properties["links"], properties["undetermined"], []
    error, refused = properties.get("error"), properties.get("refused", "")
    if refused:
        said.append(f"there is no fit to all pushes: {refused}")
    elif not links:
        said.append("there is no estimate: no push was fitted; explore again")
    if error is not None and error > ASTRAY:
        said.append(
            f"the model does not fit these pushes (error {error:.2f} times the noise), so masses "
            "count as unknown: something is missing in it, or the arm jerked; ask `diagnose` of "
            "the recording what it is, or explore again"
        )
    shares = [name for name in unknown if name.endswith(".mass")]
    if shares and properties.get("structure") == "rigid":
        said.append(
            "the parts are one body: no push of it tells what each of them weighs, only what both "
            "do and how their faces rub; take them apart and push or lift each"
        )
    elif shares and properties.get("structure") == "undecided":
        said.append(
            "the parts moved as one body: if a joint holds them, a push that turns it tells what "
            "each of them weighs; if nothing turns them, only taking them apart does"
        )
    return said
