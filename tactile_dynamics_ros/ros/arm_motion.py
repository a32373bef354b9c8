"""A motion of an arm's joints by its trajectory controller, watched and recorded."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from builtin_interfaces.msg import Duration
from geometry_msgs.msg import Point, WrenchStamped
from sensor_msgs.msg import JointState
from std_msgs.msg import ColorRGBA
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint
from visualization_msgs.msg import Marker, MarkerArray

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.configuration import parameter
from tactile_dynamics_ros.core.errors import NotIdentifiableError
from tactile_dynamics_ros.core.weighing.excitation import WeighingMotion
from tactile_dynamics_ros.ros.conversions import JointReader, header, to_seconds, wrench_to_core
from tactile_dynamics_ros.ros.inputs import Need
from tactile_dynamics_ros.ros.names import JOINT_STATES, JOINT_TRAJECTORY, WRIST_WRENCH
from tactile_dynamics_ros.ros.shell import Shell
from tactile_dynamics_ros.ros.wire import Joints, Stamped

POINTS_HZ = 50.0
"""Rate of a trajectory's points, Hz: between them controllers interpolate cubically, which is exact
to a micrometre for sines of 0.7 Hz. Twice as many make messages of 2000 points."""
BRAKE = 0.3
"""Time in which an arm that is stopped comes to rest, s: from a quarter of its speed, 0.5 rad/s, at
2 rad/s^2. Controllers of ROS 2 Jazzy throw empty trajectories away, so that one is sent that ends
where the arm can be at rest."""
LEAD = 1.0
"""Time in which the controller goes from where it wants the arm to where the arm is, s, before a
motion begins: under an unknown load an arm hangs below what its controller wants, and a step there
shakes it."""
SETTLE = 0.5
"""Time after the last point until a motion has ended, s: links stop shaking."""


@dataclass(frozen=True)
class ArmMotionConfig:
    """Topics of the arm, and when it is stopped."""

    trajectory: str = parameter(JOINT_TRAJECTORY, "topic of the joint trajectory controller")
    wrench: str = parameter(WRIST_WRENCH, "topic of the wrist sensor")
    max_force: float = parameter(100.0, "force of the sensor that stops the arm", "N", 1.0, 1e4)
    max_torque: float = parameter(10.0, "torque of the sensor that stops the arm", "N m", 0.1, 1e3)
    silence: float = parameter(
        0.5, "real time without joints or wrench after which the arm is stopped", "s", 0.05, 10.0
    )
    follow_error: float = parameter(
        0.15, "how far a joint may be from where the motion has it", "rad", 0.01, 3.0
    )


@dataclass
class Taken:
    """What was measured during a motion, its lead-in too.

    Attributes:
        joint_time: s, with positions (J,) each. wrench_time: s, with [force, torque] (6,) each.
    """

    joint_time: list[float] = field(default_factory=list)
    positions: list[Array] = field(default_factory=list)
    wrench_time: list[float] = field(default_factory=list)
    wrenches: list[Array] = field(default_factory=list)

    def after_lead(self) -> Taken:
        """Return what was measured since the motion itself began."""
        if not self.joint_time:
            return self
        joints, wrenches = (
            int(np.searchsorted(times, self.joint_time[0] + LEAD))
            for times in (self.joint_time, self.wrench_time)
        )
        return Taken(
            self.joint_time[joints:],
            self.positions[joints:],
            self.wrench_time[wrenches:],
            self.wrenches[wrenches:],
        )


class ArmMotion:
    """Sends a motion to the controller, follows it, and stops the arm when something is wrong.

    Args:
        node: that commands the arm.
        config: topics and limits.

    Attributes:
        taken: what was measured since the motion began.
        frame: frame of the sensor, from its messages; empty before.
        stopped: why the motion was stopped; empty if it was not.
    """

    def __init__(self, node: Shell, config: ArmMotionConfig) -> None:
        self._node, self.config = node, config
        self.taken, self.frame, self.stopped = Taken(), "", ""
        self._positions: dict[str, float] = {}
        self._motion: WeighingMotion | None = None
        self._reader: JointReader | None = None
        self._begun: float | None = None
        self._heard = {JOINT_STATES: -np.inf, config.wrench: -np.inf}
        self._command = node.create_publisher(JointTrajectory, config.trajectory, 1)
        node.listen(JointState, JOINT_STATES, self._on_joints, need=Need.ALWAYS)
        node.listen(WrenchStamped, config.wrench, self._on_wrench, sole=True, need=Need.ALWAYS)

    @property
    def moving(self) -> bool:
        """Whether a motion is being made."""
        return self._motion is not None

    @property
    def share(self) -> float:
        """Share of the motion that is done, 0 to 1."""
        if self._motion is None or self._begun is None or not self.taken.joint_time:
            return 0.0
        elapsed = self.taken.joint_time[-1] - self._begun - LEAD
        return float(np.clip(elapsed / self._motion.duration, 0.0, 1.0))

    def require_ready(self) -> None:
        """Check that joints, sensor and controller are there.

        Raises:
            NotIdentifiableError: one is not.
        """
        now = time.monotonic()
        for topic, heard in self._heard.items():
            if now - heard > self.config.silence:
                raise NotIdentifiableError(f"nothing comes on {topic}; is the driver running?")
        if self._node.count_subscribers(self._command.topic_name) == 0:
            raise NotIdentifiableError(
                f"nobody listens to {self._command.topic_name}; is the controller active? Another "
                "one is named by the parameter trajectory"
            )

    def position_of(self, names: Sequence[str]) -> Array:
        """Return the newest positions of joints, rad.

        Raises:
            NotIdentifiableError: one is not on joint_states.
        """
        absent = [name for name in names if name not in self._positions]
        if absent:
            raise NotIdentifiableError(f"joint '{absent[0]}' is not on {JOINT_STATES}")
        return np.array([self._positions[name] for name in names])

    def begin(self, motion: WeighingMotion) -> None:
        """Send a motion; it begins where the arm is."""
        self.taken, self.stopped, self._begun = Taken(), "", None
        self._reader = JointReader(motion.names)
        self._motion = motion
        times, positions, velocities = motion.table(POINTS_HZ)
        self._send(times + LEAD, positions, velocities)

    def stop(self, why: str) -> None:
        """Bring the arm to rest where it is."""
        if self._motion is None:
            return
        self.stopped = why
        taken = self.taken.positions
        place = taken[-1] + 0.5 * BRAKE * self._rate() if taken else self._motion.start
        self._send(np.array([BRAKE]), place[None], np.zeros((1, len(place))))
        self._motion = None

    def watch(self) -> bool:
        """Stop the arm where something is wrong; return whether the motion has ended."""
        if self._motion is None:
            return True
        now = time.monotonic()
        for topic, heard in self._heard.items():
            if now - heard > self.config.silence:
                self.stop(f"nothing came on {topic} for {self.config.silence:g} s")
                return True
        if self._begun is None or not self.taken.joint_time:
            return False
        elapsed = self.taken.joint_time[-1] - self._begun - LEAD
        if elapsed > self._motion.duration + SETTLE:
            self._motion = None
            return True
        return self._require_following(elapsed)

    def _require_following(self, elapsed: float) -> bool:
        """Stop the arm if it is not where the motion has it; return whether it was stopped."""
        assert self._motion is not None
        motion = self._motion
        wanted = motion.start + motion.offsets.evaluate(np.array([elapsed]))[0]
        error = np.abs(self.taken.positions[-1] - wanted)
        worst = int(np.argmax(error))
        if error[worst] > self.config.follow_error:
            self.stop(
                f"joint {motion.names[worst]} is {error[worst]:.2f} rad from where the motion has "
                "it: it does not follow, or the controller is not active"
            )
        return bool(self.stopped)

    def _rate(self) -> Array:
        """Return the newest velocities (J,) of the joints, rad/s."""
        times, places = self.taken.joint_time[-5:], self.taken.positions[-5:]
        if len(times) < 2 or times[-1] <= times[0]:
            return np.zeros(len(places[-1]))
        return np.asarray((places[-1] - places[0]) / (times[-1] - times[0]))

    def _send(self, times: Array, positions: Array, velocities: Array) -> None:
        assert self._motion is not None
        names = self._motion.names
        self._command.publish(trajectory_message(names, times, positions, velocities))

    def _on_joints(self, message: Joints) -> None:
        self._heard[JOINT_STATES] = time.monotonic()
        self._positions = dict(zip(message.names, message.positions.tolist(), strict=False))
        if self._motion is None or self._reader is None:
            return
        stamp = to_seconds(message.stamp)
        if self.taken.joint_time and stamp <= self.taken.joint_time[-1]:
            return
        self._begun = stamp if self._begun is None else self._begun
        self.taken.joint_time.append(stamp)
        self.taken.positions.append(self._reader.positions(message))

    def _on_wrench(self, message: Stamped) -> None:
        self._heard[self.config.wrench] = time.monotonic()
        wrench = wrench_to_core(message, self.config.wrench)
        self.frame = message.frame_id.lstrip("/") or self.frame
        if self._motion is None:
            return
        stamp = to_seconds(message.stamp)
        if self.taken.wrench_time and stamp <= self.taken.wrench_time[-1]:
            return
        self.taken.wrench_time.append(stamp)
        self.taken.wrenches.append(np.concatenate([wrench[3:], wrench[:3]]))
        torque, force = np.linalg.norm(wrench[:3]), np.linalg.norm(wrench[3:])
        if force > self.config.max_force or torque > self.config.max_torque:
            self.stop(
                f"the sensor reads {force:.0f} N, {torque:.1f} N m: more than max_force = "
                f"{self.config.max_force:g} N or max_torque = {self.config.max_torque:g} N m"
            )


def trajectory_message(
    names: Sequence[str], times: Array, positions: Array, velocities: Array
) -> JointTrajectory:
    """Return a trajectory.

    Args:
        names: of the J joints.
        times: (N,) s from the start.
        positions: (N, J) rad.
        velocities: (N, J) rad/s.
    """
    message = JointTrajectory(joint_names=list(names))
    for moment, place, rate in zip(times, positions, velocities, strict=True):
        seconds = int(moment)
        since = Duration(sec=seconds, nanosec=round(1e9 * (moment - seconds)))
        message.points.append(
            JointTrajectoryPoint(
                positions=place.tolist(), velocities=rate.tolist(), time_from_start=since
            )
        )
    return message


def way_markers(places: Array, frame: str) -> MarkerArray:
    """Return the way of a sensor as a line for RViz.

    Args:
        places: (N, 3) m.
        frame: in which they are.
    """
    line = Marker(header=header(0.0, frame), ns="weigher", type=Marker.LINE_STRIP)
    line.scale.x, line.color = 0.004, ColorRGBA(r=0.9, g=0.5, b=0.1, a=1.0)
    line.pose.orientation.w = 1.0
    line.points = [Point(x=x, y=y, z=z) for x, y, z in places.tolist()]
    return MarkerArray(markers=[line])
