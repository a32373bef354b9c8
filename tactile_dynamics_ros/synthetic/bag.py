"""Write a synthetic recording as rosbag2 (MCAP)."""

from __future__ import annotations

from pathlib import Path

from tactile_dynamics_ros.core.streams.streams import Streams
from tactile_dynamics_ros.recording import bag_writer

EPOCH_NS = 1_700_000_000_000_000_000
"""Stamp of time zero in ns (November 2023): no stamp may be negative, and streams whose clocks
differ begin before their time zero."""


def write_bag(streams: Streams, path: Path) -> Path:
    """Write all streams to a new directory, or to a single file if the name ends in .mcap.

    Args:
        streams: what to write.
        path: where; must not exist.

    Raises:
        BadInputError: the path exists already or cannot be written.
    """
    return bag_writer.write_bag(streams, path, EPOCH_NS)
