"""Node: the grasped object's pose from the joints, started from vision."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped, WrenchStamped
from sensor_msgs.msg import JointState
from std_msgs.msg import Bool, Float64

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.configuration import check_ranges, parameter
from tactile_dynamics_ros.core.rigid_body.rotation import twice
from tactile_dynamics_ros.core.robot.hand_kinematics import HandKinematics
from tactile_dynamics_ros.core.tracking.kinematic_tracker import (
    KinematicTracker,
    KinematicTrackerConfig,
)
from tactile_dynamics_ros.core.tracking.pose_fusion import (
    PoseFusion,
    PoseFusionConfig,
    average_poses,
)
from tactile_dynamics_ros.ros.conversions import (
    JointReader,
    StampGate,
    pose_to_core,
    to_seconds,
    uncertain_pose_to_core,
    uncertain_pose_to_message,
    wrench_to_core,
)
from tactile_dynamics_ros.ros.inputs import Need
from tactile_dynamics_ros.ros.names import (
    HAND_POSE,
    JOINT_STATES,
    OBJECT_HELD,
    OBJECT_POSE,
    VISION_POSE,
    VISION_SCORE,
    contact_topic,
)
from tactile_dynamics_ros.ros.parameters import declare_config
from tactile_dynamics_ros.ros.robot import JointHistory, declare_robot
from tactile_dynamics_ros.ros.shape_messages import ObjectFrame
from tactile_dynamics_ros.ros.shell import LATCHED, Shell, run_node
from tactile_dynamics_ros.ros.wire import Joints, Stamped

WORLD = "world"
_ORIGIN = np.zeros(3)


@dataclass(frozen=True)
class TrackerNodeConfig:
    """When tracking starts and ends, and what /object/pose is."""

    start_poses: int = parameter(15, "poses from vision that are averaged to start", "", 2, 1000)
    release_time: float = parameter(
        0.5, "time without the anchor that ends the grasp", "s", 0.02, 10.0
    )
    publish_fused: bool = parameter(True, "publish /object/pose too, where no fusion node runs")
    follow_vision: bool = parameter(True, "object/pose follows slip that vision sees")
    refuting_score: float = parameter(0.5, "an image with a lower score refutes the pose", "", 0, 1)
    refutations: int = parameter(2, "refuting images in a row that count", "", 1, 1000)

    def __post_init__(self) -> None:
        check_ranges(self)


class KinematicTrackerNode(Shell):
    """Follows the object while the anchor (a hand's thumb) and another finger hold it.

    Poses from vision are averaged in the anchor's frame, so the object may move meanwhile. Where
    someone says on object/held when the object is off the table, tracking starts anew at that
    moment, and object/pose is silent before and after. object/pose/kinematic knows vision only
    from the start; object/pose is corrected by it for slip in the hand.
    """

    gather = 0.03
    skimming = True  # of touch, only the newest counts

    def __init__(self) -> None:
        super().__init__("kinematic_tracker")
        self.config = declare_config(self, TrackerNodeConfig)
        self.kinematics = HandKinematics(declare_robot(self))
        tracker = declare_config(self, KinematicTrackerConfig)
        self.tracker = KinematicTracker(self.kinematics, tracker)
        self.fusion = PoseFusion(declare_config(self, PoseFusionConfig, "fusion."))
        self._reader = JointReader(
            self.kinematics.joint_names, followers=self.kinematics.robot.followers
        )
        self._joints = JointHistory()
        self._gate, self._vision_gate = StampGate(JOINT_STATES), StampGate(VISION_POSE)
        self._seen: deque[Array] = deque(maxlen=self.config.start_poses)
        self._vision_covariance: Array | None = None
        self._touched: dict[str, float] = {}
        self._touching: set[str] = set()
        self._points: dict[str, Array] = {}
        self._held = True
        self._refuting = 0
        self._frame = ObjectFrame(self)
        self._kinematic = self.stream(PoseWithCovarianceStamped, HAND_POSE)
        self._fused = self.stream(PoseWithCovarianceStamped, OBJECT_POSE)
        for finger in (
            self.kinematics.fingers
        ):  # taken first: after a pause, touch must not seem to have ended
            topic = contact_topic(finger, "force")
            self.listen(WrenchStamped, topic, self._force_taker(finger), skim=True, need=Need.ONCE)
        self.listen(JointState, JOINT_STATES, self._on_joints, need=Need.ALWAYS)
        for finger in self.kinematics.fingers:  # taken after the joints, with which they are turned
            topic = contact_topic(finger, "pose")
            self.listen(PoseStamped, topic, self._point_taker(finger), skim=True, need=Need.ONCE)
        self.listen(PoseWithCovarianceStamped, VISION_POSE, self._on_vision, need=Need.ONCE)
        self.listen(Float64, VISION_SCORE, self._on_score)
        self.listen(Bool, OBJECT_HELD, self._on_held, LATCHED)

    def _force_taker(self, finger: str) -> Callable[[Stamped], None]:
        topic = contact_topic(finger, "force")

        def take(message: Stamped) -> None:
            if wrench_to_core(message, topic, WORLD)[3:].any():
                self._touched[finger] = to_seconds(message.stamp)
                self._touching.add(finger)
            else:
                self._touching.discard(finger)

        return take

    def _point_taker(self, finger: str) -> Callable[[Stamped], None]:
        topic = contact_topic(finger, "pose")

        def take(message: Stamped) -> None:
            positions = self._joints.at(to_seconds(message.stamp))
            if positions is not None:
                point = pose_to_core(message, topic, WORLD)[:3, 3]
                self._points[finger] = self.kinematics.in_sensor_frame(finger, positions, point)

        return take

    def _on_held(self, message: Bool) -> None:
        if message.data and not self._held:
            self.tracker.reset()
        self._held = message.data

    def _on_score(self, message: Float64) -> None:
        """Doubt the pose where images show the object not to be there."""
        self._refuting = self._refuting + 1 if message.data < self.config.refuting_score else 0
        if self._refuting >= self.config.refutations and self.config.follow_vision:
            self.fusion.refute()
            self.faults.add("pose_refuted")

    def _on_vision(self, message: Stamped) -> None:
        pose, self._vision_covariance = uncertain_pose_to_core(message, VISION_POSE, WORLD)
        self._vision_gate.check(message.stamp)
        if not self._grasped(self._joints.newest):
            self._seen.clear()
            return
        positions = self._joints.at(to_seconds(message.stamp))
        if positions is None:
            return
        anchor = self.kinematics.sensor_pose(self.tracker.anchor, positions)
        self._seen.append(np.linalg.inv(anchor) @ pose)
        if self.tracker.initialised and self.config.follow_vision:
            covariance = self.tracker.vision_covariance()
            if self._vision_covariance is not None:
                covariance = self._vision_covariance
            if not self.fusion.correct(pose, covariance, to_seconds(message.stamp)):
                self.faults.add("vision_rejected")

    def _on_joints(self, message: Joints) -> None:
        positions = self._reader.positions(message)
        time = to_seconds(message.stamp)
        if self._gate.check(message.stamp):
            self.faults.add("clock_restarted")
            self._forget()
        self._joints.add(time, positions)
        if not self._grasped(time):
            self.tracker.reset()
            return
        if not self.tracker.initialised and len(self._seen) == self.config.start_poses:
            self._start(positions, time)
        if self.tracker.initialised:
            self._follow(message, positions, time)

    def _start(self, positions: Array, time: float) -> None:
        mean, spread = average_poses(np.stack(self._seen))
        anchor = self.kinematics.sensor_pose(self.tracker.anchor, positions)
        turn = twice(anchor[:3, :3])
        covariance = self._vision_covariance
        if covariance is None:
            covariance = turn @ spread @ turn.T
        self.tracker.initialise(anchor @ mean, positions, covariance, time)
        self.fusion.reset()

    def _follow(self, message: Joints, positions: Array, time: float) -> None:
        pose, covariance = self.tracker.update(positions, time, self._contacts(time))
        stamp = message.stamp
        self._kinematic.publish(uncertain_pose_to_message(pose, covariance, stamp, WORLD))
        fused, fused_covariance = self.fusion.predict(pose, covariance, time)
        if self._held and self.config.publish_fused:
            self._fused.publish(uncertain_pose_to_message(fused, fused_covariance, stamp, WORLD))
            self._frame.send(fused, stamp, WORLD)

    def _contacts(self, time: float) -> dict[str, Array]:
        """Return the points (3,) of the skin that touch now; the sensor's origin if not told."""
        touching = sorted(self._recent(time) & self._touching)
        return {finger: self._points.get(finger, _ORIGIN) for finger in touching}

    def _grasped(self, time: float) -> bool:
        """Whether the anchor and another finger have touched within the release time."""
        recent = self._recent(time)
        return self.tracker.anchor in recent and len(recent) > 1

    def _recent(self, time: float) -> set[str]:
        """Return the fingers that have touched within the release time."""
        return {f for f, last in self._touched.items() if time - last < self.config.release_time}

    def _forget(self) -> None:
        self.tracker.reset()
        self._joints.clear()
        self._seen.clear()
        self._touched.clear()
        self._touching.clear()
        self._points.clear()


def main() -> int:
    """Run the node."""
    return run_node(KinematicTrackerNode)
