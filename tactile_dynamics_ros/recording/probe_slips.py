"""Slips of a friction probe from and to rosbag2 recordings, topic /friction_probe/slip."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

from rosbags.rosbag2 import Reader, StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from tactile_dynamics_ros.core.errors import BadInputError, refuse_existing
from tactile_dynamics_ros.core.friction.estimate import SlipEvent
from tactile_dynamics_ros.core.friction.slip_table import event_from_values
from tactile_dynamics_ros.recording.bag_files import DAMAGE

SLIP = "/friction_probe/slip"
KIND = "diagnostic_msgs/msg/DiagnosticStatus"


def holds_slips(path: Path) -> bool:
    """Whether a path is a readable recording with slips of a friction probe."""
    try:
        with Reader(path) as reader:
            return any(c.topic == SLIP and c.msgcount > 0 for c in reader.connections)
    except DAMAGE:
        return False


def read_slips(path: Path) -> list[SlipEvent]:
    """Return the slips of a recording.

    Raises:
        BadInputError: it cannot be read, or a slip is malformed.
    """
    store = get_typestore(Stores.ROS2_JAZZY)
    try:
        with Reader(path) as reader:
            own = [c for c in reader.connections if c.topic == SLIP]
            rows = [store.deserialize_cdr(raw, c.msgtype) for c, _, raw in reader.messages(own)]
    except DAMAGE as error:
        raise BadInputError(f"{path}: cannot be read as a probe recording: {error}") from error
    return [event_from_values({pair.key: pair.value for pair in row.values}) for row in rows]


def write_slips(events: Sequence[SlipEvent], path: Path) -> Path:
    """Write slips as a new rosbag2 directory, as recording the node's topic would.

    Raises:
        BadInputError: the path exists already.
    """
    refuse_existing(path)
    store = get_typestore(Stores.ROS2_JAZZY)
    pair = store.types["diagnostic_msgs/msg/KeyValue"]
    status = store.types[KIND]
    with Writer(path, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        connection = writer.add_connection(SLIP, KIND, typestore=store)
        for event in events:
            pairs = [pair(key=key, value=str(value)) for key, value in asdict(event).items()]
            message = status(level=0, name="slip", message="", hardware_id="", values=pairs)
            stamp = round(1e9 * event.time)
            writer.write(connection, stamp, store.serialize_cdr(message, KIND))
    return path
