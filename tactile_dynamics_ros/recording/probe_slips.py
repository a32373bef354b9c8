"""Raw counts and probe slips of fingertips, from and to recordings."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rosbags.rosbag2 import Reader
from rosbags.typesys import Stores, get_typestore

from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.friction.estimate import SlipEvent
from tactile_dynamics_ros.core.friction.slip_log import event_from_values
from tactile_dynamics_ros.core.tactile.electrodes import CHANNELS
from tactile_dynamics_ros.recording.bag_files import DAMAGE, named_connections, read_messages
from tactile_dynamics_ros.recording.bag_limits import check_readable
from tactile_dynamics_ros.recording.bag_writer import write_tables
from tactile_dynamics_ros.recording.cdr import BIOTAC_ENCODING, BIOTAC_RAW
from tactile_dynamics_ros.recording.namespaces import (
    ROOT,
    absolute_namespace,
    choose_namespace,
    split_topic,
)

_TYPE = "sensor_msgs/msg/Image"


def read_fingertip_frames(path: Path, namespace: str = "") -> NDArray[np.uint16]:
    """Return all frames (N, F, 44) on /biotac/raw, in the order of the robot's fingers.

    Args:
        path: path of the recording.
        namespace: namespace of the hand.

    Raises:
        BadInputError: there is no such recording or topic, or an image has another type or shape.
    """
    store = get_typestore(Stores.ROS2_JAZZY)
    frames, topic = [], absolute_namespace(namespace) + BIOTAC_RAW
    for _, kind, _, data in read_messages(path, topic):
        if kind != _TYPE:
            raise BadInputError(f"{path}: {topic} is {kind}, expected {_TYPE}")
        frames.append(_counts(store.deserialize_cdr(data, kind)))
    if not frames:
        raise BadInputError(f"{path}: no images on {topic}; record it")
    return np.array(frames)


def _counts(image: Any) -> NDArray[np.uint16]:
    """Return the counts (F, 44) of a sensor_msgs/Image."""
    found = image.encoding, image.width
    if found != (BIOTAC_ENCODING, CHANNELS) or image.step != 2 * CHANNELS:
        raise BadInputError(
            f"{BIOTAC_RAW}: image with encoding and width {found}, expected "
            f"{(BIOTAC_ENCODING, CHANNELS)} without padding"
        )
    counts = np.asarray(image.data).view(">u2" if image.is_bigendian else "<u2")
    return counts.reshape(image.height, CHANNELS).astype(np.uint16)


SLIP = "/friction_probe/slip"
_KNOWN = re.compile(SLIP)
KIND = "diagnostic_msgs/msg/DiagnosticStatus"


def holds_slips(path: Path, namespace: str | None = None) -> bool:
    """Whether a path is a readable recording with slips of a friction probe.

    Args:
        path: path of the recording.
        namespace: namespace of the hand; None means any.
    """
    known = None if namespace is None else absolute_namespace(namespace)
    try:
        check_readable(path)
        with Reader(path) as reader:
            found = [split_topic(c.topic, _KNOWN) for c in named_connections(reader) if c.msgcount]
    except (BadInputError, *DAMAGE):
        return False
    return any(split is not None and known in (None, split[0]) for split in found)


def read_slips(path: Path, namespace: str | None = None) -> list[SlipEvent]:
    """Return the slips of a recording.

    Args:
        path: path of the recording.
        namespace: namespace of the hand; None means root, or the only one there is.

    Raises:
        BadInputError: it cannot be read, a slip is malformed, or several namespaces could be meant.
    """
    store = get_typestore(Stores.ROS2_JAZZY)
    try:
        check_readable(path)
        with Reader(path) as reader:
            splits = [split_topic(c.topic, _KNOWN) for c in named_connections(reader)]
            found = {split[0] for split in splits if split is not None}
            topic = choose_namespace(namespace, found, ROOT in found, str(path)) + SLIP
            own = [c for c in named_connections(reader) if c.topic == topic]
            rows = [store.deserialize_cdr(raw, c.msgtype) for c, _, raw in reader.messages(own)]
    except DAMAGE as error:
        raise BadInputError(f"{path}: cannot be read as a probe recording: {error}") from error
    return [event_from_values({pair.key: pair.value for pair in row.values}) for row in rows]


def write_slips(events: Sequence[SlipEvent], path: Path) -> Path:
    """Write slips as a new recording, as recording the node's topic would.

    Args:
        events: slips; their times are the stamps.
        path: a new directory, or a new file that ends in .mcap.

    Raises:
        BadInputError: the path exists already or cannot be written.
    """
    store = get_typestore(Stores.ROS2_JAZZY)
    pair = store.types["diagnostic_msgs/msg/KeyValue"]
    status = store.types[KIND]
    messages = []
    for event in events:
        pairs = [pair(key=key, value=str(value)) for key, value in asdict(event).items()]
        message = status(level=0, name="slip", message="", hardware_id="", values=pairs)
        messages.append(bytes(store.serialize_cdr(message, KIND)))
    stamps = np.array([round(1e9 * event.time) for event in events], dtype=np.int64)
    return write_tables([(SLIP, KIND, stamps, messages)], path)
