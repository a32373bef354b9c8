"""A node as a process: its arguments, its start and stop, what it says of itself.

A node loads its libraries for seconds. This module loads none, so that a request to stop that comes
meanwhile is answered: `executable.explorer` is the function that runs nodes/explorer.py.
"""

from __future__ import annotations

import importlib
import itertools
import math
import sys
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import NoReturn

import rclpy
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from rclpy.utilities import remove_ros_args

from tactile_dynamics_ros.core.errors import BadInputError, nearest_file
from tactile_dynamics_ros.ros.names import DIAGNOSTICS, enclave_of
from tactile_dynamics_ros.stopping import TIME_TO_END, Stopped, StopRequest, leave, take_requests


def start_tool() -> None:
    """Initialise rclpy for a command of a person, who leaves it by the command's own handlers."""
    words = ["--ros-args", *enclave_of("operator")]
    rclpy.init(args=words, signal_handler_options=SignalHandlerOptions.NO)


def start_ros(arguments: Sequence[str] | None) -> None:
    """Initialise rclpy with the command line of a node.

    Args:
        arguments: the command line without the program; that of this process if None.

    Raises:
        BadInputError: ROS would ignore a part of it, or cannot read it.
    """
    words = sys.argv[1:] if arguments is None else list(arguments)
    for flag, file in itertools.pairwise(words):
        if flag == "--params-file" and not Path(file).is_file():
            raise BadInputError(f"--params-file {file}: no such file{nearest_file(file)}")
    try:
        left = remove_ros_args(words)
        if left:
            raise BadInputError(
                f"'{left[0]}' is unknown; a node takes --ros-args with -p NAME:=VALUE "
                "(parameters), -r OLD:=NEW (names) and --params-file FILE"
            )
        rclpy.init(args=words, signal_handler_options=SignalHandlerOptions.NO)
    except RuntimeError as error:  # of rclpy, for arguments that it cannot read
        raise BadInputError(f"{' '.join(words)}: not understood by ROS: {error}") from error


_OF_EVERY_NODE = {
    *("/parameter_events", "/rosout", DIAGNOSTICS),
    *("describe_parameters", "get_parameters", "get_parameter_types", "list_parameters"),
    *("set_parameters", "set_parameters_atomically", "get_type_description"),
}
"""Topics, and last parts of services, that every node has: a line that told them would tell
nothing of this one. Names are those of ROS."""
_MANY = 4
"""Names in one folder from which only their count is reported: a contact has three topics, a hand
has twelve. Fewer would hide topics that differ, more would fill the terminal with contacts."""


def introduce(node: Node) -> str:
    """Return "started; listens to ..; publishes ..; offers ..", names relative to the namespace."""
    space = f"{node.get_namespace().rstrip('/')}/"
    groups = {
        "listens to": (entry.topic_name for entry in node.subscriptions),
        "publishes": (entry.topic_name for entry in node.publishers),
        "offers": (entry.srv_name for entry in node.services),
    }
    told = {words: _list(names, space) for words, names in groups.items()}
    return "; ".join(["started", *(f"{words} {names}" for words, names in told.items() if names)])


def _list(names: Iterable[str], space: str) -> str:
    """Return names as a list; of many in one folder, how many there are."""
    folders: dict[str, list[str]] = {}
    for name in sorted(set(names)):
        if not _OF_EVERY_NODE & {name, name.rpartition("/")[2]}:
            own = name.removeprefix(space)
            folders.setdefault(own.partition("/")[0], []).append(own)
    return ", ".join(
        f"{folder}/* ({len(own)})" if len(own) >= _MANY else ", ".join(own)
        for folder, own in folders.items()
    )


def start(name: str) -> NoReturn:
    """Run a node with the arguments of this process, and end the process with its exit code.

    Args:
        name: of the executable.
    """
    code = 0
    with StopRequest(patience=0.0, limit=TIME_TO_END) as stop, suppress(Stopped):
        take_requests()
        try:
            node = importlib.import_module(f"tactile_dynamics_ros.nodes.{name}")
        except Exception:
            if not stop.requested:
                raise
        if not stop.requested:  # libraries catch what leaves them while they load, or fail by it
            code = node.main()
        stop.patience = math.inf
    leave(code)


def __getattr__(name: str) -> Callable[[], NoReturn]:
    """Return the function that runs a node.

    Raises:
        AttributeError: there is no such node.
    """
    if not (Path(__file__).parents[1] / "nodes" / f"{name}.py").is_file():
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return partial(start, name)


if __name__ == "__main__":
    sys.argv = sys.argv[1:]
    start(sys.argv[0])
