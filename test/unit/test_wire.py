"""Messages as bytes: what rclpy writes is read, what is written rclpy reads."""

import numpy as np
import pytest

pytest.importorskip("rclpy")

from builtin_interfaces.msg import Time  # noqa: E402
from geometry_msgs.msg import PoseWithCovarianceStamped, Vector3Stamped, WrenchStamped  # noqa: E402
from rclpy.serialization import deserialize_message, serialize_message  # noqa: E402
from rosgraph_msgs.msg import Clock  # noqa: E402
from sensor_msgs.msg import CameraInfo, Image, JointState  # noqa: E402

from tactile_dynamics_ros.ros import wire  # noqa: E402

STAMP = wire.Stamp(1_780_000_000, 123_456_789)
FRAMES = ["", "w", "world", "biotac_index", "frame_of_17_chars"]


@pytest.mark.parametrize("frame", FRAMES)
def test_what_rclpy_serialises_is_read(frame):
    message = WrenchStamped()
    message.header.stamp = Time(sec=STAMP.sec, nanosec=STAMP.nanosec)
    message.header.frame_id = frame
    force, torque = message.wrench.force, message.wrench.torque
    force.x, force.y, force.z, torque.x, torque.y, torque.z = 1.0, 2.0, 3.0, 4.0, 5.0, 6.0
    found = wire.decoder_of(WrenchStamped)(serialize_message(message))
    assert (found.stamp, found.frame_id) == (STAMP, frame)
    assert found.values.tolist() == [1, 2, 3, 4, 5, 6]


@pytest.mark.parametrize("frame", FRAMES)
def test_what_is_written_rclpy_reads(frame):
    values = np.arange(43.0)
    data = wire.encode_stamped(STAMP, frame, values)
    message = deserialize_message(data, PoseWithCovarianceStamped)
    assert (message.header.stamp.sec, message.header.stamp.nanosec) == STAMP
    assert message.header.frame_id == frame
    assert (message.pose.pose.position.y, message.pose.pose.orientation.w) == (1.0, 6.0)
    assert message.pose.covariance.tolist() == values[7:].tolist()
    assert wire.decoder_of(PoseWithCovarianceStamped)(data).values.tolist() == values.tolist()


def test_a_clock_is_as_rclpy_writes_it():
    message = Clock(clock=Time(sec=STAMP.sec, nanosec=STAMP.nanosec))
    assert wire.encode_clock(STAMP) == serialize_message(message)


def test_big_endian_bytes_are_read():
    data = wire.encode_stamped(STAMP, "world", np.array([1.0, -2.0, 3.0]))
    swapped = bytes((0, 0, 0, 0)) + b"".join(
        part[::-1] for part in (data[4:8], data[8:12], data[12:16])
    )
    swapped += data[16:28] + np.array([1.0, -2.0, 3.0]).astype(">f8").tobytes()
    found = wire.decoder_of(Vector3Stamped)(swapped)
    assert (found.stamp, found.frame_id, found.values.tolist()) == (STAMP, "world", [1, -2, 3])


@pytest.mark.parametrize("count", [0, 1, 2, 5])
@pytest.mark.parametrize("with_effort", [True, False])
def test_joint_states_are_as_rclpy_reads_and_writes_them(count, with_effort):
    names = ["arm", "a_long_joint_name", "", "b", "joint"][:count]
    position, effort = np.arange(count) + 0.5, np.arange(count) - 0.5 if with_effort else None
    data = wire.encode_joint_state(names, STAMP, position, None, effort)
    message = deserialize_message(data, JointState)
    assert list(message.name) == names
    assert list(message.position) == position.tolist()
    assert list(message.velocity) == []
    assert list(message.effort) == ([] if effort is None else effort.tolist())
    message.header.frame_id = "base"
    found = wire.decoder_of(JointState)(serialize_message(message))
    assert (found.stamp, found.names) == (STAMP, tuple(names))
    assert found.positions.tolist() == position.tolist()


def test_joint_states_whose_names_change_are_read_anew():
    decode = wire.decoder_of(JointState)
    for names, values in ((["a", "b"], [1.0, 2.0]), (["b", "a"], [3.0, 4.0]), (["a"], [5.0])):
        for shift in (0.0, 0.25):
            found = decode(wire.encode_joint_state(names, STAMP, np.array(values) + shift))
            assert found.names == tuple(names)
            assert found.positions.tolist() == [value + shift for value in values]


def test_names_that_begin_like_the_known_ones_are_not_mistaken():
    decode = wire.decoder_of(JointState)
    decode(wire.encode_joint_state(["a"], STAMP, np.ones(1)))
    found = decode(wire.encode_joint_state(["a", "b"], STAMP, np.array([1.0, 2.0])))
    assert found.names == ("a", "b")


@pytest.mark.parametrize("frame", FRAMES)
@pytest.mark.parametrize("encoding", ["16UC1", "mono16"])
def test_images_are_as_rclpy_reads_and_writes_them(frame, encoding):
    values = np.arange(12, dtype="<u2").reshape(3, 4)
    data = wire.encode_image(STAMP, frame, encoding, values)
    message = deserialize_message(data, Image)
    assert (message.header.stamp.sec, message.header.stamp.nanosec) == STAMP
    assert (message.header.frame_id, message.encoding, message.step) == (frame, encoding, 8)
    assert (message.height, message.width, bytes(message.data)) == (3, 4, values.tobytes())
    message.is_bigendian = 1
    found = wire.decoder_of(Image)(serialize_message(message))
    assert found == (STAMP, 3, 4, encoding, 1, 8, values.tobytes())


def test_other_types_are_left_to_rclpy():
    assert wire.decoder_of(CameraInfo) is None


def test_stamps_of_seconds():
    assert wire.to_stamp(2.25) == (2, 250_000_000)
    assert wire.to_stamp(0.999_999_999_9) == (1, 0)
