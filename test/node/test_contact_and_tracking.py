"""Contact state and kinematic tracker as nodes: frames, gating, faults."""

import numpy as np
import pytest
from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped, WrenchStamped
from std_msgs.msg import Bool

from tactile_dynamics_ros.core.rigid_body.rotation import log_so3
from tactile_dynamics_ros.core.robot.hand_kinematics import HandKinematics
from tactile_dynamics_ros.core.robot.robot_file import load_robot
from tactile_dynamics_ros.core.tracking.kinematic_tracker import KinematicTracker
from tactile_dynamics_ros.nodes.contact_state import ContactStateNode
from tactile_dynamics_ros.nodes.kinematic_tracker import KinematicTrackerNode
from tactile_dynamics_ros.ros import conversions as cv
from tactile_dynamics_ros.ros.shell import LATCHED

ROBOT = load_robot()

POSITIONS = ROBOT.start
KINEMATICS = HandKinematics()
VISION_COVARIANCE = np.diag([np.deg2rad(0.3) ** 2] * 3 + [3e-4**2] * 3)
"""About what `vision_tracker` states."""
FORCE = np.array([0.2, -0.1, -1.5])
SKIN = {finger: np.array([4e-3, 0.0, -5.7e-3]) for finger in ROBOT.fingers}
"""Where the skin touches, sensor frames."""


def send_joints(bench, time, positions=POSITIONS):
    bench.send("/joint_states", cv.joints_to_message(ROBOT.joint_names, time, positions))


def send_force(bench, time, finger="index", force=FORCE, frame=None):
    frame = frame or f"biotac_{finger}"
    std = np.full(3, 0.05)
    bench.send(f"/biotac/{finger}/force_std", cv.std_to_message(std, time, frame))
    wrench = np.concatenate([np.zeros(3), force])
    bench.send(f"/biotac/{finger}/force", cv.wrench_to_message(wrench, time, frame))


@pytest.fixture
def contacts(bench):
    """A running contact_state whose index contact is collected."""
    bench.start(ContactStateNode)
    bench.follow(WrenchStamped, "/contact/index/force")
    bench.follow(PoseStamped, "/contact/index/pose")
    return bench


def test_force_is_turned_into_the_world_at_the_time_of_the_force(contacts):
    moved = POSITIONS.copy()
    moved[0] += 0.4
    send_joints(contacts, 1.00)
    send_joints(contacts, 1.02, moved)
    contacts.work(0.05)
    send_force(contacts, 1.01)
    found = contacts.seen["/contact/index/force"]
    contacts.until(lambda: found)
    middle = 0.5 * (POSITIONS + moved)
    rotation = KINEMATICS.sensor_pose("index", middle)[:3, :3]
    wrench = cv.wrench_to_core(found[0], "/contact/index/force", "world")
    assert wrench[3:] == pytest.approx(rotation @ FORCE, abs=1e-9)
    assert not wrench[:3].any()
    assert cv.to_seconds(found[0].stamp) == pytest.approx(1.01)
    contacts.until(lambda: contacts.seen["/contact/index/pose"])
    pose = cv.pose_to_core(contacts.seen["/contact/index/pose"][0], "/p", "world")
    assert pose[:3, 2] @ (rotation @ FORCE) > 0.9 * np.linalg.norm(FORCE)
    tip = KINEMATICS.sensor_pose("index", middle)[:3, 3]
    assert 0.005 < np.linalg.norm(pose[:3, 3] - tip) < 0.03


def test_force_waits_for_joint_states_that_come_later(contacts):
    send_joints(contacts, 1.00)
    contacts.work(0.05)
    send_force(contacts, 1.005)
    contacts.work(0.1)
    assert contacts.seen["/contact/index/force"] == []
    send_joints(contacts, 1.01)
    contacts.until(lambda: contacts.seen["/contact/index/force"])


def test_touch_below_the_threshold_is_no_contact(contacts):
    send_joints(contacts, 1.00)
    send_joints(contacts, 1.02)
    contacts.work(0.05)
    send_force(contacts, 1.01, force=np.array([0.0, 0.0, -0.001]))
    contacts.until(lambda: contacts.seen["/contact/index/force"])
    assert not cv.wrench_to_core(contacts.seen["/contact/index/force"][0], "/f").any()


def test_force_of_another_finger_or_without_joints_is_counted(contacts):
    counts = contacts.nodes[0].faults.counts
    send_joints(contacts, 1.00)
    send_force(contacts, 1.00, frame="biotac_thumb")
    contacts.until(lambda: counts["wrong_frame"] == 1)
    send_joints(contacts, 1.02)
    contacts.work(0.05)
    send_force(contacts, 0.5)
    contacts.until(lambda: counts["force_older_than_joint_states"] == 1)
    contacts.send("/joint_states", cv.joints_to_message(ROBOT.joint_names[:5], 1.1, POSITIONS[:5]))
    contacts.until(lambda: counts["missing_joint"] == 1)


class Grasp:
    """A hand that holds an object rigidly, as messages."""

    def __init__(self, bench):
        self.bench = bench
        self.time = 1.0
        self.offset = np.eye(4)
        self.offset[:3, 3] = [0.0, 0.02, -0.03]
        bench.start(KinematicTrackerNode)
        bench.follow(PoseWithCovarianceStamped, "/object/pose/kinematic")
        bench.follow(PoseWithCovarianceStamped, "/object/pose")

    def truth(self, positions):
        return KINEMATICS.sensor_pose("thumb", positions) @ self.offset

    def send(self, positions=POSITIONS, fingers=ROBOT.fingers):
        """Publish 10 ms that nobody has taken yet."""
        self.time += 0.01
        send_joints(self.bench, self.time, positions)
        for finger in ROBOT.fingers:
            wrench = np.concatenate([np.zeros(3), FORCE * (finger in fingers)])
            message = cv.wrench_to_message(wrench, self.time, "world")
            self.bench.send(f"/contact/{finger}/force", message)

    def touch(self, positions):
        """Publish where the skin touches at the next 10 ms."""
        for finger in ROBOT.fingers:
            pose = KINEMATICS.sensor_pose(finger, positions).copy()
            pose[:3, 3] += pose[:3, :3] @ SKIN[finger]
            message = cv.pose_to_message(pose, self.time + 0.01, "world")
            self.bench.send(f"/contact/{finger}/pose", message)

    def step(self, positions=POSITIONS, fingers=ROBOT.fingers, vision=True):
        """Publish 10 ms."""
        self.send(positions, fingers)
        self.bench.work(0.01)
        if vision:
            pose = self.truth(positions)
            message = cv.uncertain_pose_to_message(pose, VISION_COVARIANCE, self.time, "world")
            self.bench.send("/object/pose/vision", message)
            self.bench.work(0.01)

    def poses(self, topic="/object/pose"):
        return self.bench.seen[topic]


@pytest.fixture
def grasp(bench):
    """A grasp that the tracker follows."""
    return Grasp(bench)


def start_tracking(grasp):
    for _ in range(200):
        grasp.step()
        if grasp.poses():
            return
    raise AssertionError("tracking did not start")


def test_tracked_pose_starts_at_vision_and_follows_the_hand(grasp):
    start_tracking(grasp)
    moved = POSITIONS.copy()
    for _ in range(30):
        moved = moved + 0.01 * np.r_[np.ones(7), np.zeros(16)]
        grasp.step(moved, vision=False)
    pose, covariance = cv.uncertain_pose_to_core(grasp.poses()[-1], "/object/pose", "world")
    stamp = cv.to_seconds(grasp.poses()[-1].stamp)
    assert stamp == pytest.approx(grasp.time)
    truth = grasp.truth(moved)
    assert np.linalg.norm(pose[:3, 3] - truth[:3, 3]) < 1e-3
    assert np.linalg.norm(log_so3(pose[:3, :3] @ truth[:3, :3].T)) < 5e-3
    assert (np.linalg.eigvalsh(covariance) > 0).all()


def test_tracking_ends_when_the_thumb_lets_go(grasp):
    start_tracking(grasp)
    for _ in range(60):
        grasp.step(fingers=("index", "middle"), vision=False)
    count = len(grasp.poses("/object/pose/kinematic"))
    for _ in range(10):
        grasp.step(fingers=("index", "middle"), vision=False)
    assert len(grasp.poses("/object/pose/kinematic")) == count


def test_tracked_pose_does_not_leap_while_forces_are_late(grasp):
    start_tracking(grasp)
    spread = POSITIONS + 0.02 * np.r_[np.zeros(7), np.ones(16)]
    grasp.step(spread, vision=False)
    for _ in range(15):
        grasp.time += 0.01
        send_joints(grasp.bench, grasp.time, spread)
        grasp.bench.work(0.01)
    topic = "/object/pose/kinematic"
    grasp.bench.until(lambda: cv.to_seconds(grasp.poses(topic)[-1].stamp) > grasp.time - 0.001)
    places = [cv.uncertain_pose_to_core(m, topic, "world")[0][:3, 3] for m in grasp.poses(topic)]
    assert np.ptp(places[-15:], axis=0).max() < 1e-6
    for _ in range(3):
        grasp.step(spread, fingers=("thumb", "index"), vision=False)
    freed = cv.uncertain_pose_to_core(grasp.poses(topic)[-1], topic, "world")[0][:3, 3]
    assert np.linalg.norm(freed - places[-1]) < 1e-6


def test_object_rolls_on_the_contact_points_that_are_told(grasp):
    start_tracking(grasp)
    goal = 0.1 * np.r_[np.zeros(7), np.tile([0.0, 1.0, -1.0, 0.5], 4)]
    path = [POSITIONS + share * goal for share in np.linspace(0.0, 1.0, 30)]
    for positions in path:
        grasp.touch(positions)
        grasp.step(positions, vision=False)
    topic = "/object/pose/kinematic"
    grasp.bench.until(lambda: cv.to_seconds(grasp.poses(topic)[-1].stamp) > grasp.time - 0.001)
    found, _ = cv.uncertain_pose_to_core(grasp.poses(topic)[-1], topic, "world")
    gaps = []
    for points in (SKIN, dict.fromkeys(ROBOT.fingers, np.zeros(3))):
        tracker = KinematicTracker(KINEMATICS)
        tracker.initialise(grasp.truth(POSITIONS), POSITIONS, time=0.0)
        for positions in path:
            expected, _ = tracker.update(positions, 0.0, points)
        gaps.append(np.linalg.norm(found[:3, 3] - expected[:3, 3]))
    assert gaps[0] < 2e-4
    assert gaps[1] > 4.0 * gaps[0]


def test_tracking_goes_on_after_messages_have_piled_up(grasp):
    start_tracking(grasp)
    for _ in range(60):
        grasp.send()
    topic = "/object/pose/kinematic"
    grasp.bench.until(lambda: cv.to_seconds(grasp.poses(topic)[-1].stamp) > grasp.time - 0.001)


def test_fused_pose_is_silent_while_the_object_stands_on_the_table(grasp):
    grasp.bench.send("/object/held", Bool(data=False), profile=LATCHED)
    for _ in range(40):
        grasp.step()
    assert grasp.poses("/object/pose/kinematic")
    assert not grasp.poses()
    grasp.bench.send("/object/held", Bool(data=True))
    grasp.bench.work(0.05)
    for _ in range(30):
        grasp.step()
    assert grasp.poses()


def test_fused_pose_follows_slip_in_the_hand_that_vision_sees(grasp):
    start_tracking(grasp)
    for k in range(120):
        grasp.offset[0, 3] += 4e-5 if k < 80 else 0.0
        grasp.step()
    truth = grasp.truth(POSITIONS)[:3, 3]
    errors = []
    for topic in ("/object/pose", "/object/pose/kinematic"):
        pose, _ = cv.uncertain_pose_to_core(grasp.poses(topic)[-1], topic, "world")
        errors.append(np.linalg.norm(pose[:3, 3] - truth))
    assert errors[0] < 1e-3
    assert errors[1] > 2.5e-3
