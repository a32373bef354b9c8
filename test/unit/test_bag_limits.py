"""Recordings that would fill the memory or never end are refused before they are opened."""

import os
import sqlite3
import struct
import time

import pytest
from backports import zstd
from rosbags.rosbag2 import CompressionFormat, CompressionMode, Reader, StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.recording import Recording
from tactile_dynamics_ros.recording.bag_files import read_tables
from tactile_dynamics_ros.recording.bag_limits import (
    FREE,
    LARGEST_BLOCK,
    MAGIC,
    check_limits,
    salvage_messages,
)
from tactile_dynamics_ros.recording.importers.bag_tables import topic_types

DATA = b"\0\1\0\0" + bytes(8)


def record(opcode, body):
    return struct.pack("<BQ", opcode, len(body)) + body


def text(words):
    return struct.pack("<I", len(words)) + words.encode()


def chunk(content, kind="zstd", size=None):
    """A block of an MCAP file; `content` is expanded."""
    raw = zstd.compress(content, 3) if kind == "zstd" else content
    head = struct.pack("<QQQI", 0, 1, size or len(content), 0)
    return record(6, head + text(kind) + struct.pack("<Q", len(raw)) + raw)


def mcap(path, *blocks):
    end = record(15, struct.pack("<I", 0)) + record(2, struct.pack("<QQI", 0, 0, 0)) + MAGIC
    path.write_bytes(MAGIC + record(1, text("ros2") + text("x")) + b"".join(blocks) + end)
    return path


@pytest.mark.parametrize("claimed", [None, 100])
def test_a_block_that_expands_beyond_any_message_is_refused(tmp_path, claimed):
    """Whatever its header claims. 5 kB become 128 MB and more."""
    bomb = mcap(tmp_path / "bomb.mcap", chunk(bytes(LARGEST_BLOCK + 1), size=claimed))
    began = time.process_time()
    with pytest.raises(BadInputError, match="bomb.mcap: .*expands to more than"):
        read_tables(bomb, lambda _: True)
    assert time.process_time() - began < 2.0


def test_many_blocks_may_not_expand_to_more_together(tmp_path):
    blocks = [chunk(bytes(1 << 20))] * (1 + (FREE >> 20))
    check_limits(mcap(tmp_path / "few.mcap", *blocks[:-2]))
    with pytest.raises(BadInputError, match="many.mcap: expands to more than 8 MB"):
        check_limits(mcap(tmp_path / "many.mcap", *blocks, *blocks))


def test_streams_that_stand_still_may_be_compressed(tmp_path):
    """The same number 400,000 times: 1 part in 60."""
    types = get_typestore(Stores.ROS2_JAZZY)
    for mode in (CompressionMode.STORAGE, CompressionMode.FILE):
        writer = Writer(tmp_path / mode.name, version=9, storage_plugin=StoragePlugin.MCAP)
        writer.set_compression(mode, CompressionFormat.ZSTD)
        with writer:
            topic = writer.add_connection("/a", "std_msgs/msg/Float64", typestore=types)
            for k in range(400_000):
                writer.write(topic, 10_000_000 * k, DATA)
        check_limits(tmp_path / mode.name)


def test_messages_that_are_compressed_one_by_one_are_counted(tmp_path):
    types = get_typestore(Stores.ROS2_JAZZY)
    writer = Writer(tmp_path / "run", version=9, storage_plugin=StoragePlugin.SQLITE3)
    writer.set_compression(CompressionMode.MESSAGE, CompressionFormat.ZSTD)
    with writer:
        topic = writer.add_connection("/a", "std_msgs/msg/Float64", typestore=types)
        for k in range(60):
            writer.write(topic, k, bytes(1 << 20))
    with pytest.raises(BadInputError, match="run.db3: expands to more than"):
        check_limits(tmp_path / "run")


def test_rows_that_are_computed_are_refused(tmp_path):
    """A view can have rows without end."""
    path = tmp_path / "endless.db3"
    with sqlite3.connect(path) as database:
        database.execute("CREATE TABLE topics (id, name, type)")
        database.execute(
            "CREATE VIEW messages AS WITH RECURSIVE n(id) AS (SELECT 1 UNION ALL SELECT id + 1 "
            "FROM n) SELECT id, 1 AS topic_id, id AS timestamp, x'00' AS data FROM n"
        )
    database.close()
    with pytest.raises(BadInputError, match="'messages' is a view"):
        read_tables(path, lambda _: True)


def test_a_block_inside_a_block_is_not_entered(tmp_path):
    path = mcap(tmp_path / "nested.mcap", chunk(chunk(record(4, b"\1\0\1\0" + text("/inner")))))
    types = {}
    assert list(salvage_messages(path, types, lambda _: True)) == [] and types == {}


@pytest.mark.parametrize("read", [Recording.from_bag, topic_types])
@pytest.mark.parametrize("name", ["run.mcap", "metadata.yaml"])
def test_a_pipe_within_a_recording_is_refused_at_once(tmp_path, read, name):
    os.mkfifo(tmp_path / name)
    with pytest.raises(BadInputError, match=f"{name} is a pipe or device"):
        read(tmp_path)


def test_metadata_that_grows_are_not_read_and_the_messages_are(tmp_path):
    types = get_typestore(Stores.ROS2_JAZZY)
    with Writer(tmp_path / "run", version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        topic = writer.add_connection("/a", "std_msgs/msg/Float64", typestore=types)
        writer.write(topic, 1, DATA)
    with Reader(tmp_path / "run") as reader:
        assert reader.message_count == 1
    laughs = "a: &a [x, x, x, x, x, x, x, x]\n" + "".join(
        f"{n}: &{n} [{', '.join([f'*{o}'] * 9)}]\n"
        for o, n in zip("abcdefgh", "bcdefghi", strict=True)
    )
    (tmp_path / "run" / "metadata.yaml").write_text(laughs)
    assert read_tables(tmp_path / "run", lambda _: True).types == {"/a": "std_msgs/msg/Float64"}
    assert topic_types(tmp_path / "run") == {"/a": "std_msgs/msg/Float64"}
