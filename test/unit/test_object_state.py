"""What a node says of the object: it waits for what, is held, or not since when; time is given."""

import pytest
from diagnostic_msgs.msg import DiagnosticStatus

from tactile_dynamics_ros.ros.diagnostics import status_values
from tactile_dynamics_ros.ros.object_state import SILENT, Following, Holding


def hold(holding, start, stop, pose=True, touches=True, contact=True):
    """Let streams of 10 Hz come from a time to another, s."""
    for k in range(round(10 * (stop - start)) + 1):
        now = start + 0.1 * k
        if pose:
            holding.hear_pose(now)
        if contact:
            holding.hear_contact("thumb", touches, now)


@pytest.fixture
def holding():
    return Holding(["index", "thumb"], 100.0)


def test_before_anything_came_it_says_what_it_waits_for(holding):
    state = holding.state(103.0)
    assert (state.name, state.lasts) == ("waiting", 3.0)
    assert state.text == "waiting for object/pose, contact/index, contact/thumb"
    hold(holding, 103.0, 104.0, pose=False, touches=False)
    assert holding.state(104.0).text == "waiting for object/pose"
    hold(holding, 104.0, 105.0, touches=False)
    assert holding.state(105.0).text == "waiting for a touch: no contact presses"
    assert holding.state(108.0).text == "waiting for object/pose, silent since 3 s"
    assert holding.state(108.0).status(1.0).level == DiagnosticStatus.WARN


def test_held_lasts_since_pose_and_touch_came_together(holding):
    hold(holding, 101.0, 102.0, touches=False)
    hold(holding, 102.0, 106.0)
    state = holding.state(106.0)
    assert (state.name, state.text, state.lasts) == ("held", "held", pytest.approx(4.0))
    status = state.status(0.1)
    assert status.level == DiagnosticStatus.OK
    assert status_values(status) == {"state": "held", "lasts": "4", "age": "0.1"}


@pytest.mark.parametrize(
    ("after", "text"),
    [
        ({"pose": False, "touches": False}, "nothing held since 76 s"),
        ({"pose": True, "touches": False}, "nothing held since 76 s"),
        ({"pose": True, "contact": False}, "nothing held since 76 s; contacts are silent"),
        ({"pose": False, "contact": False}, "nothing held since 76 s; contacts are silent"),
        ({"pose": False}, "waiting for object/pose, silent since 76 s; touching: thumb"),
    ],
)
def test_after_a_grasp_it_says_since_when_nothing_is_held(holding, after, text):
    hold(holding, 101.0, 106.0)
    hold(holding, 106.1, 182.0, **after)
    assert holding.state(182.0).text == text
    assert not holding.state(182.0).current


def test_a_grasp_that_ended_is_noticed_within_two_seconds_and_the_next_one_at_once(holding):
    hold(holding, 101.0, 106.0)
    assert holding.state(106.0 + SILENT).name == "held"
    assert SILENT < 2.0
    assert holding.state(106.1 + SILENT).name == "nothing held"
    hold(holding, 120.0, 120.1)
    assert holding.state(120.1).lasts == pytest.approx(0.1)


def test_after_the_clock_was_set_back_nothing_is_known(holding):
    hold(holding, 101.0, 106.0)
    holding.clear(107.0)
    assert holding.state(108.0).text.startswith("waiting for object/pose")


def follow(following, start, stop, *topics):
    for k in range(round(10 * (stop - start)) + 1):
        for topic in topics:
            following.hear(topic, start + 0.1 * k)


def test_a_pushed_object_is_followed_though_nothing_touches_it():
    following = Following(10.0)
    waits = following.state(12.0, outlined=False)
    assert waits.text == "waiting for object/footprint, object/pose, pusher/pose"
    assert waits.lasts == 2.0
    follow(following, 12.0, 20.0, "object/pose", "pusher/pose")
    assert following.state(20.0, outlined=False).text == "waiting for object/footprint"
    state = following.state(20.0, outlined=True)
    assert (state.name, state.text) == ("followed", "followed, not touched")
    assert state.lasts == pytest.approx(8.0)
    following.hear_touch(20.0)
    follow(following, 20.0, 50.0, "object/pose", "pusher/pose")
    assert following.state(50.0, outlined=True).text == "followed, last touched 30 s ago"


def test_a_pushed_object_whose_pose_is_silent_is_not_followed():
    following = Following(10.0)
    follow(following, 12.0, 20.0, "object/pose", "pusher/pose")
    follow(following, 20.0, 32.0, "pusher/pose")
    state = following.state(32.0, outlined=True)
    assert (state.name, state.current) == ("waiting", False)
    assert state.text == "waiting for object/pose, silent since 12 s"
