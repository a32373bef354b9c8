"""What the recorder of live topics leaves: a directory, or one file if that is its name."""

import errno

import pytest
from std_msgs.msg import Float64

from tactile_dynamics_ros.cli.main import main
from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.recording.bag_files import read_messages
from tactile_dynamics_ros.ros.recorder import Recorder

TOPIC = "/model_check/error"


def record(bench, path):
    """Record a few numbers; return the recorder before it is closed."""
    recorder = bench.start(lambda: Recorder(path, [TOPIC]))
    publisher = recorder.create_publisher(Float64, TOPIC, 10)

    def heard():
        publisher.publish(Float64(data=1.5))
        return recorder.counts[TOPIC] > 2

    bench.until(heard)
    return recorder


def test_a_recording_whose_name_ends_in_mcap_is_one_file(bench, tmp_path):
    path = tmp_path / "run.mcap"
    recorder = record(bench, path)
    assert recorder.folder.is_dir() and not path.exists(), "readable if the recorder is killed"
    recorder.close()
    assert [p.name for p in tmp_path.iterdir()] == ["run.mcap"]
    assert path.is_file()
    assert len(list(read_messages(path, TOPIC))) == recorder.counts[TOPIC]


def test_a_recording_of_another_name_is_a_rosbag2_directory(bench, tmp_path):
    recorder = record(bench, tmp_path / "run")
    recorder.close()
    assert sorted(p.name for p in (tmp_path / "run").iterdir()) == ["metadata.yaml", "run.mcap"]
    with pytest.raises(BadInputError, match="run exists already"):
        Recorder(tmp_path / "run")


def test_hidden_topics_are_recorded_only_if_they_are_named(bench, tmp_path):
    hidden = "/push_controller/push/_action/feedback"
    recorder = bench.start(lambda: Recorder(tmp_path / "all"))
    publishers = [recorder.create_publisher(Float64, topic, 10) for topic in (hidden, TOPIC)]

    def heard():
        for publisher in publishers:
            publisher.publish(Float64(data=1.5))
        return recorder.counts[TOPIC] > 2

    bench.until(heard)
    assert hidden not in recorder.counts and hidden not in recorder.refused
    recorder.close()
    named = bench.start(lambda: Recorder(tmp_path / "named", [hidden]))
    assert named._is_wanted(hidden)
    named.close()


def test_a_full_disk_ends_a_recording_in_one_line_with_what_was_heard(
    tmp_path, monkeypatch, capsys
):
    def spin(recorder, is_over):
        topic = recorder._writer.add_connection(TOPIC, "std_msgs/msg/Float64")
        recorder._writer.write(topic, 1, b"\0\1\0\0" + bytes(8))
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr("tactile_dynamics_ros.ros.shell.spin", spin)
    assert main(["record", str(tmp_path / "run.mcap"), TOPIC]) == 2
    said = capsys.readouterr().err.splitlines()[1:]
    assert len(said) == 1 and "No space left on device; free space there" in said[0]
    assert "what was written before is kept" in said[0]
    assert [path.name for path in tmp_path.iterdir()] == ["run.mcap"]
    assert len(list(read_messages(tmp_path / "run.mcap", TOPIC))) == 1
