"""One clock for streams that belong together, and readings in the order they were taken in."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from tactile_dynamics_ros.core.streams.stamps import Reordered, SharedClock


def feed(clock, stamps, pause=0.01):
    """Check stamps that come one after the other; return which were believed and set it back."""
    start = feed.now
    feed.now = start + pause * len(stamps)
    return [clock.check(float(t), start + pause * (k + 1)) for k, t in enumerate(stamps)]


feed.now = 100.0


def test_stamps_of_streams_with_different_latency_are_believed():
    clock = SharedClock()
    assert feed(clock, [5.0, 4.2, 5.01, 5.9, 4.95]) == [(True, False)] * 5
    assert clock.newest == 5.9


def test_a_single_stray_is_refused_and_leaves_no_trace():
    clock = SharedClock()
    feed(clock, np.arange(10.0, 11.0, 0.1))
    found = feed(clock, [3611.0, 11.0, 3611.1, 11.1])
    assert [believed for believed, _ in found] == [False, True, False, True]


def test_a_stream_on_another_clock_is_refused_as_long_as_the_others_speak():
    clock = SharedClock()
    stamps = np.column_stack([np.arange(50) * 0.01, 3600.0 + np.arange(50) * 0.01]).ravel()
    found = feed(clock, stamps[:2])
    found = feed(clock, stamps[2:])
    assert [believed for believed, _ in found] == [True, False] * 49


def test_a_clock_that_is_set_back_is_told_once():
    clock = SharedClock()
    feed(clock, 3600.0 + np.arange(20) * 0.01)
    found = feed(clock, 5.0 + np.arange(40) * 0.01)
    assert sum(back for _, back in found) == 1
    assert all(believed for believed, _ in found[10:])
    assert abs(clock.newest - 5.39) < 1e-9


def test_a_clock_that_leaps_ahead_is_followed_and_not_called_restarted():
    clock = SharedClock()
    feed(clock, np.arange(20) * 0.01)
    found = feed(clock, 3600.0 + np.arange(20) * 0.01)
    assert found[-1] == (True, False)
    assert not any(back for _, back in found)


def test_a_pause_is_no_leap():
    clock = SharedClock()
    clock.check(1.0, 50.0)
    assert clock.check(31.0, 80.0) == (True, False)


def test_a_stray_at_the_very_beginning_does_not_last():
    clock = SharedClock()
    clock.check(9999.0, 50.0)
    found = [clock.check(1.0 + 0.01 * k, 50.01 + 0.01 * k)[0] for k in range(30)]
    assert found[-1] and sum(found) >= 20


@given(st.lists(st.integers(0, 40), min_size=1, max_size=60))
def test_reordered_items_come_once_and_in_order(stamps):
    queue, taken, refused = Reordered(), [], 0
    for stamp in stamps:
        refused += not queue.add(float(stamp), stamp)
        taken += queue.take(max(stamps) - 20.0)
    taken += queue.take(np.inf)
    times = [time for time, _ in taken]
    assert times == sorted(set(times))
    assert all(time == item for time, item in taken)
    assert len(taken) + refused == len(stamps)
    newest = np.maximum.accumulate(stamps)
    assert queue.late <= sum(s < n for s, n in zip(stamps, newest, strict=True))
    late = {s for s in stamps if s > max(stamps) - 20.0}
    assert late <= set(times)


def test_the_oldest_go_beyond_the_capacity():
    queue = Reordered(capacity=3)
    for k in range(5):
        queue.add(float(k), k)
    assert [item for _, item in queue.take(np.inf)] == [2, 3, 4]
    assert not queue.add(1.0, 1)
