"""Dead electrodes, warming and slip of a live fingertip."""

from __future__ import annotations

import numpy as np
import pytest

from tactile_dynamics_ros.core.tactile.analytic_force import AnalyticForceEstimator
from tactile_dynamics_ros.core.tactile.electrodes import ELECTRODE_POSITION, TDC
from tactile_dynamics_ros.core.tactile.fingertip import fill_dead_electrodes, find_dead_electrodes
from tactile_dynamics_ros.core.tactile.slip import SlipDetector
from tactile_dynamics_ros.sim.sensors.biotac import BioTacArray

PLACE = np.array([[-5e-3, 0.0, -7e-3]])
PRESS = np.array([[0.1, 0.0, -1.2]])


@pytest.fixture
def frames() -> tuple[np.ndarray, np.ndarray]:
    sensor = BioTacArray(1, seed=12)
    rest = np.array([sensor.measure(np.zeros((1, 3)), PLACE)[0] for _ in range(50)])
    pressed = np.array([sensor.measure(PRESS, PLACE)[0] for _ in range(300)])
    return rest.astype(float), pressed.astype(float)


def test_dead_electrodes_are_found_and_hardly_spoil_the_force(frames):
    rest, pressed = frames
    healthy, broken = AnalyticForceEstimator(), AnalyticForceEstimator()
    healthy.tare(rest)
    spoilt = rest.copy()
    spoilt[:, 3], spoilt[:, 12] = 4095, 2900
    broken.tare(spoilt)
    assert not healthy.dead.any()
    assert np.flatnonzero(broken.dead).tolist() == [3, 12]
    pressed = pressed.copy()
    reference = np.array([healthy.observe(frame).force for frame in pressed])
    pressed[:, 3], pressed[:, 12] = 4095, 2900
    found = [broken.observe(frame) for frame in pressed]
    force = np.array([each.force for each in found])
    assert np.linalg.norm(force[100:] - reference[100:], axis=1).mean() < 0.25
    assert np.all(found[-1].std > 1.3 * healthy.last.std)
    assert not found[-1].saturated


def test_a_dead_electrode_is_the_mean_of_the_live_ones_near_to_it():
    dead = np.zeros((2, 19), dtype=bool)
    dead[1, [3, 12]] = True
    none, some = fill_dead_electrodes(dead)
    assert np.array_equal(none, np.eye(19))
    assert np.array_equal(some[~dead[1]], np.eye(19)[~dead[1]])
    assert np.allclose(some.sum(axis=1), 1.0)
    assert not some[:, dead[1]].any()
    gap = np.linalg.norm(ELECTRODE_POSITION - ELECTRODE_POSITION[3], axis=1)
    alive = np.flatnonzero(~dead[1])
    assert np.all(np.diff(some[3, alive[np.argsort(gap[alive])]]) <= 0.0)
    assert not fill_dead_electrodes(np.ones(19, dtype=bool)).any()


def test_a_single_frame_condemns_no_electrode(frames):
    assert not find_dead_electrodes(frames[0][:1]).any()


def test_warming_is_reported_and_flagged(frames):
    rest, pressed = frames
    estimator = AnalyticForceEstimator()
    estimator.tare(rest)
    assert not estimator.observe(pressed[10]).drifting
    for frame in pressed[:20]:
        warm = frame.copy()
        warm[TDC] += 250.0
        result = estimator.observe(warm)
    assert result.warming > 4.0
    assert result.drifting


def test_slip_is_heard_within_50_ms_and_its_end_too():
    sensor, detector = BioTacArray(1, seed=2), SlipDetector()
    detector.tare([sensor.measure(np.zeros((1, 3)), PLACE)[0] for _ in range(50)])
    levels, scores, slips = [], [], []
    for k in range(400):
        speed = 0.02 if 200 <= k < 300 else 0.0
        heard = detector.update(sensor.measure(PRESS, PLACE, slip_speed=speed)[0])
        levels.append(heard.level)
        scores.append(heard.score)
        slips.append(heard.slipping)
    assert not any(slips[20:200])
    assert all(slips[205:300])
    assert not any(slips[306:])
    assert np.mean(levels[100:200]) == pytest.approx(1.0, abs=0.3)
    assert max(scores[20:200]) < 1.0 < np.mean(scores[205:300])
    sliding = [sensor.measure(PRESS, PLACE, slip_speed=0.02)[0] for _ in range(6)]
    assert all(detector.update(frame).score > 1.0 for frame in sliding[:3])
    untouched = [detector.update(frame, False) for frame in sliding[3:]]
    assert all(heard.score == 0.0 and heard.level > 3.0 for heard in untouched)
    assert not untouched[-1].slipping


def test_fingers_that_are_listened_to_together_slip_as_each_does_alone():
    sensor, together = BioTacArray(3, seed=2), SlipDetector()
    press, place, still = np.tile(PRESS, (3, 1)), np.tile(PLACE, (3, 1)), np.zeros((3, 3))
    rest = np.array([sensor.measure(still, place) for _ in range(50)])
    moving = np.array([sensor.measure(press, place, slip_speed=0.02) for _ in range(50)])
    frames = np.concatenate([rest, moving])
    frames[50:, 1] = rest[:, 1]
    together.tare(rest)
    alone = [SlipDetector() for _ in range(3)]
    for finger, detector in enumerate(alone):
        detector.tare(rest[:, finger])
    for frame in frames:
        touching = np.array([True, True, False])
        heard = together.update(frame, touching)
        each = [d.update(*pair) for d, *pair in zip(alone, frame, touching, strict=True)]
        assert np.allclose(heard.level, [one.level for one in each])
        assert np.allclose(heard.score, [one.score for one in each])
        assert heard.slipping.tolist() == [bool(one.slipping) for one in each]
    assert heard.slipping.tolist() == [True, False, False]
