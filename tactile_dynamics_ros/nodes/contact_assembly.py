"""Force, standard deviation and pose of one contact, which come on topics of their own."""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import islice

import numpy as np
from geometry_msgs.msg import PoseStamped, Vector3Stamped, WrenchStamped
from numpy.typing import NDArray

from tactile_dynamics_ros.core.streams import places_at
from tactile_dynamics_ros.nodes.conversions import (
    StampGate,
    pose_to_core,
    std_to_core,
    to_seconds,
    wrench_to_core,
)
from tactile_dynamics_ros.nodes.hand_error import HandError
from tactile_dynamics_ros.nodes.shell import Shell
from tactile_dynamics_ros.nodes.wire import Stamped

Array = NDArray[np.float64]

WORLD = "world"
KEPT = 50
TOLERANCE = 0.03


@dataclass(frozen=True)
class AssembledContact:
    """One contact at one instant, world axes.

    Attributes:
        time: s. name: of the finger. point: (3,) m. rotation: (3, 3), z is the normal.
        force: (3,) N on the object. torque: (3,) N m about the point.
        std: (3,) N, or None if it is not stated.
    """

    time: float
    name: str
    point: Array
    rotation: Array
    force: Array
    torque: Array
    std: Array | None

    def moved(self, motion: Array) -> AssembledContact:
        """Return the contact after a motion (4, 4) of the world."""
        turn = motion[:3, :3]
        return replace(
            self,
            point=turn @ self.point + motion[:3, 3],
            rotation=turn @ self.rotation,
            force=turn @ self.force,
            torque=turn @ self.torque,
        )


class ContactAssembly:
    """Puts together what belongs to one stamp and hands it on.

    Forces wait until a pose of the same stamp or a later one has come; a force without a pose
    nearer than 30 ms is counted and dropped.

    Args:
        node: that subscribes.
        name: of the contact.
        deliver: called with each assembled contact in the order of time.
        hand: whose error in the world is corrected, or None to take contacts as they are told.
    """

    def __init__(
        self,
        node: Shell,
        name: str,
        deliver: Callable[[AssembledContact], None],
        hand: HandError | None = None,
    ) -> None:
        self._node, self._name, self._deliver, self._hand = node, name, deliver, hand
        self._topic = f"contact/{name}"
        self._gate = StampGate(f"{self._topic}/force")
        self._forces: deque[tuple[float, Array]] = deque(maxlen=KEPT)
        self._poses: deque[tuple[float, Array]] = deque(maxlen=KEPT)
        self._stds: deque[tuple[float, Array]] = deque(maxlen=KEPT)
        node.listen(PoseStamped, f"{self._topic}/pose", self._on_pose, skim=True)
        node.listen(Vector3Stamped, f"{self._topic}/force_std", self._on_std, skim=True)
        node.listen(WrenchStamped, f"{self._topic}/force", self._on_force, skim=True)

    def _on_pose(self, message: Stamped) -> None:
        matrix = pose_to_core(message, f"{self._topic}/pose", WORLD)
        self._poses.append((to_seconds(message.stamp), matrix))
        self._release()

    def _on_std(self, message: Stamped) -> None:
        std = std_to_core(message, f"{self._topic}/force_std")
        self._stds.append((to_seconds(message.stamp), std))

    def _on_force(self, message: Stamped) -> None:
        wrench = wrench_to_core(message, f"{self._topic}/force", WORLD)
        if self._gate.check(message.stamp):
            for queue in (self._forces, self._poses, self._stds):
                queue.clear()
        self._forces.append((to_seconds(message.stamp), wrench))
        self._release()

    def _release(self) -> None:
        while self._forces and self._poses and self._forces[0][0] <= self._poses[-1][0]:
            time, wrench = self._forces.popleft()
            place = self._place(time)
            if place is None:
                self._node.faults.add(f"force_without_pose_{self._name}")
                continue
            self._deliver(self._assemble(time, wrench, *place))

    def _place(self, time: float) -> tuple[Array, Array] | None:
        """The pose of that stamp, or `places_at` of those around it; None if both are too far."""
        after = bisect_left(self._poses, time, key=_stamp_of)
        if after < len(self._poses) and self._poses[after][0] == time:
            matrix = self._poses[after][1]
            return matrix[:3, 3], matrix[:3, :3]
        around = list(islice(self._poses, max(after - 1, 0), after + 1))
        stamps = np.array([stamp for stamp, _ in around])
        if np.min(np.abs(stamps - time)) > TOLERANCE:
            return None
        poses = np.array([matrix for _, matrix in around])
        points, rotations = places_at(stamps, poses[:, :3, 3], poses[:, :3, :3], np.array([time]))
        return points[0], rotations[0]

    def _assemble(
        self, time: float, wrench: Array, point: Array, rotation: Array
    ) -> AssembledContact:
        after = bisect_right(self._stds, time + 1e-9, key=_stamp_of)
        std = self._stds[max(after - 1, 0)][1] if self._stds else None
        contact = AssembledContact(time, self._name, point, rotation, wrench[3:], wrench[:3], std)
        return contact if self._hand is None else contact.moved(self._hand.at(time))


def _stamp_of(entry: tuple[float, Array]) -> float:
    return entry[0]
