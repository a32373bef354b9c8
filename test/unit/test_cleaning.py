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


def _turning(rng, rate, seconds=10.0):
    """Six smooth channels, (N, 6)."""
    time = np.arange(0.0, seconds, 1.0 / rate)[:, None]
    waves = [(rng.uniform(2, 8, 6), rng.uniform(0.1, 1.0, 6), rng.uniform(0, 6, 6)) for _ in "abc"]
    return sum(size * np.sin(2 * np.pi * f * time + phase) for size, f, phase in waves)


@pytest.mark.parametrize("step", [0.1, 1.0])
@pytest.mark.parametrize("rate", [100, 1000])
def test_coarse_steps_of_a_sensor_are_no_rail(step, rate):
    rng = np.random.default_rng(int(rate / step))
    fine = _turning(rng, rate) + 0.02 * rng.normal(size=(10 * rate, 6))
    assert not find_saturated(step * np.round(fine / step)).any()


@pytest.mark.parametrize("rate", [100, 1000])
def test_a_rail_of_a_coarse_sensor_is_found(rate):
    rng, step = np.random.default_rng(rate), 0.1
    fine = _turning(rng, rate) + 0.02 * rng.normal(size=(10 * rate, 6))
    limit = 0.7 * fine[:, 0].max()
    clipped = fine.copy()
    clipped[:, 0] = np.minimum(clipped[:, 0], limit)
    beyond = fine[:, 0] > limit + step
    assert find_saturated(step * np.round(clipped / step))[beyond].mean() > 0.6


def test_a_coarse_sensor_at_rest_is_not_on_its_rail():
    time = np.linspace(0.0, 10.0, 1000)[:, None]
    lifted = np.clip(2.0 * (5.0 - np.abs(time - 5.0)), 0.0, 6.0) ** 1.5
    steady = 0.1 * np.round(lifted * np.arange(1.0, 7.0) / 0.1)
    assert not find_saturated(steady).any()


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
