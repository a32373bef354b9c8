"""Faulty recordings: every fault is counted in one clear line or refused with what to do."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rosbags.rosbag2 import Reader, StoragePlugin, Writer
from rosbags.rosbag2.enums import CompressionFormat, CompressionMode
from rosbags.typesys import Stores, get_typestore
from synthetic_recording import held_box

from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.recording import Recording

STORE = get_typestore(Stores.ROS2_JAZZY)
POSE, FORCE = "/object/pose", "/contact/index/force"


@pytest.fixture(scope="module")
def bag(tmp_path_factory) -> Path:
    """Return a clean recording of two seconds."""
    return held_box(seconds=2.0).to_bag(tmp_path_factory.mktemp("bags") / "clean")


@pytest.fixture
def edited(bag, tmp_path) -> Callable[..., Path]:
    """Return a function that copies the recording with some messages changed or left out."""

    def edit(topic: str, change: Callable, rename: Callable[[str], str] = str) -> Path:
        target = tmp_path / "edited"
        count = 0
        with (
            Reader(bag) as reader,
            Writer(target, version=9, storage_plugin=StoragePlugin.MCAP) as writer,
        ):
            known = {
                c.id: writer.add_connection(rename(c.topic), c.msgtype, typestore=STORE)
                for c in reader.connections
                if rename(c.topic)
            }
            for connection, received, data in reader.messages():
                if connection.id not in known:
                    continue
                if connection.topic == topic:
                    message = STORE.deserialize_cdr(data, connection.msgtype)
                    if change(message, count) is False:
                        continue
                    data = STORE.serialize_cdr(message, connection.msgtype)
                    count += 1
                writer.write(known[connection.id], received, data)
        return target

    return edit


def _set_nan(message, k):
    if k in (5, 9):
        message.wrench.force.x = np.nan


def _set_absurd(message, k):
    if k == 7:
        message.wrench.force.z = 3e7


def _repeat_stamp(message, k):
    if k == 50:
        message.header.stamp.nanosec -= 10_000_000


def _jump_back(message, k):
    if k == 50:
        message.header.stamp.sec -= 1


def _stop_clock(message, k):
    message.header.stamp.sec = message.header.stamp.nanosec = 0


def _other_frame(message, k):
    if k < 3:
        message.header.frame_id = "camera"


def _no_frame(message, k):
    message.header.frame_id = ""


def _long_quaternion(message, k):
    if k < 4:
        q = message.pose.pose.orientation
        q.x, q.y, q.z, q.w = 1.1 * q.x, 1.1 * q.y, 1.1 * q.z, 1.1 * q.w


def _no_quaternion(message, k):
    if k == 3:
        q = message.pose.pose.orientation
        q.x = q.y = q.z = q.w = 0.0


def _leap(message, k):
    if k in (60, 61):
        message.pose.pose.position.x += 0.3


def _flip(message, k):
    if k == 60:
        q = message.pose.pose.orientation
        q.x, q.w = q.w, -q.x


def _break_covariance(message, k):
    if k < 2:
        message.pose.covariance = np.diag([-1.0, 1.0, 1.0, 1.0, 1.0, 1.0]).ravel()


def _pause(message, k):
    return not 1.0 <= message.header.stamp.sec + 1e-9 * message.header.stamp.nanosec < 1.3


@pytest.mark.parametrize(
    ("topic", "change", "problem", "count"),
    [
        (FORCE, _set_nan, "sample is not finite (dropped)", 2),
        (FORCE, _set_absurd, "force or torque is absurd (dropped)", 1),
        (FORCE, _repeat_stamp, "stamp repeats (dropped)", 1),
        (FORCE, _jump_back, "stamp jumps (dropped)", 1),
        (FORCE, _other_frame, "frame_id is not world (dropped)", 3),
        (FORCE, _no_frame, "frame_id empty (taken as world)", 200),
        (FORCE, _stop_clock, "unstamped: taken at their receive times", 200),
        (POSE, _jump_back, "stamp jumps (dropped)", 1),
        (POSE, _long_quaternion, "quaternion is not of unit length (normalised)", 4),
        (POSE, _no_quaternion, "quaternion is not a rotation (dropped)", 1),
        (POSE, _leap, "pose leaps away and back (dropped)", 2),
        (POSE, _flip, "pose leaps away and back (dropped)", 1),
        (POSE, _break_covariance, "covariance is not positive definite (median used)", 2),
        (POSE, _pause, "gap in the stream", 1),
    ],
)
def test_a_fault_is_counted_and_the_rest_is_kept(edited, topic, change, problem, count):
    recording = Recording.from_bag(edited(topic, change))
    assert recording.problems == {f"{topic}: {problem}": count}
    assert recording.problem_lines() == [f"{topic}: {problem}: {count}"]
    dropped = count if "dropped" in problem else 0
    kept = recording.streams.pose if topic == POSE else recording.streams.contacts["index"]
    assert len(kept.time) == (170 if change is _pause else 200 - dropped)
    assert np.all(np.diff(kept.time) > 0)
    assert recording.duration == pytest.approx(1.99, abs=1e-6)


def test_a_saturated_force_is_dropped(edited, bag):
    clean = Recording.from_bag(bag).streams.contacts["index"].force[:, 0]
    rail = np.quantile(clean, 0.2)

    def saturate(message, k):
        message.wrench.force.x = max(message.wrench.force.x, rail)

    recording = Recording.from_bag(edited(FORCE, saturate))
    dropped = recording.problems[f"{FORCE}: sensor saturated (dropped)"]
    kept = recording.streams.contacts["index"].force[:, 0]
    assert dropped > 25
    assert dropped + np.count_nonzero(kept == rail) == np.count_nonzero(clean <= rail)


def test_a_pose_that_is_published_twice_is_kept_once(edited):
    last = {}

    def repeat(message, count):
        if count % 2:
            message.pose.pose = last["pose"]
        last["pose"] = message.pose.pose

    recording = Recording.from_bag(edited(POSE, repeat))
    [(line, count)] = recording.problems.items()
    assert line == "/object/pose: sample of a slower sensor repeated (dropped)"
    assert len(recording.streams.pose.time) == count


@pytest.mark.parametrize(
    ("topic", "change", "rename", "message"),
    [
        (POSE, None, {POSE: ""}, r"/object/pose \(or /object/imu\) is missing .*record it"),
        (POSE, None, {POSE: "/object/pse"}, r"remap it \(/object/pse:=/object/pose\)"),
        (FORCE, None, {"/contact/index/pose": ""}, "/contact/index/pose is missing"),
        (
            FORCE,
            None,
            dict.fromkeys(("index", "middle", "ring", "thumb"), ""),
            "<finger>/force is missing",
        ),
        (POSE, "frame", {}, "frame_id 'camera' in 200 of 200 messages; expected 'world'"),
        (POSE, "nan", {}, "0 usable poses of 200; expected .*not finite"),
        (FORCE, "late", {}, "contact index .* never overlap; stamp both with the same clock"),
        (
            "/contact/index/pose",
            "nan",
            {},
            "no usable pose of 200, but /contact/index/force has 200",
        ),
    ],
)
def test_unusable_recordings_are_refused_with_what_to_do(edited, topic, change, rename, message):
    def corrupt(msg, k):
        if change == "frame":
            msg.header.frame_id = "camera"
        if change == "nan":
            pose = msg.pose.pose if hasattr(msg.pose, "pose") else msg.pose
            pose.position.y = np.inf
        if change == "late":
            msg.header.stamp.sec += 1000

    def new_name(name):
        finger = name.split("/")[2]
        return rename.get(name, rename.get(finger, name))

    with pytest.raises(BadInputError, match=message) as error:
        Recording.from_bag(edited(topic, corrupt, new_name))
    assert "\n" not in str(error.value)


def test_a_topic_of_another_type_is_refused(tmp_path, bag):
    with Writer(tmp_path / "odd", version=9) as writer:
        connection = writer.add_connection(POSE, "geometry_msgs/msg/Twist", typestore=STORE)
        vector = STORE.types["geometry_msgs/msg/Vector3"](x=0.0, y=0.0, z=0.0)
        twist = STORE.types["geometry_msgs/msg/Twist"](linear=vector, angular=vector)
        writer.write(connection, 0, STORE.serialize_cdr(twist, "geometry_msgs/msg/Twist"))
    with pytest.raises(
        BadInputError, match="/object/pose .* is a geometry_msgs/msg/Twist; expected"
    ):
        Recording.from_bag(tmp_path / "odd")


def test_a_remapped_topic_is_read_under_its_meaning(edited):
    path = edited(POSE, lambda m, k: None, lambda t: "/tracker/box" if t == POSE else t)
    recording = Recording.from_bag(path, remap={"/tracker/box": POSE})
    assert len(recording.streams.pose.time) == 200
    with pytest.raises(BadInputError, match="/nothing is not in"):
        Recording.from_bag(path, remap={"/nothing": POSE})


def test_remapped_topics_may_swap_their_names(edited):
    index, thumb = "/contact/index/force", "/contact/thumb/force"
    path = edited(POSE, lambda m, k: None)
    plain = Recording.from_bag(path).streams.contacts
    swapped = Recording.from_bag(path, remap={index: thumb, thumb: index}).streams.contacts
    assert np.array_equal(swapped["thumb"].force, plain["index"].force)
    assert np.array_equal(swapped["index"].force, plain["thumb"].force)


def test_a_finger_that_never_touches_is_left_out(edited):
    def silence(message, k):
        force = message.wrench.force
        force.x = force.y = force.z = 0.0

    recording = Recording.from_bag(edited(FORCE, silence))
    assert "index" not in recording.streams.contacts
    assert recording.problems == {f"{FORCE}: no force at all (contact left out)": 1}


def test_contact_poses_may_lack_an_orientation(edited):
    def unset(message, k):
        q = message.pose.orientation
        q.x = q.y = q.z = q.w = 0.0

    recording = Recording.from_bag(edited("/contact/index/pose", unset))
    assert recording.problems == {
        "/contact/index/pose: orientation not set (normal not known)": 200
    }
    assert len(recording.streams.contacts["index"].position) == 200


@pytest.mark.parametrize("share", [0.3, 0.6, 0.95])
@pytest.mark.parametrize("compression", [None, CompressionFormat.ZSTD])
def test_a_truncated_mcap_gives_what_it_still_holds(tmp_path, bag, share, compression):
    source = _compressed(bag, tmp_path / "whole", compression)
    data = source.read_bytes()
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(data[: int(share * len(data))])
    recording = Recording.from_bag(cut)
    (problem,) = [p for p in recording.problems if "damaged" in p]
    assert problem.startswith("cut.mcap: damaged (")
    assert 0.5 * share * 200 < len(recording.streams.pose.time) <= 200
    whole = Recording.from_bag(bag).streams.pose.position
    np.testing.assert_array_equal(
        recording.streams.pose.position, whole[: len(recording.streams.pose.time)]
    )


def _compressed(bag, target, compression):
    with Reader(bag) as reader:
        writer = Writer(target, version=9, storage_plugin=StoragePlugin.MCAP)
        if compression:
            writer.set_compression(CompressionMode.STORAGE, compression)
        with writer:
            known = {
                c.id: writer.add_connection(c.topic, c.msgtype, typestore=STORE)
                for c in reader.connections
            }
            for connection, received, data in reader.messages():
                writer.write(known[connection.id], received, data)
    return next(target.glob("*.mcap"))


def as_sqlite(bag, target):
    """Write a recording as a SQLite one; return the file."""
    with Reader(bag) as reader, Writer(target, version=9) as writer:
        known = {
            c.id: writer.add_connection(c.topic, c.msgtype, typestore=STORE)
            for c in reader.connections
        }
        for connection, received, data in reader.messages():
            writer.write(known[connection.id], received, data)
    return next(target.glob("*.db3"))


def test_a_truncated_sqlite_recording_gives_what_it_still_holds(tmp_path, bag):
    file = as_sqlite(bag, tmp_path / "sql")
    data = file.read_bytes()
    file.write_bytes(data[: int(0.7 * len(data))])
    recording = Recording.from_bag(tmp_path / "sql")
    assert any("damaged" in p for p in recording.problems)
    assert 60 < len(recording.streams.pose.time) < 200


def test_a_sqlite_recording_whose_names_are_no_text_is_refused(tmp_path, bag):
    file = as_sqlite(bag, tmp_path / "sql")
    file.write_bytes(
        file.read_bytes().replace(b"CREATE TABLE topics", b"CREATE \xff\xfeBLE topics")
    )
    with pytest.raises(BadInputError, match="no message could be read"):
        Recording.from_bag(tmp_path / "sql")


def test_a_directory_without_metadata_is_read(tmp_path):
    path = held_box(seconds=1.0).to_bag(tmp_path / "run")
    (path / "metadata.yaml").unlink()
    assert Recording.from_bag(path).problems == {}


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("missing.mcap", None, "no such file"),
        ("notes.txt", b"hello", "unknown kind of file"),
        ("empty.mcap", b"", "no message could be read"),
        ("noise.mcap", bytes(range(256)) * 9, "no message could be read"),
        ("noise.db3", bytes(range(256)) * 9, "no message could be read"),
    ],
)
def test_what_is_not_a_recording_is_refused(tmp_path, name, content, message):
    if content is not None:
        (tmp_path / name).write_bytes(content)
    with pytest.raises(BadInputError, match=message):
        Recording.from_bag(tmp_path / name)
    (tmp_path / "folder").mkdir()
    with pytest.raises(BadInputError, match="holds no .mcap, .db3 or .bag"):
        Recording.from_bag(tmp_path / "folder")


@settings(max_examples=60, deadline=None)
@given(data=st.data())
def test_flipped_bytes_never_escape_as_another_error(bag, tmp_path_factory, data):
    content = bytearray(next(bag.glob("*.mcap")).read_bytes())
    for _ in range(data.draw(st.integers(1, 5))):
        content[data.draw(st.integers(0, len(content) - 1))] ^= data.draw(st.integers(1, 255))
    file = tmp_path_factory.mktemp("flipped") / "run.mcap"
    file.write_bytes(content)
    try:
        recording = Recording.from_bag(file)
    except BadInputError as error:
        assert "\n" not in str(error)
    else:
        assert np.isfinite(recording.streams.pose.position).all()
