"""A recording that is written as it comes: whole on an empty disk, and readable on a full one."""

import errno

import pytest
from rosbags.rosbag2 import Reader

from tactile_dynamics_ros.recording import bag_writer as live_writer
from tactile_dynamics_ros.recording.bag_limits import salvage_messages
from tactile_dynamics_ros.recording.bag_writer import RESERVE, LiveWriter

KIND = "std_msgs/msg/Float64"
DATA = b"\0\1\0\0" + bytes(8)


@pytest.fixture
def small_disk(monkeypatch):
    """A disk for three blocks of messages and the reserve; beyond, only a part is written."""
    room = 3_500_000 + RESERVE

    class Disk(live_writer.FileIO):
        def write(self, data):
            from pathlib import Path

            file = Path(self.name)
            reserve = file.with_name(".reserve")
            left = room - self.tell() - (reserve.stat().st_size if reserve.exists() else 0)
            if left < len(data):
                super().write(bytes(data)[: max(left, 0)])
                raise OSError(errno.ENOSPC, "No space left on device")
            return super().write(data)

    monkeypatch.setattr(live_writer, "FileIO", Disk)


def fill(writer):
    """Write until the disk is full; return how many messages were handed over."""
    topic = writer.add_connection("/a", KIND)
    for count in range(200_000):
        try:
            writer.write(topic, 10 * count, DATA)
        except OSError:
            return count + 1
    raise AssertionError("the disk never was full")


@pytest.mark.parametrize("name", ["run", "run.mcap"])
def test_on_a_full_disk_all_messages_are_kept_with_index_and_metadata(tmp_path, small_disk, name):
    writer = LiveWriter(tmp_path / name)
    count = fill(writer)
    writer.close()
    left = {file.name for file in tmp_path.rglob("*")}
    assert left == ({"run", "run.mcap", "metadata.yaml"} if name == "run" else {"run.mcap"})
    with Reader(tmp_path / name) as reader:
        assert reader.message_count == count
        stamps = [stamp for _, stamp, _ in reader.messages()]
    assert stamps == [10 * k for k in range(count)]
    [file] = (tmp_path / name).rglob("*.mcap") if name == "run" else [tmp_path / name]
    salvaged = salvage_messages(file, {}, lambda _: True)
    assert [stamp for _, _, stamp, _ in salvaged] == stamps, "nothing unfinished lies between"


def test_the_reserve_is_given_back_at_the_end(tmp_path):
    writer = LiveWriter(tmp_path / "run")
    assert (tmp_path / "run" / ".reserve").stat().st_size == RESERVE
    writer.write(writer.add_connection("/a", KIND), 1, DATA)
    writer.close()
    assert sorted(file.name for file in (tmp_path / "run").iterdir()) == [
        "metadata.yaml",
        "run.mcap",
    ]


def test_without_room_for_the_reserve_nothing_is_begun(tmp_path, monkeypatch):
    def full(*_):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(live_writer.os, "posix_fallocate", full)
    with pytest.raises(OSError, match="No space"):
        LiveWriter(tmp_path / "run.mcap")
    assert list(tmp_path.iterdir()) == []
