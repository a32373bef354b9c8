"""Verbs that talk to running nodes: echo, call, set."""

from __future__ import annotations

import array
import itertools
import json
import math
import signal
import sys
import time
from argparse import ArgumentParser, Namespace, _SubParsersAction
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from tactile_dynamics_ros.cli.domain import stay_on_this_host
from tactile_dynamics_ros.core.errors import BadInputError, TactileDynamicsError
from tactile_dynamics_ros.core.options import COUNT, POSITIVE
from tactile_dynamics_ros.core.reading import parse_yaml

if TYPE_CHECKING:
    from rclpy.node import Node

_LARGEST_INTEGER = 2**63 - 1
"""Largest whole number of a parameter, which ROS sends with 64 bits."""
_GONE = 2.0
"""Time for which nobody offers a service, s, before its node is taken to have ended: on a busy
machine discovery forgets a node that lives for some tenths of a second."""
TERMINATED = 128 + signal.SIGTERM
"""Exit code of a command that SIGTERM has ended, as shells count."""


def add_parser(verbs: _SubParsersAction[Any]) -> None:
    """Add the verbs."""
    echo = verbs.add_parser("echo")
    echo.add_argument("topic", metavar="TOPIC")
    echo.add_argument("--count", type=COUNT, metavar="N", help="stop after N messages")
    _add_timeout(echo, 5.0, "wait this long for the first message")
    echo.set_defaults(run=run_echo)

    call = verbs.add_parser("call")
    call.add_argument("service", metavar="SERVICE")
    _add_timeout(call, None, "wait this long for the answer; else while the service is there")
    call.set_defaults(run=run_call)

    change = verbs.add_parser("set")
    change.add_argument("node", metavar="NODE", help="with its namespace: left/model_check")
    change.add_argument("parameter", metavar="PARAMETER")
    change.add_argument("value", metavar="VALUE", help="yaml: 0.5, true, [viscous_drag], []")
    _add_timeout(change, 10.0, "wait this long for the answer")
    change.set_defaults(run=run_set)


def _add_timeout(parser: ArgumentParser, default: float | None, text: str) -> None:
    parser.add_argument("--timeout", type=POSITIVE, default=default, metavar="S", help=text)


@contextmanager
def short_lived_node(namespace: str = "") -> Iterator[Node]:
    """A node that lives as long as the context; SIGTERM ends the command as Ctrl-C does."""
    stay_on_this_host()
    import rclpy
    from rclpy.node import Node as RosNode

    from tactile_dynamics_ros.ros.startup import start_tool

    start_tool()
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(TERMINATED))
    try:
        yield RosNode(
            "tactile_dynamics",
            namespace=namespace,
            enable_rosout=False,
            start_parameter_services=False,
        )
    finally:
        rclpy.try_shutdown()


def spin_until(node: Node, condition: Callable[[], bool], timeout: float) -> bool:
    """Let a node work until the condition holds; return whether it does."""
    import rclpy

    deadline = time.monotonic() + timeout
    while not condition():
        if time.monotonic() > deadline:
            return False
        rclpy.spin_once(node, timeout_sec=0.05)
    return True


def run_echo(args: Namespace) -> int:
    """Print messages as JSON, one per line with --json; without a count until Ctrl-C."""
    from tactile_dynamics_ros.ros.recorder import message_type
    from tactile_dynamics_ros.ros.shell import LATCHED, STREAM

    seen: list[Any] = []
    topic = "/" + args.topic.lstrip("/")
    with short_lived_node() as node:

        def kinds() -> list[str]:
            return dict(node.get_topic_names_and_types()).get(topic, [])

        if not spin_until(node, lambda: bool(kinds()), args.timeout):
            known = sorted(name for name, _ in node.get_topic_names_and_types())
            raise BadInputError(f"topic '{topic}' is not published; there are {known}")
        offers = [i.qos_profile for i in node.get_publishers_info_by_topic(topic)]
        latched = bool(offers) and all(q.durability == LATCHED.durability for q in offers)
        profile = LATCHED if latched else STREAM
        node.create_subscription(message_type(kinds()[0]), topic, seen.append, profile)
        if not spin_until(node, lambda: bool(seen), args.timeout):
            raise BadInputError(f"topic '{topic}': no message within {args.timeout} s")
        try:
            for _ in range(args.count) if args.count is not None else itertools.count():
                spin_until(node, lambda: bool(seen), math.inf)
                message = to_plain(seen.pop(0))
                print(json.dumps(message, indent=None if args.json else 1), flush=True)
        except KeyboardInterrupt:
            if args.count is not None:
                raise
    return 0


def to_plain(value: Any) -> Any:
    """Return a message as dictionaries, lists and numbers; what is not finite becomes text."""
    if hasattr(value, "get_fields_and_field_types"):
        return {name: to_plain(getattr(value, name)) for name in value.get_fields_and_field_types()}
    if hasattr(value, "tolist"):
        return to_plain(value.tolist())
    if isinstance(value, (list, tuple, array.array)):
        return [to_plain(item) for item in value]
    if isinstance(value, bytes):
        return value[0] if len(value) == 1 else list(value)
    if isinstance(value, float) and not math.isfinite(value):
        return str(value)
    return value


def call_trigger(node: Node, service: str, timeout: float) -> tuple[bool, str]:
    """Call a std_srvs/Trigger; return success and message.

    Raises:
        BadInputError: nobody offers the service.
        TactileDynamicsError: no answer in time, or who offered the service is gone.
    """
    from std_srvs.srv import Trigger

    client = node.create_client(Trigger, service)
    if not spin_until(node, client.service_is_ready, min(timeout, 5.0)):
        raise BadInputError(f"service '{service}' is not offered; start the node that has it")
    future = client.call_async(Trigger.Request())
    gone = absence(client.service_is_ready)
    if not spin_until(node, lambda: future.done() or gone(), timeout):
        raise TactileDynamicsError(f"service '{service}': no answer within {timeout} s")
    if not future.done():
        raise TactileDynamicsError(f"service '{service}': its node ended before it answered")
    answer = future.result()
    node.destroy_client(client)
    return bool(answer.success), str(answer.message)


def absence(present: Callable[[], bool]) -> Callable[[], bool]:
    """Return whether something has been absent for _GONE; asked again and again."""
    seen = time.monotonic()

    def absent() -> bool:
        nonlocal seen
        now = time.monotonic()
        if present():
            seen = now
        return now - seen > _GONE

    return absent


def run_call(args: Namespace) -> int:
    """Call a service and print its message, which may itself be JSON."""
    timeout = math.inf if args.timeout is None else args.timeout
    with short_lived_node() as node:
        success, message = call_trigger(node, args.service, timeout)
    if args.json:
        try:
            content = json.loads(message)
        except ValueError:
            content = message
        print(json.dumps({"success": success, "message": content}))
    else:
        print(message, file=sys.stdout if success else sys.stderr)
    return 0 if success else 1


def full_names(node: Node) -> set[str]:
    """Return the nodes that run, with their namespaces and without this one."""
    found = node.get_node_names_and_namespaces()
    return {f"{space.rstrip('/')}/{name}" for name, space in found if name != node.get_name()}


def set_parameter(node: Node, target: str, name: str, value: Any, timeout: float) -> str:
    """Change a parameter of a running node; return what the node says that this does, if anything.

    Args:
        node: that asks.
        target: name of the node that has the parameter.
        name: of the parameter.
        value: its new value.
        timeout: s for the answer.

    Raises:
        BadInputError: the node is not there, or refuses the value.
        TactileDynamicsError: no answer in time.
    """
    from rclpy.parameter import Parameter
    from rclpy.parameter_client import AsyncParameterClient

    numbers = [v for v in (value if isinstance(value, list) else [value]) if type(v) is int]
    try:
        if value is None or any(abs(number) > _LARGEST_INTEGER for number in numbers):
            raise TypeError("no value of a parameter")
        parameter = Parameter(name, value=value)
    except TypeError as error:
        raise BadInputError(
            f"{name}: {str(value)[:40]!r}, expected a number, a text, or a list of one kind"
        ) from error
    client = AsyncParameterClient(node, target.lstrip("/"))
    if not spin_until(node, client.services_are_ready, 5.0):
        raise BadInputError(f"node '{target}' is not running; there are {sorted(full_names(node))}")
    future = client.set_parameters([parameter])
    if not spin_until(node, future.done, timeout):
        raise TactileDynamicsError(f"node '{target}': no answer within {timeout} s")
    result = future.result().results[0]
    if not result.successful:
        raise BadInputError(f"{target} {name} = {value}: {result.reason}")
    return str(result.reason)


def run_set(args: Namespace) -> int:
    """Change one parameter."""
    value = parse_yaml(args.value, f"value of {args.parameter}")
    with short_lived_node() as node:
        remark = set_parameter(node, args.node, args.parameter, value, args.timeout)
    plain = f"{args.parameter} = {value}" + (f" ({remark})" if remark else "")
    print(json.dumps({args.parameter: value}) if args.json else plain)
    return 0
