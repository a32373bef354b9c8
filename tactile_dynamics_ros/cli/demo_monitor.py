"""What the demo hears and sees of the running nodes: phase, estimates, pace, table."""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable, Sequence
from functools import partial
from math import atan2
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rich.console import Console
from rich.live import Live
from rich.table import Table
from std_msgs.msg import String
from std_srvs.srv import Trigger

from tactile_dynamics_ros.cli.bringup import nodes_of
from tactile_dynamics_ros.cli.topics import call_trigger
from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.errors import TactileDynamicsError
from tactile_dynamics_ros.report.estimates import PARAMETERS, SHOWN_PARAMETERS, EstimateHistory
from tactile_dynamics_ros.ros import names
from tactile_dynamics_ros.ros.conversions import to_seconds
from tactile_dynamics_ros.ros.diagnostics import Statuses, status_values, to_number
from tactile_dynamics_ros.ros.names import (
    DIAGNOSTICS,
    ESTIMATOR_STATUS,
    GRASP_PHASE,
    GRASP_START,
    REVEAL,
)
from tactile_dynamics_ros.ros.shell import LATCHED
from tactile_dynamics_ros.ros.startup import start_tool
from tactile_dynamics_ros.ros.statuses import InertiaStatus, read_inertia_status

if TYPE_CHECKING:
    from rclpy.node import Node

ASK_EVERY = 0.5
"""Pause between two questions, s of real time: half a second is nothing beside a grasp of ten."""
PATIENCE = 5.0
"""Time for an answer, s of real time: the node answers at once, so that one which is still out by
then was asked of a node that has died meanwhile."""


class GraspStart:
    """Calls grasp_controller/start when all nodes are there, and again until that is accepted.

    Call `advance` often; nothing here blocks.

    Args:
        node: to talk with.
        awaited: names of the nodes that must be there.
        say: prints a line for people.

    Attributes:
        accepted: whether the motion was started.
        reason: why it was not, so far.
    """

    def __init__(self, node: Node, awaited: Sequence[str], say: Callable[[str], None]) -> None:
        self.accepted, self.reason = False, ""
        self._node, self._awaited, self._say = node, set(awaited), say
        self._client = node.create_client(Trigger, GRASP_START)
        self._question: Any = None
        self._asked = 0.0

    def advance(self) -> None:
        """Ask if it is time, and hear the answer."""
        if self.accepted:
            return
        if self._question is not None and self._question.done():
            answer, self._question = self._question.result(), None
            self.accepted, self.reason = answer.success, answer.message
            if self.accepted:
                self._say(f"{GRASP_START}: {answer.message}")
        elif time.monotonic() - self._asked > (ASK_EVERY if self._question is None else PATIENCE):
            self._asked = time.monotonic()
            self._ask()

    def _ask(self) -> None:
        if self._question is not None:
            self._client.remove_pending_request(self._question)
            self._question, self.reason = None, f"no answer of {GRASP_START}"
        missing = self._awaited - set(self._node.get_node_names())
        if missing:
            self.reason = f"no node {min(missing)} yet"
        elif self._client.service_is_ready():
            self._question = self._client.call_async(Trigger.Request())


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


LINE_EVERY = 3.0
STILL_PHASES = ("starting", "idle")
"""Phases in which nothing has moved yet."""


class Monitor:
    """A node that lets the hand move once all nodes are there, follows the story and shows it.

    Args:
        say: prints a line for people.
        config: yaml file of the robot.
    """

    def __init__(self, say: Callable[[str], None], config: Path) -> None:
        self._say = say
        start_tool()
        self.node = Node("demo_monitor", enable_rosout=False, start_parameter_services=False)
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(self.node)
        self.phase, self.failure = "starting", ""
        self._estimates: list[tuple[float, Array, Array]] = []
        self._measured: tuple[float, float] | None = None
        self._pace: list[float] = []
        self._advanced: float | None = None
        self._last_line = 0.0
        self._live: Live | None = None
        self._start = GraspStart(self.node, nodes_of(config), say)
        create = self.node.create_subscription
        create(String, GRASP_PHASE, self._on_phase, LATCHED)
        create(DiagnosticArray, ESTIMATOR_STATUS, self._on_status, LATCHED)
        create(DiagnosticArray, DIAGNOSTICS, self._on_diagnostics, 50)

    @property
    def finished(self) -> bool:
        """Whether the object has been put down, or lost."""
        return self.phase in ("done", "failed")

    @property
    def not_started(self) -> str:
        """Why the hand was not let move so far; empty once it was."""
        return "" if self._start.accepted else self._start.reason

    @property
    def seconds_of_data(self) -> float:
        """Span of the measurements so far, s, whether their estimate is withheld or not."""
        return self._measured[1] - self._measured[0] if self._measured else 0.0

    @property
    def standing_still(self) -> float | None:
        """Seconds for which simulated time has not advanced; None until it first does."""
        return None if self._advanced is None else time.monotonic() - self._advanced

    def spin_once(self) -> None:
        """Handle what has come, or wait a moment; let the hand move as soon as it may."""
        self._start.advance()
        self._executor.spin_once(timeout_sec=0.1)

    def reveal(self) -> dict[str, Any]:
        """Ask the simulator for the truth."""
        self._stop_table()
        self._executor.remove_node(self.node)
        success, message = call_trigger(self.node, REVEAL, 30.0)
        if not success:
            raise TactileDynamicsError(f"{REVEAL}: {message}")
        truth: dict[str, Any] = json.loads(message)
        truth["real_time_factor"] = float(np.median(self._pace)) if self._pace else None
        return truth

    def history(self) -> EstimateHistory:
        """Return the estimates that came, those of a changed model from where it begins."""
        if not self._estimates:
            empty = np.zeros((0, PARAMETERS))
            return EstimateHistory(np.zeros(0), empty, empty)
        time_, value, std = zip(*self._estimates, strict=True)
        return EstimateHistory(np.array(time_), np.stack(value), np.stack(std)).of_last_model()

    def close(self) -> None:
        """Leave ROS."""
        self._stop_table()
        rclpy.try_shutdown()

    def _on_phase(self, message: String) -> None:
        self.phase, _, reason = message.data.partition(": ")
        if self.phase == "failed":
            self.failure = reason or "the grasp failed"
        if self._live is None:
            self._say(f"hand: {message.data}")

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        for status in message.status:
            pace = status_values(status).get("real_time_factor")
            if status.name != "robot_sim" or pace is None:
                continue
            if float(pace) > 0.0:
                self._advanced = time.monotonic()
            if self.phase not in STILL_PHASES:
                self._pace.append(float(pace))

    def _on_status(self, message: DiagnosticArray) -> None:
        said, time_ = read_inertia_status(message.status), to_seconds(message.header.stamp)
        if said.samples:
            self._measured = (self._measured or (time_,))[0], time_
        repeated = bool(self._estimates) and time_ <= self._estimates[-1][0]
        if said.known and repeated:  # a status comes at least once a second, renewed or not
            return
        if said.known:
            self._estimates.append((time_, said.value, said.std))
        self._show(said)

    def _show(self, said: InertiaStatus) -> None:
        """Show an estimate, or why there is none, at most every LINE_EVERY seconds as a line."""
        if getattr(self._say, "quiet", False):
            return
        if sys.stdout.isatty():
            if self._live is None:
                self._live = Live(console=Console(), refresh_per_second=4)
                self._live.start()
            self._live.update(self._table(said))
        elif time.monotonic() - self._last_line > LINE_EVERY:
            self._last_line = time.monotonic()
            self._say(_line(said))

    def _table(self, said: InertiaStatus) -> Table:
        pace = f"{self._pace[-1]:.2f} x real time" if self._pace else ""
        table = Table(title=f"hand: {self.phase}   {said.samples} samples   {pace}")
        for heading, justify in (("", "left"), ("estimate", "right"), ("± std", "right")):
            table.add_column(heading, justify=justify)  # type: ignore[arg-type]
        table.add_column("unit")
        if not said.known:
            table.caption = said.text
            return table
        for (label, scale, unit), v, s in zip(SHOWN_PARAMETERS, said.value, said.std, strict=True):
            table.add_row(label, f"{scale * v:.2f}", f"{scale * s:.2f}", unit)
        table.add_row("error", f"{said.error:.2f}", "", "x sensor noise")
        return table

    def _stop_table(self) -> None:
        if self._live is not None:
            self._live.stop()
            self._live = None


def _line(said: InertiaStatus) -> str:
    """Return samples, mass and centre of mass, or why these are not known."""
    if not said.known:
        return f"  no estimate: {said.text or 'nothing is measured yet'}"
    shown = list(zip(SHOWN_PARAMETERS, said.value, said.std, strict=True))[:4]
    values = ", ".join(
        f"{label} {scale * value:.1f} ± {scale * std:.1f} {unit}"
        for (label, scale, unit), value, std in shown
    )
    return f"  {said.samples:>5} samples: {values}"
