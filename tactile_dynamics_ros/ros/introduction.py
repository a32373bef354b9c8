"""What a node says of itself as it starts: one line on what it listens to and offers."""

from __future__ import annotations

from collections.abc import Iterable

from rclpy.node import Node

from tactile_dynamics_ros.ros.names import DIAGNOSTICS

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
