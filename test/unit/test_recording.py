"""Recordings: what goes into a bag comes out, from whichever file, at whichever rate."""

from __future__ import annotations

import json
import shutil
import time
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore
from synthetic_recording import held_box

from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.streams.streams import between_turns
from tactile_dynamics_ros.recording import Recording
from tactile_dynamics_ros.recording.arrays import frame_of_normal
from tactile_dynamics_ros.recording.cdr import DOUBLES, decode_messages, encode_messages

SAMPLE = Path(__file__).resolve().parents[3] / "shared" / "data" / "inhand_sample"
STORE = get_typestore(Stores.ROS2_JAZZY)

finite = st.floats(-1e6, 1e6, allow_nan=False, allow_subnormal=False)


@settings(max_examples=40, deadline=None)
@given(
    msgtype=st.sampled_from(sorted(DOUBLES)),
    frame=st.text("abcdefgh_/é", max_size=20),
    data=st.data(),
)
def test_messages_decode_as_the_ros_library_decodes_them(msgtype, frame, data):
    rows = data.draw(st.integers(1, 4))
    values = data.draw(hnp.arrays(float, (rows, DOUBLES[msgtype]), elements=finite))
    stamps = np.array(data.draw(st.lists(st.integers(0, 2**60), min_size=rows, max_size=rows)))
    raw = encode_messages(msgtype, stamps, frame, values)
    table = decode_messages(msgtype, raw, [0] * rows)
    np.testing.assert_array_equal(table.values, values)
    np.testing.assert_array_equal(table.stamp_ns, stamps)
    message = STORE.deserialize_cdr(raw[0], msgtype)
    assert message.header.frame_id == frame
    assert message.header.stamp.sec * 10**9 + message.header.stamp.nanosec == stamps[0]
    assert bytes(STORE.serialize_cdr(message, msgtype)) == raw[0]
    big_endian = bytes(STORE.serialize_cdr(message, msgtype, little_endian=False))
    swapped = decode_messages(msgtype, [big_endian], [0])
    np.testing.assert_array_equal(swapped.values[0], values[0])
    assert swapped.stamp_ns[0] == stamps[0]


def test_messages_of_different_lengths_keep_their_order():
    kind = "geometry_msgs/msg/Vector3Stamped"
    stamps = np.arange(6)
    rows = np.arange(18.0).reshape(6, 3)
    raw = [
        encode_messages(kind, stamps[[k]], "world" if k % 2 else "a/long/frame", rows[[k]])[0]
        for k in range(6)
    ]
    raw.insert(3, b"\0\1\0\0 not a message")
    table = decode_messages(kind, raw, range(7))
    np.testing.assert_array_equal(table.values, rows)
    assert table.malformed == 1
    assert table.receive_ns.tolist() == [0, 1, 2, 4, 5, 6]


@pytest.mark.parametrize("name", ["run", "run.mcap"])
def test_a_bag_returns_what_was_written(tmp_path, name):
    recording = held_box(seconds=2.0)
    path = recording.to_bag(tmp_path / name)
    back = Recording.from_bag(path)
    assert back.problems == {}
    pose, again = recording.streams.pose, back.streams.pose
    np.testing.assert_allclose(again.time, pose.time, atol=1e-9)
    np.testing.assert_allclose(again.rotation, pose.rotation, atol=1e-12)
    np.testing.assert_array_equal(again.position, pose.position)
    np.testing.assert_allclose(again.covariance, pose.covariance)
    assert list(back.streams.contacts) == ["index", "middle", "ring", "thumb"]
    for contact, copy in zip(
        recording.streams.contacts.values(), back.streams.contacts.values(), strict=True
    ):
        np.testing.assert_array_equal(copy.force, contact.force)
        np.testing.assert_array_equal(copy.force_std, contact.force_std)
        np.testing.assert_allclose(copy.rotation, contact.rotation, atol=1e-12)
        assert not copy.carries_torque


def test_the_file_inside_a_recording_reads_like_the_directory(tmp_path):
    path = held_box(seconds=1.0).to_bag(tmp_path / "run")
    inside = Recording.from_bag(next(path.glob("*.mcap")))
    np.testing.assert_array_equal(
        inside.streams.contacts["ring"].force,
        Recording.from_bag(path).streams.contacts["ring"].force,
    )


def test_an_sqlite_recording_reads_like_an_mcap_recording(tmp_path):
    mcap = held_box(seconds=1.0).to_bag(tmp_path / "mcap")
    _convert(mcap, tmp_path / "sqlite", StoragePlugin.SQLITE3)
    for path in (tmp_path / "sqlite", next((tmp_path / "sqlite").glob("*.db3"))):
        copy = Recording.from_bag(path)
        np.testing.assert_array_equal(
            copy.streams.pose.position, Recording.from_bag(mcap).streams.pose.position
        )


def _convert(source, target, plugin):
    from rosbags.rosbag2 import Reader

    with Reader(source) as reader, Writer(target, version=9, storage_plugin=plugin) as writer:
        known = {
            c.id: writer.add_connection(c.topic, c.msgtype, typestore=STORE)
            for c in reader.connections
        }
        for connection, received, data in reader.messages():
            writer.write(known[connection.id], received, data)


def test_a_torque_makes_a_contact_that_carries_torque(tmp_path):
    recording = _wrist()
    assert recording.streams.contacts["wrist"].carries_torque
    back = Recording.from_bag(recording.to_bag(tmp_path / "run.mcap"))
    assert back.streams.contacts["wrist"].carries_torque
    np.testing.assert_array_equal(
        back.streams.contacts["wrist"].torque, recording.streams.contacts["wrist"].torque
    )


def _wrist(**imu):
    time_s = np.arange(100) / 50
    contact = {
        "time": time_s,
        "force": np.stack([np.zeros(100), np.ones(100), 9 + np.sin(time_s)], 1),
        "torque": np.stack([np.sin(time_s), np.cos(time_s), time_s], 1),
        "position": [0.1, 0.2, 0.3],
    }
    readings = {"time": time_s, "specific_force": np.tile([0, 0, 9.81], (100, 1)), **imu}
    return Recording.from_arrays({"wrist": contact}, imu=readings)


def test_an_imu_keeps_what_it_measures_and_what_it_does_not(tmp_path):
    plain = Recording.from_bag(_wrist().to_bag(tmp_path / "plain.mcap")).streams
    assert plain.pose is None
    assert plain.imu.rotation is None and plain.imu.angular_velocity is None
    assert plain.imu.specific_force_std is None
    turned = np.tile(np.diag([-1.0, -1.0, 1.0]), (100, 1, 1))
    full = _wrist(rotation=turned, angular_velocity=[0.1, 0.2, 0.3], specific_force_std=0.05)
    full = Recording.from_bag(full.to_bag(tmp_path / "full.mcap")).streams
    np.testing.assert_allclose(full.imu.rotation, turned, atol=1e-12)
    np.testing.assert_allclose(full.imu.angular_velocity, np.tile([0.1, 0.2, 0.3], (100, 1)))
    assert full.imu.specific_force_std == pytest.approx(0.05)


def test_covariance_is_position_first_in_messages_and_rotation_first_in_core(tmp_path):
    recording = held_box(seconds=1.0)
    path = recording.to_bag(tmp_path / "run.mcap")
    from rosbags.rosbag2 import Reader

    with Reader(path) as reader:
        wanted = [c for c in reader.connections if c.topic == "/object/pose"]
        connection, _, raw = next(reader.messages(connections=wanted))
    diagonal = (
        STORE.deserialize_cdr(raw, connection.msgtype).pose.covariance.reshape(6, 6).diagonal()
    )
    np.testing.assert_allclose(diagonal, [4e-8] * 3 + [4e-6] * 3)
    np.testing.assert_allclose(
        recording.streams.pose.covariance[0].diagonal(), [4e-6] * 3 + [4e-8] * 3
    )


def test_object_axes_turn_with_the_object():
    world = held_box(seconds=1.0, noise=0.0).streams
    pose = world.pose
    to_body = lambda v: np.einsum("nji,nj->ni", pose.rotation, v)  # noqa: E731
    contacts = {
        name: {
            "time": c.time,
            "force": to_body(c.force),
            "position": to_body(c.position - pose.position)[0],
            "normal": to_body(c.rotation[:, :, 2]),
        }
        for name, c in world.contacts.items()
    }
    arrays = {"time": pose.time, "position": pose.position, "rotation": pose.rotation}
    turned = Recording.from_arrays(contacts, arrays, contact_frame="object").streams
    for name, contact in world.contacts.items():
        np.testing.assert_allclose(turned.contacts[name].force, contact.force, atol=1e-9)
        np.testing.assert_allclose(turned.contacts[name].position, contact.position, atol=1e-9)
        np.testing.assert_allclose(
            turned.contacts[name].rotation[:, :, 2], contact.rotation[:, :, 2], atol=1e-9
        )


@settings(max_examples=50, deadline=None)
@given(hnp.arrays(float, (3, 3), elements=st.floats(-1, 1)))
def test_frames_of_normals_are_rotations_onto_the_normal(normals):
    normals = np.where(np.linalg.norm(normals, axis=1, keepdims=True) < 1e-3, [0, 0, -1.0], normals)
    frames = frame_of_normal(normals)
    np.testing.assert_allclose(
        np.swapaxes(frames, 1, 2) @ frames, np.tile(np.eye(3), (3, 1, 1)), atol=1e-7
    )
    np.testing.assert_allclose(np.linalg.det(frames), 1.0, atol=1e-7)
    unit = normals / np.linalg.norm(normals, axis=1, keepdims=True)
    np.testing.assert_allclose(frames[:, :, 2], unit, atol=1e-6)


def test_rotations_interpolate_along_the_arc():
    from scipy.spatial.transform import Rotation

    ends = Rotation.from_rotvec([[0, 0, 0], [0, 0, 1.0]]).as_matrix()
    middle = between_turns(np.array([0.0, 2.0]), ends, np.array([-1.0, 0.5, 9.0]))
    expected = Rotation.from_rotvec([[0, 0, 0], [0, 0, 0.25], [0, 0, 1.0]]).as_matrix()
    np.testing.assert_allclose(middle, expected, atol=1e-12)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"froce": 1.0}, "unknown array 'froce'"),
        (
            {"force": np.zeros((100, 2))},
            r"contacts.wrist.force has shape \(100, 2\); expected \(100, 3\)",
        ),
        ({"force": [["a", "b", "c"]] * 100}, "not numeric"),
        ({"position": None}, "contacts.wrist.position is missing"),
        ({"time": np.arange(100) + 1e4}, "never overlap"),
        ({"rotation": np.diag([1.0, 1.0, -1.0])}, "right-handed"),
    ],
)
def test_wrong_arrays_are_refused_by_name(change, message):
    time_s = np.arange(100) / 50
    contact = {"time": time_s, "force": np.ones((100, 3)), "position": [0, 0, 0.0], **change}
    imu = {"time": time_s, "specific_force": [0, 0, 9.81]}
    with pytest.raises(BadInputError, match=message):
        Recording.from_arrays({"wrist": contact}, imu=imu)


def test_an_accelerometer_in_units_of_g_is_refused():
    with pytest.raises(BadInputError, match="units of g"):
        _wrist(specific_force=[0.0, 0.0, 1.0])


def test_a_recording_is_not_overwritten(tmp_path):
    recording = held_box(seconds=1.0)
    path = recording.to_bag(tmp_path / "run.mcap")
    with pytest.raises(BadInputError, match="exists already"):
        recording.to_bag(path)


def test_a_recording_made_elsewhere_reads_in_seconds():
    if not SAMPLE.exists():
        pytest.skip("../shared/data/inhand_sample is not on this machine")
    start = time.monotonic()
    recording = Recording.from_bag(SAMPLE / "recording")
    assert time.monotonic() - start < 3.0
    assert recording.problems == {}
    assert recording.duration == pytest.approx(29.99, abs=1e-3)
    assert sorted(recording.streams.contacts) == ["index", "middle", "ring", "thumb"]
    weight = sum(c.force.mean(axis=0) for c in recording.streams.contacts.values())
    mass = json.loads((SAMPLE / "truth.json").read_text())["m"]
    assert weight[2] / 9.81 == pytest.approx(mass, rel=0.02)


def test_a_split_recording_is_joined(tmp_path):
    recording = held_box(seconds=2.0)
    half = recording.to_bag(tmp_path / "first")
    (half / "metadata.yaml").unlink()
    shutil.copy(next(half.glob("*.mcap")), half / "second.mcap")
    doubled = Recording.from_bag(half)
    repeated = doubled.problems["/object/pose: stamp repeats (dropped)"]
    assert repeated == len(recording.streams.pose.time)
    assert len(doubled.streams.pose.time) == len(recording.streams.pose.time)


def test_a_part_of_a_recording_keeps_its_stamps(tmp_path):
    recording = held_box(seconds=2.0)
    part = recording.between(0.5, 1.0).streams
    np.testing.assert_allclose(part.pose.time, np.arange(50, 100) / 100)
    np.testing.assert_array_equal(
        part.contacts["thumb"].force, recording.streams.contacts["thumb"].force[50:100]
    )
    assert len(part.contacts["thumb"].pose_time) == len(part.pose.covariance) == 50
    wrist = _wrist(angular_velocity=[0.1, 0.2, 0.3]).between(0.0, 1.0).streams
    assert len(wrist.imu.time) == len(wrist.imu.angular_velocity) == 50
    assert recording.between(5.0, 6.0).streams.contacts == {}


def test_a_bag_of_the_benchmark_generator_reads_without_problems(tmp_path):
    from tactile_dynamics_ros.synthetic import ScenarioOptions, SensorOptions, generate
    from tactile_dynamics_ros.synthetic.recordings import write_bag

    made = generate(
        3,
        scenario=ScenarioOptions(duration=6.0, contact_breaks=2, regrasp=True),
        sensors=SensorOptions(stagger=True, pose_gaps=1, zero_when_lifted=True),
    )
    recording = Recording.from_bag(write_bag(made.streams, tmp_path / "run"))
    assert recording.problems == {"/object/pose: gap in the stream": 1}
    for name, contact in made.streams.contacts.items():
        np.testing.assert_allclose(recording.streams.contacts[name].force, contact.force)
    assert len(recording.streams.pose.time) == len(made.streams.pose.time)
