"""The property estimator as a node: frames, silent contacts, what it says before a push, reset."""

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import PoseStamped
from rclpy.parameter import Parameter

from tactile_dynamics_ros.core.planar.filter.patch import PatchProcess
from tactile_dynamics_ros.core.planar.filter.process import PusherMotion
from tactile_dynamics_ros.core.planar.known import KnownPushed
from tactile_dynamics_ros.core.planar.properties.estimate import PushedEstimate
from tactile_dynamics_ros.core.rigid_body.rotation import exp_so3
from tactile_dynamics_ros.nodes.property_estimator import PropertyEstimatorNode
from tactile_dynamics_ros.recording.pushed.known_files import read_known, write_known
from tactile_dynamics_ros.ros import conversions as cv
from tactile_dynamics_ros.ros.diagnostics import status_values
from tactile_dynamics_ros.ros.names import PROPERTY_STATUS, SUPPORT_POSE
from tactile_dynamics_ros.ros.pusher_streams import outline_message
from tactile_dynamics_ros.ros.shell import LATCHED

BLOCK = np.array([[-0.05, -0.03], [0.05, -0.03], [0.05, 0.03], [-0.05, 0.03]])
COVARIANCE = np.diag([1.0, 1.0, 3e-3, 5e-4, 5e-4, 1.0]) ** 2


def pose(x, y, z, yaw):
    out = np.eye(4)
    out[:3, :3], out[:3, 3] = exp_so3(np.array([0.0, 0.0, yaw])), [x, y, z]
    return out


@pytest.fixture
def node(bench):
    """A node that has heard where a turned table is, and an outline."""
    node = bench.start(PropertyEstimatorNode)
    bench.seen_status = bench.follow(DiagnosticArray, PROPERTY_STATUS, profile=LATCHED)
    hear_table(bench, node)
    return node


def hear_table(bench, node):
    """Tell where the table is, and the outline."""
    table = cv.pose_to_message(pose(0.1, 0.2, 0.4, 0.5 * np.pi), 1.0, "world")
    for kind, topic, message in (
        (PoseStamped, SUPPORT_POSE, table),
        (type(outline_message(BLOCK, "object")), "object/footprint", outline_message(BLOCK, "o")),
    ):
        publisher = node.create_publisher(kind, topic, LATCHED)
        publisher.publish(message)
    bench.until(lambda: node.live.outline is not None and node._streams._X_SW[0, 3] != 0.0)


def pushed_block(seconds):
    """Poses of a block of 1 kg that a tip pushes at 20 mm/s, places of the tip, forces; at 100 Hz.

    Friction is 0.3, so that the force of a straight push is 2.94 N.
    """
    process, states = PatchProcess(BLOCK), np.zeros((1, 6))
    own = np.array([[np.log(0.3), 0.0, 0.0, 0.0, np.log(0.4)]])
    rows = []
    for k in range(round(100 * seconds)):
        tip = np.array([-0.05 + 2e-4 * k, 0.0, 0.0])
        after = tip + np.array([2e-4, 0.0, 0.0])
        motion = PusherMotion(tip, after, 0.01, touching=True, normal=np.array([1.0, 0.0]))
        found = process.predict(states, own, motion)
        states = found.states
        rows.append((states[0, :3], after, found.wrench[0]))
    return rows


def tell_push(bench, start, rows, noise):
    """Send a push on the turned table, sensed with noise."""
    for k, (at, tip, wrench) in enumerate(rows):
        time = start + 0.01 * k
        seen = at + noise.normal(size=3) * [5e-4, 5e-4, 3e-3]
        where = on_table(*seen)
        for topic, message in (
            ("object/pose", cv.uncertain_pose_to_message(where, COVARIANCE, time, "world")),
            ("pusher/pose", cv.pose_to_message(on_table(*tip[:2], 0.0, 0.02), time, "world")),
            ("contact/pusher/pose", cv.pose_to_message(facing(tip), time, "world")),
        ):
            bench.send(topic, message)
        force = wrench[:2] + 0.03 * noise.normal(size=2)
        measured = np.array([0.0, 0.0, 0.0, -force[1], force[0], 0.0])
        bench.send("contact/pusher/force", cv.wrench_to_message(measured, time, "world"))
        bench.work(0.002)


def on_table(x, y, yaw, z=0.0):
    """A pose of the table's frame in the world."""
    return pose(0.1 - y, 0.2 + x, 0.4 + z, yaw + 0.5 * np.pi)


def facing(tip):
    """Pose of the contact, whose z points into the block."""
    out = on_table(tip[0], tip[1], 0.0, 0.02)
    out[:3, :3] = out[:3, :3] @ np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    return out


@pytest.mark.parametrize("model", ["graph", "graph_residual"])
def test_a_push_tells_a_learnt_model_the_friction_force_and_no_mass(bench, model):
    node = bench.start(PropertyEstimatorNode, "-p", f"model:={model}")
    statuses = bench.follow(DiagnosticArray, PROPERTY_STATUS, profile=LATCHED)
    hear_table(bench, node)
    tell_push(bench, 5.0, pushed_block(1.5), np.random.default_rng(0))
    told = [{}]

    def told_enough():
        told.extend({s.name: status_values(s) for s in seen.status} for seen in statuses)
        statuses.clear()
        return int(told[-1].get("solver", {"touched": 0})["touched"]) > 16

    bench.until(told_enough)
    newest = told[-1]
    assert newest["solver"]["model"] == model
    assert newest["solver"]["source"] == "filter"
    assert {"mass", "friction"} <= {*newest["link_1"]["undetermined"].split(",")}
    force, std = (float(newest["link_1"][f"friction_force_n{end}"]) for end in ("", "_std"))
    assert abs(force - 0.3 * 9.81) < 2.0 * std
    assert std < 0.2 * force
    assert node.live.faster == 0


def tell(bench, start, count, force=0.0):
    """Send poses of object and pusher and forces, without the pose of the contact."""
    for k in range(count):
        time = start + 0.01 * k
        seen = cv.uncertain_pose_to_message(pose(0.1, 0.7, 0.4, 1.0), COVARIANCE, time, "world")
        bench.send("object/pose", seen)
        bench.send("pusher/pose", cv.pose_to_message(pose(0.1, 0.6, 0.42, 0.0), time, "world"))
        wrench = np.array([0.0, 0.0, 0.0, 0.0, force, 0.0])
        bench.send("contact/pusher/force", cv.wrench_to_message(wrench, time, "world"))
        bench.work(0.002)


def test_before_a_push_the_pose_is_followed_on_the_table_and_nothing_is_known(bench, node):
    tell(bench, 5.0, 60)
    bench.until(lambda: any(s.name == "motion" for m in bench.seen_status[-1:] for s in m.status))
    newest = {s.name: s for s in bench.seen_status[-1].status}
    assert "nothing was pushed yet" in newest["link_1"].message
    values = status_values(newest["link_1"])
    assert {"mass", "friction_force_n", "com"} <= {*values["undetermined"].split(",")}
    moved = status_values(newest["motion"])
    assert float(moved["x"]) == pytest.approx(0.5, abs=1e-4)
    assert float(moved["y"]) == pytest.approx(0.0, abs=1e-4)
    assert float(moved["yaw"]) == pytest.approx(1.0 - 0.5 * np.pi, abs=1e-3)
    assert not [kind for kind in node.faults.counts if kind.startswith("force_without")]
    assert status_values(newest["solver"])["source"] == "nothing"


def test_the_status_says_what_is_awaited_and_when_the_pose_falls_silent(bench):
    node = bench.start(PropertyEstimatorNode)
    statuses = bench.follow(DiagnosticArray, PROPERTY_STATUS, profile=LATCHED)

    def newest(name):
        return next(status for status in statuses[-1].status if status.name == name)

    bench.until(lambda: bool(statuses))
    assert newest("state").message == "waiting for object/footprint, object/pose, pusher/pose"
    assert newest("link_1").level == DiagnosticStatus.WARN
    answer = node.set_parameters_atomically([Parameter("effects", value=["support_tilt"])])
    assert answer.reason == "applies from the next push on: nothing was pushed yet"
    hear_table(bench, node)
    tell(bench, 5.0, 40)
    bench.until(lambda: newest("state").message == "followed, not touched")
    bench.until(lambda: newest("state").level == DiagnosticStatus.WARN, timeout=5.0)
    silent = newest("state").message
    assert silent.startswith("waiting for object/pose, pusher/pose, silent since ")
    assert newest("link_1").message.startswith(f"{silent}; before: ")
    assert "mass" in status_values(newest("link_1"))
    statuses.clear()
    bench.until(lambda: len(statuses) >= 2, timeout=5.0)


def test_a_force_without_its_place_is_counted_and_not_used(bench, node):
    tell(bench, 5.0, 40, force=2.0)
    bench.until(lambda: node.faults.counts["force_without_pose_pusher"] > 5)
    assert node.live.tracker.touched == 0


def test_a_reset_forgets_measurements_and_keeps_the_outline(bench, node):
    tell(bench, 5.0, 40)
    bench.until(lambda: node.live.properties() is not None)
    assert "outline is kept" in node.reset()
    assert node.live.properties() is None
    assert node.live.outline is not None
    tell(bench, 6.0, 40)
    bench.until(lambda: node.live.properties() is not None)


def test_pushes_start_where_earlier_ones_ended_and_a_changed_object_is_noticed(bench, tmp_path):
    file = tmp_path / "block.yaml"
    values, std = (
        np.array([np.log(3.0), np.log(1.5), 0.01, -0.005]),
        np.array([0.05, 0.1, 1e-3, 1e-3]),
    )
    write_known(KnownPushed(values, np.diag(std**2), "before", (), 2), file)
    node = bench.start(PropertyEstimatorNode, "-p", f"prior:={file}", "-p", f"save:={file}")
    statuses = bench.follow(DiagnosticArray, PROPERTY_STATUS, profile=LATCHED)
    hear_table(bench, node)
    tell(bench, 5.0, 60)
    bench.until(lambda: bool(statuses) and node._memory._begun)
    statuses.clear()
    tell(bench, 5.6, 20)
    bench.until(lambda: bool(statuses))
    newest = {s.name: status_values(s) for s in statuses[-1].status}
    assert float(newest["link_1"]["friction_force_n"]) == pytest.approx(3.0, rel=0.01)
    assert float(newest["link_1"]["friction_force_n_std"]) == pytest.approx(3.0 * 0.054, rel=0.1)
    assert (newest["memory"]["recordings"], newest["memory"]["changed"]) == ("2", "")
    found = fitted(3.03, 1.5)
    both = node._memory.combine(found)
    assert both.values["friction_force_n"][1] < found.values["friction_force_n"][1]
    assert read_known(file).recordings == 3
    before = file.read_text()
    assert node._memory.combine(fitted(3.03, 4.5)).values["mass"][0] == 4.5
    assert node.faults.counts["changed_object"] == 1
    assert node._memory.statuses()[0].level == DiagnosticStatus.WARN
    assert file.read_text() == before
    node.reset()
    assert status_values(node._memory.statuses()[0])["recordings"] == "3"


def fitted(force, mass):
    """An estimate from pushes, 5 % wide."""
    values = {
        "mass": (mass, 0.05 * mass),
        "friction": (force / mass / 9.81, 0.02),
        "friction_force_n": (force, 0.05 * force),
        "com_x": (0.01, 1e-3),
        "com_y": (-0.005, 1e-3),
        "friction_radius_m": (0.04, 1e-3),
        "inertia_zz": (1e-3, 1e-4),
    }
    return PushedEstimate(100, 2.0, values, (), np.diag([0.05, 0.05, 1e-3, 1e-3]) ** 2, 1.0)
