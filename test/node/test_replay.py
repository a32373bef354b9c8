"""The endless recording, its messages, and the faults that are put into them."""

from collections import Counter
from dataclasses import replace

import numpy as np
import pytest

from benchmarks.replay.input_faults import INPUT_FAULTS
from benchmarks.replay.live_effects import Found, Result, compare
from benchmarks.replay.motion import BODY, FORCE_STD, record_motion
from benchmarks.replay.observations import Report, Status, risen, said_text, wrong_time
from benchmarks.replay.soak import growth
from benchmarks.replay.stream_faults import FINGER, HOUR_NS, RIVAL, STREAM_FAULTS
from benchmarks.replay.tape import COUNTED, messages_of
from tactile_dynamics_ros.core.inertia.batch.batch import fit_body
from tactile_dynamics_ros.core.inertia.batch.inertial_estimate import PARAMETER_NAMES
from tactile_dynamics_ros.ros.wire import decode_stamped

FAULTS = {fault.name: fault for fault in (*STREAM_FAULTS, *INPUT_FAULTS)}
EPOCH_NS = 1_700_000_000 * 10**9


@pytest.fixture(scope="module")
def clean():
    return messages_of(record_motion(0.0, 3.0))


def inject(name, clean):
    """Return the messages with a fault from 1 s to 2 s."""
    return FAULTS[name].inject(clean, 1.0, 2.0)


def of(messages, topic, start=0.0, stop=9.0):
    return [m for m in messages if m.topic == topic and start <= m.due < stop]


def test_offline_estimate_of_the_motion_is_the_true_body():
    estimate = fit_body(record_motion(0.0, 20.0, pace=1.6)).to_estimate()
    tensor = estimate.inertia.inertia_com
    rows, columns = (0, 0, 1, 0, 1, 2), (0, 1, 1, 2, 2, 2)
    found = np.array([estimate.inertia.mass, *estimate.inertia.com, *tensor[rows, columns]])
    assert np.all(np.abs(found - BODY.values()) < 4 * estimate.parameter_std)
    assert estimate.error.whitened_rms == pytest.approx(1.0, abs=0.05)
    assert estimate.parameter_std[0] < 1e-3


def test_chunks_continue_the_motion():
    whole, later = record_motion(0.0, 2.0), record_motion(1.0, 2.0)
    assert len(whole.pose.time) == 200
    np.testing.assert_allclose(whole.pose.time[100:], later.pose.time)
    np.testing.assert_allclose(whole.pose.position[100:], later.pose.position, atol=2e-3)
    difference = whole.contacts["thumb"].force[100:] - later.contacts["thumb"].force
    assert np.std(difference) == pytest.approx(np.sqrt(2) * FORCE_STD, rel=0.15)


def test_messages_carry_the_recording_with_the_epoch_in_their_stamps(clean):
    streams = record_motion(0.0, 3.0)
    assert len(clean) == 300 * 13
    message = of(clean, "/contact/index/force")[7]
    read = decode_stamped(message.encoded(EPOCH_NS), COUNTED["force"])
    assert read.stamp.sec * 10**9 + read.stamp.nanosec == EPOCH_NS + 70_000_000
    assert read.frame_id == "world"
    np.testing.assert_array_equal(read.values[:3], streams.contacts["index"].force[7])


@pytest.mark.parametrize("name", FAULTS)
def test_what_comes_before_a_fault_is_untouched_and_the_order_is_that_of_sending(name, clean):
    messages = inject(name, clean)
    if not FAULTS[name].whole:
        assert [m for m in messages if m.due < 1.0] == [m for m in clean if m.due < 1.0]
    if not FAULTS[name].shift_ns:
        late = [m for m in messages if m.due >= 2.0 and m.stamp_ns >= 2 * 10**9]
        assert late == [m for m in clean if m.due >= 2.0]
    assert all(a.due <= b.due for a, b in zip(messages, messages[1:], strict=False))
    assert messages != clean


def test_an_outlier_is_in_one_message(clean):
    changed = [m for m in inject("force_1e10", clean) if m not in clean]
    assert [(m.topic, m.values[0]) for m in changed] == [(f"/contact/{FINGER}/force", 1e10)]


def test_a_silent_finger_sends_nothing_and_the_others_all(clean):
    counts = Counter(m.finger for m in inject("finger_silent", clean) if 1.0 <= m.due < 2.0)
    assert counts == {"": 100, "index": 300, "middle": 300, "thumb": 300}


def test_a_frozen_finger_repeats_its_stamp_and_a_stuck_one_does_not(clean):
    topic = f"/contact/{FINGER}/force"
    frozen, stuck = (
        of(inject(name, clean), topic, 1.0, 2.0) for name in ("finger_frozen", "finger_stuck")
    )
    assert {m.stamp_ns for m in frozen} == {10**9}
    assert len({m.stamp_ns for m in stuck}) == len({m.due for m in stuck}) == 100
    assert len({m.values.tobytes() for m in [*frozen, *stuck]}) == 1


def test_a_sensor_that_sticks_reads_the_same_in_its_own_axes(clean):
    messages = inject("finger_stuck_in_sensor", clean)
    forces = of(messages, f"/contact/{FINGER}/force", 1.0, 2.0)
    lengths = [np.linalg.norm(m.values[:3]) for m in forces]
    assert np.ptp(lengths) < 1e-9
    assert np.ptp([m.values[0] for m in forces]) > 0.1


def test_shuffled_frames_stay_whole_and_within_three(clean):
    poses = of(inject("shuffled", clean), "/object/pose", 1.0, 2.0)
    late = np.array([m.due - 1e-9 * m.stamp_ns for m in poses])
    assert 0.0 < np.max(np.abs(late)) <= 0.02 + 1e-9
    assert sorted(m.stamp_ns for m in poses) == [10**9 + 10**7 * k for k in range(100)]


def test_a_clock_that_jumps_stays_there(clean):
    messages = inject("clock_back_1h", clean)
    shift = {m.stamp_ns - n.stamp_ns for m, n in zip(messages, clean, strict=True) if m.due >= 1.0}
    assert shift == {-HOUR_NS}


def test_batches_lose_nothing_and_come_a_second_late_at_most(clean):
    messages = inject("batches_1s", clean)
    held = [m for m in messages if 10**9 <= m.stamp_ns < 2 * 10**9]
    assert len(held) == 1300
    assert {m.due for m in held} == {2.0}


def test_the_second_publisher_sends_poses_of_its_own_beside_the_first(clean):
    messages = inject("second_publisher", clean)
    rivals = [m for m in messages if m.sender == RIVAL]
    assert len(rivals) == 100
    assert len(messages) == len(clean) + 100
    assert {m.topic for m in rivals} == {"/object/pose"}


def test_bytes_are_spoilt_where_they_must_be(clean):
    text = of(inject("invalid_utf8", clean), "/object/pose", 1.0, 2.0)[0].encoded(EPOCH_NS)
    with pytest.raises(UnicodeDecodeError):
        text.decode()
    assert len(text) == len(of(clean, "/object/pose")[0].encoded(EPOCH_NS))
    short = {len(m.encoded(EPOCH_NS)) for m in inject("short_cdr", clean) if 1.0 <= m.due < 2.0}
    assert short == {6, 15, 30, 45}


def status(at, distance, sure=True):
    """Return a status whose mass is that many standard deviations off."""
    value, std = BODY.values().copy(), np.full(len(PARAMETER_NAMES), 0.01)
    value[0] += 0.01 * distance
    return Status(at, at, 0, "", value, std if sure else np.full_like(std, np.inf), {})


def test_an_estimate_is_wrong_until_the_next_one_and_claims_nothing_without_an_interval():
    chain = [status(0.0, 1), status(0.1, 7), status(0.4, 9, sure=False), status(0.6, 2)]
    worst, wrong = wrong_time(chain, BODY.values())
    assert worst == pytest.approx(7.0)
    assert wrong == pytest.approx(0.3)


def test_counts_and_texts_that_a_fault_brings_are_told_from_usual_ones():
    reports = [
        Report(1.0, "model_check", 0, "ok", {"dropped": 2.0}),
        Report(2.0, "model_check", 0, "ok", {"dropped": 2.0, "not_finite": 1.0}),
        Report(3.0, "model_check", 0, "ok", {"dropped": 3.0, "not_finite": 1.0}),
    ]
    assert risen(reports, 1.5, 2.5) == {"model_check/not_finite"}
    assert risen(reports, 1.5, 3.5) == {"model_check/not_finite", "model_check/dropped"}
    again = Report(4.0, "model_check", 0, "ok", {})
    after = Report(5.0, "model_check", 0, "ok", {"dropped": 1.0})
    assert risen([*reports, again, after], 4.5, 5.5) == {"model_check/dropped"}
    unsure = replace(status(0.0, 1), level=1, text="9 of 10 directions identified")
    misfit = replace(unsure, text="the model does not fit: error 12 times the noise")
    assert said_text([unsure, replace(misfit, level=0)]) == set()
    assert said_text([misfit]) == {"the model does not fit: error ## times the noise"}


def test_memory_is_a_line_through_whole_cycles():
    time = np.arange(5.0, 6000.1, 5.0)
    sawtooth = 30.0 * (time % 600.0) / 600.0
    warming = np.where(time <= 500.0, -50.0, 0.0)
    usual, growth_, std = growth(time, 100.0 + sawtooth + warming, 600.0)
    assert usual == pytest.approx(115.0, abs=1.0)
    assert abs(growth_) < 0.001
    assert std < 0.001
    leaking = 100.0 + sawtooth + 0.001 * time
    usual, growth_, std = growth(time, leaking, 600.0)
    assert growth_ * usual == pytest.approx(0.9 * 6.0, rel=0.05)


def found(mass, std, error=1.0):
    """Return an estimate with that mass; the rest is as true as can be."""
    values = dict(zip(PARAMETER_NAMES, BODY.values(), strict=True))
    return Found(values | {"mass": mass}, dict.fromkeys(values, std), {"viscous_drag": {}}, error)


def test_live_is_measured_against_truth_and_offline():
    truth = {"mass": BODY.mass, "com": BODY.com, "inertia_com": BODY.inertia_com}
    truth["effects"] = {"viscous_drag": {"parameters": {}}}
    result = Result("viscous_drag", 1)
    live = found(BODY.mass + 0.05, std=0.01, error=1.2)
    compare(result, live, found(BODY.mass - 0.02, std=0.02), truth, True)
    assert result.z["mass"] == pytest.approx(5.0)
    assert result.offline_z["mass"] == pytest.approx(1.0)
    assert result.distance["mass"] == pytest.approx(3.5)
    assert result.failures == [
        "mass off 5.0",
        "mass from offline 3.5",
        "error 1.20 times offline's",
    ]
