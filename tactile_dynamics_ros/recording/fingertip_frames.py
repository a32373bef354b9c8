"""Raw counts of fingertips from recordings."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rosbags.typesys import Stores, get_typestore

from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.tactile.electrodes import CHANNELS
from tactile_dynamics_ros.recording.bag_files import read_messages
from tactile_dynamics_ros.recording.cdr import BIOTAC_ENCODING, BIOTAC_RAW
from tactile_dynamics_ros.recording.namespaces import absolute_namespace

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
