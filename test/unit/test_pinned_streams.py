"""Order, clocks and the window of live measurements, at their limits."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.rigid_body.rotation import exp_so3, log_so3
from tactile_dynamics_ros.core.streams.measurement_window import MeasurementWindow
from tactile_dynamics_ros.core.streams.stamps import Admission, Reordered, SharedClock
from tactile_dynamics_ros.core.streams.streams import (
    ContactSample,
    enclosing_steps,
    nearest_samples,
    places_at,
)


def test_every_item_comes_once_in_order_however_it_was_shuffled_within_its_delay():
    rng = np.random.default_rng(1)
    for _ in range(200):
        stamps = np.cumsum(rng.uniform(0.001, 0.02, 60))
        arrival = stamps + rng.uniform(0.0, 0.05, 60)
        own, got, late, newest = Reordered[int](), [], 0, -np.inf
        for k in np.argsort(arrival):
            late += stamps[k] < newest
            newest = max(newest, stamps[k])
            assert own.add(stamps[k], k)
            got += own.take(arrival[k] - 0.05)
        got += own.take(np.inf)
        assert [item for _, item in got] == list(range(60))
        assert own.late == late


def test_items_are_taken_up_to_and_with_their_time_and_never_behind_it():
    own = Reordered[str]()
    for time, item in ((0.3, "c"), (0.1, "a"), (0.2, "b")):
        assert own.add(time, item)
    assert not own.add(0.2, "again")
    assert own.take(0.2) == [(0.1, "a"), (0.2, "b")]
    assert not own.add(0.2, "too late")
    assert not own.add(0.15, "too late")
    assert own.take(0.25) == []
    assert own.add(0.25, "between")
    assert own.take(1.0) == [(0.25, "between"), (0.3, "c")]


def test_beyond_the_capacity_the_oldest_go_and_do_not_come_back():
    own = Reordered[int](capacity=3)
    for k in (1, 2, 3, 4):
        own.add(float(k), k)
    assert not own.add(0.5, 0)
    assert [item for _, item in own.take(9.0)] == [2, 3, 4]


@pytest.mark.parametrize(("step", "waited", "believed"), [
    (-0.99, 0.0, True), (-1.01, 0.0, False), (0.99, 0.0, True), (1.01, 0.0, False),
    (10.9, 0.5, True), (11.1, 0.5, False), (-1.01, 5.0, False),
])  # fmt: skip
def test_a_stamp_is_believed_within_a_second_or_as_long_as_was_waited(step, waited, believed):
    clock = SharedClock()
    assert clock.check(100.0, 7.0) is Admission.BELIEVED
    found = clock.check(100.0 + step, 7.0 + waited)
    assert found is (Admission.BELIEVED if believed else Admission.STRAY)
    assert clock.newest == (max(100.0, 100.0 + step) if believed else 100.0)


def test_ten_strays_in_a_row_are_the_clock_and_nine_are_not():
    for step, moved in ((-50.0, Admission.RESTARTED), (50.0, Admission.BELIEVED)):
        clock = SharedClock()
        clock.check(100.0, 0.0)
        answers = [clock.check(100.0 + step + 0.01 * k, 1e-3 * k) for k in range(10)]
        assert answers == [Admission.STRAY] * 9 + [moved]
        assert clock.newest == pytest.approx(100.0 + step + 0.09)


def test_strays_on_unlike_clocks_or_with_a_word_between_them_are_not_the_clock():
    clock = SharedClock()
    clock.check(100.0, 0.0)
    for k in range(30):
        assert clock.check(50.0 - 2.0 * k, 1e-3 * k) is Admission.STRAY
    for k in range(30):
        if k % 9 == 8:
            assert clock.check(100.0, 0.0) is Admission.BELIEVED
        assert clock.check(50.0, 1e-3 * k) is Admission.STRAY


@pytest.mark.parametrize("step", [0.05, 0.9])
def test_five_stamps_in_a_row_behind_those_of_their_topic_are_a_step_back(step):
    clock = SharedClock()
    for k in range(100):
        assert clock.check(0.01 * k, 0.01 * k, "a") is Admission.BELIEVED
    answers = [clock.check(0.99 + 0.01 * (k + 1) - step, 1.0, "a") for k in range(5)]
    late = round(step / 0.01)
    assert answers == [Admission.BELIEVED] * 4 + [
        Admission.STEPPED if late > 5 else Admission.BELIEVED
    ]
    assert clock.newest == pytest.approx(1.04 - step if late > 5 else 0.99, abs=1e-9)


def test_other_topics_and_orders_that_a_link_changes_are_no_step_back():
    clock, order = SharedClock(), (2, 1, 0)
    for k in range(100):
        stamp = 0.01 * (k // 3 * 3 + order[k % 3])
        assert clock.check(stamp, 0.0, "a") is Admission.BELIEVED
        assert clock.check(stamp - 0.5, 0.0, "late") is Admission.BELIEVED


def window(count: int = 31) -> MeasurementWindow:
    own = MeasurementWindow(2.0)
    for k in range(count):
        pose = np.eye(4)
        pose[:3, 3] = k
        own.add_pose(0.1 * k, pose, float(k + 1) * np.eye(6))
        stated = np.array([0.1, 0.2, 0.3]) * (k + 1)
        point, force = np.array([0.0, k, 1.0]), np.array([k, 2.0, 3.0])
        own.add_contact(
            ContactSample(0.1 * k, "index", point, np.eye(3), force, 0.0 * force, stated)
        )
        unstated = ContactSample(0.1 * k, "wrist", point, np.eye(3), force, force)
        own.add_contact(replace(unstated, std=stated) if k % 2 else unstated)
    return own


def test_the_window_keeps_its_duration_and_gives_the_last_of_it():
    own = window()
    assert own.newest == pytest.approx(3.0)
    assert own.span == pytest.approx(2.0, abs=0.101)
    streams = own.streams(0.75)
    np.testing.assert_allclose(streams.pose.time, 0.1 * np.arange(23, 31))
    np.testing.assert_allclose(streams.pose.position[:, 0], np.arange(23, 31))
    np.testing.assert_allclose(streams.pose.covariance[:, 0, 0], np.arange(24, 32))
    index = streams.contacts["index"]
    np.testing.assert_allclose(index.force[:, 0], np.arange(23, 31))
    np.testing.assert_allclose(index.force_std[:, 2], 0.3 * np.arange(24, 32))
    np.testing.assert_allclose(index.position[:, 1], np.arange(23, 31))


def test_what_one_reading_does_not_state_is_not_stated():
    contacts = window().streams().contacts
    assert contacts["index"].force_std is not None
    assert contacts["wrist"].force_std is None
    assert (contacts["index"].carries_torque, contacts["wrist"].carries_torque) == (False, True)


def test_late_readings_are_left_out_and_a_clock_set_back_begins_anew():
    own = window()
    own.add_pose(2.5, np.eye(4), None)
    assert len(own.streams(0.75).pose.time) == 8
    own.add_pose(1.5, np.eye(4), None)
    assert own.newest == 1.5
    with pytest.raises(BadInputError, match="no object pose"):
        own.streams()


def test_nearest_sample_is_the_nearer_one_and_the_earlier_of_two():
    stamps = np.array([0.0, 1.0, 3.0])
    time = np.array([-5.0, 0.4, 0.5, 0.6, 1.9, 2.0, 2.1, 9.0])
    assert nearest_samples(stamps, time).tolist() == [0, 0, 0, 1, 1, 1, 2, 2]


def test_samples_around_a_time_and_places_on_the_line_between_them():
    stamps = np.array([0.0, 1.0, 3.0])
    left, step = enclosing_steps(stamps, np.array([-1.0, 0.0, 0.5, 1.0, 2.9, 3.0, 4.0]))
    assert left.tolist() == [0, 0, 0, 1, 1, 1, 1]
    assert step.tolist() == [1.0, 1.0, 1.0, 2.0, 2.0, 2.0, 2.0]
    places = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 1.0], [5.0, 2.0, 1.0]])
    turns = exp_so3(np.array([[0.0, 0.0, 0.2], [0.0, 0.0, 0.6], [0.0, 0.4, 0.0]]))
    found, frames = places_at(stamps, places, turns, np.array([0.25, 1.5, 2.5, 9.0]))
    np.testing.assert_allclose(found[:3], [[0.25, 0.0, 1.0], [2.0, 0.5, 1.0], [4.0, 1.5, 1.0]])
    np.testing.assert_allclose(frames[0], exp_so3(np.array([0.0, 0.0, 0.3])), atol=1e-12)
    quarter = log_so3(turns[1].T @ frames[1]), log_so3(turns[1].T @ turns[2])
    np.testing.assert_allclose(quarter[0], 0.25 * quarter[1], atol=1e-12)
    np.testing.assert_allclose(frames[3], turns[2], atol=1e-12)
