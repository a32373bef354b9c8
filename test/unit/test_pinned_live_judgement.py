"""Which live samples are believed, and what says that the model no longer fits."""

from __future__ import annotations

import numpy as np
import pytest

from tactile_dynamics_ros.core.inertia.live.live_estimate import RecentFit
from tactile_dynamics_ros.core.inertia.live.pipeline import Judge

HUBER, GATE = 1.9, 8.0


def judge() -> Judge:
    return Judge(HUBER, GATE)


@pytest.mark.parametrize(
    ("deviations", "weight"),
    [(0.0, 1.0), (1.8, 1.0), (3.8, 0.5), (7.6, 0.25), (7.99, HUBER / 7.99), (8.01, 0.0)],
)
def test_weight_falls_with_the_innovation_and_ends_at_the_gate(deviations, weight):
    own = judge()
    own._seen = 10**9  # the scale learns nothing from one sample
    assert own.weigh(deviations**2, False) == pytest.approx(weight, rel=1e-6)
    assert own.rejected == int(weight == 0.0)


def test_innovations_count_relative_to_how_well_the_model_fits_lately():
    own = judge()
    own._seen, own.scale = 10**9, 9.0
    assert own.weigh((3.0 * 3.8) ** 2, False) == pytest.approx(0.5, rel=1e-6)


def test_scale_is_the_mean_square_and_one_at_least():
    own = judge()
    squares = np.random.default_rng(1).chisquare(6, 4000) / 6.0
    for square in 2.0 * squares:
        own.weigh(float(square), False)
    assert own.scale == pytest.approx(2.0, rel=0.12)
    for square in 0.1 * squares:
        own.weigh(float(square), False)
    assert own.scale == 1.0


def test_one_innovation_moves_the_scale_by_no_more_than_itself():
    own = judge()
    own._seen, own.scale = 499, 4.0
    own.weigh(1e6, False)
    assert own.scale == pytest.approx(4.0 + 4.0 / 500)


def test_samples_count_less_only_while_the_model_fits_worse_than_before():
    """Where it misfits from the start nothing is left of the past that would be better."""
    squares = np.random.default_rng(2).chisquare(6, 1200) / 6.0
    own, always = judge(), judge()
    before = [own.noise for s in squares[:600] if own.weigh(float(s), False)]
    assert max(before) < 1.4 and np.mean(before) < 1.05
    during = [own.noise for s in squares[600:900] if own.weigh(16.0 * float(s), False)]
    assert during[-1] == pytest.approx(9.0 * 16.0 / own.scale, rel=0.5) and during[4] > 5.0
    after = [own.noise for s in squares[900:] if own.weigh(float(s), False)]
    assert max(after[100:]) < 1.4
    lasting = [always.noise for s in squares if always.weigh(16.0 * float(s), False)]
    assert np.mean(lasting[300:]) < 1.1


def test_doubtful_samples_are_believed_as_they_are_or_not_at_all_and_teach_no_scale():
    own = judge()
    assert own.weigh(1.8**2, True) == 1.0
    assert own.weigh(2.0**2, True) == 0.0
    assert (own.scale, own.rejected) == (1.0, 1)


def test_nothing_doubtful_is_believed_while_a_tenth_of_it_does_not_fit():
    """A fault of which one sample in five happens to misfit is a choice that biases."""
    own = judge()
    weights = [own.weigh(25.0 if k % 5 == 0 else 0.5, True) for k in range(200)]
    assert not any(weights[50:])
    trusted = judge()
    weights = [trusted.weigh(25.0 if k % 50 == 0 else 0.5, True) for k in range(200)]
    fits = [k for k in range(200) if k % 50]
    assert all(weights[k] for k in fits)


@pytest.mark.parametrize(("waited", "believed"), [(54, 0.0), (57, 1.0)])
def test_trust_comes_back_with_samples_that_nobody_doubts(waited, believed):
    """After a fault the share of misfits falls below a tenth in 25 log 10 samples."""
    own = judge()
    for _ in range(400):
        own.weigh(25.0, True)
    for _ in range(waited):
        own.weigh(0.5, False)
    assert own.weigh(0.5, True) == believed


def test_error_of_the_last_samples_is_relative_to_the_noise_and_to_what_was_measured():
    rng = np.random.default_rng(2)
    wrench = np.tile([0.1, 5.0, 0.3, 20.0, 1.0, 2.0], 200) * rng.normal(size=1200)
    residual = 2.0 * rng.normal(size=1200)
    fit = RecentFit.of_rows(residual, wrench)
    assert fit.rms == pytest.approx(np.sqrt(np.mean(residual**2)))
    assert fit.explained == pytest.approx(1.0 - np.sum(residual**2) / np.sum(wrench**2))


def test_forces_of_the_wrong_sign_leave_a_model_that_is_worse_than_no_object():
    wrench = np.random.default_rng(3).normal(size=600) * 30.0
    assert RecentFit.of_rows(0.0 * wrench, wrench).explained == 1.0
    assert RecentFit.of_rows(wrench, wrench).explained == pytest.approx(0.0)
    assert RecentFit.of_rows(2.0 * wrench, wrench).explained == pytest.approx(-3.0)


def test_noise_alone_explains_nothing_and_refutes_nothing():
    noise = 0.3 * np.random.default_rng(4).normal(size=600)
    assert RecentFit.of_rows(noise, noise).explained == pytest.approx(1.0 - np.mean(noise**2))
