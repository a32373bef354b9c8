"""Node: raw BioTac counts to the force of each finger on the object, with standard deviation."""

from __future__ import annotations

import time
from collections import deque
from dataclasses import dataclass, replace

import numpy as np
from geometry_msgs.msg import Vector3Stamped, WrenchStamped
from numpy.typing import NDArray
from sensor_msgs.msg import Image

from tactile_dynamics_ros.core.configuration import check_ranges, parameter
from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.robot.robot import Robot
from tactile_dynamics_ros.core.tactile.analytic_force import create_force_estimator
from tactile_dynamics_ros.core.tactile.fingertip import FingertipConfig, TactileEstimate
from tactile_dynamics_ros.core.tactile.signal_change import COUNTS_PER_KELVIN
from tactile_dynamics_ros.core.tactile.slip import SlipConfig, SlipDetector, SlipEstimate
from tactile_dynamics_ros.ros.conversions import (
    StampGate,
    biotac_to_core,
    std_to_message,
    wrench_to_message,
)
from tactile_dynamics_ros.ros.inputs import Need
from tactile_dynamics_ros.ros.names import BIOTAC_RAW, TARE, fingertip_topic
from tactile_dynamics_ros.ros.object_memory import KeptTare
from tactile_dynamics_ros.ros.parameters import declare_config
from tactile_dynamics_ros.ros.robot import declare_robot
from tactile_dynamics_ros.ros.shell import Shell, run_node
from tactile_dynamics_ros.ros.wire import AnyStamp, Picture


@dataclass(frozen=True)
class BiotacForceConfig:
    """Which model estimates the force, and how the rest state is found and kept."""

    model: str = parameter(
        "network", "force model: network, analytic, or a file of `train biotac` (.npz)"
    )
    gains: tuple[float, ...] = parameter(
        (1.0,),
        "of the fingers: one for all, a number each, or the nine of a matrix by rows each",
    )
    drift: tuple[float, ...] = parameter(
        (COUNTS_PER_KELVIN,),
        "of the electrodes with temperature: one for all, one per finger, or E1 to E19 of each",
        "counts/K",
    )
    tare_frames: int = parameter(30, "frames without contact that make a tare", "", 1, 1000)
    tare_file: str = parameter("", "where the tare outlives the node (empty: one per namespace)")
    tare_max_age: float = parameter(30.0, "pause after which a kept tare is not used", "s", 0.0)

    def __post_init__(self) -> None:
        check_ranges(self)

    def fingertips(self, robot: Robot, tip: FingertipConfig) -> list[FingertipConfig]:
        """Return what holds for all fingertips with the numbers of each unit.

        Raises:
            BadInputError: there are neither numbers for all fingers nor for each.
        """
        gains = _split("gains", self.gains, len(robot.fingers), 9)
        drifts = _split("drift", self.drift, len(robot.fingers), 19)
        pairs = zip(gains, drifts, strict=True)
        return [replace(tip, drift=drift).with_gain(gain) for gain, drift in pairs]


def _split(
    name: str, values: tuple[float, ...], fingers: int, each: int
) -> list[tuple[float, ...]]:
    """Return the numbers of each finger."""
    count = len(values)
    if count not in (1, fingers, each * fingers):
        raise BadInputError(f"{name}: {count} values, expected 1, {fingers} or {each * fingers}")
    if count == 1:
        return [values] * fingers
    return [tuple(map(float, part)) for part in np.split(np.array(values), fingers)]


class BiotacForce(Shell):
    """Estimates a force per finger from each frame; tares at the start and on request.

    A restarted node continues with the tare that it kept, since the fingers may hold something.
    """

    gather = 0.0  # one message carries all fingers: there is nothing to wait for

    def __init__(self) -> None:
        super().__init__("biotac_force")
        self.config = declare_config(self, BiotacForceConfig)
        tip = declare_config(self, FingertipConfig, "fingertip.")
        slip = declare_config(self, SlipConfig, "slip.")
        self.robot = declare_robot(self)
        self.robot.require_tips("biotac", "biotac_force")
        tips = self.config.fingertips(self.robot, tip)
        self.estimator = create_force_estimator(self.config.model, tips)
        self._slip = SlipDetector(slip)
        self._kept = KeptTare(len(tips), self.config.tare_file, self.get_namespace())
        self._rest: deque[NDArray[np.float64]] | None = None
        frames = self._kept.read(self.config.tare_max_age)
        if frames is None:
            self.start_tare()
        else:
            self._set_rest(frames)
        self._gate = StampGate(BIOTAC_RAW)
        self.listen(Image, BIOTAC_RAW, self._on_raw, need=Need.ALWAYS)
        fingers = self.robot.fingers
        self._frames = [self.robot.sensor_frame(finger) for finger in fingers]
        self._force = [self.stream(WrenchStamped, fingertip_topic(f, "force")) for f in fingers]
        self._std = [self.stream(Vector3Stamped, fingertip_topic(f, "force_std")) for f in fingers]
        self._slips = [self.stream(Vector3Stamped, fingertip_topic(f, "slip")) for f in fingers]
        self._spent: deque[NDArray[np.float64]] = deque(maxlen=1000)
        self.serve(TARE, self.start_tare)
        self.every(1.0, self._show_spent)
        self.every(1.0, self._kept.refresh)

    def start_tare(self) -> str:
        """Take the coming frames as the state without contact."""
        self._rest = deque(maxlen=self.config.tare_frames)
        return f"taring with the next {self.config.tare_frames} frames; keep the fingers free"

    def _on_raw(self, message: Picture) -> None:
        start = _clocks()
        counts = biotac_to_core(message, BIOTAC_RAW, len(self._frames))
        if self._gate.check(message.stamp):
            self.faults.add("clock_restarted")
            self.start_tare()
        if self._rest is not None:
            self._collect(counts)
            return
        seen = self.estimator.observe(counts)
        self._publish_forces(seen, message.stamp)
        self._publish_slips(self._slip.update(counts, seen.in_contact), message.stamp)
        self._flag(seen)
        self._spent.append(_clocks() - start)

    def _show_spent(self) -> None:
        """Tell on /diagnostics how long the last thousand frames took, and this thread's part, ms.

        Where frames take much longer than the thread works on them, the machine is busy.
        """
        if self._spent:
            (median, _), (slow, worked) = 1e3 * np.quantile(self._spent, [0.5, 0.99], axis=0)
            self.faults.show("frame_ms_median", float(median))
            self.faults.show("frame_ms_p99", float(slow))
            self.faults.show("frame_cpu_ms_p99", float(worked))

    def _publish_forces(self, seen: TactileEstimate, stamp: AnyStamp) -> None:
        wrench = np.concatenate([seen.torque, seen.force], axis=-1)
        for k, frame in enumerate(self._frames):
            self._std[k].publish(std_to_message(seen.std[k], stamp, frame))
            self._force[k].publish(wrench_to_message(wrench[k], stamp, frame))

    def _publish_slips(self, heard: SlipEstimate, stamp: AnyStamp) -> None:
        """Publish score, level over rest, and whether it slips (0 or 1) as x, y and z."""
        said = np.stack([heard.score, heard.level, heard.slipping], axis=-1)
        for k, frame in enumerate(self._frames):
            self._slips[k].publish(std_to_message(said[k], stamp, frame))

    def _flag(self, seen: TactileEstimate) -> None:
        """Count the frames of fingers that cannot be trusted."""
        rows = zip(self.robot.fingers, seen.saturated, seen.drifting, seen.warming, strict=True)
        for finger, saturated, drifting, warming in rows:
            if saturated:
                self.faults.add(f"saturated_{finger}")
            if drifting:
                self.faults.add(f"warming_{finger}", f"{finger} warmed by {warming:.1f} K")

    def _collect(self, counts: NDArray[np.float64]) -> None:
        assert self._rest is not None
        self._rest.append(counts)
        if len(self._rest) < self.config.tare_frames:
            return
        frames = np.stack(self._rest)
        try:
            self._set_rest(frames)
        except BadInputError as error:
            self.faults.add("tare_disturbed", str(error))
            return
        self._rest = None
        self._kept.write(frames)
        self.get_logger().info(f"tared with {len(frames)} frames")

    def _set_rest(self, frames: NDArray[np.float64]) -> None:
        """Tare all fingers with frames (K, F, 44)."""
        self.estimator.tare(frames)
        self._slip.tare(frames)
        for finger, dead in zip(self.robot.fingers, self.estimator.dead, strict=True):
            if dead.any():
                names = ", ".join(f"E{n + 1}" for n in np.flatnonzero(dead))
                self.faults.add(f"dead_electrodes_{finger}", f"{finger}: {names}")


def _clocks() -> NDArray[np.float64]:
    """Return wall time and the processor time of this thread, s."""
    return np.array([time.perf_counter(), time.thread_time()])


def main() -> int:
    """Run the node."""
    return run_node(BiotacForce)
