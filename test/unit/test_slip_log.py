"""What the log of one attempt makes of the forces around a slip."""

import numpy as np
import pytest

from tactile_dynamics_ros.core.friction.slip_log import Attempt, SlipLog

STATIC, KINETIC, PULL = 0.8, 0.64, 0.6


def log_ramp(rate, rng=None, noise=0.0):
    """A fingertip pulled with 0.6 N that is unloaded at a rate (N/s) until it slips."""
    rng = rng or np.random.default_rng(0)
    log, time, slipped = SlipLog(), 0.0, None
    press = PULL / STATIC + 0.45 * rate
    while slipped is None or time < slipped + 0.15:
        if slipped is None:
            press -= 0.01 * rate
            if press < PULL / STATIC:
                slipped = time
        pull = PULL if slipped is None else KINETIC * press
        way = 0.0 if slipped is None else 0.01 * (time - slipped)
        force = np.array([press, pull, 0.0]) + rng.normal(0.0, noise, 3)
        log.add(time, force, np.array([0.0, way, 0.0]))
        time += 0.01
    attempt = Attempt(0.0, "body", "unload", 0.0, slipped + 0.03, np.eye(3), np.zeros(3))
    return log.event(attempt)


@pytest.mark.parametrize("rate", [0.1, 0.5, 1.0, 1.5])
def test_a_steep_ramp_reads_as_a_slow_one(rate):
    last_step = 0.01 * rate / (PULL / STATIC)
    assert STATIC * (1.0 - last_step) <= log_ramp(rate).ratio <= STATIC * 1.001


def test_noise_of_the_forces_does_not_shift_the_coefficient_by_more_than_a_percent_or_two():
    rng = np.random.default_rng(1)
    ratios = [log_ramp(0.5, rng, noise=0.015).ratio for _ in range(60)]
    assert np.mean(ratios) == pytest.approx(STATIC, rel=0.02)
    assert np.std(ratios) < 0.02


def test_the_slide_tells_the_kinetic_coefficient_and_the_speed():
    event = log_ramp(0.5)
    assert event.kinetic == pytest.approx(KINETIC, rel=0.01)
    assert event.speed == pytest.approx(0.01, rel=0.05)
