"""What is wrong with a topic is named: silent, of another type, rivals, refused."""

from types import SimpleNamespace

import pytest

from tactile_dynamics_ros.nodes.inertial_estimator import InertialEstimatorConfig
from tactile_dynamics_ros.ros.conversions import MessageError
from tactile_dynamics_ros.ros.inputs import PATIENCE, Input, Need, Numbers, Source
from tactile_dynamics_ros.ros.object_state import DROPPED, SILENT, Holding
from tactile_dynamics_ros.ros.shell import LOOK, STREAM
from tactile_dynamics_ros.ros.stream_clock import StreamClock
from tactile_dynamics_ros.ros.wire import Stamp

WRENCH, TEXT = "geometry_msgs/msg/WrenchStamped", "std_msgs/msg/String"
RIGHT = [Source("/contact_state", WRENCH, "")]
PAD = [Source("/pad", TEXT, "")]
BRIEF = [Source("/driver", WRENCH, "ERROR: Best effort publisher and reliable subscription;")]


def source(need=Need.ONCE, ever=False, publishers=RIGHT):
    name = "contact/ring/force"
    return Input(name, f"/{name}", WRENCH, need, STREAM, 100.0, ever, publishers=publishers)


@pytest.mark.parametrize(("publishers", "text"), [
    ([], "contact/ring/force: never heard, published by nobody"),
    (RIGHT, "contact/ring/force: never heard, published by /contact_state"),
    (PAD, f"contact/ring/force: expected {WRENCH}, found {TEXT} from /pad"),
])  # fmt: skip
def test_a_topic_that_was_never_heard_names_its_publisher_or_its_type(publishers, text):
    found = source(publishers=publishers)
    assert found.trouble(100.0 + SILENT) == ""
    assert found.trouble(100.1 + SILENT) == text


def test_a_quality_of_service_that_does_not_do_is_named_with_what_to_set():
    said = source(publishers=BRIEF).trouble(104.0)
    assert said.startswith("contact/ring/force: /driver offers less than is asked for (ERROR: Best")
    assert said.endswith("qos_overrides./contact/ring/force.subscription.*")
    assert "offers less" not in source(publishers=[*BRIEF, *RIGHT]).trouble(104.0)


def test_silence_after_the_first_message_is_a_trouble_only_of_what_always_comes():
    assert source(ever=True).trouble(104.0) == ""
    said = source(Need.ALWAYS, ever=True).trouble(104.0)
    assert said == "contact/ring/force: silent since 4 s, published by /contact_state"
    assert source(Need.OPTIONAL).trouble(104.0) == ""


def test_what_is_published_and_needed_and_never_comes_is_subscribed_to_anew_ever_more_seldom():
    found = source()
    assert not found.is_deaf(100.0 + PATIENCE) and found.is_deaf(100.1 + PATIENCE)
    found.renew(105.1)
    assert not found.is_deaf(105.1 + 2 * PATIENCE) and found.is_deaf(105.2 + 2 * PATIENCE)
    found.take(120.0)
    assert not found.is_deaf(999.0)
    found.need = Need.ALWAYS
    assert found.is_deaf(120.1 + PATIENCE)


@pytest.mark.parametrize("other", [
    source(Need.OPTIONAL), source(publishers=[]), source(publishers=PAD), source(publishers=BRIEF),
])  # fmt: skip
def test_nothing_is_subscribed_to_anew_that_nobody_publishes_or_needs(other):
    assert not other.is_deaf(999.0)


def test_what_is_refused_was_heard():
    found = source()
    found.refuse("negative", 104.0)
    assert not found.is_deaf(104.0 + PATIENCE)


def test_what_is_refused_says_why_until_a_message_is_used():
    found = source()
    found.refuse("negative", 103.5)
    assert found.trouble(104.0).endswith("all that comes is refused: negative")
    found.take(104.0)
    assert found.trouble(104.1) == ""


def test_rivals_are_named_as_long_as_their_messages_mix():
    found = source(ever=True, publishers=[*RIGHT, Source("/rival", WRENCH, "")])
    found.rivals = 105.0
    said = found.trouble(104.0)
    assert "two publishers at once (/contact_state and /rival)" in said
    assert found.trouble(105.0) == ""


def test_numbers_of_two_publishers_mix_and_those_of_a_restarted_one_do_not():
    two, restarted = Numbers(), Numbers()
    assert not two.mix([5001, 1, 5002], 1.0)
    assert two.mix([2, 5003, 3], 1.1)
    assert not restarted.mix([5001, 5002, 1, 2, 3], 1.0)
    assert not Numbers().mix([None, None], 1.0)


def test_a_finger_that_fell_silent_while_it_pressed_is_named_for_ten_seconds():
    holding = Holding(["ring", "thumb"], 0.0)
    for k in range(200):
        holding.hear_pose(0.1 * k)
        holding.hear_contact("thumb", True, 0.1 * k)
        if k <= 50:
            holding.hear_contact("ring", True, 0.1 * k)
    assert holding.state(19.9).troubles == ()
    assert holding.state(19.9).text == "held"


def test_a_dropped_finger_is_a_trouble_from_its_silence_on_for_ten_seconds():
    holding = Holding(["ring", "thumb"], 0.0)
    holding.hear_contact("ring", True, 5.0)
    for now, count in ((5.0 + SILENT, 0), (8.0, 1), (5.0 + DROPPED, 1), (15.1, 0)):
        holding.hear_pose(now)
        holding.hear_contact("thumb", True, now)
        said = holding.state(now).troubles
        assert len(said) == count, now
        assert all(text.startswith("contact/ring: silent since") for text in said)


def test_a_trouble_is_said_within_two_seconds_of_real_time():
    assert SILENT + LOOK + 1.0 / InertialEstimatorConfig().update_rate_hz < 2.0


def test_a_finger_that_tells_of_no_touch_by_zeros_may_not_fall_silent():
    holding = Holding(["ring", "thumb"], 0.0)
    holding.hear_contact("ring", False, 5.0)
    holding.hear_pose(60.0)
    holding.hear_contact("thumb", True, 60.0)
    assert holding.state(60.0).troubles == (
        "contact/ring: silent since 55 s, where it told of no touch by zeros before",
    )


def test_a_step_back_is_counted_and_told_with_its_size_and_forgets_nothing_but_what_waits():
    counted, told, forgotten = [], [], []
    node = SimpleNamespace(faults=SimpleNamespace(add=lambda kind, text: counted.append(kind)))
    clock = StreamClock(node)
    clock.on_move.append(lambda: told.append("move"))
    clock.on_step.append(told.append)
    clock.on_restart.append(lambda: forgotten.append("all"))
    for hundredth in [*range(100, 200), *range(110, 120)]:
        clock.admit(Stamp(5 + hundredth // 100, hundredth % 100 * 10**7), "object/pose")
    assert counted == ["clock_stepped_back"] and forgotten == []
    assert told == ["move", pytest.approx(6.99 - 6.14)]
    assert clock.newest == pytest.approx(6.19)


def test_a_stamp_before_the_epoch_is_refused_and_moves_no_clock():
    clock = StreamClock(SimpleNamespace(faults=None))
    clock.admit(Stamp(5, 0), "object/pose")
    for _ in range(20):
        with pytest.raises(MessageError, match="zero or less"):
            clock.admit(Stamp(-1, 999_999_999), "object/pose")
    assert clock.newest == 5.0
