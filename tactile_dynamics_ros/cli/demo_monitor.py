"""What the demo sees of the running nodes: phase, estimates, pace."""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from numpy.typing import NDArray
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rich.console import Console
from rich.live import Live
from rich.table import Table
from std_msgs.msg import String

from tactile_dynamics_ros.cli.bringup import nodes_of
from tactile_dynamics_ros.cli.grasp_start import GraspStart
from tactile_dynamics_ros.cli.topics import call_trigger
from tactile_dynamics_ros.core.errors import TactileDynamicsError
from tactile_dynamics_ros.report.history import EstimateHistory
from tactile_dynamics_ros.ros.arguments import start_tool
from tactile_dynamics_ros.ros.conversions import to_seconds
from tactile_dynamics_ros.ros.diagnostics import status_values
from tactile_dynamics_ros.ros.inertia_status import InertiaStatus, read_inertia_status
from tactile_dynamics_ros.ros.names import DIAGNOSTICS, ESTIMATOR_STATUS, GRASP_PHASE, REVEAL
from tactile_dynamics_ros.ros.shell import LATCHED

Array = NDArray[np.float64]

NAMES = (
    ("mass", "mass", 1e3, "g"),
    ("com_x", "centre of mass x", 1e3, "mm"),
    ("com_y", "centre of mass y", 1e3, "mm"),
    ("com_z", "centre of mass z", 1e3, "mm"),
    ("inertia_xx", "inertia xx", 1e6, "kg mm²"),
    ("inertia_xy", "inertia xy", 1e6, "kg mm²"),
    ("inertia_yy", "inertia yy", 1e6, "kg mm²"),
    ("inertia_xz", "inertia xz", 1e6, "kg mm²"),
    ("inertia_yz", "inertia yz", 1e6, "kg mm²"),
    ("inertia_zz", "inertia zz", 1e6, "kg mm²"),
)
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
            empty = np.zeros((0, len(NAMES)))
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
        for (_, label, scale, unit), v, s in zip(NAMES, said.value, said.std, strict=True):
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
    shown = list(zip(NAMES, said.value, said.std, strict=True))[:4]
    values = ", ".join(
        f"{label} {scale * value:.1f} ± {scale * std:.1f} {unit}"
        for (_, label, scale, unit), value, std in shown
    )
    return f"  {said.samples:>5} samples: {values}"
