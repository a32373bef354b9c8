"""Node: joint states and fingertip forces to contact point, normal and force in the world."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from geometry_msgs.msg import PoseStamped, Vector3Stamped, WrenchStamped
from numpy.typing import NDArray
from sensor_msgs.msg import JointState

from tactile_dynamics_ros.core.configuration import parameter
from tactile_dynamics_ros.core.contact.contact_state import (
    Contact,
    ContactState,
    ContactStateConfig,
)
from tactile_dynamics_ros.core.errors import NotIdentifiableError
from tactile_dynamics_ros.core.robot.hand_kinematics import HandKinematics
from tactile_dynamics_ros.ros.conversions import (
    JointReader,
    StampGate,
    pose_to_message,
    std_to_core,
    std_to_message,
    to_seconds,
    wrench_to_core,
    wrench_to_message,
)
from tactile_dynamics_ros.ros.inputs import Need
from tactile_dynamics_ros.ros.names import JOINT_STATES, contact_topic, fingertip_topic
from tactile_dynamics_ros.ros.parameters import declare_config
from tactile_dynamics_ros.ros.pushed_contacts import PushedContacts
from tactile_dynamics_ros.ros.robot import JointHistory, declare_robot
from tactile_dynamics_ros.ros.shell import Shell, run_node
from tactile_dynamics_ros.ros.wire import Joints, Stamp, Stamped
from tactile_dynamics_ros.ros.wrist_contact import WristConfig, WristContact

WORLD = "world"
WAITING = 200


@dataclass(frozen=True)
class PlaceConfig:
    """What the forces are of."""

    pushing: bool = parameter(
        False, "of a tip and pads that push on a table, placed on the object's outline"
    )


class Touch(NamedTuple):
    """A force that waits for joint positions: (6,) [torque, force] and (3,), sensor frame."""

    finger: str
    stamp: Stamp
    time: float
    wrench: NDArray[np.float64]
    std: NDArray[np.float64]


class ContactStateNode(Shell):
    """Places each force with the joint positions at the time of the force."""

    gather = 0.01

    def __init__(self) -> None:
        super().__init__("contact_state")
        wrist = declare_config(self, WristConfig, "wrist.")
        self._placed: PushedContacts | WristContact | None = None
        if declare_config(self, PlaceConfig).pushing:
            self._placed = PushedContacts(self)
        elif wrist.wrench:
            self._placed = WristContact(self, wrist)
        else:
            self._begin_hand()

    def _begin_hand(self) -> None:
        """Listen to a hand's fingertips."""
        config = declare_config(self, ContactStateConfig)
        self.robot = robot = declare_robot(self)
        self.contact_state = ContactState(HandKinematics(robot), config)
        self._reader = JointReader(robot.joint_names, followers=robot.followers)
        self._joints = JointHistory()
        self._joint_gate = StampGate(JOINT_STATES)
        self._gates = {finger: StampGate(self._topic(finger, "force")) for finger in robot.fingers}
        self._std: dict[str, NDArray[np.float64]] = {}
        self._waiting: deque[Touch] = deque(maxlen=WAITING)
        self._force, self._force_std, self._pose = {}, {}, {}
        for finger in robot.fingers:
            self._force[finger] = self.stream(WrenchStamped, contact_topic(finger, "force"))
            self._force_std[finger] = self.stream(
                Vector3Stamped, contact_topic(finger, "force_std")
            )
            self._pose[finger] = self.stream(PoseStamped, contact_topic(finger, "pose"))
        self.listen(JointState, JOINT_STATES, self._on_joints, need=Need.ALWAYS)
        for finger in robot.fingers:
            std, force = (self._topic(finger, kind) for kind in ("force_std", "force"))
            take = self._force_taker(finger)
            self.listen(Vector3Stamped, std, self._std_taker(finger), need=Need.ONCE)
            self.listen(WrenchStamped, force, take, sole=True, need=Need.ALWAYS)

    def _topic(self, finger: str, kind: str) -> str:
        return fingertip_topic(finger, kind, self.robot.tips.kind)

    def _on_joints(self, message: Joints) -> None:
        positions = self._reader.positions(message)
        if self._joint_gate.check(message.stamp):
            self.faults.add("clock_restarted")
            self._joints.clear()
            self._waiting.clear()
        self._joints.add(to_seconds(message.stamp), positions)

    def _std_taker(self, finger: str) -> Callable[[Stamped], None]:
        topic = self._topic(finger, "force_std")

        def take(message: Stamped) -> None:
            self._std[finger] = std_to_core(message, topic)

        return take

    def _force_taker(self, finger: str) -> Callable[[Stamped], None]:
        topic, frame = self._topic(finger, "force"), self.robot.sensor_frame(finger)

        def take(message: Stamped) -> None:
            wrench = wrench_to_core(message, topic, frame)
            self._gates[finger].check(message.stamp)
            if finger not in self._std:
                raise NotIdentifiableError(f"{topic}_std has not come yet")
            if len(self._waiting) == WAITING:
                self.faults.add("joint_states_missing", "forces come but no joint states")
            time = to_seconds(message.stamp)
            self._waiting.append(Touch(finger, message.stamp, time, wrench, self._std[finger]))

        return take

    def process(self) -> None:
        """Place the forces for whose time joint positions, or poses, are known."""
        if self._placed is not None:
            self._placed.process()
            return
        ready: list[tuple[Touch, NDArray[np.float64]]] = []
        for _ in range(len(self._waiting)):
            touch = self._waiting.popleft()
            positions = self._joints.at(touch.time)
            if positions is not None:
                ready.append((touch, positions))
            elif touch.time > self._joints.newest:
                self._waiting.append(touch)
            else:
                self.faults.add("force_older_than_joint_states")
        if ready:
            self._place(*zip(*ready, strict=True))

    def _place(
        self, touches: tuple[Touch, ...], positions: tuple[NDArray[np.float64], ...]
    ) -> None:
        wrench = np.stack([touch.wrench for touch in touches])
        std = np.stack([touch.std for touch in touches])
        fingers = [touch.finger for touch in touches]
        contacts = self.contact_state.update_all(
            fingers, np.stack(positions), wrench[:, 3:], std, wrench[:, :3]
        )
        for contact, touch in zip(contacts, touches, strict=True):
            self._publish(contact, touch.stamp)

    def _publish(self, contact: Contact, stamp: Stamp) -> None:
        matrix = np.eye(4)
        matrix[:3, :3], matrix[:3, 3] = contact.rotation, contact.point
        world_wrench = np.zeros(6)
        if contact.touching:
            world_wrench = np.concatenate([contact.torque, contact.force])
        finger = contact.finger
        self._pose[finger].publish(pose_to_message(matrix, stamp, WORLD))
        self._force_std[finger].publish(std_to_message(contact.force_std, stamp, WORLD))
        self._force[finger].publish(wrench_to_message(world_wrench, stamp, WORLD))


def main() -> int:
    """Run the node."""
    return run_node(ContactStateNode)
