"""`tactile-dynamics send-goal`, and goals for the verbs that move a robot: Ctrl-C cancels."""

from __future__ import annotations

import importlib
import json
import math
import signal
import sys
import time
from argparse import Namespace, _SubParsersAction
from typing import TYPE_CHECKING, Any

from tactile_dynamics_ros.cli.topics import (
    absence,
    full_names,
    short_lived_node,
    spin_until,
    to_plain,
)
from tactile_dynamics_ros.core.errors import BadInputError, TactileDynamicsError, nearest
from tactile_dynamics_ros.core.options import POSITIVE
from tactile_dynamics_ros.core.reading import parse_yaml
from tactile_dynamics_ros.stopping import StopRequest

if TYPE_CHECKING:
    from rclpy.action.client import ClientGoalHandle
    from rclpy.node import Node
    from rclpy.task import Future

DISCOVERY = 5.0
"""Real time until an action is given up if it is not found, s: DDS takes 0.3 s on one host, and the
start of a node takes longer."""
OFFERED = 1.0
"""Real time from the discovery of a node until a verb calls its service where no action is found,
s: both are found at once, and a node without actions should not keep people waiting."""
CANCELING = 3.0
"""Real time for which a canceled goal's result is awaited, s: nodes answer within half a second."""


def add_parser(verbs: _SubParsersAction[Any]) -> None:
    """Add the verb."""
    parser = verbs.add_parser("send-goal")
    parser.add_argument("action", metavar="ACTION")
    parser.add_argument("goal", nargs="?", default="{}", metavar="GOAL", help="its fields, as yaml")
    parser.add_argument("--feedback", action="store_true", help="print what is being done")
    parser.add_argument("--timeout", type=POSITIVE, metavar="S", help="cancel it after S seconds")
    parser.set_defaults(run=run)


def run(args: Namespace) -> int:
    """Send a goal and print its result; 0 if it succeeded, 1 if not."""
    name = "/" + args.action.lstrip("/")
    with short_lived_node() as node:
        kind = _offered_kind(node, name)
        goal = kind.Goal()
        fill(goal, parse_yaml(args.goal, "goal"), "goal")
        timeout = math.inf if args.timeout is None else args.timeout
        result = send_goal(node, kind, name, goal, timeout, args.feedback)
    plain = to_plain(result)
    if "json" in plain:
        plain["json"] = json.loads(plain["json"] or "null")
    success = bool(plain.get("success", True))
    if args.json or "message" not in plain:
        print(json.dumps(plain))
    else:
        print(plain["message"], file=sys.stdout if success else sys.stderr)
    return 0 if success else 1


def _offered_kind(node: Node, name: str) -> Any:
    """Return the type of an action.

    Raises:
        BadInputError: nobody offers it, or its package is not installed.
    """
    from rclpy.action import get_action_names_and_types

    def kinds() -> dict[str, list[str]]:
        return dict(get_action_names_and_types(node))

    if not spin_until(node, lambda: name in kinds(), DISCOVERY):
        known = sorted(kinds())
        raise BadInputError(f"action '{name}' is not offered; there are {known}")
    package, _, kind = kinds()[name][0].split("/")
    try:
        return getattr(importlib.import_module(f"{package}.action"), kind)
    except ImportError as error:
        raise BadInputError(f"{package}/{kind} cannot be imported: {error}") from error


def fill(message: Any, fields: Any, where: str) -> None:
    """Set fields of a message.

    Args:
        message: whose other fields keep their values.
        fields: by name; those of messages in it are mappings too.
        where: the message is, for errors.

    Raises:
        BadInputError: no such field, or of another type.
    """
    known = message.get_fields_and_field_types()
    if not isinstance(fields, dict):
        raise BadInputError(f"{where}: {fields!r}, expected fields as {{name: value}} of {known}")
    for name, value in fields.items():
        if name not in known:
            names = sorted(known)
            raise BadInputError(f"{where}.{name}: there are {names}{nearest(str(name), names)}")
        held = getattr(message, name)
        if hasattr(held, "get_fields_and_field_types"):
            fill(held, value, f"{where}.{name}")
            continue
        number = isinstance(held, float) and type(value) is int
        given = float(value) if number else value
        try:
            checked = type(message)(check_fields=True, **{name: given})
            setattr(message, name, getattr(checked, name))
        except (AssertionError, TypeError, ValueError) as error:
            expected = f"expected {known[name]}"
            raise BadInputError(f"{where}.{name}: {value!r}, {expected}") from error


def send_goal(
    node: Node,
    kind: Any,
    name: str,
    goal: Any,
    timeout: float,
    feedback: bool,
    patience: float = math.inf,
) -> Any:
    """Send a goal and return its result; cancel it on Ctrl-C, SIGTERM and after the time.

    Args:
        node: that asks.
        kind: type of the action.
        name: of the action.
        goal: its fields.
        timeout: real time for it, s.
        feedback: print on stderr what is being done.
        patience: real time without feedback after which it is canceled, s.

    Raises:
        BadInputError: nobody offers the action.
        TactileDynamicsError: it is rejected, too late, or its node has ended.
    """
    with StopRequest() as stop:  # an exception amid rclpy's work may lose an answer
        sent = _Sent(node, kind, name, feedback)
        result = sent.accepted(goal).get_result_async()
        gone, deadline = absence(sent.client.server_is_ready), time.monotonic() + timeout

        def over() -> bool:
            now = time.monotonic()
            late = now > deadline or now - sent.heard > patience
            return bool(result.done()) or gone() or late or stop.requested

        spin_until(node, over, math.inf)
        if result.done():
            return result.result().result
        if gone():
            raise TactileDynamicsError(f"action '{name}': its node ended before it answered")
        sent.cancel(result)
    if stop.requested:
        signal.raise_signal(signal.SIGINT)
    raise TactileDynamicsError(f"action '{name}': not done in time, canceled")


class _Sent:
    """A goal on its way.

    Attributes:
        client: that sends it. heard: monotonic s, when something came of it last.
    """

    def __init__(self, node: Node, kind: Any, name: str, feedback: bool) -> None:
        from rclpy.action import ActionClient

        self._node, self._name, self._feedback = node, name, feedback
        self.client, self.heard = ActionClient(node, kind, name), 0.0

    def accepted(self, goal: Any) -> ClientGoalHandle:
        """Send a goal and return its handle."""
        node, name = self._node, self._name
        if not spin_until(node, self.client.server_is_ready, DISCOVERY):
            raise BadInputError(f"action '{name}' is not offered; start the node that has it")
        asked = self.client.send_goal_async(goal, feedback_callback=self._take)
        if not spin_until(node, asked.done, DISCOVERY):
            raise TactileDynamicsError(f"action '{name}': no answer within {DISCOVERY:g} s")
        self._handle, self.heard = asked.result(), time.monotonic()
        if not self._handle.accepted:
            raise TactileDynamicsError(f"action '{name}': rejected, it works on another goal")
        return self._handle

    def cancel(self, result: Future) -> None:
        """Cancel the goal, and wait until it has ended."""
        self._handle.cancel_goal_async()
        ended = spin_until(self._node, result.done, CANCELING)
        print("canceled" if ended else "asked to cancel; no answer", file=sys.stderr)

    def _take(self, message: Any) -> None:
        self.heard = time.monotonic()
        if self._feedback:
            _tell(message.feedback)


def _tell(feedback: Any) -> None:
    """Print feedback."""
    if not hasattr(feedback, "share_done"):  # of an action that is not ours
        print(json.dumps(to_plain(feedback)), file=sys.stderr)
        return
    share = "" if math.isnan(feedback.share_done) else f" {100.0 * feedback.share_done:3.0f} %"
    print(f"  {feedback.phase:<10}{share}  {feedback.text}", file=sys.stderr, flush=True)


def try_goal(
    node: Node,
    kind: str,
    name: str,
    timeout: float,
    feedback: bool,
    patience: float = math.inf,
    **fields: Any,
) -> Any:
    """Return the result of an action of ours, or None where it is not offered.

    Args:
        node: that asks.
        kind: type in tactile_dynamics_msgs, such as Explore.
        name: of the action.
        timeout: real time for it, s.
        feedback: print on stderr what is being done.
        patience: real time without feedback after which it is given up, s.
        fields: of the goal.
    """
    from rclpy.action import get_action_names_and_types

    from tactile_dynamics_ros.ros.actions import interface

    def is_offered() -> bool:
        return name in dict(get_action_names_and_types(node))

    found, owner = interface(f"action.{kind}"), name.rpartition("/")[0]
    if found is None:
        return None
    spin_until(node, lambda: is_offered() or owner in full_names(node), DISCOVERY)
    if not spin_until(node, is_offered, OFFERED):
        return None
    return send_goal(node, found, name, found.Goal(**fields), timeout, feedback, patience)
