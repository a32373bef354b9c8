"""Messages to core and back: order, frames, and refusal of bad input."""

import math

import numpy as np
import pytest

pytest.importorskip("rclpy")

from geometry_msgs.msg import PoseWithCovarianceStamped, WrenchStamped  # noqa: E402
from rclpy.serialization import deserialize_message, serialize_message  # noqa: E402
from sensor_msgs.msg import Image, JointState  # noqa: E402

from tactile_dynamics_ros.core.rigid_body.inertial_parameters import (  # noqa: E402
    InertialParameters,
)
from tactile_dynamics_ros.core.rigid_body.rotation import exp_so3  # noqa: E402
from tactile_dynamics_ros.ros import conversions as cv  # noqa: E402
from tactile_dynamics_ros.ros.wire import decoder_of  # noqa: E402


def read(message):
    """Return a message as a node gets it."""
    return decoder_of(type(message))(serialize_message(message))


def wrench_message(force, torque, frame="world", stamp=1.5):
    message = WrenchStamped(header=cv.header(stamp, frame))
    message.wrench.force = cv.array_to_vector(np.array(force))
    message.wrench.torque = cv.array_to_vector(np.array(torque))
    return read(message)


def test_core_wrench_has_torque_first_and_messages_force_first():
    wrench = cv.wrench_to_core(wrench_message([1.0, 2, 3], [4.0, 5, 6]), "/t", "world")
    assert wrench.tolist() == [4, 5, 6, 1, 2, 3]
    message = deserialize_message(cv.wrench_to_message(wrench, 2.25, "world"), WrenchStamped)
    assert (message.wrench.force.x, message.wrench.torque.x) == (1.0, 4.0)
    assert (message.header.stamp.sec, message.header.stamp.nanosec) == (2, 250_000_000)


@pytest.mark.parametrize("value", [math.nan, math.inf])
def test_wrench_that_is_not_finite_is_refused_and_named(value):
    with pytest.raises(cv.MessageError, match="/contact/index/force") as caught:
        cv.wrench_to_core(wrench_message([value, 0, 0], [0.0, 0, 0]), "/contact/index/force")
    assert caught.value.kind == "not_finite"


def test_wrench_in_another_frame_is_refused():
    with pytest.raises(cv.MessageError, match="'palm', expected 'world'") as caught:
        cv.wrench_to_core(wrench_message([1.0, 0, 0], [0.0, 0, 0], "palm"), "/t", "world")
    assert caught.value.kind == "wrong_frame"


def test_pose_covariance_changes_order_with_the_pose():
    pose = np.eye(4)
    pose[:3, :3] = exp_so3(np.array([0.3, -0.2, 0.9]))
    pose[:3, 3] = [0.1, 0.2, 0.3]
    covariance = np.diag([1.0, 2, 3, 4, 5, 6])
    covariance[0, 4] = covariance[4, 0] = 0.5
    data = cv.uncertain_pose_to_message(pose, covariance, 3.0, "world")
    message = deserialize_message(data, PoseWithCovarianceStamped)
    stated = np.array(message.pose.covariance).reshape(6, 6)
    assert np.diag(stated).tolist() == [4, 5, 6, 1, 2, 3]
    assert stated[1, 3] == 0.5
    back, covariance_back = cv.uncertain_pose_to_core(read(message), "/object/pose", "world")
    np.testing.assert_allclose(back, pose, atol=1e-12)
    np.testing.assert_array_equal(covariance_back, covariance)


def test_pose_with_a_broken_quaternion_is_refused():
    message = PoseWithCovarianceStamped(header=cv.header(0.0, "world"))
    message.pose.pose.orientation.w = 0.5
    with pytest.raises(cv.MessageError, match="length 0.5") as caught:
        cv.uncertain_pose_to_core(read(message), "/object/pose", "world")
    assert caught.value.kind == "bad_quaternion"


def test_pose_without_covariance_says_so():
    message = PoseWithCovarianceStamped(header=cv.header(0.0, "world"))
    assert cv.uncertain_pose_to_core(read(message), "/object/pose", "world")[1] is None


def test_stamps_that_jump_back_are_refused_and_a_restarted_clock_is_told():
    gate = cv.StampGate("/joint_states")
    assert gate.check(cv.to_stamp(5.0)) is False
    with pytest.raises(cv.MessageError) as caught:
        gate.check(cv.to_stamp(4.99))
    assert caught.value.kind == "stamp_jumped_back"
    with pytest.raises(cv.MessageError):
        gate.check(cv.to_stamp(5.0))
    assert gate.check(cv.to_stamp(5.01)) is False
    assert gate.check(cv.to_stamp(0.01)) is True
    assert gate.check(cv.to_stamp(0.02)) is False


def test_joint_states_are_sorted_into_the_order_of_the_table():
    reader = cv.JointReader(["a", "b"])

    def positions(names, values):
        message = decoder_of(JointState)(cv.joints_to_message(names, 0.0, np.array(values)))
        return reader.positions(message).tolist()

    assert positions(["b", "x", "a"], [2.0, 9.0, 1.0]) == [1.0, 2.0]
    with pytest.raises(cv.MessageError, match="first: b"):
        positions(["a"], [1.0])
    with pytest.raises(cv.MessageError, match="1 positions for 2 names"):
        positions(["a", "b"], [1.0])
    with pytest.raises(cv.MessageError, match="not finite"):
        positions(["a", "b"], [1.0, math.nan])


def biotac_message(counts):
    return deserialize_message(cv.biotac_to_message(counts, 0.0, "hand"), Image)


def test_biotac_image_round_trip_in_both_byte_orders():
    counts = np.arange(176, dtype=np.uint16).reshape(4, 44) + 2000
    message = biotac_message(counts)
    assert (message.encoding, message.height, message.width, message.step) == ("16UC1", 4, 44, 88)
    np.testing.assert_array_equal(cv.biotac_to_core(read(message), "/biotac/raw"), counts)
    message.data = counts.astype(">u2").tobytes()
    message.is_bigendian = 1
    np.testing.assert_array_equal(cv.biotac_to_core(read(message), "/biotac/raw"), counts)


def test_biotac_image_of_another_size_or_encoding_is_refused():
    message = biotac_message(np.zeros((5, 44), np.uint16))
    with pytest.raises(cv.MessageError, match="expected .4, 44, 88, 352.") as caught:
        cv.biotac_to_core(read(message), "/biotac/raw")
    assert caught.value.kind == "wrong_shape"
    message.encoding = "mono16"
    with pytest.raises(cv.MessageError, match="mono16"):
        cv.biotac_to_core(read(message), "/biotac/raw")


def test_depth_image_round_trip():
    depth = np.linspace(0.3, 2.0, 12, dtype=np.float32).reshape(3, 4)
    message = deserialize_message(cv.depth_to_message(depth, 0.0, "camera"), Image)
    assert (message.encoding, message.step) == ("32FC1", 16)
    np.testing.assert_array_equal(cv.depth_to_core(read(message), "/camera"), depth)


def test_inertia_message_is_about_the_centre_of_mass_with_tensor_signs():
    tensor = np.array([[2e-4, -3e-5, 1e-5], [-3e-5, 3e-4, 2e-5], [1e-5, 2e-5, 4e-4]])
    parameters = InertialParameters(0.2, np.array([0.1, 0.0, 0.0]), tensor)
    inertia = cv.inertia_to_message(parameters, 0.0, "object").inertia
    assert (inertia.m, inertia.com.x) == (0.2, 0.1)
    assert (inertia.ixx, inertia.ixy, inertia.ixz) == (2e-4, -3e-5, 1e-5)
    assert (inertia.iyy, inertia.iyz, inertia.izz) == (3e-4, 2e-5, 4e-4)
