"""Which samples of a stream are faulty, repeated or out of order."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tactile_dynamics_ros.recording.cleaning import find_held, find_not_increasing, find_saturated


@pytest.mark.parametrize(("sensor", "published"), [(50.0, 100.0), (60.0, 100.0), (30.0, 200.0)])
def test_repetitions_of_a_slower_sensor_are_found(sensor, published):
    rng = np.random.default_rng(1)
    values = rng.normal(size=(500, 3))
    index = np.floor(np.arange(400) * sensor / published).astype(int)
    held = find_held(values[index])
    assert held.tolist() == [False, *(np.diff(index) == 0).tolist()]


def test_resting_quantised_or_noisy_signals_do_not_count_as_repeated():
    rng = np.random.default_rng(2)
    assert not find_held(np.ones((300, 3))).any()
    assert not find_held(rng.normal(size=(300, 3))).any()
    for step in (0.5, 1.0, 2.0, 4.0):
        assert not find_held(np.round(rng.normal(size=(300, 3)) / step)).any()
    assert not find_held(np.empty((0, 3))).any()


def test_constant_and_held_signals_are_not_called_saturated():
    random = np.random.default_rng(0)
    constant = np.full((200, 1), 2.0)
    held = np.repeat(random.normal(size=40), 5)[:, None]
    counts = np.round(random.normal(size=(200, 1)) * 3)
    silent = np.concatenate([np.zeros(100), np.abs(random.normal(size=100))])[:, None]
    for channel in (constant, held, counts, silent):
        assert not find_saturated(channel).any()


@settings(max_examples=100, deadline=None)
@given(st.lists(st.integers(0, 30), min_size=1, max_size=40))
def test_kept_stamps_increase_and_no_larger_choice_exists(stamps):
    time = np.array(stamps, dtype=float)
    kept = time[~find_not_increasing(time)]
    assert np.all(np.diff(kept) > 0)
    longest = np.ones(len(time), dtype=int)
    for k in range(len(time)):
        below = longest[:k][time[:k] < time[k]]
        longest[k] = 1 + below.max(initial=0)
    assert len(kept) == longest.max()
