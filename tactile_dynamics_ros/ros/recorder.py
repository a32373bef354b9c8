"""Records all topics as they are on the wire into a rosbag2 recording (MCAP)."""

from __future__ import annotations

import importlib
import time
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rosbags.interfaces import Connection
from rosbags.rosbag2 import WriterError

from tactile_dynamics_ros.core.errors import refuse_existing
from tactile_dynamics_ros.recording.bag_writer import LiveWriter
from tactile_dynamics_ros.ros.names import CLOCK, DEPTH_IMAGE, DIAGNOSTICS, EMERGENCY_STOP, TF
from tactile_dynamics_ros.ros.shell import Shell

IGNORED = ("/rosout", "/parameter_events")
TRANSITIONS = "/transition_event"
"""End of the topic on which a managed node says its changes of state; no measurement."""
IMAGES = (f"/{DEPTH_IMAGE}",)
"""Ends of the names of topics that are recorded only if they are named: they are large."""
GLOBAL = (CLOCK, DIAGNOSTICS, EMERGENCY_STOP, TF)


class Recorder(Shell):
    """Subscribes to topics as they appear and writes their serialised messages.

    Messages are not decoded, so that recording costs little, and the file is independent of the
    life of every other process.

    Args:
        path: new directory of the recording, or a new file that ends in .mcap. A file is written in
            the directory `<path>.part`, which stays readable if the recorder is killed.
        topics: to record; all but large images and hidden ones (a part of the name begins with _,
            as those of actions do) if empty.
        namespace: with its leading slash; if given, only topics inside it and global ones.
    """

    gather = 0.1

    def __init__(self, path: Path, topics: Sequence[str] = (), namespace: str = "") -> None:
        super().__init__("recorder")
        refuse_existing(path)
        self.counts: Counter[str] = Counter()
        self.refused: dict[str, str] = {}
        self._topics, self._inside = tuple(topics), namespace
        self._writer = LiveWriter(path)
        self.folder = self._writer.folder
        self._connections: dict[str, Connection] = {}
        self._discover()
        self.every(0.2, self._discover)

    def close(self) -> None:
        """Finish the recording."""
        self._writer.close()

    def _discover(self) -> None:
        for topic, kinds in self.get_topic_names_and_types():
            known = topic in self._connections or topic in self.refused
            if not known and self._is_wanted(topic) and self.count_publishers(topic):
                self._add(topic, kinds[0])

    def _is_wanted(self, topic: str) -> bool:
        if self._topics:
            return topic in self._topics
        if topic in IGNORED or topic.endswith((TRANSITIONS, *IMAGES)) or "/_" in topic:
            return False
        return topic in GLOBAL or topic.startswith(f"{self._inside}/")

    def _add(self, topic: str, kind: str) -> None:
        try:
            message_class = message_type(kind)
            self._connections[topic] = self._writer.add_connection(topic, kind)
        except (ImportError, AttributeError, KeyError, WriterError) as error:
            self.refused[topic] = f"{kind}: {error}"
            self.get_logger().warning(f"{topic} is not recorded: type {self.refused[topic]}")
            return
        connection = self._connections[topic]

        def write(data: bytes) -> None:
            self.counts[topic] += 1
            self._writer.write(connection, time.time_ns(), data)

        self.listen(message_class, topic, write, self._profile(topic), raw=True)

    def _profile(self, topic: str) -> QoSProfile:
        """Return the strongest profile that every publisher of the topic can serve."""
        offered = [info.qos_profile for info in self.get_publishers_info_by_topic(topic)]
        latched = all(q.durability == DurabilityPolicy.TRANSIENT_LOCAL for q in offered)
        reliable = all(q.reliability == ReliabilityPolicy.RELIABLE for q in offered)
        return QoSProfile(
            depth=500,
            reliability=ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT,
            durability=(DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE),
        )


def message_type(kind: str) -> Any:
    """Return the message class of a type like `geometry_msgs/msg/PoseStamped`."""
    package, _, name = kind.split("/")
    return getattr(importlib.import_module(f"{package}.msg"), name)
