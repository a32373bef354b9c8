"""The model check as a node: error near one on clean data, above it where a drag is missing."""

import json
import time
from functools import partial

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import WrenchStamped
from std_msgs.msg import Float64
from synthetic_recording import held_box
from test_inertial_estimator import play, put_down

from tactile_dynamics_ros.core.streams.joining import cut_streams
from tactile_dynamics_ros.nodes.model_check import ModelCheckNode
from tactile_dynamics_ros.ros.conversions import header
from tactile_dynamics_ros.ros.diagnostics import status_message
from tactile_dynamics_ros.ros.shell import LATCHED
from tactile_dynamics_ros.synthetic import ScenarioOptions, generate_at_whitened_rms

ERROR = "/model_check/error"


@pytest.fixture
def checker(bench):
    """A running model_check whose results are collected."""
    arguments = ["period:=0.5", "error_window:=5.0", "iterations:=1"]
    bench.start(ModelCheckNode, *[word for a in arguments for word in ("-p", a)])
    bench.follow(Float64, ERROR, profile=LATCHED)
    bench.follow(WrenchStamped, "/model_check/residual")
    bench.follow(DiagnosticArray, "/model_check/diagnosis", profile=LATCHED)
    return bench


def test_error_is_near_one_where_only_noise_remains(checker):
    play(checker, held_box(seconds=5.0).streams)
    checker.until(lambda: checker.seen[ERROR], timeout=60.0)
    assert checker.seen[ERROR][-1].data == pytest.approx(1.0, abs=0.15)
    checker.until(lambda: checker.seen["/model_check/residual"], timeout=10.0)


def test_effects_of_the_estimator_are_taken_over(checker):
    message = DiagnosticArray(header=header(1.0, "object"))
    message.status = [status_message("solver", {"effects": "viscous_drag,force_bias"})]
    checker.send("/inertial_estimator/status", message, profile=LATCHED)
    check = checker.nodes[0].check
    checker.until(lambda: check.effects == ("viscous_drag", "force_bias"))


def test_without_measurements_a_diagnosis_says_what_is_missing(checker):
    answer = checker.trigger(checker.nodes[0], "/model_check/diagnose", timeout=20.0)
    assert not answer.success
    assert answer.message.startswith("nothing held yet: ")
    assert "; now: waiting for object/pose, contact/index" in answer.message


def test_diagnosis_is_of_the_last_grasp_and_answers_while_messages_go_on(checker):
    streams = held_box(seconds=6.0).streams
    play(checker, streams)
    put_down(checker, streams, 50.0)
    node = checker.nodes[0]
    checker.until(lambda: node._streams.state.name == "nothing held")
    answer = checker.trigger(node, "/model_check/diagnose", timeout=120.0)
    document = json.loads(answer.message)
    assert document["verdict"] == "adequate"
    assert document["effect"] is None
    assert (
        "Diagnosed from the last measurements that were kept; now: nothing held since"
        in (document["sentence"])
    )
    assert np.isfinite(document["error"]["before"])
    checker.until(lambda: checker.seen["/model_check/diagnosis"])


def test_a_request_to_learn_is_no_mere_diagnosis_and_is_answered_once(bench, tmp_path):
    arguments = [f"laws:={tmp_path / 'laws'}", "period:=600.0"]
    node = bench.start(ModelCheckNode, *[word for a in arguments for word in ("-p", a)])
    streams = held_box(seconds=5.0).streams
    play(bench, streams)
    put_down(bench, streams, 50.0)
    bench.until(lambda: node._streams.state.name == "nothing held")
    plain = node._begin_diagnosis(node.check.diagnosis)
    both = [node._begin_diagnosis(node._begin_learning) for _ in range(2)]
    assert both[0] is both[1] is not plain
    answer = json.loads(bench.trigger(node, "/model_check/learn", timeout=120.0).message)
    assert (answer["law"], answer["nothing_learnt"]) == (None, "nothing is missing")
    assert (tmp_path / "laws").is_dir()


def test_a_diagnosis_that_a_stop_ends_is_not_published(bench, capfd):
    """Its answer comes in another thread, when there may be no publisher any longer."""
    node = bench.start(ModelCheckNode)
    answers = [node._diagnose_by(partial(time.sleep, 60.0)) for _ in range(2)]
    bench.nodes.remove(node)
    node.destroy_node()
    deadline = time.monotonic() + 30.0
    while node._background.busy and time.monotonic() < deadline:
        time.sleep(0.01)
    assert not node._background.busy
    assert not any(answer.done.done() for answer in answers)
    assert capfd.readouterr().err == ""


def test_an_error_that_stays_is_reported_once_and_kept_with_its_diagnosis(bench, tmp_path):
    drag = {"viscous_drag": 3.0}
    made = generate_at_whitened_rms(31, drag, ScenarioOptions(duration=8.0))
    values = {"threshold": 1.5, "hold": 0.5, "span": 6.0, "folder": str(tmp_path)}
    arguments = [f"watch.{name}:={value}" for name, value in values.items()]
    arguments += ["period:=0.5", "error_window:=3.0", "iterations:=1"]
    bench.start(ModelCheckNode, *[word for a in arguments for word in ("-p", a)])
    bench.follow(DiagnosticArray, "/diagnostics")
    bench.follow(DiagnosticArray, "/model_check/diagnosis", profile=LATCHED)
    bench.follow(Float64, ERROR, profile=LATCHED)
    for start, stop in ((0.0, 3.0), (3.0, 5.0), (5.0, 8.0)):
        seen = len(bench.seen[ERROR])
        play(bench, cut_streams(made.streams, start, stop))
        bench.until(lambda seen=seen: len(bench.seen[ERROR]) > seen, timeout=60.0)
    bench.until(lambda: list(tmp_path.glob("*/diagnosis.json")), timeout=120.0)
    errors = [
        status
        for message in bench.seen["/diagnostics"]
        for status in message.status
        if status.level == DiagnosticStatus.ERROR
    ]
    assert [status.name for status in errors] == ["model_check: error"]
    assert "times the noise" in errors[0].message
    [path] = tmp_path.glob("*/diagnosis.json")
    assert json.loads(path.read_text())["effect"] == "viscous_drag"
    bench.until(lambda: bench.seen["/model_check/diagnosis"])
