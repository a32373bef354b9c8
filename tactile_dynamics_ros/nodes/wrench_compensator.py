"""Node: the wrench of the world on what is carried, at the sensor's rate."""

from __future__ import annotations

import time as clock
from collections import deque
from dataclasses import dataclass

import numpy as np
from geometry_msgs.msg import PoseWithCovarianceStamped, WrenchStamped
from sensor_msgs.msg import Imu
from std_msgs.msg import Bool

from tactile_dynamics_ros.core.configuration import parameter
from tactile_dynamics_ros.core.inertia.compensation import (
    Compensated,
    Compensator,
    ContactWrenches,
)
from tactile_dynamics_ros.core.inertia.compensation.causal_motion import CausalMotion, ImuMotion
from tactile_dynamics_ros.core.streams.streams import ContactSample
from tactile_dynamics_ros.ros.conversions import MessageError, wrench_to_message
from tactile_dynamics_ros.ros.friction_messages import ContactAssembly
from tactile_dynamics_ros.ros.inputs import Need
from tactile_dynamics_ros.ros.names import (
    COMPENSATED,
    COMPENSATED_STD,
    COMPENSATED_VALID,
    CONTACTS,
    OBJECT_IMU,
    OBJECT_POSE,
)
from tactile_dynamics_ros.ros.parameters import declare_config
from tactile_dynamics_ros.ros.payload_services import CarriedLoad
from tactile_dynamics_ros.ros.shell import LATCHED, Shell, run_node
from tactile_dynamics_ros.ros.stated_noise import read_tracked_pose
from tactile_dynamics_ros.ros.stream_clock import StreamClock
from tactile_dynamics_ros.ros.wire import Stamped

LOOK = 0.1
"""Time between looks at the load, s: a change of it is said that much late at most."""
REPEAT = 0.5
"""Time after which an unchanged answer is published again, s, so that it is seen to be alive."""
STALE = 0.1
"""Age of the newest pose beyond which there is no contact wrench, s of the streams: as long as the
filter of the motion bridges."""
PATIENCE = 0.02
"""Time for which readings of one stamp wait for other sensors', s of the streams."""
ABSENT = 0.1
"""Silence of a sensor after which it touches nothing, s of the streams, as for the estimators."""
ASSUMED_STD = 0.05
"""Standard deviation of a force whose sensor states none, N: of a good wrist sensor; it only says
what is beyond noise."""


@dataclass(frozen=True)
class CompensatorConfig:
    """What is compensated, and with which load."""

    contacts: tuple[str, ...] = parameter(
        CONTACTS, "names of the contacts on contact/<name>: fingers, or one wrist sensor"
    )
    imu: bool = parameter(
        False, "take accelerations from object/imu, at the origin and in the axes of object/pose"
    )
    valid_topic: str = parameter(
        "", "std_msgs/Bool that says whether the readings are to be believed; empty: always"
    )
    sensor_frame: str = parameter(
        "", "frame in the header of the wrenches; empty: contact/<name>, or object of fingers"
    )


class WrenchCompensatorNode(Shell):
    """Publishes contact wrenches, their standard deviations, and whether they are to be believed.

    wrench = Y phi - Delta - measured: what the world applies on what is carried, without zero,
    gravity and inertia. With one sensor about its point and in its axes, with several about the
    origin of the object and in its axes.
    """

    gather = 0.0

    def __init__(self) -> None:
        super().__init__("wrench_compensator")
        config = declare_config(self, CompensatorConfig)
        self._config = config
        self.compensator = Compensator()
        self.compensator.motion = self._new_motion()
        self._load = CarriedLoad(self, config.contacts)
        one = len(config.contacts) == 1
        self._frame = config.sensor_frame or (f"contact/{config.contacts[0]}" if one else "object")
        self._time = StreamClock(self)
        self._time.on_move.append(self._begin_anew)
        self._believed = not config.valid_topic
        if config.valid_topic:
            self.listen(Bool, config.valid_topic, self._on_valid, LATCHED, need=Need.ALWAYS)
        self._waiting: deque[ContactSample] = deque(maxlen=2000)
        self._newest: dict[str, ContactSample] = {}
        self._said: bool | None = None
        self._say_again = -np.inf
        self.listen(PoseWithCovarianceStamped, OBJECT_POSE, self._on_pose, need=Need.ALWAYS)
        if config.imu:
            self.listen(Imu, OBJECT_IMU, self._on_imu, need=Need.ALWAYS)
        self._contacts = [
            ContactAssembly(self, name, self._waiting.append, self._time)
            for name in config.contacts
        ]
        self._wrench = self.stream(WrenchStamped, COMPENSATED)
        self._std = self.stream(WrenchStamped, COMPENSATED_STD)
        self._valid = self.latched(Bool, COMPENSATED_VALID)
        self.every(LOOK, self._say_validity)
        self.stops.append(self._say_valid)

    def _new_motion(self) -> CausalMotion:
        return ImuMotion() if self._config.imu else CausalMotion()

    def _begin_anew(self) -> None:
        self.compensator.motion = self._new_motion()
        self._waiting.clear()
        self._newest.clear()

    def _on_pose(self, message: Stamped) -> None:
        pose, _ = read_tracked_pose(message, OBJECT_POSE, "world", self.faults)
        self.compensator.motion.add(self._time.admit(message.stamp, OBJECT_POSE), pose)

    def _on_valid(self, message: Bool) -> None:
        self._believed = message.data

    def _on_imu(self, message: Imu) -> None:
        measured, motion = message.linear_acceleration, self.compensator.motion
        force = np.array([measured.x, measured.y, measured.z])
        if not np.isfinite(force).all():
            raise MessageError("not_finite", f"{OBJECT_IMU}: {force.tolist()}, expected numbers")
        assert isinstance(motion, ImuMotion)
        motion.feel(self._time.admit(message.header.stamp, OBJECT_IMU), force)

    def process(self) -> None:
        """Compensate what was taken together, and say so at once."""
        self.compensator.load = self._load.load
        seen = self._take_readings()
        motion = self.compensator.motion
        if seen is None or self.compensator.load is None or not motion.settled:
            return
        found = self.compensator.compensate(seen)
        for k, stamp in enumerate(found.time):
            self._publish(found, k, float(stamp))

    def _publish(self, found: Compensated, k: int, stamp: float) -> None:
        self._wrench.publish(wrench_to_message(found.wrench[k], stamp, self._frame))
        self._std.publish(wrench_to_message(found.std[k], stamp, self._frame))

    def _take_readings(self) -> ContactWrenches | None:
        """Readings of the stamps that all sensors have, or that have waited long enough."""
        if not self._waiting:
            return None
        samples = sorted(self._waiting, key=lambda sample: sample.time)
        newest = samples[-1].time
        heard = {**self._newest, **{sample.name: sample for sample in samples}}
        present = [s.time for s in heard.values() if newest - s.time < ABSENT]
        until = max(min(present), newest - PATIENCE)
        self._waiting.clear()
        self._waiting.extend(sample for sample in samples if sample.time > until)
        rows = []
        ready = [sample for sample in samples if sample.time <= until]
        for k, sample in enumerate(ready):
            self._newest[sample.name] = sample
            if k + 1 == len(ready) or ready[k + 1].time > sample.time:
                rows.append((sample.time, dict(self._newest)))
        return _readings(self._config.contacts, rows) if rows else None

    def _say_validity(self) -> None:
        """Say whether the wrenches are to be believed, and why not."""
        reason = self._doubt()
        self.faults.show("valid", reason or "yes")
        motion = self.compensator.motion
        if motion.settled:
            self.faults.show("acceleration_delay_ms", round(1e3 * motion.acceleration_delay, 1))
        now, valid = clock.monotonic(), not reason
        if valid is not self._said or now >= self._say_again:
            self._say_again = now + REPEAT
            self._say_valid(reason)

    def _say_valid(self, reason: str) -> None:
        """Publish that wrenches are valid, or are not for a reason: the topic is latched."""
        self._said = not reason
        self._valid.publish(Bool(data=self._said))

    def _doubt(self) -> str:
        """Why the wrenches are not to be believed now; empty if they are."""
        load, motion = self.compensator.load, self.compensator.motion
        if load is None or self._load.trouble:
            return self._load.trouble
        if not self._believed:
            return f"{self._config.valid_topic} is false, or has not come"
        if load.uncompensated:
            return f"{', '.join(load.uncompensated)} cannot be taken out as it comes"
        if not motion.settled or self._time.newest - motion.time > STALE or self._time.is_idle:
            return f"{OBJECT_POSE} is not known now"
        if change := self.compensator.load_change:
            return f"the load seems to have changed by {change:+.3g} kg"
        return ""


def _readings(
    names: tuple[str, ...], rows: list[tuple[float, dict[str, ContactSample]]]
) -> ContactWrenches:
    """Put readings side by side; a sensor that is silent touches nothing."""
    shape = (len(rows), len(names))
    point, force, torque = (np.zeros((*shape, 3)) for _ in range(3))
    rotation = np.tile(np.eye(3), (*shape, 1, 1))
    touches = np.zeros(shape, dtype=bool)
    variance = np.zeros((len(rows), 3))
    for row, (stamp, newest) in enumerate(rows):
        for column, name in enumerate(names):
            one = newest.get(name)
            if one is None or stamp - one.time > ABSENT:
                continue
            point[row, column], rotation[row, column] = one.point, one.rotation
            force[row, column], torque[row, column] = one.force, one.torque
            touches[row, column] = one.touches
            stated = np.full(3, ASSUMED_STD) if one.std is None else one.std
            variance[row] += np.where(np.isfinite(stated), stated, ASSUMED_STD) ** 2
    time = np.array([stamp for stamp, _ in rows])
    return ContactWrenches(time, names, point, rotation, force, torque, touches, np.sqrt(variance))


def main() -> int:
    """Run the node."""
    return run_node(WrenchCompensatorNode, prompt=True)
