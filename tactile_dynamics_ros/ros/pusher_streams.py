"""What an arm that pushes and a tracker of markers on its objects tell."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from geometry_msgs.msg import (
    Point32,
    PolygonStamped,
    PoseStamped,
    PoseWithCovarianceStamped,
    Vector3Stamped,
    WrenchStamped,
)
from rclpy.publisher import Publisher
from std_msgs.msg import Float64

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.configuration import check_ranges, parameter
from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.ros.conversions import (
    header,
    pose_to_message,
    std_to_message,
    uncertain_pose_to_message,
    wrench_to_message,
)
from tactile_dynamics_ros.ros.names import (
    GRIPPER_WIDTH,
    PUSHER_POSE,
    contact_topic,
    fingertip_topic,
    link_topic,
)
from tactile_dynamics_ros.ros.shell import Shell
from tactile_dynamics_ros.ros.wire import AnyStamp

WORLD, PUSHER_FRAME = "world", "pusher"


PUSHER, PADS = "pusher", ("pad_left", "pad_right")


@dataclass(frozen=True)
class SensedConfig:
    """Which contacts of an arm that pushes have sensors; the tip always has one."""

    sensed_pads: tuple[str, ...] = parameter(
        PADS, "pads with a sensor, of pad_left and pad_right; [''] if none has"
    )

    def __post_init__(self) -> None:
        check_ranges(self)
        unknown = [pad for pad in self.sensed_pads if pad and pad not in PADS]
        if unknown:
            raise BadInputError(f"sensed_pads '{unknown[0]}': expected {' or '.join(PADS)}")

    @property
    def contacts(self) -> tuple[str, ...]:
        """Names of the contacts with a sensor."""
        return (PUSHER, *(pad for pad in self.sensed_pads if pad))


class PusherStreams:
    """Publishes the tip's pose and the jaws' width.

    Args:
        node: that publishes.
    """

    def __init__(self, node: Shell) -> None:
        self._pose = node.stream(PoseStamped, PUSHER_POSE)
        self._width = node.stream(Float64, GRIPPER_WIDTH)

    def publish(self, pose: Array, width: float, time: float) -> None:
        """Tell where tip (4, 4) and jaws (m) are."""
        self._pose.publish(pose_to_message(pose, time, WORLD))
        self._width.publish(Float64(data=width))


class TouchReading(Protocol):
    """What the sensor of one contact reports; `raw` is the force before contact is judged."""

    @property
    def name(self) -> str:
        """Of the contact."""

    @property
    def time(self) -> float:
        """Of the force, s."""

    @property
    def force(self) -> Array:
        """On the object, (3,) N, world; zero where nothing is touched."""

    @property
    def raw(self) -> Array:
        """As it was measured, (3,) N, world."""

    @property
    def pose(self) -> Array:
        """Of the contact, (4, 4)."""

    @property
    def touching(self) -> bool:
        """Whether anything is touched."""


class ContactStreams:
    """Publishes contacts that a robot itself places in the world.

    Args:
        node: that publishes.
        names: of all contacts.
    """

    def __init__(self, node: Shell, names: Sequence[str]) -> None:
        kinds = {"force": WrenchStamped, "force_std": Vector3Stamped, "pose": PoseStamped}
        self._publishers = {
            (name, kind): node.stream(message, contact_topic(name, kind))
            for name in names
            for kind, message in kinds.items()
        }

    def messages(
        self, name: str, force: Array, std: Array, pose: Array, time: float | AnyStamp
    ) -> list[tuple[Publisher, bytes]]:
        """Return what is reported of a contact, with the publishers that tell it.

        Args:
            name: of the contact.
            force: (3,) N on the object, world.
            std: (3,) N, of the force.
            pose: (4, 4), the contact point, z the normal into the object.
            time: s, or a stamp.
        """
        wrench = np.concatenate([np.zeros(3), force])
        return [
            (self._publishers[name, "pose"], pose_to_message(pose, time, WORLD)),
            (self._publishers[name, "force_std"], std_to_message(std, time, WORLD)),
            (self._publishers[name, "force"], wrench_to_message(wrench, time, WORLD)),
        ]

    def report(
        self, reading: TouchReading, std: Array, gripper: Array
    ) -> list[tuple[Publisher, bytes]]:
        """Return what is reported of a contact; where nothing is touched its force, zero, alone."""
        told = self.messages(reading.name, reading.force, std, reading.pose, reading.time)
        return told if reading.touching else told[-1:]


class SensorStreams:
    """Publishes forces as three-axis sensors tell them, for `contact_state` to place.

    Args:
        node: that publishes.
        names: of all contacts.
    """

    def __init__(self, node: Shell, names: Sequence[str]) -> None:
        kinds = {"force": WrenchStamped, "force_std": Vector3Stamped}
        self._publishers = {
            (name, kind): node.stream(message, fingertip_topic(name, kind, "pad"))
            for name in names
            for kind, message in kinds.items()
        }

    def report(
        self, reading: TouchReading, std: Array, gripper: Array
    ) -> list[tuple[Publisher, bytes]]:
        """Return what is reported of a sensor, with the publishers that tell it.

        Args:
            reading: what it reports.
            std: (3,) N, of the force.
            gripper: (4, 4) of the tip, in whose axes the sensor measures.
        """
        wrench = np.concatenate([np.zeros(3), reading.raw @ gripper[:3, :3]])
        std_message = std_to_message(std, reading.time, PUSHER_FRAME)
        force_message = wrench_to_message(wrench, reading.time, PUSHER_FRAME)
        return [
            (self._publishers[reading.name, "force_std"], std_message),
            (self._publishers[reading.name, "force"], force_message),
        ]


class LinkStreams:
    """Publishes poses of the parts of an object that carry markers, and once their outlines.

    Args:
        node: that publishes.
        outlines: (V, 2) m of each part, in its frame.
    """

    def __init__(self, node: Shell, outlines: Sequence[Array]) -> None:
        links = [f"link_{k}" for k in range(1, len(outlines) + 1)]
        self._poses = [
            node.stream(PoseWithCovarianceStamped, link_topic(link, "pose")) for link in links
        ]
        for link, corners in zip(links, outlines, strict=True):
            message = outline_message(corners, "object" if link == "link_1" else link)
            node.latched(PolygonStamped, link_topic(link, "footprint")).publish(message)

    def messages(
        self, poses: Sequence[Array | None], covariance: Array, time: float
    ) -> list[tuple[Publisher, bytes]]:
        """Return what is reported of the parts, with the publishers that tell it.

        Args:
            poses: (4, 4) of each part; None where it is lost.
            covariance: (6, 6) [rotation, position] of each.
            time: s.
        """
        return [
            (publisher, uncertain_pose_to_message(pose, covariance, time, WORLD))
            for publisher, pose in zip(self._poses, poses, strict=False)
            if pose is not None
        ]


def outline_message(corners: Array, frame: str, time: float = 0.0) -> PolygonStamped:
    """Return the outline (V, 2) of a part in its own frame, m."""
    message = PolygonStamped(header=header(time, frame))
    message.polygon.points = [Point32(x=float(x), y=float(y), z=0.0) for x, y in corners]
    return message
