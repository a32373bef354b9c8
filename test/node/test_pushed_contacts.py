"""contact_state on a table: forces of a tip and of pads, placed on the outline of the object."""

import numpy as np
import pytest
from geometry_msgs.msg import PoseStamped, WrenchStamped
from numpy.testing import assert_allclose
from std_msgs.msg import Float64

from tactile_dynamics_ros.core.contact.contact_state import nearest_side
from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.rigid_body.rotation import exp_so3
from tactile_dynamics_ros.nodes.contact_state import ContactStateNode
from tactile_dynamics_ros.ros import conversions as cv
from tactile_dynamics_ros.ros.pusher_streams import SensedConfig, outline_message
from tactile_dynamics_ros.ros.shell import LATCHED

SQUARE = 0.05 * np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
TURN = np.deg2rad(10.0)
COVARIANCE = np.diag([1e-6] * 6)
STD = np.full(3, 0.03)


def pose(x, y, z=0.0, turn=0.0):
    """Return a pose (4, 4)."""
    made = np.eye(4)
    made[:3, :3] = exp_so3(np.array([0.0, 0.0, turn]))
    made[:3, 3] = [x, y, z]
    return made


def test_nearest_side_is_a_face_a_corner_or_the_nearer_of_two_outlines():
    face = nearest_side(np.array([-0.056, 0.01]), [SQUARE])
    assert_allclose(face.point, [-0.05, 0.01])
    assert_allclose(face.normal, [1.0, 0.0], atol=1e-12)
    assert face.gap == pytest.approx(0.006)
    inside = nearest_side(np.array([-0.049, 0.01]), [SQUARE])
    assert_allclose(inside.normal, [1.0, 0.0], atol=1e-12)
    assert inside.gap == pytest.approx(-0.001)
    corner = nearest_side(np.array([-0.053, -0.054]), [SQUARE])
    assert_allclose(corner.normal, [0.6, 0.8])
    other = nearest_side(np.array([-0.056, 0.01]), [SQUARE, SQUARE - [0.105, 0.0]])
    assert_allclose(other.point, [-0.055, 0.01])


class Arm:
    """An arm and an object whose messages a test sends."""

    def __init__(self, bench):
        self.bench = bench
        bench.start(ContactStateNode, "-p", "pushing:=true")
        for name in ("pusher", "pad_left"):
            bench.follow(WrenchStamped, f"/contact/{name}/force")
            bench.follow(PoseStamped, f"/contact/{name}/pose")
        bench.send("/object/footprint", outline_message(SQUARE, "object"), profile=LATCHED)
        bench.work(0.05)

    def poses(self, time, tip=0.444, turn=0.0):
        """Tell where tip and object are."""
        self.bench.send(
            "/pusher/pose", cv.pose_to_message(pose(tip, 0.0, 0.02, turn), time, "world")
        )
        told = cv.uncertain_pose_to_message(pose(0.5, 0.0), COVARIANCE, time, "world")
        self.bench.send("/object/pose", told)
        self.bench.work(0.02)

    def force(self, time, force, name="pusher"):
        """Tell what a sensor measures."""
        wrench = np.concatenate([np.zeros(3), force])
        self.bench.send(f"/pad/{name}/force_std", cv.std_to_message(STD, time, "pusher"))
        self.bench.work(0.02)
        self.bench.send(f"/pad/{name}/force", cv.wrench_to_message(wrench, time, "pusher"))
        self.bench.work(0.02)

    def told(self, kind, count, name="pusher"):
        """Return the messages of a contact once there are so many."""
        found = self.bench.seen[f"/contact/{name}/{kind}"]
        self.bench.until(lambda: len(found) >= count)
        return found


@pytest.fixture
def arm(bench):
    """An arm beside a square."""
    return Arm(bench)


def wrench(message):
    """Return [torque, force] (6,)."""
    return cv.wrench_to_core(message, "force", "world")


def test_a_force_waits_for_poses_and_is_placed_on_the_outline_in_world_axes(arm):
    arm.poses(1.00, 0.443, TURN)
    arm.force(1.01, [2.0, 0.0, 0.1])
    assert not arm.bench.seen["/contact/pusher/force"]
    arm.poses(1.02, 0.445, TURN)
    (force,) = arm.told("force", 1)
    assert force.stamp.sec + 1e-9 * force.stamp.nanosec == pytest.approx(1.01)
    assert_allclose(wrench(force)[3:], [2.0 * np.cos(TURN), 2.0 * np.sin(TURN), 0.1], atol=1e-9)
    (told,) = arm.told("pose", 1)
    place = cv.pose_to_core(told, "pose", "world")
    assert_allclose(place[:3, 3], [0.45, 0.0, 0.02], atol=1e-9)
    assert_allclose(place[:3, 2], [1.0, 0.0, 0.0], atol=1e-9)
    assert np.linalg.det(place[:3, :3]) == pytest.approx(1.0)


def test_forces_of_a_contact_come_out_in_their_order_and_noise_is_no_contact(arm):
    arm.poses(1.00)
    arm.force(1.005, [2.0, 0.0, 0.0])
    arm.force(1.015, [0.05, 0.0, 0.0])
    arm.poses(1.02)
    first, second = arm.told("force", 2)
    assert wrench(first)[3] == pytest.approx(2.0)
    assert not wrench(second).any()
    assert len(arm.told("pose", 1)) == 1


def test_a_pad_touches_in_the_middle_of_its_face(arm):
    arm.bench.send("/gripper/width", Float64(data=0.06))
    arm.bench.work(0.05)
    arm.poses(1.00, 0.5, TURN)
    arm.force(1.0, [0.0, -3.0, 0.0], "pad_left")
    (told,) = arm.told("pose", 1, "pad_left")
    place = cv.pose_to_core(told, "pose", "world")
    out = np.array([-np.sin(TURN), np.cos(TURN), 0.0])
    assert_allclose(place[:3, 3], [0.5, 0.0, 0.02] + 0.03 * out, atol=1e-9)
    assert_allclose(place[:3, 2], -out, atol=1e-9)


def test_a_force_far_from_the_object_is_no_contact_with_it(arm):
    arm.poses(1.00, 0.3)
    arm.force(1.0, [2.0, 0.0, 0.0])
    arm.bench.until(lambda: arm.bench.nodes[0].faults.counts["touch_off_the_object"] == 1)
    assert not arm.bench.seen["/contact/pusher/force"]


def test_a_pad_without_sensor_has_no_contact_and_an_unknown_one_is_refused(bench):
    node = bench.start(ContactStateNode, "-p", "pushing:=true", "-p", "sensed_pads:=[pad_right]")
    topics = {publisher.topic_name for publisher in node.publishers}
    assert {"/contact/pusher/force", "/contact/pad_right/force"} <= topics
    assert "/contact/pad_left/force" not in topics
    with pytest.raises(BadInputError, match="expected pad_left or pad_right"):
        SensedConfig(sensed_pads=("index",))
