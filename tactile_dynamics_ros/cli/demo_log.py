"""What the demo of a table hears of the object while the story goes on."""

from __future__ import annotations

from functools import partial
from math import atan2
from typing import TYPE_CHECKING, Any

from tactile_dynamics_ros.ros import names
from tactile_dynamics_ros.ros.status_reader import Statuses, to_number

if TYPE_CHECKING:
    from rclpy.node import Node

NODES = {"shape_estimator", "property_estimator", "explorer", "push_controller", "model_check"}
"""Nodes of the story that have to be there before it begins."""
LINKS = ("link_1", "link_2")
"""Parts that objects of the table have at most."""


class Log:
    """Keeps the ways and outlines of the parts, and the estimates.

    Args:
        node: that listens.

    Attributes:
        paths: of each part, rows of x, y (m), yaw (rad) and time (s). outlines: of each part.
        history: estimates by name, each with time, value and std.
    """

    def __init__(self, node: Node) -> None:
        from diagnostic_msgs.msg import DiagnosticArray
        from geometry_msgs.msg import PolygonStamped, PoseStamped, PoseWithCovarianceStamped

        from tactile_dynamics_ros.ros.shell import LATCHED, STREAM

        self.paths: dict[str, list[list[float]]] = {link: [] for link in LINKS}
        self.outlines: dict[str, list[list[float]]] = {}
        self.history: list[dict[str, Any]] = []
        self._node, self._pusher = node, False
        for link in LINKS:
            pose, outline = (names.link_topic(link, kind) for kind in ("pose", "footprint"))
            take_pose, take_outline = partial(self._on_pose, link), partial(self._on_outline, link)
            node.create_subscription(PoseWithCovarianceStamped, pose, take_pose, STREAM)
            node.create_subscription(PolygonStamped, outline, take_outline, LATCHED)
        node.create_subscription(PoseStamped, names.PUSHER_POSE, self._on_pusher, STREAM)
        status = names.PROPERTY_STATUS
        node.create_subscription(DiagnosticArray, status, self._on_properties, LATCHED)

    @property
    def ready(self) -> bool:
        """Whether robot, object and all nodes are heard."""
        heard = bool(self.paths["link_1"]) and "link_1" in self.outlines and self._pusher
        return heard and set(self._node.get_node_names()) >= NODES

    @property
    def parted(self) -> bool:
        """Whether a second part is tracked."""
        return "link_2" in self.outlines

    @property
    def now(self) -> float:
        """Time of the newest pose, s."""
        return self.paths["link_1"][-1][3]

    def document(self) -> dict[str, Any]:
        """Return the parts with their outlines and ways, and the history of a single one."""
        seen = [link for link in LINKS if link in self.outlines]
        parts = [{"footprint": self.outlines[link], "path": self.paths[link]} for link in seen]
        return {"parts": parts, "history": [] if self.parted else self.history}

    def _on_pose(self, link: str, message: Any) -> None:
        pose, stamp = message.pose.pose, message.header.stamp
        turn = 2.0 * atan2(pose.orientation.z, pose.orientation.w)
        row = [pose.position.x, pose.position.y, turn, stamp.sec + 1e-9 * stamp.nanosec]
        self.paths[link].append(row)

    def _on_pusher(self, _: Any) -> None:
        self._pusher = True

    def _on_outline(self, link: str, message: Any) -> None:
        self.outlines[link] = [[p.x, p.y] for p in message.polygon.points]

    def _on_properties(self, message: Any) -> None:
        stamp = message.header.stamp
        link = Statuses(message.status).values("link_1")
        if "com_x" in link:
            row = {key: to_number(text) for key, text in link.items() if key != "undetermined"}
            self.history.append({"time": stamp.sec + 1e-9 * stamp.nanosec, **row})
