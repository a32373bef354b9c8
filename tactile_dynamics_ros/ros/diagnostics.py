"""Counts of what went wrong, once per second on /diagnostics, which all hands share."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.node import Node

from tactile_dynamics_ros.ros.names import DIAGNOSTICS
from tactile_dynamics_ros.ros.status_reader import status_values as status_values


class Faults:
    """Counter of refused or unusual input of one node.

    Args:
        node: that publishes.

    Attributes:
        counts: of faults, by kind.
        troubles: what is wrong with the node's inputs now; the level is WARN while there is any.
    """

    def __init__(self, node: Node) -> None:
        self.counts: Counter[str] = Counter()
        self.troubles: Sequence[str] = ()
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
            "; ".join(said) or "ok",
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
