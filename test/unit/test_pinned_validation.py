"""Held-out errors come from data that the fit has not seen, and scatter from block to block."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

from tactile_dynamics_ros.core.discrepancy.verdict.validation import HeldOut, fits_equally, held_out

DRAWS = 200


@dataclass(frozen=True)
class Fit:
    residual: np.ndarray
    jacobian: np.ndarray
    time: np.ndarray


def fit(rng: np.random.Generator, rows: int = 480, size: int = 10) -> Fit:
    time = np.sort(rng.uniform(0.0, 24.0, rows))
    jacobian = rng.normal(size=(rows, size)) * 10.0 ** rng.uniform(-3, 3, size)
    raw = rng.normal(size=rows)
    return Fit(raw - jacobian @ np.linalg.lstsq(jacobian, raw, rcond=None)[0], jacobian, time)


def test_each_block_is_predicted_from_the_blocks_of_the_other_parity():
    model = fit(np.random.default_rng(1))
    block = ((model.time - model.time[0]) // 1.5).astype(int)
    expected = np.zeros(block.max() + 1)
    for parity in (0, 1):
        known = block % 2 != parity
        rows = model.jacobian[known], model.residual[known]
        step = np.linalg.lstsq(rows[0], rows[1], rcond=None)[0]
        for k in range(parity, len(expected), 2):
            own = block == k
            expected[k] = np.sum((model.residual[own] - model.jacobian[own] @ step) ** 2)
    found = held_out(model)
    np.testing.assert_allclose(found.losses, expected, rtol=1e-4)
    assert found.rms == pytest.approx(np.sqrt(expected.sum() / len(block)), rel=1e-4)


def test_needless_parameters_raise_the_held_out_error_by_what_they_cost():
    """E |test error|^2 = N + 2 p for p needless parameters, of training it would be N - 2 p."""
    rng = np.random.default_rng(2)
    squares = [held_out(fit(rng)).losses.sum() for _ in range(DRAWS)]
    assert np.mean(squares) == pytest.approx(480 + 2 * 10, abs=8)


def losses(values: np.ndarray) -> HeldOut:
    return HeldOut(np.asarray(values, dtype=float), 600)


def test_a_difference_within_the_scatter_of_the_blocks_decides_nothing():
    rng = np.random.default_rng(3)
    base = 30.0 + rng.normal(size=(DRAWS, 20))
    scattered = base + 10.0 * rng.normal(size=base.shape)
    pairs = list(zip(base, scattered, strict=True))
    equal = [fits_equally(losses(best), losses(other)) for best, other in pairs]
    assert np.mean(equal) > 0.93  # 97 % by Student's t with 19 degrees of freedom at two


def test_a_difference_beyond_the_scatter_decides():
    rng = np.random.default_rng(4)
    base = 30.0 + rng.normal(size=(DRAWS, 20))
    worse = base + 10.0 + 10.0 * rng.normal(size=base.shape)
    pairs = list(zip(base, worse, strict=True))
    equal = [fits_equally(losses(best), losses(other)) for best, other in pairs]
    assert np.mean(equal) < 0.1  # 4.5 standard errors away


def test_the_limit_is_two_standard_errors_or_the_cost_of_a_few_parameters():
    base = np.full(16, 50.0)
    swing = np.tile([1.0, -1.0], 8)
    spread = np.sqrt(16) * swing.std(ddof=1)
    for share, equal in ((1.95, True), (2.05, False)):
        other = base + 5.0 * (swing + share * spread / 16)
        assert fits_equally(losses(base), losses(other)) is equal
    assert fits_equally(losses(base), losses(base + 3.9 / 16))
    assert not fits_equally(losses(base), losses(base + 4.1 / 16))
