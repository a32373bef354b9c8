"""What a fingertip admits: wider where it is at its limit, no slip of what is not pulled."""

from __future__ import annotations

import numpy as np
import pytest

from tactile_dynamics_ros.core.friction.slip_detection import SlipFusion, SlipObservation
from tactile_dynamics_ros.core.tactile.electrodes import ELECTRODES, FULL_SCALE, PAC, PDC
from tactile_dynamics_ros.core.tactile.fingertip import FingertipConfig, FingertipEstimator
from tactile_dynamics_ros.core.tactile.slip import SlipDetector

FORCE = np.array([0.4, -0.2, -1.5])
STD = np.array([0.02, 0.11, 0.05])
GAIN = np.array([[1.0, 0.2, 0.0], [0.0, 1.1, 0.0], [0.0, -0.1, 0.9]])


class Told:
    """A model of the force that always says the same."""

    def reset(self, rest: np.ndarray) -> None:
        """Nothing to forget."""

    def predict(self, change: np.ndarray) -> tuple[np.ndarray, ...]:
        shape = change.shape[:-1]
        wide = [np.broadcast_to(value, (*shape, 3)) for value in (FORCE, STD, 0.01 * STD)]
        return wide[0], wide[1], wide[2], np.full(shape, 1e-3)


def frames(count: int, fingers: int = 1) -> np.ndarray:
    counts = np.full((count, fingers, 44), 2000.0)
    return counts + np.random.default_rng(1).integers(-2, 3, counts.shape)


def estimator(fingers: int, gain: tuple[float, ...] = (1.0,)) -> FingertipEstimator:
    own = FingertipEstimator(Told(), [FingertipConfig(gain=gain)] * fingers)
    own.tare(frames(50, fingers))
    return own


@pytest.mark.parametrize("count", [0.0, 5.0, FULL_SCALE - 3.0, FULL_SCALE])
def test_an_electrode_at_the_end_of_its_range_trebles_the_uncertainty_of_its_finger(count):
    own = estimator(3)
    frame = frames(1, 3)[0]
    before = own.observe(frame)
    assert not before.saturated.any()
    np.testing.assert_allclose(before.std, [STD] * 3)
    frame[1, ELECTRODES][4] = count
    after = own.observe(frame)
    assert after.saturated.tolist() == [False, True, False]
    np.testing.assert_allclose(after.std, np.array([[1.0], [3.0], [1.0]]) * STD)


def test_an_electrode_near_the_end_of_its_range_changes_nothing():
    own = estimator(1)
    frame = frames(1)[0]
    frame[0, ELECTRODES][4] = FULL_SCALE - 40.0
    np.testing.assert_allclose(own.observe(frame).std, [STD])


def test_dead_electrodes_widen_by_three_tenths_each_and_are_not_saturated():
    own = FingertipEstimator(Told(), [FingertipConfig()])
    rest = frames(50)
    rest[:, 0, ELECTRODES][:, [2, 9]] = [0.0, FULL_SCALE]
    own.tare(rest)
    frame = rest[0].copy()
    found = own.observe(frame)
    assert not found.saturated.any()
    np.testing.assert_allclose(found.std, [1.6 * STD])


def test_force_is_that_of_the_model_times_the_gain_of_this_unit():
    own = estimator(1, tuple(GAIN.ravel()))
    frame = frames(1)[0]
    frame[0, PDC] += 400.0
    for _ in range(3):
        found = own.observe(frame)
    assert found.in_contact.all()
    np.testing.assert_allclose(found.force, [GAIN @ FORCE])


def vibrating(ratio: float | None, seconds: float = 1.0) -> list[bool]:
    fusion = SlipFusion()
    steps = np.arange(round(100 * seconds)) / 100
    seen = [SlipObservation(5.0, 6.0, 0.01 * time, ratio) for time in steps]
    return [fusion.update(time, each).slipping for time, each in zip(steps, seen, strict=True)]


def test_what_is_hardly_pulled_does_not_slip_however_much_it_shakes():
    least = SlipFusion().config.least_ratio
    assert not any(vibrating(0.95 * least))
    assert all(vibrating(1.05 * least)[20:])
    assert all(vibrating(None)[20:])


def test_letting_go_of_the_pull_ends_a_slip_at_once_and_forgets_it():
    fusion = SlipFusion()
    for k in range(50):
        state = fusion.update(0.01 * k, SlipObservation(5.0, 6.0, 1e-4 * k, 0.6))
    assert state.slipping
    state = fusion.update(0.5, SlipObservation(5.0, 6.0, 5e-3, 0.1))
    assert (state.slipping, state.score) == (False, 0.0)


def test_what_is_not_touched_does_not_slip_however_much_it_shakes():
    rng = np.random.default_rng(2)
    rest = frames(100)[:, 0]
    loud = rest.copy()
    channels = np.arange(44)[PAC]
    loud[:, channels] += 300.0 * rng.normal(size=(100, len(channels)))
    for touching in (False, True):
        detector = SlipDetector()
        detector.tare(rest)
        found = [detector.update(frame, touching) for frame in loud]
        assert found[-1].level > 3.0
        assert [bool(each.slipping) for each in found[20:]] == [touching] * 80
        assert bool(found[-1].score > 1.0) is touching
