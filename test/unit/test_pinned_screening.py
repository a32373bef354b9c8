"""Score tests pay for every effect that was tried, and count correlated residuals for less."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest

from tactile_dynamics_ros.core.discrepancy.screening import Family, adjusted_p_value, screen
from tactile_dynamics_ros.core.discrepancy.structure import examine
from tactile_dynamics_ros.core.discrepancy.trials import evidence, in_place, try_effect
from tactile_dynamics_ros.core.discrepancy.verdict.adequacy import assess

DRAWS = 200
RARE = 20
"""Of 200 draws, how many may fall below a level of 5 %: more has a chance of 1 in 1000."""
CHANNELS = 3
INSTANTS = 120


@dataclass(frozen=True)
class Linear:
    """A fitted model with two parameters and a residual that is given."""

    raw: np.ndarray
    time: np.ndarray
    jacobian: np.ndarray
    offered: tuple[Family, ...] = ()
    freedom: float = 0.0

    @property
    def residual(self) -> np.ndarray:
        return self.raw - self.jacobian @ np.linalg.lstsq(self.jacobian, self.raw, rcond=None)[0]

    def families(self, names=None) -> tuple[Family, ...]:
        return self.offered

    def with_effect(self, family: Family, coefficients: np.ndarray) -> Linear:
        columns = family.columns[:, list(family.kept)]
        jacobian = np.concatenate([self.jacobian, columns], axis=1)
        return replace(self, jacobian=jacobian, freedom=self.freedom + len(family.kept))


def linear(rng: np.random.Generator, raw: np.ndarray | None = None) -> Linear:
    time = np.repeat(0.05 * np.arange(INSTANTS), CHANNELS)
    jacobian = rng.normal(size=(len(time), 2)) * [1.0, 30.0]
    return Linear(rng.normal(size=len(time)) if raw is None else raw, time, jacobian)


def families(rng: np.random.Generator, count: int, rows: int, size: int = 2) -> list[Family]:
    columns = rng.normal(size=(rows, count * size)) * 10.0 ** rng.uniform(-2, 2, count * size)
    kept = [tuple(range(size * k, size * (k + 1))) for k in range(count)]
    return [Family(f"e{k}", f"e{k}", "", columns, own) for k, own in enumerate(kept)]


def below(p_values: list[float], level: float = 0.05) -> int:
    return int(np.sum(np.array(p_values) < level))


def test_p_value_of_the_best_of_twelve_effects_holds_its_level():
    rng = np.random.default_rng(1)
    found = []
    for _ in range(DRAWS):
        model = linear(rng)
        found.append(adjusted_p_value(screen(model, families(rng, 12, len(model.time)))))
    assert 1 <= below(found) <= RARE


def test_p_value_of_one_effect_is_uniform_whatever_the_size_of_the_noise():
    rng = np.random.default_rng(2)
    found = []
    for _ in range(DRAWS):
        model = linear(rng)
        model = replace(model, raw=3.0 * model.raw)
        found.append(screen(model, families(rng, 1, len(model.time)))[0].p_value)
    counts = np.histogram(found, 4, (0.0, 1.0))[0]
    assert np.all(np.abs(counts - DRAWS / 4) < 4 * np.sqrt(DRAWS * 3 / 16))


def test_bonferroni_multiplies_by_all_that_was_scored():
    rng = np.random.default_rng(3)
    model = linear(rng)
    score = screen(model, families(rng, 1, len(model.time)))[0]
    scores = [replace(score, p_value=p) for p in (0.3, 0.004, 0.9, 0.5, 0.02)]
    assert adjusted_p_value(scores) == pytest.approx(5 * 0.004)
    assert adjusted_p_value([replace(score, p_value=0.6)] * 3) == 1.0


def test_assessment_that_looks_at_effects_and_at_structure_holds_its_level():
    rng = np.random.default_rng(4)
    found = []
    for _ in range(DRAWS):
        model = linear(rng)
        offered = tuple(families(rng, 12, len(model.time)))
        assessment = assess(replace(model, offered=offered))
        parts = adjusted_p_value(assessment.scores), assessment.structure.p_value
        assert assessment.p_value == pytest.approx(min(1.0, 2 * parts[0], 2 * parts[1]))
        found.append(assessment.p_value)
    assert below(found) <= RARE


def test_structure_of_channels_with_unlike_noise_holds_its_level():
    rng = np.random.default_rng(5)
    time, std = 0.01 * np.arange(600), np.array([0.4, 1.0, 2.5, 0.9, 1.1, 1.7])
    drawn = [examine(time, std * rng.normal(size=(600, 6))) for _ in range(DRAWS)]
    assert below([structure.p_value for structure in drawn]) <= RARE
    floors = [structure.floor for structure in drawn]
    assert np.mean(floors) == pytest.approx(np.sqrt(np.mean(std**2)), rel=0.03)


def test_noise_that_stays_alike_for_half_a_second_is_no_effect():
    rng = np.random.default_rng(6)
    found = []
    for _ in range(DRAWS):
        model = linear(rng)
        slow = np.repeat(rng.normal(size=(INSTANTS // 10, CHANNELS)), 10, axis=0).ravel()
        model = replace(model, raw=slow + 0.3 * rng.normal(size=len(slow)))
        axis = np.tile([1.0, 0.5, 0.0], INSTANTS)
        column = (axis * np.sin(0.9 * model.time + rng.uniform(0, 6)))[:, None]
        found.append(screen(model, [Family("e", "e", "", column, (0,))])[0].p_value)
    assert below(found) <= RARE


def test_gain_and_coefficients_are_those_of_the_regression_beside_the_model():
    rng = np.random.default_rng(7)
    model = linear(rng)
    family = families(rng, 1, len(model.time))[0]
    score = screen(model, [family], floor=0.8)[0]
    both = np.concatenate([model.jacobian, family.columns], axis=1)
    solution = np.linalg.lstsq(both, model.residual, rcond=None)[0]
    left = model.residual - both @ solution
    assert score.coefficients == pytest.approx(solution[2:])
    assert score.gain == pytest.approx(model.residual @ model.residual - left @ left)
    price = 2 * np.log(len(model.time))
    assert score.criterion == pytest.approx(left @ left / 0.8**2 + price)


def test_a_reading_pays_for_all_readings_among_which_it_was_sought():
    rng = np.random.default_rng(8)
    model = linear(rng)
    family = families(rng, 1, len(model.time))[0]
    one, many = screen(model, [family, replace(family, choices=12)])
    assert many.criterion - one.criterion == pytest.approx(2 * np.log(12))
    trials = [try_effect(model, [score], "e0", 0.9) for score in (one, many)]
    fitted = trials[0].model
    square = fitted.residual @ fitted.residual
    own = square / 0.9**2 + 2 * np.log(len(model.time))
    assert [trial.criterion for trial in trials] == pytest.approx([own, own + 2 * np.log(12)])
    again = [in_place(trial, fitted, 0.9).criterion for trial in trials]
    assert again == pytest.approx([own, own + 2 * np.log(12)])


def test_the_best_of_many_readings_hardly_ever_beats_no_effect():
    rng = np.random.default_rng(9)
    won = 0
    for _ in range(DRAWS):
        model = linear(rng)
        offered = [replace(f, choices=20) for f in families(rng, 20, len(model.time), 1)]
        scores = screen(model, [replace(f, name="e") for f in offered])
        won += try_effect(model, scores, "e", 1.0).criterion < evidence(model, 1.0)
    assert won <= 4


def test_dispersion_makes_squares_and_samples_count_less():
    rng = np.random.default_rng(10)
    model = replace(linear(rng), freedom=3.0)
    square, rows = model.residual @ model.residual, len(model.time)
    expected = square / 4.0 / 2.5 + 3.0 * np.log(rows / 2.5) + 2 * np.log(6)
    assert evidence(model, 2.0, 6, 2.5) == pytest.approx(expected)
