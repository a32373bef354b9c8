"""How long the live node `biotac_force` takes, from a frame on its topic to the last force."""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.cli.domain import private_domain
from tactile_dynamics_ros.core.robot.robot_file import load_robot
from tactile_dynamics_ros.sim.sensors.biotac import BioTacArray

ROBOT = load_robot()

if TYPE_CHECKING:
    from rclpy.node import Node

_NODE = "import sys; from tactile_dynamics_ros.nodes.biotac_force import main; sys.exit(main())"
_PAD = np.tile([-6e-3, 0.0, -7e-3], (len(ROBOT.fingers), 1))
_TARE_FRAMES, _START_S, _LOST_S = 60, 30.0, 0.2
_SPIN_S, _PERIOD = 2e-3, 0.01


def node_latency(frames: int = 2000) -> dict[str, float]:
    """Publish frames of four pressed fingertips at 100 Hz and wait for the last finger's force.

    The node is a process of its own; times (ms) include both ways over DDS. The receiver waits as
    the nodes of this package do, since building an executor's wait set would count too. The node's
    own share, from a frame that is taken to the last message that it publishes, is what it tells of
    its last thousand frames on /diagnostics. How much of the slowest frames is the machine's, a
    loop tells that spins for 2 ms before every frame, when the node rests: how late it ends.

    Raises:
        RuntimeError: the node does not answer.
    """
    with private_domain(), tempfile.TemporaryDirectory() as folder:
        words = ["--ros-args", "-p", f"tare_file:={Path(folder) / 'tare.npy'}"]
        node = subprocess.Popen([sys.executable, "-c", _NODE, *words])
        try:
            spent, late, told = _round_trips(frames)
        finally:
            node.terminate()
            node.wait(10.0)
    lost = np.isnan(spent)
    return {
        "frames": len(spent),
        "lost": int(lost.sum()),
        "median_ms": float(np.median(spent[~lost])),
        "p99_ms": float(np.quantile(spent[~lost], 0.99)),
        "in_node_median_ms": float(told["frame_ms_median"]),
        "in_node_p99_ms": float(told["frame_ms_p99"]),
        "in_node_cpu_p99_ms": float(told["frame_cpu_ms_p99"]),
        "machine_late_p99_ms": float(np.quantile(late, 0.99)),
    }


def _round_trips(
    frames: int,
) -> tuple[NDArray[np.float64], NDArray[np.float64], dict[str, str]]:
    """Return the time (frames,) ms until the last force of each frame came back, NaN if none.

    The other results are how late (frames,) ms a spinning loop ended before each of them, and what
    the node tells on /diagnostics at the end.
    """
    import rclpy
    from diagnostic_msgs.msg import DiagnosticArray
    from geometry_msgs.msg import WrenchStamped
    from sensor_msgs.msg import Image

    from tactile_dynamics_ros.ros.conversions import biotac_to_message
    from tactile_dynamics_ros.ros.diagnostics import status_values
    from tactile_dynamics_ros.ros.listening import Waiter, take_messages
    from tactile_dynamics_ros.ros.shell import STREAM

    rclpy.init()
    here = rclpy.create_node("biotac_latency")
    force = here.create_subscription(
        WrenchStamped, f"/biotac/{ROBOT.fingers[-1]}/force", lambda _: None, STREAM, raw=True
    )
    publisher = here.create_publisher(Image, "/biotac/raw", STREAM)
    waiter = Waiter(here, lambda: [force])
    _wait_for(here, lambda: publisher.get_subscription_count() > 0)
    messages = [
        biotac_to_message(counts, 1.0 + _PERIOD * k, "hand")
        for k, counts in enumerate(_frames(frames))
    ]
    spent, late = [], []
    start = time.perf_counter()
    for message in messages:
        due = max(start + _PERIOD, time.perf_counter() + _SPIN_S)
        late.append(1e3 * _spin_until(due))
        take_messages(force)
        start = time.perf_counter()
        publisher.publish(message)
        arrived = False
        while not arrived and time.perf_counter() < start + _LOST_S:
            waiter.wait(0.01)
            arrived = bool(take_messages(force))
        spent.append(1e3 * (time.perf_counter() - start) if arrived else np.nan)
    told: dict[str, str] = {}
    here.create_subscription(
        DiagnosticArray, "/diagnostics", lambda m: told.update(status_values(m.status[0])), 10
    )
    _wait_for(here, lambda: "frame_ms_p99" in told)
    here.destroy_node()
    rclpy.shutdown()
    return np.array(spent)[_TARE_FRAMES:], np.array(late)[_TARE_FRAMES:], told


def _frames(pressed: int) -> Iterator[NDArray[np.uint16]]:
    """Yield counts (4, 44) of free fingertips, then of as many frames of pressed ones."""
    sensors = BioTacArray(len(ROBOT.fingers), seed=0)
    for k in range(_TARE_FRAMES + pressed):
        press = 0.0 if k < _TARE_FRAMES else 1.0 + 0.5 * np.sin(0.05 * k)
        yield sensors.measure(np.tile([0.0, 0.0, -press], (len(ROBOT.fingers), 1)), _PAD)


def _spin_until(due: float) -> float:
    """Spin for the last 2 ms until a time and return by how much, s, the machine is late."""
    time.sleep(max(0.0, due - _SPIN_S - time.perf_counter()))
    while (now := time.perf_counter()) < due:
        pass
    return now - due


def _wait_for(node: Node, condition: Callable[[], bool]) -> None:
    import rclpy

    deadline = time.monotonic() + _START_S
    while not condition():
        if time.monotonic() > deadline:
            raise RuntimeError("biotac_force does not answer within 30 s")
        rclpy.spin_once(node, timeout_sec=0.05)


if __name__ == "__main__":
    print(node_latency())
