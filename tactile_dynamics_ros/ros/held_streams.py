"""What nodes hear of a held object: its poses and contacts, checked and in the order of time."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from time import monotonic

import numpy as np
from geometry_msgs.msg import PoseWithCovarianceStamped

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.streams.pose_noise import ASSUMED_POSITION_STD
from tactile_dynamics_ros.core.streams.stamps import Reordered
from tactile_dynamics_ros.core.streams.streams import ContactSample
from tactile_dynamics_ros.ros.conversions import MessageError
from tactile_dynamics_ros.ros.friction_messages import ContactAssembly
from tactile_dynamics_ros.ros.inputs import Need
from tactile_dynamics_ros.ros.names import OBJECT_POSE
from tactile_dynamics_ros.ros.object_state import Holding, ObjectState
from tactile_dynamics_ros.ros.robot import HandError
from tactile_dynamics_ros.ros.shell import Shell
from tactile_dynamics_ros.ros.stated_noise import read_tracked_pose
from tactile_dynamics_ros.ros.stream_clock import StreamClock
from tactile_dynamics_ros.ros.wire import Stamped

HOLD = 0.05
"""How long a reading waits for those that were taken before it and come later, s: five frames at
100 Hz. The estimators look 0.12 s ahead anyway."""

_UNSTATED = f"none stated; as poses scatter, {1e3 * ASSUMED_POSITION_STD:g} mm until that is known"
"""What is said of poses without a covariance. Words for people."""


class HeldStreams:
    """Subscriptions to the pose of the object and to its contacts.

    Args:
        node: that subscribes.
        contacts: their names.
        on_pose: called with time (s), pose (4, 4) and covariance (6, 6) or None, in order of time.
        on_contact: called with each contact, in order of time.
        on_restart: called when the clock of the streams was set back.
        on_step: called with by how much, s, when it stepped back by less than a second.
    """

    def __init__(
        self,
        node: Shell,
        contacts: Sequence[str],
        on_pose: Callable[[float, Array, Array | None], None],
        on_contact: Callable[[ContactSample], None],
        on_restart: Callable[[], None],
        on_step: Callable[[float], None],
    ) -> None:
        self._node, self._on_pose, self._on_contact = node, on_pose, on_contact
        self.clock = StreamClock(node)
        self._holding = Holding(contacts, monotonic())
        self._poses = Reordered[tuple[Array, Array | None]]()
        self._hand = HandError(node)
        self.clock.on_move += [self._poses.clear, self._hand.clear]
        self.clock.on_restart += [self._begin_anew, on_restart]
        self.clock.on_step.append(on_step)
        node.listen(
            PoseWithCovarianceStamped, OBJECT_POSE, self._on_message, sole=True, need=Need.ALWAYS
        )
        self._contacts = [
            ContactAssembly(node, name, self._take_contact, self.clock, self._hand, held=True)
            for name in contacts
        ]

    @property
    def state(self) -> ObjectState:
        """Whether the object is held now, and since when."""
        state = self._holding.state(monotonic())
        return replace(state, troubles=(*self._node.inputs.troubles, *state.troubles))

    @property
    def conflict(self) -> str:
        """Why nobody can know where the object is; empty where there is no such reason."""
        if self._node.inputs.has_rivals(OBJECT_POSE):
            return f"two publishers on {OBJECT_POSE}, nobody can know which is right: stop one"
        return ""

    def release(self) -> None:
        """Hand on what need not wait any longer; to be called after messages were taken."""
        if self.conflict:
            self._poses.clear()
        until = np.inf if self.clock.is_idle else self.clock.newest - HOLD
        for time, (pose, covariance) in self._poses.take(until):
            self._hand.add_fused(time, pose)
            self._holding.hear_pose(monotonic())
            self._on_pose(time, pose, covariance)
        for contact in self._contacts:
            contact.release(until)
        late = self._poses.late + sum(contact.late for contact in self._contacts)
        self._node.faults.count("out_of_order", late)

    def _take_contact(self, contact: ContactSample) -> None:
        self._holding.hear_contact(contact.name, contact.touches, monotonic())
        self._on_contact(contact)

    def _begin_anew(self) -> None:
        self._holding.clear(monotonic())

    def _on_message(self, message: Stamped) -> None:
        pose, covariance = read_tracked_pose(message, OBJECT_POSE, "world", self._node.faults)
        self._node.faults.show("pose_noise", _UNSTATED if covariance is None else "stated")
        time = self.clock.admit(message.stamp, OBJECT_POSE)
        if not self._poses.add(time, (pose, covariance)):
            raise MessageError(
                "stamp_repeated", f"{OBJECT_POSE}: stamp {time:.6f} s repeats or comes too late"
            )
