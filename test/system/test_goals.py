"""`tactile-dynamics send-goal`, and verbs that send goals: feedback, result, Ctrl-C cancels."""

import json
import signal
import subprocess

import pytest

from tactile_dynamics_ros.cli.supervisor import verb_command
from tactile_dynamics_ros.ros.actions import Action, interface

pytestmark = pytest.mark.skipif(
    interface("action.Push") is None, reason="tactile_dynamics_msgs is not built; ./dev env"
)


class Worker:
    """Offers an action on the listener's node, and works until it is told to end."""

    def __init__(self, listener, kind, name):
        self.listener, self.goals, self.stops = listener, [], 0
        listener.node.require_active = lambda: None  # it is no managed node
        listener.node.actions = []  # as a managed node has them
        self.action = Action(listener.node, kind, name, self.goals.append, self.stop)

    def stop(self):
        self.stops += 1

    def run(self, *words):
        """Start the command, and wait until its goal is there."""
        done = subprocess.Popen(
            verb_command(*words), stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
        )
        self.listener.wait(lambda: self.goals or done.poll() is not None, 30.0, "goal")
        return done

    def finish(self, command):
        """Wait for the end of a command; return exit code and output."""
        self.listener.wait(lambda: command.poll() is not None, 30.0, "end of the command")
        return (command.returncode, *command.communicate())


@pytest.fixture
def worker(listener):
    made = []

    def make(*words):
        made.append(Worker(listener, *words))
        return made[-1]

    yield make
    for one in made:
        one.action.close()


def test_a_goal_is_sent_and_its_feedback_and_result_are_printed(worker):
    pushing = worker("Push", "/goals/push")
    command = pushing.run(
        "send-goal", "goals/push", "{pose: {pose: {position: {x: 1}}}}", "--feedback", "--json"
    )
    assert pushing.goals[0].pose.pose.position.x == 1.0
    heard = "/goals/push/_action/feedback"
    pushing.listener.wait(lambda: pushing.listener.node.count_subscribers(heard), 30.0, heard)
    pushing.action.tell("push", 0.25, "30 mm to go")
    pushing.action.end(True, "near enough", {"reached": True}, pushes=3)
    code, out, err = pushing.finish(command)
    assert code == 0, err
    told = json.loads(out)
    assert (told["success"], told["json"], told["pushes"]) == (True, {"reached": True}, 3)
    assert err.split() == ["push", "25", "%", "30", "mm", "to", "go"]


@pytest.mark.parametrize(
    ("words", "kind", "name"),
    [
        (("send-goal", "/goals/push"), "Push", "/goals/push"),
        (("explore",), "Explore", "/explorer/explore"),
        (("probe",), "Probe", "/friction_probe/probe"),
        (("push", "--goal", "0.5", "0.1", "0"), "Push", "/push_controller/push"),
    ],
)
def test_ctrl_c_cancels_what_a_command_asked_for(worker, words, kind, name):
    moving = worker(kind, name)
    command = moving.run(*words)
    assert command.poll() is None, command.communicate()
    assert moving.stops == 0
    command.send_signal(signal.SIGINT)
    code, _, err = moving.finish(command)
    assert (code, moving.stops) == (130, 1), err
    assert err.splitlines()[-1] == "canceled"


def test_a_goal_that_the_node_refuses_ends_with_its_reason(worker):
    pushing = worker("Push", "/goals/push")
    command = pushing.run("send-goal", "/goals/push")
    pushing.action.end(False, "the emergency stop is on")
    code, _, err = pushing.finish(command)
    assert (code, err) == (1, "the emergency stop is on\n")


def test_a_wrong_goal_is_refused_in_one_line(worker):
    pushing = worker("Push", "/goals/push")
    for goal, reason in (
        ("{pose: {pse: 1}}", "goal.pose.pse: there are ['header', 'pose']"),
        ("{pose: {pose: {position: {x: far}}}}", "goal.pose.pose.position.x: 'far'"),
        ("3", "goal: 3, expected fields"),
    ):
        command = pushing.run("send-goal", "/goals/push", goal)
        code, _, err = pushing.finish(command)
        assert (code, err.count("\n")) == (2, 1)
        assert reason in err
    assert pushing.goals == []
