"""Processor time per simulated second of each process of the running demo, and its pace."""

from __future__ import annotations

import argparse
import json
import os
import sys
import tempfile
import time
from collections.abc import Mapping
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from rosbags.rosbag2 import Reader

from tactile_dynamics_ros.cli.demo import start_processes
from tactile_dynamics_ros.cli.demo_monitor import Monitor
from tactile_dynamics_ros.cli.domain import private_domain
from tactile_dynamics_ros.cli.live import DEFAULT_CONFIG
from tactile_dynamics_ros.cli.supervisor import Supervisor
from tactile_dynamics_ros.cli.topics import call_trigger
from tactile_dynamics_ros.core.errors import TactileDynamicsError
from tactile_dynamics_ros.share import share_file

TICKS = os.sysconf("SC_CLK_TCK")
MOVING = "excite"
PATIENCE = 600.0
"""Real seconds within which the object must be in the hand."""
RATES = ("/joint_states", "/biotac/raw", "/contact/thumb/force", "/object/pose/vision",
         "/object/pose", "/inertial_estimator/status")  # fmt: skip
SPEED_SIZE, SPEED_ROUNDS = 200_000, 20


@dataclass(frozen=True)
class Moment:
    """What has been used until a moment.

    Attributes:
        simulated: time of the simulation, s. real: of the wall clock, s.
        used: processor time by process, s.
    """

    simulated: float
    real: float
    used: dict[str, float]


def main() -> int:
    """Run the demo until the object moves, measure, and print a table."""
    options = _parse()
    with tempfile.TemporaryDirectory() as folder, private_domain() as domain:
        out = Path(options.out or folder)
        out.mkdir(parents=True, exist_ok=True)
        print(f"ROS_DOMAIN_ID={domain}", file=sys.stderr)
        with Supervisor(out / "logs", respawn=False) as supervisor:
            before, after = measure(supervisor, options, out, options.seconds)
            supervisor.stop(["recorder"])
        result = summarise(before, after, count_messages(out / "recording", before, after))
    result["machine_ns"] = machine_speed()
    print(json.dumps(result) if options.json else table(result), flush=True)
    return 0


def measure(
    supervisor: Supervisor, options: argparse.Namespace, out: Path, seconds: float
) -> tuple[Moment, Moment]:
    """Start the demo's processes and return the moments around a stretch of the motion.

    Args:
        supervisor: of the processes.
        options: object, seed and what else the demo takes.
        out: folder of the demo.
        seconds: length of the stretch, real time.

    Raises:
        TactileDynamicsError: a process ended, or nothing is in the hand.
    """
    config = share_file(DEFAULT_CONFIG)
    with closing(Monitor(lambda text: print(text, file=sys.stderr), config)) as monitor:
        options.config = DEFAULT_CONFIG
        start_processes(supervisor, options, out, monitor.node.get_logger().info)
        _wait(supervisor, monitor, PATIENCE, until_phase=MOVING)
        _wait(supervisor, monitor, options.settle)
        before = take_moment(supervisor, monitor)
        _wait(supervisor, monitor, seconds)
        after = take_moment(supervisor, monitor)
        if monitor.phase != MOVING:
            raise TactileDynamicsError(f"the motion ended ({monitor.phase}): ask for less seconds")
    return before, after


def take_moment(supervisor: Supervisor, monitor: Monitor) -> Moment:
    """Return what all processes have used until now."""
    _, message = call_trigger(monitor.node, "/robot_sim/reveal", 30.0)
    pids = {n: m.process.pid for n, m in supervisor.members.items() if m.process is not None}
    used = {name: processor_time(pid) for name, pid in {**pids, "demo": os.getpid()}.items()}
    return Moment(float(json.loads(message)["time"]), time.time(), used)


def processor_time(pid: int) -> float:
    """Return the processor time that a process and its threads have used, s."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(") ")[2].split()
    return (int(fields[11]) + int(fields[12])) / TICKS


def count_messages(recording: Path, before: Moment, after: Moment) -> dict[str, float]:
    """Return recorded messages per simulated second by topic between two moments."""
    found = dict.fromkeys(RATES, 0)
    with Reader(recording) as reader:
        wanted = [c for c in reader.connections if c.topic in RATES]
        for connection, stamp, _ in reader.messages(connections=wanted):
            found[connection.topic] += before.real <= 1e-9 * stamp < after.real
    span = after.simulated - before.simulated
    return {topic: count / span for topic, count in found.items()}


def summarise(before: Moment, after: Moment, rates: Mapping[str, float]) -> dict[str, object]:
    """Return processor time per simulated second by process, pace and rates."""
    simulated, real = after.simulated - before.simulated, after.real - before.real
    used = {name: (after.used[name] - before.used[name]) / simulated for name in before.used}
    return {
        "simulated_s": simulated,
        "real_time_factor": simulated / real,
        "processor_s_per_simulated_s": sum(used.values()),
        "processes": dict(sorted(used.items(), key=lambda item: -item[1])),
        "messages_per_simulated_s": dict(rates),
    }


def machine_speed() -> float:
    """Return how long this machine takes for one turn of a plain Python loop, ns of processor."""
    spent = []
    for _ in range(SPEED_ROUNDS):
        began = time.process_time()
        for _ in range(SPEED_SIZE):
            pass
        spent.append(time.process_time() - began)
    return 1e9 * float(np.median(spent)) / SPEED_SIZE


def table(result: dict[str, object]) -> str:
    """Return the result as lines of a table."""
    processes, rates = result["processes"], result["messages_per_simulated_s"]
    assert isinstance(processes, dict) and isinstance(rates, dict)
    lines = [f"  {name:20s} {used:6.3f}" for name, used in processes.items()]
    lines.insert(0, "processor time per simulated second, s")
    lines.append(f"  {'all':20s} {result['processor_s_per_simulated_s']:6.3f}")
    lines.append("messages per simulated second")
    lines += [f"  {topic:28s} {rate:6.1f}" for topic, rate in rates.items()]
    lines.append(f"real-time factor {result['real_time_factor']:.3f} over")
    lines[-1] += f" {result['simulated_s']:.1f} simulated s"
    lines.append(f"one turn of a Python loop: {result['machine_ns']:.1f} ns")
    return "\n".join(lines)


def _wait(
    supervisor: Supervisor, monitor: Monitor, seconds: float, until_phase: str | None = None
) -> None:
    """Show what comes for some seconds of real time, or until a phase is reached."""
    deadline = time.monotonic() + seconds
    while monitor.phase != until_phase:
        if time.monotonic() > deadline:
            if until_phase is None:
                return
            raise TactileDynamicsError(f"no phase '{until_phase}' within {seconds:.0f} s")
        monitor.spin_once()
        for member in supervisor.watch():
            raise TactileDynamicsError(f"{member.name} ended: {member.last_words()}")
        if monitor.failure:
            raise TactileDynamicsError(monitor.failure)


def _parse() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=20.0, help="of real time to measure")
    parser.add_argument("--settle", type=float, default=3.0, help="of the motion before, s")
    parser.add_argument("--duration", type=float, default=60.0, help="of the motion, s")
    parser.add_argument("--object", default="box_0", help="file in config/objects")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--real-time-factor", type=float, default=1.0, help="aim of the simulation")
    parser.add_argument("--out", help="folder for recording and logs; none is kept if left out")
    parser.add_argument("--json", action="store_true", help="print only JSON on stdout")
    parser.set_defaults(hidden="none", magnitude=1.0)
    return parser.parse_args()
