"""Rest state of a fingertip: an average over the time without contact, at first of all of it."""

from __future__ import annotations

import numpy as np
import pytest

from tactile_dynamics_ros.core.tactile.electrodes import ELECTRODES
from tactile_dynamics_ros.core.tactile.fingertip import FingertipConfig
from tactile_dynamics_ros.core.tactile.signal_change import RestState
from tactile_dynamics_ros.sim.sensors.biotac import BioTacArray, BioTacConfig

TARE, FREE = 30, 800


@pytest.fixture(scope="module")
def frames() -> np.ndarray:
    """Counts (T, 20, 44) of twenty free fingertips whose electrodes wander."""
    steady, nothing = BioTacConfig(temperature_wander=0.0), np.zeros((20, 3))
    sensors = BioTacArray(20, steady, seed=71)
    return np.array([sensors.measure(nothing, nothing) for _ in range(5 * FREE)], dtype=float)


def settled(frames: np.ndarray, gain: float) -> RestState:
    state = RestState.from_frames(frames[:TARE])
    for counts in frames[TARE:]:
        state = state.follow(counts, gain)
    return state


def test_every_frame_counts_the_same_at_first(frames):
    state = settled(frames[:FREE, 0], gain=1e-4)
    assert state.frames == FREE
    np.testing.assert_allclose(state.electrodes, frames[:FREE, 0, ELECTRODES].mean(axis=0))


def test_only_free_fingers_follow(frames):
    tare = RestState.from_frames(frames[:TARE])
    free = np.arange(20) % 3 == 0
    moved = tare.follow(frames[TARE] + 60.0, 0.01, free)
    assert np.array_equal(np.any(moved.signals != tare.signals, axis=1), free)
    assert np.array_equal(moved.temperature != tare.temperature, free)
    assert moved.frames.tolist() == (TARE + free).tolist()


def test_old_frames_fade(frames):
    state = settled(np.concatenate([frames[:FREE, 0], frames[:FREE, 0] + 50.0]), gain=0.05)
    assert np.all(
        np.abs(state.electrodes - 50.0 - frames[FREE - 20 : FREE, 0, ELECTRODES].mean(axis=0)) < 5.0
    )


def test_no_gain_keeps_the_tare(frames):
    tare = RestState.from_frames(frames[:TARE, 0])
    assert np.array_equal(settled(frames[:, 0], gain=0.0).electrodes, tare.electrodes)


def test_wander_averages_out_before_the_grasp(frames):
    """What is left of the wander acts as a constant force while the finger holds something."""

    before, after = frames[:FREE], frames[2 * FREE :].mean(axis=0)

    def error(gain: float) -> float:
        state = settled(before, gain)
        return float(np.std(state.change(after, state.warming(after))[:, :19]))

    assert error(FingertipConfig().rest_gain) < 0.85 * error(0.01)
