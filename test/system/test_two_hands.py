"""Two hands side by side in one system: each in its namespace, neither hears the other."""

import json

import pytest
from diagnostic_msgs.msg import DiagnosticArray
from std_msgs.msg import Float64
from test_commands import run_verb
from test_live_story import Player

from tactile_dynamics_ros.cli.supervisor import node_command
from tactile_dynamics_ros.cli.topics import call_trigger
from tactile_dynamics_ros.recording import Recording
from tactile_dynamics_ros.ros.diagnostics import status_values
from tactile_dynamics_ros.synthetic import ScenarioOptions, generate

HANDS = ("left", "right")
NODES = ("inertial_estimator", "model_check")
SECONDS = 8.0
ENOUGH = 300
"""Samples of the 800 that are played: a machine with other work loses some, and these suffice."""


def status(listener, hand):
    """Return the newest status of a hand's estimator, by part."""
    found = listener.seen[f"/{hand}/inertial_estimator/status"]
    return {part.name: status_values(part) for part in found[-1].status} if found else None


def samples(listener, hand):
    """Return how many samples a hand's estimator has used."""
    found = status(listener, hand)
    return 0 if found is None else int(found["solver"]["samples"])


def mass(listener, hand):
    """Return the mass that a hand's estimator has found, kg."""
    return float(status(listener, hand)["parameters"]["mass"])


@pytest.fixture(scope="module")
def recordings():
    """Recordings of two objects that differ much in mass."""
    options = ScenarioOptions(duration=SECONDS)
    return {
        hand: generate(seed, scenario=options) for hand, seed in zip(HANDS, (3, 8), strict=True)
    }


@pytest.mark.timeout(280)
def test_each_hand_answers_for_its_own_object(system, listener, recordings, tmp_path):
    truth = {hand: recording.scenario.body.mass for hand, recording in recordings.items()}
    assert abs(truth["left"] - truth["right"]) > 0.2 * max(truth.values())
    players = {}
    for hand in HANDS:
        for name in NODES:
            given = {"period": 1.0} if name == "model_check" else {}
            command = node_command(name, None, given, f"/{hand}")
            system.start(f"{hand}_{name}", command)
        listener.follow(DiagnosticArray, f"/{hand}/inertial_estimator/status", latched=True)
        listener.follow(Float64, f"/{hand}/model_check/error", latched=True)
        players[hand] = Player(listener, recordings[hand].streams, f"/{hand}")
        players[hand].connect(listeners=2)
    listener.follow(DiagnosticArray, "/diagnostics")
    out = tmp_path / "left"
    system.start_verb("recorder", "record", str(out), "--namespace", "left")
    listener.wait(lambda: "recorder" in listener.node.get_node_names(), 60.0, "recorder")

    players["left"].play(until=SECONDS)
    listener.wait(lambda: samples(listener, "left") > ENOUGH, 30.0, "left's samples")
    listener.wait(lambda: listener.seen["/left/model_check/error"], 60.0, "left's error")
    assert mass(listener, "left") == pytest.approx(truth["left"], rel=0.05)
    assert samples(listener, "right") == 0
    assert listener.seen["/right/model_check/error"] == []
    success, answer = call_trigger(listener.node, "/right/model_check/diagnose", 30.0)
    assert not success, answer

    players["right"].play(until=SECONDS)
    listener.wait(lambda: samples(listener, "right") > ENOUGH, 30.0, "right's samples")
    listener.wait(lambda: listener.seen["/right/model_check/error"], 60.0, "right's error")
    assert mass(listener, "right") == pytest.approx(truth["right"], rel=0.05)
    assert mass(listener, "left") == pytest.approx(truth["left"], rel=0.05)

    changed = run_verb("set", "left/inertial_estimator", "effects", "[viscous_drag]")
    assert changed.returncode == 0, changed.stderr
    missing = run_verb("set", "inertial_estimator", "effects", "[viscous_drag]")
    assert missing.returncode == 2
    assert "/left/inertial_estimator" in missing.stderr
    listener.wait(
        lambda: status(listener, "left")["solver"]["effects"] == "viscous_drag", 60.0, "the effect"
    )
    assert status(listener, "right")["solver"]["effects"] == ""

    before = samples(listener, "right")
    called = run_verb("call", "/left/inertial_estimator/reset", "--json")
    assert json.loads(called.stdout)["success"]
    assert samples(listener, "right") >= before
    told = {s.name for message in listener.seen["/diagnostics"] for s in message.status}
    assert {f"{hand}/{name}" for hand in HANDS for name in NODES} <= told

    def stray():
        """Return topics of no hand; those of processes that were killed before last 20 s."""
        topics = {name for name, _ in listener.node.get_topic_names_and_types()}
        return {t for t in topics if not t.startswith(("/left/", "/right/"))}

    shared = {"/diagnostics", "/parameter_events", "/rosout", "/clock"}
    shared.add("/recorder/transition_event")  # of the recorder, which is of no hand
    try:
        listener.wait(lambda: stray() <= shared, 60.0, "topics of both hands alone")
    except AssertionError as error:
        raise AssertionError(f"{error}; stray: {sorted(stray() - shared)}") from None
    system.stop(["recorder"])
    recorded = Recording.from_bag(out)
    assert recorded.source.endswith("(namespace /left)")
    assert len(recorded.streams.pose.time) > ENOUGH
