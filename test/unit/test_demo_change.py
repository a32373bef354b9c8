"""The last act of the demo of a table: what is said of a change, and its section of the report."""

import argparse

import pytest

pytest.importorskip("rclpy")

from tactile_dynamics_ros.cli.demo_change import Act, fall, leaning, sentence  # noqa: E402
from tactile_dynamics_ros.cli.demo_planar import table_parameters  # noqa: E402
from tactile_dynamics_ros.core.errors import BadInputError  # noqa: E402
from tactile_dynamics_ros.report.exploration import _changes  # noqa: E402


def document(verdict="missing_effect", effect="support_tilt", group=()):
    axes = {"t_x": {"value": 0.06, "std": 0.006}, "t_y": {"value": 0.0, "std": 0.01}}
    named = {"name": "support_tilt", "parameters": axes}
    said = {"verdict": verdict, "effect": effect, "sentence": "Said."}
    return said | {"candidates": [named], "group": list(group)}


def test_the_angle_of_a_lean_is_told_with_its_interval_and_only_of_a_lean():
    assert leaning(document()) == pytest.approx((3.4377, 0.34377), abs=1e-3)
    assert sentence(document()) == "the table leans by 3.4 ± 0.3 deg. Said."
    assert "as if" in sentence(document("ambiguous"))
    assert sentence(document(effect="constant_pull")) == "Said."
    among = document("ambiguous", "constant_pull", ["constant_pull", "support_tilt"])
    assert "as if the table leant by 3.4" in sentence(among)


def test_a_hidden_effect_that_does_not_exist_is_refused_and_one_that_does_waits():
    words = {"object": "121", "seed": 0, "magnitude": 2.0, "real_time_factor": 1.0}
    with pytest.raises(BadInputError, match="does not exist; expected one of none, random"):
        table_parameters(argparse.Namespace(hidden="wind", **words))
    assert table_parameters(argparse.Namespace(hidden="load_change", **words))["hidden_waits"]
    assert not table_parameters(argparse.Namespace(hidden="none", **words))["hidden_waits"]


class Listening:
    """Stands for a node; keeps who is to be called back."""

    def create_subscription(self, _, __, callback, ___):
        self.tell = callback


def test_only_what_changes_after_the_beginning_counts(monkeypatch):
    from diagnostic_msgs.msg import DiagnosticArray

    from tactile_dynamics_ros.ros.diagnostics import status_message

    node, called = Listening(), []

    def told(changes):
        message = DiagnosticArray()
        values = {"changes": changes} | ({"since": 3.0} if changes else {})
        message.status = [status_message("change", values, message=f"change {changes}")]
        node.tell(message)

    def call(name):
        called.append(name)
        return name == "robot_sim/begin", "refused"

    act = Act(node, call, lambda _: told(2), lambda _: None)
    monkeypatch.setattr(act, "_spin", lambda *_: None)
    told(1)
    found = act.play()
    assert found["noticed"]
    assert found["alarms_before"] == 1
    assert found["text"] == "change 2"
    assert found["refused"] == "refused"
    assert called[0] == "robot_sim/begin"
    unnoticed = Act(node, call, lambda _: None, lambda _: None)
    monkeypatch.setattr(unnoticed, "_spin", lambda *_: None)
    told(1)
    called.clear()
    assert not unnoticed.play()["noticed"]
    assert called == ["robot_sim/begin", "explorer/explore_change"]
    shown_by_straight_ones = Act(node, call, lambda _: None, lambda _: None)
    monkeypatch.setattr(shown_by_straight_ones, "_spin", lambda *_: None)
    told(1)
    monkeypatch.setattr(shown_by_straight_ones, "_push_straight", lambda: told(2) or [])
    assert shown_by_straight_ones.play()["noticed"]


def test_an_effect_that_is_added_tells_how_the_error_falls(monkeypatch):
    from diagnostic_msgs.msg import DiagnosticArray

    from tactile_dynamics_ros.ros.diagnostics import status_message

    node, said, asked = Listening(), [], []

    def tell(errors, *effects):
        message = DiagnosticArray()
        message.status = [status_message("solver", errors | {"refused": ""})]
        message.status += [status_message(f"effect {name}", {}) for name in effects]
        node.tell(message)

    class Client:
        def __init__(self, _, name):
            assert name == "property_estimator"

        def set_parameters(self, parameters):
            asked.extend(parameters[0].value)

    def spin(condition, _):
        tell({"whitened_rms": 0.9})
        assert not condition()
        tell({"whitened_rms": 0.97, "without_effects": 2.31}, "support_tilt")
        assert condition()

    act = Act(node, None, None, said.append)
    monkeypatch.setattr(act, "_spin", spin)
    monkeypatch.setattr("rclpy.parameter_client.AsyncParameterClient", Client)
    found = document() | {"error": {"before": 2.2, "after": 1.0, "noise_floor": 0.98}}
    told = act._take_over(found)
    assert asked == ["support_tilt"]
    assert (told["live_before"], told["live_after"]) == (2.31, 0.97)
    words = "error of the live model: 2.31 times the noise without it, 0.97 with it"
    assert told["fall"] == said[-1] == words
    vague = {"whitened_rms": 0.97, "without_effects": 2.31, "vague": "support_tilt"}
    monkeypatch.setattr(act, "_spin", lambda *_: tell(vague, "support_tilt"))
    words = "how large support_tilt is, the pushes do not determine"
    assert words in act._take_over(found)["fall"]
    assert fall(None, 0.97) == "error of the live model: 0.97 with it"
    assert fall(2.31, None) == "the live model has no fit with it after 240 s"
    assert "came to no end" in fall(2.31, None, ended=True)


def test_a_fit_with_the_effect_that_comes_to_no_end_is_said_and_not_waited_for(monkeypatch):
    from diagnostic_msgs.msg import DiagnosticArray

    from tactile_dynamics_ros.ros.diagnostics import status_message

    node, said, added = Listening(), [], []

    class Client:
        def __init__(self, _, name):
            pass

        def set_parameters(self, parameters):
            added.extend(parameters)

    def tell(effects, refused):
        values = {"whitened_rms": 2.31, "refused": refused, "effects": effects}
        message = DiagnosticArray()
        message.status = [status_message("solver", values)]
        node.tell(message)

    def spin(condition, _):
        tell("support_tilt", "")
        assert not condition()
        tell("support_tilt", "came to no end")
        assert condition()

    act = Act(node, None, None, said.append)
    monkeypatch.setattr(act, "_spin", spin)
    monkeypatch.setattr("rclpy.parameter_client.AsyncParameterClient", Client)
    found = document() | {"error": {"before": 2.2, "after": 1.0, "noise_floor": 0.98}}
    told = act._take_over(found)
    assert told["live_after"] is None
    assert "came to no end" in said[-1]


def test_the_report_tells_the_errors_the_sentence_and_the_truth():
    truth = {
        "name": "support_tilt",
        "begins": 99.5,
        "parameters": {"angle": {"value": 0.07, "unit": "rad"}},
    }
    told = {"truth": {"hidden_effect": truth}, "changed": None}
    assert _changes(told) == []
    told["changed"] = {
        "noticed": True, "text": "it slides unlike before", "sentence": "the table leans",
        "before": 2.0, "after": 1.01, "live_before": None, "live_after": None,
        "added": "support_tilt", "fall": fall(None, 0.97),
    }  # fmt: skip
    (section,) = _changes(told)
    assert section.rows == [["held-out error, times the noise", "2.00", "1.01"]]
    assert "the table leans" in section.sentences
    added = "support_tilt was added while it ran; error of the live model: 0.97"
    assert f"{added} with it." in section.sentences
    assert "support_tilt from 99.5 s on (angle 0.07 rad)" in section.sentences[-1]
