"""What the demo adds to the live model, what it says of that, and how the story ends."""

import argparse
import json
from types import SimpleNamespace

import numpy as np
import pytest

pytest.importorskip("rclpy")

from tactile_dynamics_ros.cli import demo, demo_result, demo_story  # noqa: E402
from tactile_dynamics_ros.cli.demo_result import Findings, doubts  # noqa: E402
from tactile_dynamics_ros.cli.demo_story import Story, proposal  # noqa: E402
from tactile_dynamics_ros.core.errors import (  # noqa: E402
    BadInputError,
    NotIdentifiableError,
    TactileDynamicsError,
)

HIDDEN = {"name": "added_mass", "parameters": {"mass": {"value": 0.115, "unit": "kg"}}}


def diagnosed(verdict, effect=None, group=(), expected=3.5):
    candidates = [{"name": "hanging_cable", "predicted_whitened_rms": expected}]
    return {
        "verdict": verdict,
        "effect": effect,
        "group": list(group),
        "candidates": candidates,
        "error": {"before": 4.0},
        "sentence": f"{verdict} live.",
    }


def explained(verdict, *effects, **groups):
    words = f"{verdict} offline."
    return {"verdict": verdict, "effects": [*effects], "groups": groups, "sentence": words}


def test_a_certain_effect_is_added_and_nothing_where_nothing_is_missing():
    assert proposal(diagnosed("missing_effect", "viscous_drag")) == ("viscous_drag", "")
    assert proposal(diagnosed("adequate", expected=0.1)) is None
    assert proposal(diagnosed("unexplained")) is None


def test_the_first_of_several_is_added_with_a_word_of_what_that_means():
    group = ("added_mass", "hanging_cable", "force_scale")
    effect, meaning = proposal(diagnosed("ambiguous", "added_mass", group))
    assert effect == "added_mass"
    assert "the first of added_mass, hanging_cable and force_scale" in meaning
    assert "cannot be determined" in meaning
    assert "hold only if it is this one" in meaning


def test_what_promises_much_but_explains_not_all_is_tried_with_a_warning():
    effect, meaning = proposal(diagnosed("unexplained", expected=1.7))
    assert effect == "hanging_cable"
    assert "not the whole cause" in meaning
    assert "not to be trusted" in meaning


class Answered:
    """A future with a result."""

    def __init__(self, result):
        self.result = lambda: result

    def done(self):
        return True


class Nodes:
    """Stands for a node, whose services and parameters answer at once."""

    def __init__(self, answer, reason=""):
        self.answer = SimpleNamespace(success=True, message=json.dumps(answer))
        self.reason, self.asked, self.added = reason, [], []

    def create_client(self, *_):
        return SimpleNamespace(service_is_ready=lambda: True, call_async=self.diagnose)

    def diagnose(self, request):
        self.asked.append(request)
        return Answered(self.answer)

    def create_subscription(self, *_):
        pass

    def set_parameters(self, parameters):
        self.added += parameters[0].value
        result = SimpleNamespace(successful=not self.reason, reason=self.reason)
        return Answered(SimpleNamespace(results=[result]))


def tell_story(monkeypatch, nodes, motion, seconds):
    monkeypatch.setattr(demo_story, "AsyncParameterClient", lambda node, _: node)
    said = []
    story = Story(nodes, said.append, motion)
    for each in seconds:
        story.advance(each)
    return story, said


def test_a_short_motion_is_asked_about_while_some_of_it_is_left(monkeypatch):
    for motion, enough in ((60.0, 25.0), (12.0, 14.0)):
        nodes = Nodes(diagnosed("missing_effect", "viscous_drag"))
        story, _ = tell_story(monkeypatch, nodes, motion, [enough - 0.1])
        assert not nodes.asked
        story.advance(enough + 0.1)
        story.advance(enough + 0.2)
        assert len(nodes.asked) == 1
        assert nodes.added == ["viscous_drag"]
        assert story.seconds == enough + 0.1


def test_nothing_is_proposed_where_nothing_is_missing_and_a_refusal_is_said(monkeypatch):
    _, said = tell_story(monkeypatch, Nodes(diagnosed("adequate")), 60.0, [26.0, 26.1, 26.2])
    assert not [line for line in said if "candidate" in line or "adding" in line]
    nodes = Nodes(diagnosed("missing_effect", "viscous_drag"), reason="no such effect")
    _, said = tell_story(monkeypatch, nodes, 60.0, [26.0, 26.1, 26.2, 26.3])
    assert [line for line in said if "refuses" in line] == [
        "inertial_estimator refuses: no such effect"
    ]


def test_a_law_that_was_learnt_is_added_and_held_against_the_whole_recording(monkeypatch, tmp_path):
    law = {
        "beside": ["viscous_drag"],
        "file": "law_1.yaml",
        "form": "central_force",
        "sentence": "Learnt: a force.",
    }
    live = diagnosed("unexplained") | {"law": law}
    nodes = Nodes(live)
    story, said = tell_story(monkeypatch, nodes, 60.0, [26.0, 26.1])
    assert nodes.added == ["viscous_drag", "law_1.yaml"]
    assert said[-1] == "adding viscous_drag,law_1.yaml to the live model, the law that was learnt"
    found = Findings(story.diagnosis, 26.0, explained("adequate"))
    assert found.effects == ["viscous_drag", "law_1.yaml"]
    told = found.summary(68.0, HIDDEN)
    assert told[0].startswith("With the law learnt live, in all 68 s of the recording: nothing is")
    assert told[1].endswith("; the law learnt live has the form central_force.")
    asked = []
    monkeypatch.setattr(
        demo.subprocess, "run", lambda words, **_: asked.append(words) or SimpleNamespace(
            returncode=3, stdout="", stderr=""
        )
    )  # fmt: skip
    demo._explain(tmp_path, found.effects, lambda _: None)
    assert asked[0][-2:] == ["--effects", "viscous_drag,law_1.yaml"]


def test_what_comes_after_the_object_was_put_down_is_not_added(monkeypatch):
    nodes = Nodes(diagnosed("missing_effect", "viscous_drag"))
    story, said = tell_story(monkeypatch, nodes, 60.0, [26.0])
    story.advance(26.0, held=False)
    assert story.diagnosis["effect"] == "viscous_drag"
    assert (nodes.added, story.added) == ([], None)
    assert "nothing is added" in said[-1]


def test_the_story_ends_with_how_the_error_fell(monkeypatch):
    nodes = Nodes(diagnosed("missing_effect", "viscous_drag"))
    story, said = tell_story(monkeypatch, nodes, 60.0, [])
    story._on_error(SimpleNamespace(data=2.5))
    for _ in range(3):
        story.advance(26.0)
    story.close()
    assert said[-1] == "the motion ended before the live model had an error with viscous_drag"
    story._on_error(SimpleNamespace(data=0.9))
    story.close()
    assert "2.50 times the sensor noise without viscous_drag, 0.90 with it" in said[-1]


@pytest.mark.parametrize(
    ("live", "offline", "words"),
    [
        (("adequate",), ("adequate",), "Live and offline agree: nothing is missing."),
        (
            ("missing_effect", "viscous_drag"),
            ("adequate", "viscous_drag"),
            "Live and offline agree: viscous_drag.",
        ),
        (
            ("ambiguous", "added_mass", ("added_mass", "hanging_cable")),
            ("unexplained",),
            "Live, from the first 27 s: added_mass or hanging_cable; offline, from all 68 s: "
            "something is missing that is not in the catalogue. Both ask the same question; "
            "offline has more of the motion, and counts.",
        ),
        (
            ("ambiguous", "added_mass", ("added_mass", "hanging_cable")),
            ("adequate", "hanging_cable"),
            "Live, from the first 27 s: added_mass or hanging_cable; offline, from all 68 s: "
            "hanging_cable. They have a name in common; a longer motion determines more of it.",
        ),
    ],
)
def test_live_and_offline_do_not_differ_without_a_word(live, offline, words):
    found = Findings(diagnosed(*live), 27.2, explained(*offline))
    assert found.summary(68.4, HIDDEN)[0] == words
    assert found.sentences(68.4, HIDDEN)[:2] == [
        f"Live, from the first 27 s: {live[0]} live.",
        f"From all 68 s of the recording: {offline[0]} offline.",
    ]


def test_the_same_names_in_another_order_agree_and_their_doubt_is_said():
    both = ("added_mass", "hanging_cable")
    offline = explained("adequate", "hanging_cable", hanging_cable=["hanging_cable", "added_mass"])
    found = Findings(diagnosed("ambiguous", "added_mass", both), 27.0, offline)
    assert found.summary(68.0, HIDDEN)[0] == "Live and offline agree: added_mass or hanging_cable."
    assert doubts(offline)[0].startswith("This recording cannot tell hanging_cable from added_mass")


def test_the_truth_is_revealed_with_who_named_it_whatever_was_found():
    said = "Hidden effect: added_mass (mass 0.115 kg); named "
    live = diagnosed("missing_effect", "added_mass")
    unknown = explained("unexplained")
    for found, who in (
        (Findings(live, 27.0, explained("adequate", "added_mass")), "live and offline."),
        (Findings(live, 27.0, unknown), "live."),
        (Findings({"verdict": "none", "sentence": "-", "effect": None}, 9.0, None), "neither"),
        (Findings(None, 0.0, unknown), "neither live nor offline."),
    ):
        assert found.summary(68.0, HIDDEN)[-1].startswith(said + who)
        assert len(found.sentences(68.0, HIDDEN)) >= 2


def test_an_explanation_that_fails_ends_no_story(monkeypatch, tmp_path):
    said = []
    for words, last in (("", "it ended without a word"), ("a\nerror: no contacts\n", "error: no")):
        done = SimpleNamespace(returncode=3, stdout="", stderr=words)
        monkeypatch.setattr(demo.subprocess, "run", lambda *_, done=done, **__: done)
        assert demo._explain(tmp_path, [], said.append) is None
        assert said[-1].startswith(f"no explanation: {last}")


def test_an_estimate_with_the_effects_that_diverges_is_one_of_the_body_alone(monkeypatch):
    def estimate(recording, effects=()):
        if effects:
            raise NotIdentifiableError("the iteration diverged")
        return "body alone"

    monkeypatch.setattr(demo_result, "estimate", estimate)
    said = []
    found = demo_result._estimate("recording", ["viscous_drag"], said.append)
    assert found == ("body alone", ())
    assert "viscous_drag (the iteration diverged)" in said[0]
    assert demo_result._shown(np.nan) == "-"


def test_a_recording_that_exists_is_refused_before_anything_starts(tmp_path):
    (tmp_path / "recording").mkdir()
    parser = argparse.ArgumentParser()
    demo.add_parser(parser.add_subparsers())
    with pytest.raises(BadInputError, match="exists already"):
        demo.run(parser.parse_args(["demo", "--out", str(tmp_path)]))
    assert not (tmp_path / "logs").exists()


@pytest.mark.parametrize(
    ("standing_still", "waited", "complaint"),
    [
        (None, demo.STILL + 1.0, None),
        (None, demo.STARTING + 1.0, "no simulated time within 401 s"),
        (1.0, demo.STARTING + 1.0, None),
        (demo.STILL + 1.0, demo.STILL + 1.0, "stands still for 91 s"),
        (1.0, 5000.0, "not finished after 4500 s"),
    ],
)
def test_a_slow_start_is_no_fault_and_a_simulation_that_stops_is(standing_still, waited, complaint):
    monitor = argparse.Namespace(standing_still=standing_still, not_started="")
    if complaint is None:
        demo._require_progress(monitor, waited, limit=4500.0)
        return
    with pytest.raises(TactileDynamicsError, match=complaint):
        demo._require_progress(monitor, waited, limit=4500.0)
