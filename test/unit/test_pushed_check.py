"""What `check` says of pushes before the experiment is over."""

import json
from dataclasses import replace

import numpy as np
import pytest

from tactile_dynamics_ros.api import pushed_checks
from tactile_dynamics_ros.api.pushed_checks import check_pushes
from tactile_dynamics_ros.api.pushed_estimates import EstimateOfPushes
from tactile_dynamics_ros.cli.main import main
from tactile_dynamics_ros.cli.record_check import check_so_far
from tactile_dynamics_ros.core.planar.actions.continuation import continued
from tactile_dynamics_ros.core.planar.actions.information import Belief, Candidate, PredictedObject
from tactile_dynamics_ros.core.planar.properties.estimate import estimate
from tactile_dynamics_ros.recording.pushed import PushedRecording
from tactile_dynamics_ros.synthetic import pushed

SLOW = pushed.ActionOptions(count=2, speed=(0.03, 0.04), travel=0.04, duration=1.2, pauses=0)

QUICK = pushed.ActionOptions(count=2, speed=(0.1, 0.2))


@pytest.fixture(scope="module")
def slow():
    """Two slow pushes, which hardly tell the mass."""
    return pushed.generate([7], {}, pushed.PushOptions(actions=SLOW))[0]


@pytest.fixture(scope="module")
def checked(slow):
    return check_pushes(PushedRecording(slow.streams, "slow.mcap"))


def test_slow_pushes_lack_the_mass_and_a_faster_one_is_proposed(checked):
    assert checked.lacking == ["mass"]
    assert checked.addition.choice.candidate.speed > 0.1
    assert checked.promised["mass"] < 0.8 * checked.relative["mass"]
    lines = "\n".join(checked.lines())
    assert f"{checked.addition.many} would bring it to" in lines
    assert lines.endswith("not ready")
    assert checked.to_json()["addition"]["count"] == checked.addition.count


def test_a_simulated_push_goes_on_from_the_last_pose_with_the_friction_believed(slow):
    truth = slow.truth()["links"][0]
    mean = np.array(
        [np.log(truth["mass"] * truth["friction"]), np.log(truth["mass"]), *truth["com"]]
    )
    thing = PredictedObject(slow.scene.thing.links[0].corners, push_height=slow.scene.tip.height)
    middle, along = thing.outline[:2].mean(axis=0), thing.outline[1] - thing.outline[0]
    normal = np.array([-along[1], along[0]]) / np.linalg.norm(along)
    push = Candidate(middle, normal, normal, 0.1, 0.04, 4.0)
    belief, random = Belief(mean, np.eye(4)), np.random.default_rng(0)
    longer = continued(slow.streams, thing, belief, push, random)
    link, contact = longer.links[0], longer.contacts["pusher"]
    new = link.time >= longer.session_starts[-1]
    assert np.all(np.diff(link.time) > 0.0)
    assert np.allclose(link.pose[new][0], slow.streams.links[0].pose[-1], atol=5e-3)
    assert np.linalg.norm(link.pose[-1, :2] - link.pose[new][0, :2]) > 0.02
    measured = np.linalg.norm(contact.force[contact.time > longer.session_starts[-1] + 0.2], axis=1)
    assert 0.6 < np.median(measured) / truth["friction_force_n"] < 1.2


def test_clocks_that_differ_are_a_fault():
    """Starts and stops tell it; steady slow pushes do not."""
    streams = pushed.generate([7], {}, pushed.PushOptions(actions=QUICK))[0].streams
    late = {n: replace(c, time=c.time + 0.04) for n, c in streams.contacts.items()}
    found = check_pushes(PushedRecording(replace(streams, contacts=late), "late.mcap"))
    assert any("stamps of forces and poses seem to differ by" in fault for fault in found.faults)
    assert not found.ready


def test_where_friction_had_to_differ_clocks_are_no_fault_but_a_note(monkeypatch):
    """A lean that the model lacks makes both."""
    actions = pushed.ActionOptions(count=3, speed=(0.08, 0.15), travel=0.05)
    options = pushed.PushOptions(actions=actions)
    [made] = pushed.generate([31], {"support_tilt": 2.0}, options)
    leaning = replace(estimate(made.streams), delay=(-0.02, 0.001))
    assert leaning.is_uneven and "10 % from place to place" in "".join(leaning.lines())
    assert leaning.to_document()["friction_variation"] == 0.1
    recording = PushedRecording(made.streams, "leans.mcap")
    asked = EstimateOfPushes(recording, leaning)
    monkeypatch.setattr(pushed_checks.EstimateOfPushes, "of", lambda _: asked)
    found = check_pushes(recording)
    assert found.faults == ()
    assert any("or something else is missing" in remark for remark in found.remarks)


def test_command_and_recorder_say_the_same(slow, tmp_path, capsys):
    path = tmp_path / "slow.mcap"
    PushedRecording(slow.streams, "slow").to_bag(path)
    assert main(["check", str(path), "--goal", "40", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["ready"] and told["parameters"]["mass"]["relative"] < 0.4
    assert "mass is known to" in check_so_far(str(path), None).text
