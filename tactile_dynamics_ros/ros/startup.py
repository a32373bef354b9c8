"""What a node does first: it reads its arguments, and says what it listens to."""

from __future__ import annotations

import itertools
import os
import sys
from collections.abc import Iterable, Sequence
from contextlib import suppress
from pathlib import Path

import rclpy
from rclpy.signals import SignalHandlerOptions
from rclpy.utilities import remove_ros_args

from tactile_dynamics_ros.core.errors import BadInputError, nearest_file
from tactile_dynamics_ros.ros.managed import ManagedNode
from tactile_dynamics_ros.ros.names import DIAGNOSTICS, enclave_of


def finish_bursts() -> None:
    """Let this process finish what it publishes together before those that it wakes run.

    Each message of a burst would else be interrupted by its receivers, one after the other: Linux's
    batch policy wakes without preempting. Called before DDS makes its threads, which inherit it; a
    policy that somebody has chosen stays.
    """
    if hasattr(os, "SCHED_BATCH") and os.sched_getscheduler(0) == os.SCHED_OTHER:
        with suppress(OSError):  # a sandbox may forbid it
            os.sched_setscheduler(0, os.SCHED_BATCH, os.sched_param(0))


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
    *("change_state", "get_state", "get_available_states"),
    *("get_available_transitions", "get_transition_graph"),
}
"""Topics, and last parts of services, that every node has: a line that told them would tell
nothing of this one. Names are those of ROS."""
_MANY = 4
"""Names in one folder from which only their count is reported: a contact has three topics, a hand
has twelve. Fewer would hide topics that differ, more would fill the terminal with contacts."""


def introduce(node: ManagedNode) -> str:
    """Return "started; listens to ..; publishes ..; ..", names relative to the namespace."""
    space = f"{node.get_namespace().rstrip('/')}/"
    groups = {
        "listens to": (entry.topic_name for entry in node.subscriptions),
        "publishes": (entry.topic_name for entry in node.publishers),
        "offers": (entry.srv_name for entry in node.services),
        "takes goals of": node.actions,
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
