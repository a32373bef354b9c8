"""Counts of what went wrong, on /diagnostics, and statuses: written and read back.

Messages are read by their fields: those of running nodes and those of recordings alike.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.node import Node

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.ros.names import DIAGNOSTICS

OK, STALE = 0, 3
"""Levels of diagnostic_msgs/DiagnosticStatus: all is well; nothing was heard."""


class Statuses:
    """Statuses by name. What is missing reads as "", as no entries, as NaN, as level STALE.

    Args:
        statuses: of one DiagnosticArray; of two with one name the last counts.
    """

    def __init__(self, statuses: Iterable[Any] = ()) -> None:
        self._found = {status.name: status for status in statuses}

    def __contains__(self, name: object) -> bool:
        return name in self._found

    def level(self, name: str) -> int:
        """Return the level of a status."""
        if name not in self._found:
            return STALE
        level = self._found[name].level
        return level[0] if isinstance(level, bytes) else int(level)

    def text(self, name: str) -> str:
        """Return the sentence of a status."""
        return str(self._found[name].message) if name in self._found else ""

    def values(self, name: str) -> dict[str, str]:
        """Return all entries of a status."""
        return status_values(self._found[name]) if name in self._found else {}

    def number(self, name: str, key: str) -> float:
        """Return an entry as a number."""
        return to_number(self.values(name).get(key))

    def numbers(self, name: str, keys: Sequence[str]) -> Array:
        """Return entries as numbers, in the order of the keys."""
        values = self.values(name)
        return np.array([to_number(values.get(key)) for key in keys])

    def words(self, name: str, key: str) -> tuple[str, ...]:
        """Return the parts of an entry that commas separate."""
        return tuple(filter(None, self.values(name).get(key, "").split(",")))


def status_values(status: Any) -> dict[str, str]:
    """Return the entries of a status."""
    return {pair.key: pair.value for pair in status.values}


def to_number(text: str | None) -> float:
    """Return the number that a text is; NaN where it is none or missing."""
    try:
        return float("nan" if text is None else text)
    except ValueError:
        return float("nan")


class Faults:
    """Counter of refused or unusual input of one node.

    Args:
        node: that publishes.

    Attributes:
        counts: of faults, by kind.
        troubles: what is wrong with the node's inputs now; the level is WARN while there is any.
        idle: why the node does nothing, though nothing is wrong.
    """

    def __init__(self, node: Node) -> None:
        self.counts: Counter[str] = Counter()
        self.troubles: Sequence[str] = ()
        self.idle = ""
        self._node = node
        self._followed: Counter[str] = Counter()
        self._reported: Counter[str] = Counter()
        self._shown: dict[str, object] = {}
        self._last = ""
        self._publisher = node.create_publisher(DiagnosticArray, DIAGNOSTICS, 10)

    def add(self, kind: str, message: str = "") -> None:
        """Count one fault; the first of its kind is logged too."""
        self.counts[kind] += 1
        self._last = message or kind
        if self.counts[kind] == 1:
            self._node.get_logger().warning(f"{kind}: {self._last} (counted on /diagnostics)")

    def count(self, kind: str, total: int) -> None:
        """Follow a count that somebody else keeps, and that may begin anew at any time."""
        before, self._followed[kind] = self._followed[kind], total
        fresh = total - before if total >= before else total
        if fresh > 0:
            self._last = kind
            self.counts[kind] += fresh

    def show(self, name: str, value: object) -> None:
        """Publish a value of interest beside the counts."""
        self._shown[name] = value

    def alarm(self, subject: str, message: str, values: Mapping[str, object]) -> None:
        """Publish an ERROR at once, under the node's name and a subject."""
        self._node.get_logger().error(message)
        self.tell(subject, message, values, DiagnosticStatus.ERROR)

    def tell(self, subject: str, message: str, values: Mapping[str, object], level: bytes) -> None:
        """Publish a status at once, under the node's name and a subject."""
        name = f"{self._node.get_fully_qualified_name().lstrip('/')}: {subject}"
        self._send(status_message(name, values, level, message))

    def publish(self) -> None:
        """Publish all counts; the level is WARN while new faults come in or an input is in trouble.

        The status bears the node's name behind its namespace, so that hands can be told apart.
        """
        fresh = self.counts != self._reported
        self._reported = self.counts.copy()
        said = [
            *self.troubles,
            *([self._last] if fresh and self._last not in self.troubles else []),
        ]
        status = status_message(
            self._node.get_fully_qualified_name().lstrip("/"),
            {**self._shown, "inputs": "; ".join(self.troubles) or "ok", **self.counts},
            DiagnosticStatus.WARN if said else DiagnosticStatus.OK,
            "; ".join(said) or self.idle or "ok",
        )
        self._send(status)

    def _send(self, status: DiagnosticStatus) -> None:
        message = DiagnosticArray(status=[status])
        message.header.stamp = self._node.get_clock().now().to_msg()
        self._publisher.publish(message)


def status_message(
    name: str, values: Mapping[str, object], level: bytes = DiagnosticStatus.OK, message: str = ""
) -> DiagnosticStatus:
    """Return a status whose key-value pairs are `values`; floats with 9 significant digits."""
    pairs = [KeyValue(key=key, value=_text(value)) for key, value in values.items()]
    return DiagnosticStatus(level=level, name=name, message=message, values=pairs)


def effect_status(effect: str, parameters: Mapping[str, Mapping[str, object]]) -> DiagnosticStatus:
    """Return the status of an effect in the model: "<effect>.<parameter>", with _std and _unit.

    The effect's name is in each key because two effects may have a parameter of one name, and keys
    are unique over all statuses of a message.

    Args:
        effect: its name.
        parameters: value, std and unit by parameter.
    """
    values = {
        f"{effect}.{name}" if kind == "value" else f"{effect}.{name}_{kind}": value
        for name, entry in parameters.items()
        for kind, value in entry.items()
    }
    return status_message(f"effect {effect}", values)


def _text(value: object) -> str:
    return f"{value:.9g}" if isinstance(value, float) else str(value)
