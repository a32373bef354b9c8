"""The story of the demo of a table: what is stopped does not end it, and all that began is told."""

import argparse
import json
from types import SimpleNamespace

import pytest

pytest.importorskip("rclpy")

from tactile_dynamics_ros.cli import demo_change, demo_planar
from tactile_dynamics_ros.core.errors import TactileDynamicsError

ARGUMENTS = argparse.Namespace(
    object="121", seed=4, hidden="support_tilt", magnitude=2.0, real_time_factor=1.0, view=8081
)
PRESSED = {"stopped": "the contact bears 30.0 N, more than 25 N"}
TRUTH = {"links": [], "hidden_effect": {"name": "none", "begins": None}, "late_commands": 0}


class Log:
    """Stands for what was heard: one part that does not move."""

    ready, parted, now = True, False, 1.0

    def __init__(self, _):
        pass

    def document(self):
        box = [[-0.05, -0.04], [0.05, -0.04], [0.05, 0.04]]
        return {"parts": [{"footprint": box, "path": [[0.5, 0.0, 0.0, 1.0]]}], "history": []}


class Supervisor:
    """Stands for the processes; keeps what is started and stopped."""

    def __init__(self, *_):
        self.started, self.stopped = {}, []

    def start(self, name, command):
        self.started[name] = command

    def stop(self, names):
        self.stopped += names


@pytest.fixture
def story(monkeypatch, tmp_path):
    """Play the story with answers of services by their names; return what is told and said."""
    monkeypatch.setattr(demo_planar, "Log", Log)
    monkeypatch.setattr(demo_planar, "_spin", lambda *_: True)
    said = []

    def play(answers, goal=None, acts=None):
        def call(_, __, service, *___):
            answer = answers[service]
            if isinstance(answer, Exception):
                raise answer
            return answer

        def ask(*_):
            if goal is None:
                raise TactileDynamicsError("push_controller says nothing for 30 s")
            return goal

        class Act:
            def __init__(self, *_):
                pass

            def play(self):
                raise TactileDynamicsError("no hidden effect waits")

        monkeypatch.setattr(demo_planar, "_call", call)
        monkeypatch.setattr(demo_planar, "ask", ask)
        monkeypatch.setattr(demo_change, "Act", Act)
        told = demo_planar._story(None, Supervisor(), said.append, True)
        demo_planar.report(told, tmp_path, said.append)
        assert (tmp_path / "report.html").exists()
        return told, said

    return play


def explored(success, *actions, why="all is known"):
    told = {
        "actions": [ACTION | action for action in actions],
        "properties": {"links": [], "undetermined": []},
        "stopped_because": why,
    }
    return success, json.dumps(told)


ACTION = {
    "kind": "push",
    "point": [0.4, 0.0],
    "direction": [1.0, 0.0],
    "speed": 0.2,
    "expected_gain": 3.0,
    "chosen_because": "it narrows the mass",
}
SEEN = (True, json.dumps({"parts": []}))


def test_a_story_in_which_everything_is_stopped_ends_with_a_report(story):
    why = "the contact bears 30.0 N, more than 25 N"
    answers = {
        "shape_estimator/start": (False, "too little is seen"),
        "explorer/explore": explored(False, PRESSED, PRESSED, PRESSED, why=why),
        "robot_sim/reveal": (True, json.dumps(TRUTH)),
    }
    told, said = story(answers)
    assert len(told["explored"]["actions"]) == 3  # it pushed more gently itself: not called again
    assert told["explored"]["stopped_because"] == why
    assert told["stopped"] == ["push_controller says nothing for 30 s", "no hidden effect waits"]
    assert told["truth"] == TRUTH
    assert not told["broken"]
    assert any("its shape is not known" in line for line in said)


def test_a_story_whose_explorer_never_begins_goes_on(story):
    answers = {
        "shape_estimator/start": SEEN,
        "explorer/explore": (False, "the emergency stop is on"),
        "robot_sim/reveal": TactileDynamicsError("service robot_sim/reveal is not offered"),
    }
    goal = {"reached": True, "error_m": 0.001, "error_rad": 0.0, "pushes": 2, "duration_s": 9.0}
    told, _ = story(answers, goal | {"stopped_because": "near enough"})
    assert told["stopped"][0] == "exploring did not begin: the emergency stop is on"
    assert told["pushed"]["reached"]
    assert told["truth"] is None


def test_a_story_that_breaks_ends_with_a_report_and_says_so(story):
    answers = {
        "shape_estimator/start": SEEN,
        "explorer/explore": demo_planar.BrokenError("explorer ended with -9"),
        "robot_sim/reveal": (True, json.dumps(TRUTH | {"late_commands": 7})),
    }
    told, said = story(answers)
    assert told["broken"] == "explorer ended with -9"
    assert told["pushed"] is None  # nothing more is played
    assert any("cannot keep up: 7 times" in line for line in said)


def test_what_was_stopped_for_safety_once_is_called_again():
    calls = [
        explored(False, {"stopped": "the arm does not follow its targets"}),
        explored(True, {}),
    ]
    told = demo_planar._explore(lambda: calls.pop(0), lambda _: None)
    assert len(told["actions"]) == 2
    assert not calls


def test_two_parts_are_announced_before_they_are_pushed(story, monkeypatch):
    monkeypatch.setattr(Log, "parted", True)
    answers = {
        "shape_estimator/start": SEEN,
        "explorer/explore": explored(True, {"part": 1}),
        "robot_sim/reveal": (True, json.dumps(TRUTH)),
    }
    _, said = story(answers)
    assert said.index(demo_planar.TWO_PARTS) < next(
        k for k, line in enumerate(said) if line.startswith("exploring")
    )


def test_the_live_page_is_started_on_request(monkeypatch, tmp_path):
    started = Supervisor()

    class Entered:
        def __init__(self, *_):
            pass

        def __enter__(self):
            return started

        def __exit__(self, *_):
            return None

    def stop(*_):
        raise TactileDynamicsError("enough is seen")

    monkeypatch.setattr(demo_planar, "Supervisor", Entered)
    monkeypatch.setattr(demo_planar, "_story", stop)
    said = []
    with pytest.raises(TactileDynamicsError, match="enough"):
        demo_planar.play(ARGUMENTS, tmp_path, said.append)
    assert started.started["view"][-3:] == ["--port", "8081", "--control"]
    assert any(line.startswith("live page: http://127.0.0.1:8081/?token=") for line in said)


def test_a_node_that_has_not_heard_something_yet_is_asked_again(monkeypatch):
    """It runs before DDS has told it of all publishers; any other refusal stands at once."""
    later = iter(["no support/pose yet: publish where the table is", ""])
    monkeypatch.setattr(demo_planar, "_spin", lambda *_: True)

    def client(answers):
        def call_async(_):
            text = next(answers)
            return SimpleNamespace(
                done=lambda: True,
                result=lambda: SimpleNamespace(success=not text, message=text),
            )

        return SimpleNamespace(service_is_ready=lambda: True, call_async=call_async)

    def call(answers):
        node = SimpleNamespace(create_client=lambda *_: client(answers))
        return demo_planar._call(node, None, "shape_estimator/start")

    assert call(later) == (True, "")
    assert call(iter(["nothing is seen on the table"])) == (False, "nothing is seen on the table")
