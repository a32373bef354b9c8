"""The estimator node on a box with known inertia: signs, frames and units from end to end."""

import math
import re
from time import monotonic
from types import SimpleNamespace

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import InertiaStamped
from rclpy.parameter import Parameter
from synthetic_recording import COM, FORCE_STD, INERTIA_COM, MASS, held_box
from visualization_msgs.msg import MarkerArray

from tactile_dynamics_ros.core.friction.estimate import FrictionEstimate
from tactile_dynamics_ros.core.rigid_body.inertial_parameters import InertialParameters, KnownBody
from tactile_dynamics_ros.core.shape.superquadric.superquadric import Superquadric
from tactile_dynamics_ros.nodes.inertial_estimator import InertialEstimatorNode
from tactile_dynamics_ros.recording.yaml_files import read_body, write_body
from tactile_dynamics_ros.ros import conversions as cv
from tactile_dynamics_ros.ros import shape_messages
from tactile_dynamics_ros.ros.diagnostics import status_values
from tactile_dynamics_ros.ros.friction_messages import estimate_status
from tactile_dynamics_ros.ros.object_state import REPEAT
from tactile_dynamics_ros.ros.shape_messages import METRES_PER_NEWTON
from tactile_dynamics_ros.ros.shell import LATCHED

INERTIA = "/inertial_estimator/inertia"
STATUS = "/inertial_estimator/status"


def matrix(position, rotation):
    """Return a pose (4, 4)."""
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = rotation, position
    return pose


def play(bench, streams, start=0, stop=None, shift=0.0):
    """Publish what was measured, as the nodes before the estimator would."""
    pose = streams.pose
    for k in range(start, stop or len(pose.time)):
        time = float(pose.time[k]) + shift
        where = matrix(pose.position[k], pose.rotation[k])
        bench.send(
            "/object/pose",
            cv.uncertain_pose_to_message(where, pose.covariance[k], time, "world"),
        )
        for name, contact in streams.contacts.items():
            place = matrix(contact.position[k], contact.rotation[k])
            wrench = np.concatenate([np.zeros(3), contact.force[k]])
            std = np.full(3, FORCE_STD)
            topic = f"/contact/{name}"
            bench.send(f"{topic}/pose", cv.pose_to_message(place, time, "world"))
            bench.send(f"{topic}/force_std", cv.std_to_message(std, time, "world"))
            bench.send(f"{topic}/force", cv.wrench_to_message(wrench, time, "world"))
        if k % 10 == 9:
            bench.work()


@pytest.fixture
def estimator(bench):
    """A running estimator whose results are collected."""
    bench.start(InertialEstimatorNode, "-p", "update_rate_hz:=100.0")
    bench.follow(InertiaStamped, INERTIA, profile=LATCHED)
    bench.follow(DiagnosticArray, STATUS, profile=LATCHED)
    return bench


def status(bench, name):
    """Return the values of the newest status of a name."""
    return next(status_values(s) for s in bench.seen[STATUS][-1].status if s.name == name)


def settled(bench, samples):
    """Whether the newest status has used so many samples and has none left."""
    found = bench.seen[STATUS]
    return bool(found) and int(status(bench, "solver")["samples"]) >= samples


def test_known_box_is_found_with_its_uncertainty(estimator):
    streams = held_box(seconds=8.0).streams
    play(estimator, streams)
    estimator.until(lambda: settled(estimator, 700))
    inertia = estimator.seen[INERTIA][-1].inertia
    assert inertia.m == pytest.approx(MASS, rel=0.01)
    com = np.array([inertia.com.x, inertia.com.y, inertia.com.z])
    assert com == pytest.approx(COM, abs=1.5e-3)
    values = status(estimator, "parameters")
    for name, truth in (("mass", MASS), ("com_x", COM[0]), ("inertia_xx", INERTIA_COM[0, 0])):
        std = float(values[f"{name}_std"])
        assert 0.0 < std < math.inf
        assert abs(float(values[name]) - truth) < 5 * std
    assert len(status(estimator, "directions")) == 10
    assert float(status(estimator, "solver")["whitened_rms"]) == pytest.approx(1.0, abs=0.15)


def test_a_shape_from_its_topic_counts(bench):
    """Parts of object/shape are taken in the axes of the first; the status says what they add."""
    bench.start(InertialEstimatorNode, "-p", "update_rate_hz:=100.0", "-p", "shape:=topic")
    bench.follow(InertiaStamped, INERTIA, profile=LATCHED)
    bench.follow(DiagnosticArray, STATUS, profile=LATCHED)
    pose = matrix([0.4, 0.1, 0.05], np.eye(3))
    half = np.array([0.06, 0.08, 0.1])
    part = Superquadric(half, np.array([0.1, 0.1]), np.zeros(2), pose)
    names = {name for group in shape_messages.STDS.values() for name in group} - {"z", "yaw"}
    found = SimpleNamespace(shape=part, std=dict.fromkeys(names, 1e-3))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(shape_messages, "describe", lambda _: "a box")
        bench.send("/object/shape", shape_messages.shape_message([found], 1.0), profile=LATCHED)
    play(bench, held_box(seconds=4.0).streams)
    bench.until(lambda: settled(bench, 300))
    text = next(s.message for s in bench.seen[STATUS][-1].status if s.name == "parameters")
    assert "object/shape" in text


def test_contacts_go_with_the_fused_pose_where_the_hand_is_off(estimator):
    got, node = {}, estimator.nodes[0]
    node.estimator.add_contact = lambda c: got.update({(c.name, c.time): c.point})
    streams = held_box(seconds=0.3).streams
    shift = np.array([2e-3, 0.0, -1e-3])
    pose, contact = streams.pose, streams.contacts["index"]
    topics = ["/object/pose/kinematic", "/object/pose"]
    topics += ["/contact/index/pose", "/contact/index/force"]
    for k, time in enumerate(map(float, pose.time + 1.0)):
        place = matrix(contact.position[k], contact.rotation[k])
        wrench = np.concatenate([np.zeros(3), contact.force[k]])
        messages = [
            cv.uncertain_pose_to_message(
                matrix(pose.position[k] + off, pose.rotation[k]), pose.covariance[k], time, "world"
            )
            for off in (shift, 0.0)
        ]
        messages.append(cv.pose_to_message(place, time, "world"))
        messages.append(cv.wrench_to_message(wrench, time, "world"))
        for topic, message in zip(topics, messages, strict=True):
            estimator.send(topic, message)
    estimator.until(lambda: len(got) == len(pose.time))
    points = np.array([got["index", time] for time in sorted(time for _, time in got)])
    np.testing.assert_allclose(points, contact.position - shift, atol=1e-9)


def test_measured_friction_shows_the_grip_and_doubts_forces_that_it_cannot_hold(estimator):
    streams = held_box(seconds=4.0).streams
    index = streams.contacts["index"]
    index.force[300:] += 20.0 * index.rotation[300:, :, 0]
    found = {"object": FrictionEstimate("object", 8, 1.8, 0.1, (1.6, 2.0), 1.7, 0.02, 0.03)}
    topic, profile = "/friction_probe/estimate", LATCHED
    estimator.send(topic, estimate_status(found, True, ""), profile=profile)
    node = estimator.nodes[0]
    estimator.until(lambda: node._friction is not None)
    play(estimator, streams)
    estimator.until(
        lambda: node.faults.counts["beyond_friction_index"] >= 95 and settled(estimator, 300)
    )
    press = np.sum(index.force * index.rotation[:, :, 2], axis=1)
    drag = np.linalg.norm(index.force - press[:, None] * index.rotation[:, :, 2], axis=1)
    pulled = (drag / (1.6 * press))[300:]
    assert pulled.min() - 0.01 < float(status(estimator, "grip")["index"]) < pulled.max() + 0.01
    assert estimator.seen[INERTIA][-1].inertia.m == pytest.approx(MASS, rel=0.03)


def test_model_changes_live_and_unknown_effects_are_refused(estimator):
    streams = held_box(seconds=3.0).streams
    play(estimator, streams)
    node = estimator.nodes[0]
    assert node.set_parameters([Parameter("effects", value=["viscous_drag"])])[0].successful
    estimator.until(
        lambda: any(s.name == "effect viscous_drag" for s in estimator.seen[STATUS][-1].status),
        timeout=60.0,
    )
    assert "viscous_drag.c" in status(estimator, "effect viscous_drag")
    assert not node.set_parameters([Parameter("effects", value=["magic"])])[0].successful


def put_down(bench, streams, seconds):
    """Publish forces of zero, without poses, for some seconds of the stamps after a recording."""
    end = float(streams.pose.time[-1])
    for time in end + 0.01 * np.arange(1, round(100 * seconds)):
        bench.send("/contact/index/pose", cv.pose_to_message(np.eye(4), time, "world"))
        bench.send("/contact/index/force", cv.wrench_to_message(np.zeros(6), time, "world"))
        if round(100 * time) % 100 == 0:
            bench.work()


def test_the_status_never_stands_ok_while_nothing_is_held(estimator):
    node, statuses = estimator.nodes[0], estimator.seen[STATUS]
    estimator.until(lambda: bool(statuses))
    first = statuses[-1].status[0]
    assert (first.name, first.level) == ("state", DiagnosticStatus.WARN)
    assert first.message.startswith("waiting for object/pose, contact/index")
    assert all(s.level != DiagnosticStatus.OK for s in statuses[-1].status if s.message)
    play(estimator, held_box(seconds=6.0).streams)
    estimator.until(lambda: settled(estimator, 500))
    assert status(estimator, "state")["state"] == "held"
    ended = monotonic()
    estimator.until(lambda: status(estimator, "state")["state"] == "nothing held")
    assert monotonic() - ended < 2.0
    found = {s.name: s for s in statuses[-1].status}
    said = found["state"].message
    assert re.match(r"nothing held since \d s", said)
    assert found["parameters"].level == DiagnosticStatus.WARN
    assert found["parameters"].message.startswith(f"{said}; last grasp: ")
    assert float(status(estimator, "parameters")["mass"]) == pytest.approx(MASS, rel=0.02)
    statuses.clear()
    estimator.until(lambda: len(statuses) >= 2, timeout=5.0 * REPEAT)
    lasts = [float(status_values(message.status[0])["lasts"]) for message in statuses]
    assert 0.9 * REPEAT < np.diff(lasts)[0] < 2.0
    assert float(status(estimator, "state")["age"]) == pytest.approx(lasts[-1], abs=1.0)
    node.reset()
    statuses.clear()
    estimator.until(lambda: bool(statuses))
    assert status(estimator, "parameters") == {}


def set_effects(node, names):
    """Change the parameter as its service does."""
    kind = Parameter.Type.STRING_ARRAY
    return node.set_parameters_atomically([Parameter("effects", kind, names)])


def test_effects_set_after_the_grasp_are_fitted_to_it_and_the_answer_says_so(bench):
    bench.start(InertialEstimatorNode, "-p", "history:=5.0")
    bench.follow(DiagnosticArray, STATUS, profile=LATCHED)
    node, streams = bench.nodes[0], held_box(seconds=4.0).streams
    early = set_effects(node, ["viscous_drag"])
    assert early.successful
    assert "once 2 s of a grasp were measured; now: waiting for object/pose" in early.reason
    assert "rigid body alone" in set_effects(node, []).reason
    play(bench, streams)
    put_down(bench, streams, 12.0)
    bench.until(lambda: status(bench, "state")["state"] == "nothing held")
    answer = set_effects(node, ["viscous_drag"])
    assert "viscous_drag will be fitted to the last 4 s in which the object" in answer.reason
    assert "now: nothing held since" in answer.reason
    bench.until(
        lambda: any(s.name == "effect viscous_drag" for s in bench.seen[STATUS][-1].status),
        timeout=60.0,
    )
    found = {s.name: s for s in bench.seen[STATUS][-1].status}
    assert found["parameters"].level == DiagnosticStatus.WARN
    assert "last grasp:" in found["parameters"].message
    assert float(status(bench, "parameters")["mass"]) == pytest.approx(MASS, rel=0.03)
    keys = [pair.key for s in bench.seen[STATUS][-1].status for pair in s.values]
    assert len(keys) == len(set(keys))


def test_reset_and_restarted_clock_forget_the_measurements(estimator):
    streams = held_box(seconds=3.0).streams
    play(estimator, streams)
    estimator.until(lambda: settled(estimator, 200))
    estimator.nodes[0].reset()
    play(estimator, streams, stop=60, shift=10.0)
    estimator.until(lambda: estimator.seen[STATUS][-1].header.stamp.sec >= 10)
    assert int(status(estimator, "solver")["samples"]) < 100
    play(estimator, streams, stop=60, shift=0.0)
    estimator.until(lambda: estimator.seen[STATUS][-1].header.stamp.sec < 5)
    assert estimator.nodes[0].faults.counts["clock_restarted"] == 1


def test_bad_messages_are_counted_and_harmless(estimator):
    streams = held_box(seconds=3.0).streams
    play(estimator, streams, stop=100)
    pose = np.eye(4)
    nan = np.full(6, np.nan)
    estimator.send("/contact/index/force", cv.wrench_to_message(nan, 1.0, "world"))
    estimator.send("/contact/index/force", cv.wrench_to_message(np.ones(6), 1.0, "palm"))
    estimator.send(
        "/object/pose", cv.uncertain_pose_to_message(pose, 1e-6 * np.eye(6), 0.5, "world")
    )
    estimator.send("/object/pose", cv.uncertain_pose_to_message(pose, np.eye(6), 2.0, "hand"))
    counts = estimator.nodes[0].faults.counts
    estimator.until(lambda: {"not_finite", "wrong_frame", "stamp_repeated"} <= set(counts))
    assert counts["wrong_frame"] == 2
    play(estimator, streams, start=100)
    estimator.until(lambda: settled(estimator, 200))


def test_contact_names_are_free(bench):
    node = bench.start(InertialEstimatorNode, "-p", "contacts:=[wrist]")
    topics = {name for name, _ in node.get_topic_names_and_types()}
    assert "/contact/wrist/force" in topics
    assert "/contact/index/force" not in topics


def test_markers_show_the_forces_and_the_centre_of_mass_where_they_are(bench):
    bench.start(InertialEstimatorNode, "-p", "update_rate_hz:=100.0")
    markers = bench.follow(MarkerArray, "/object/markers", profile=LATCHED)
    streams = held_box().streams
    play(bench, streams)
    found = {(m.ns, m.text): m for m in markers[-1].markers}
    assert {text for ns, text in found if ns == "forces"} == set(streams.contacts)
    ball = found["centre_of_mass", ""]
    centres = streams.pose.position + streams.pose.rotation @ COM
    place = [ball.pose.position.x, ball.pose.position.y, ball.pose.position.z]
    assert np.linalg.norm(centres - place, axis=1).min() < 4e-3 < np.linalg.norm(COM)
    index, contact = found["forces", "index"], streams.contacts["index"]
    start, tip = (np.array([p.x, p.y, p.z]) for p in index.points)
    k = np.abs(contact.position - start).sum(axis=1).argmin()
    np.testing.assert_allclose(tip - start, METRES_PER_NEWTON * contact.force[k], atol=1e-3)


def known_box(path, mass=MASS):
    """A file of an earlier grasp of the box, known to 1 %."""
    phi = InertialParameters(mass, COM, INERTIA_COM).dynamic_parameters
    std = np.array([0.01 * MASS, *[0.01 * MASS * 0.05] * 3, *[0.05 * INERTIA_COM[0, 0]] * 6])
    return write_body(KnownBody(phi, np.diag(std**2), "before", (), {}, 2), path)


def with_memory(bench, file, seconds):
    node = bench.start(InertialEstimatorNode, "-p", f"prior:={file}", "-p", f"save:={file}")
    bench.follow(InertiaStamped, INERTIA, profile=LATCHED)
    bench.follow(DiagnosticArray, STATUS, profile=LATCHED)
    play(bench, held_box(seconds=seconds).streams)
    bench.until(lambda: settled(bench, int(75 * seconds)))
    return node


def test_a_second_grasp_starts_where_the_first_ended(bench, tmp_path):
    file = known_box(tmp_path / "box.yaml")
    node = with_memory(bench, file, 7.0)
    bench.until(lambda: float(status(bench, "parameters")["mass_std"]) < 0.01 * MASS)
    found = status(bench, "parameters")
    assert float(found["mass"]) == pytest.approx(MASS, rel=0.02)
    memory = status(bench, "memory")
    assert (memory["recordings"], memory["changed"]) == ("2", "")
    node.reset()
    after = read_body(file)
    assert after.recordings == 3
    assert after.phi[0] == pytest.approx(float(found["mass"]), rel=0.01)


def test_a_changed_object_is_noticed_and_its_file_is_kept(bench, tmp_path):
    file = known_box(tmp_path / "box.yaml", mass=1.5 * MASS)
    before = file.read_text()
    node = with_memory(bench, file, 7.0)
    bench.until(lambda: "mass" in status(bench, "memory")["changed"].split(","))
    assert float(status(bench, "parameters")["mass"]) == pytest.approx(MASS, rel=0.03)
    node.reset()
    assert file.read_text() == before


def test_a_file_of_earlier_grasps_that_cannot_be_is_counted_and_left_alone(bench, tmp_path):
    file = known_box(tmp_path / "box.yaml")
    known = read_body(file)
    text = file.read_text().replace("recordings: 2", "recordings: abc")
    file.write_text(text)
    node = bench.start(InertialEstimatorNode, "-p", f"prior:={file}", "-p", f"save:={file}")
    assert node.faults.counts["prior_not_read"] == 1
    node._memory._newest = known
    node.reset()
    assert node.faults.counts["prior_not_read"] == 2
    assert file.read_text() == text, "a person may mend it"
    file.unlink()
    node._memory._newest = known
    node.reset()
    assert node.faults.counts["prior_not_read"] == 2
    assert read_body(file).recordings == 2


def test_a_tool_is_taken_out_of_what_is_published(bench, tmp_path):
    share = InertialParameters(0.6 * MASS, COM, 0.6 * INERTIA_COM)
    file = write_body(KnownBody.exact(share, "part"), tmp_path / "part.yaml")
    bench.start(InertialEstimatorNode, "-p", f"tool:={file}")
    bench.follow(InertiaStamped, INERTIA, profile=LATCHED)
    bench.follow(DiagnosticArray, STATUS, profile=LATCHED)
    play(bench, held_box(seconds=5.0).streams)
    bench.until(lambda: settled(bench, 400))
    inertia = bench.seen[INERTIA][-1].inertia
    assert inertia.m == pytest.approx(0.4 * MASS, rel=0.03)
    assert float(status(bench, "parameters")["mass"]) == pytest.approx(inertia.m, rel=1e-6)
