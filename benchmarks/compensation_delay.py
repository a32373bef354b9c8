"""How much later a compensated wrench comes than the reading that it is made of.

A process publishes poses of a wrist and readings of its sensor, the node compensates them, and the
first process hears both: the delay is of the compensated wrench over that of the reading itself.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from contextlib import ExitStack
from pathlib import Path

import numpy as np
import rclpy
from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped, WrenchStamped
from rclpy.node import Node

from tactile_dynamics_ros.cli.domain import private_domain
from tactile_dynamics_ros.cli.supervisor import node_command
from tactile_dynamics_ros.core.rigid_body.inertial_parameters import (
    InertialParameters,
    KnownBody,
)
from tactile_dynamics_ros.recording.yaml_files import write_body
from tactile_dynamics_ros.ros import conversions as cv
from tactile_dynamics_ros.ros.names import COMPENSATED, OBJECT_POSE, contact_topic
from tactile_dynamics_ros.ros.shell import STREAM

WARM_UP = 2.0
"""Start of a run that is not counted, s: libraries are loaded into caches."""


BESIDE = {
    "inertial_estimator": {"contacts": ["wrist"]},
    "model_check": {"contacts": ["wrist"]},
    "payload_writer": {"contacts": ["wrist"]},
}
"""Parameters of nodes that hear the same sensor; others have none."""


class Rig:
    """Publishes readings at a rate and notes when each comes back."""

    def __init__(self) -> None:
        """Make the node and its topics."""
        self.node = Node("compensation_delay", enable_rosout=False)
        publish = self.node.create_publisher
        self._pose = publish(PoseWithCovarianceStamped, OBJECT_POSE, STREAM)
        self._place = publish(PoseStamped, contact_topic("wrist", "pose"), STREAM)
        self._force = publish(WrenchStamped, contact_topic("wrist", "force"), STREAM)
        self.raw: dict[int, float] = {}
        self.compensated: dict[int, float] = {}
        self._heard = [
            (self._listen(contact_topic("wrist", "force")), self.raw),
            (self._listen(COMPENSATED), self.compensated),
        ]

    def _listen(self, topic: str) -> rclpy.subscription.Subscription:
        return self.node.create_subscription(WrenchStamped, topic, lambda _: None, STREAM, raw=True)

    def hear(self) -> None:
        """Note what has come by now."""
        for subscription, heard in self._heard:
            while True:
                with subscription.handle:
                    taken = subscription.handle.take_message(subscription.msg_type, True)
                if taken is None:
                    break
                seconds, nanoseconds = np.frombuffer(taken[0], "<u4", 2, 4)
                heard.setdefault(int(seconds) * 10**9 + int(nanoseconds), time.monotonic())

    def run(self, rate: float, seconds: float) -> np.ndarray:
        """Publish for a while; return the delays, s."""
        sent, began, k = [], time.monotonic(), 0
        while (now := time.monotonic()) < began + seconds:
            if now >= began + k / rate:
                k += 1
                angle = 0.5 * np.sin(2.0 * now)
                stamp = time.time()
                pose = np.eye(4)
                pose[:2, :2] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
                pose[:3, 3] = [0.1 * np.sin(now), 0.0, 0.5]
                covariance = 1e-8 * np.eye(6)
                self._pose.publish(cv.uncertain_pose_to_message(pose, covariance, stamp, "world"))
                self._place.publish(cv.pose_to_message(pose, stamp, "world"))
                wrench = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 9.81])
                self._force.publish(cv.wrench_to_message(wrench, stamp, "world"))
                if now > began + WARM_UP:
                    sent.append(round(stamp * 1e9))
            self.hear()
            time.sleep(5e-5)
        until = time.monotonic() + 0.5
        while time.monotonic() < until:
            self.hear()
            time.sleep(1e-3)
        self.sent = sent
        both = sorted(set(self.raw) & set(self.compensated))
        return np.array(
            [self.compensated[key] - self.raw[key] for key in both[int(WARM_UP * rate) :]]
        )


def main() -> int:
    """Print one row per rate."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rates", type=float, nargs="+", default=[100.0, 250.0, 500.0, 1000.0])
    parser.add_argument(
        "--beside",
        default="",
        metavar="A,B",
        help="nodes that run as well and hear the same: inertial_estimator,model_check ...",
    )
    parser.add_argument("--seconds", type=float, default=20.0, help="of each rate")
    parser.add_argument("--json", action="store_true", help="print only JSON on stdout")
    options = parser.parse_args()
    rows = []
    with tempfile.TemporaryDirectory() as folder, private_domain():
        body = InertialParameters(1.0, np.zeros(3), 1e-3 * np.eye(3))
        file = write_body(KnownBody.exact(body, "tool"), Path(folder) / "tool.yaml")
        command = node_command(
            "wrench_compensator", parameters={"contacts": ["wrist"], "load": str(file)}
        )
        rclpy.init()
        for rate in options.rates:
            with subprocess.Popen(command, env=os.environ.copy()) as process, ExitStack() as others:
                for name in filter(None, options.beside.split(",")):
                    words = node_command(name, parameters=BESIDE.get(name))
                    others.callback(others.enter_context(subprocess.Popen(words)).terminate)
                rig = Rig()
                while rig._force.get_subscription_count() < 2:
                    time.sleep(0.05)
                began = time.process_time()
                delay = rig.run(rate, options.seconds)
                used = _used(process.pid)
                process.terminate()
            sent = len(rig.sent)
            lost = 1.0 - len(set(rig.compensated) & set(rig.sent)) / max(sent, 1)
            row = {
                "rate_hz": rate,
                "beside": options.beside,
                "n": len(delay),
                "p50_ms": 1e3 * float(np.median(delay)),
                "p99_ms": 1e3 * float(np.percentile(delay, 99.0)),
                "largest_ms": 1e3 * float(delay.max()),
                "lost": round(lost * sent),
                "cpu": used / options.seconds,
                "rig_cpu": (time.process_time() - began) / options.seconds,
            }
            rows.append(row)
            rig.node.destroy_node()
            print(row, file=sys.stderr)
        rclpy.shutdown()
    if options.json:
        print(json.dumps(rows))
    return 0


def _used(process: int) -> float:
    """Processor time of a process, s."""
    fields = Path(f"/proc/{process}/stat").read_text().rsplit(")", 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")
