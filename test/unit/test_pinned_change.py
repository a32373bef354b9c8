"""A change at one time pays for all the times, sides and readings among which it was sought."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest

from tactile_dynamics_ros.core.discrepancy.screening import Family, screen
from tactile_dynamics_ros.core.discrepancy.signature import clear_change, find_change

DRAWS = 200


@dataclass(frozen=True)
class Linear:
    """A fitted model with a residual that is given."""

    residual: np.ndarray
    jacobian: np.ndarray
    time: np.ndarray
    offered: tuple[Family, ...]

    def families(self, names=None) -> tuple[Family, ...]:
        return self.offered


def linear(rng: np.random.Generator, step: float = 0.0, choices: int = 1) -> Linear:
    time = np.repeat(0.05 * np.arange(480), 2)
    jacobian = np.stack([np.sin(0.7 * time), np.tile([1.0, 0.0], 480)], axis=1)
    columns = rng.normal(size=(960, 2)) * [1.0, 20.0]
    raw = rng.normal(size=960) + step * columns[:, 0] * (time >= 15.0)
    residual = raw - jacobian @ np.linalg.lstsq(jacobian, raw, rcond=None)[0]
    family = Family("load", "load", "", columns, (0, 1), choices=choices)
    return Linear(residual, jacobian, time, (family,))


def left(matrix: np.ndarray, values: np.ndarray) -> float:
    error = values - matrix @ np.linalg.lstsq(matrix, values, rcond=None)[0]
    return float(error @ error)


def by_brute_force(model: Linear, floor: float) -> tuple[float, float, bool]:
    """Criterion without what was searched, time and side of the best change."""
    window = (model.time // 0.5).astype(int)
    count = window.max() + 1
    found = []
    for k in range(1, count):
        if not int(0.1 * (count - 1)) < k <= (count - 1) - int(0.1 * (count - 1)):
            continue
        used = (window != k - 1) & (window != k)
        for ends in (False, True):
            acts = (window < k) if ends else (window >= k)
            columns = model.offered[0].columns * acts[:, None]
            both = np.concatenate([model.jacobian, columns], axis=1)[used]
            beyond = left(both, model.residual[used]) - np.sum(model.residual[used] ** 2)
            found.append((beyond / floor**2 + 2 * np.log(len(model.time)), 0.5 * k, ends))
    return min(found)


@pytest.mark.parametrize("choices", [1, 9])
def test_criterion_is_that_of_a_regression_on_both_sides_of_every_time(choices):
    model = linear(np.random.default_rng(1), 0.4, choices)
    criterion, time, ends = by_brute_force(model, 0.9)
    change = find_change(model, model.residual, 7.0, 0.9)
    assert (change.time, change.ends) == (pytest.approx(time, abs=0.05), ends)
    searched = 2 * np.log(2 * 47 * choices)
    assert change.criterion == pytest.approx(criterion + searched - 7.0)


def test_chance_hardly_ever_looks_like_a_change():
    rng = np.random.default_rng(2)
    models = [linear(rng) for _ in range(DRAWS)]
    found = [find_change(model, model.residual, 0.0).criterion for model in models]
    assert np.sum(np.array(found) < 0.0) <= 4
    # 2 log N + 2 log(2 times 47) = 22.8, less what the best of 94 chances gains
    assert np.mean(found) == pytest.approx(17.0, abs=1.5)


def test_a_clear_change_has_to_beat_what_the_best_effect_paid_for_its_readings():
    model = linear(np.random.default_rng(3), 1.0)
    steady = Family("spring", "spring", "", np.cos(2.0 * model.time)[:, None], (0,))
    found = []
    for choices in (1, 30):
        scores = screen(model, [replace(steady, choices=choices)])
        found.append(clear_change(model, scores, 1.0).criterion)
    assert found[0] - found[1] == pytest.approx(2 * np.log(30))
