"""Effects are held against simpler laws and against errors that last, each at its full price."""

from __future__ import annotations

from dataclasses import dataclass, replace
from types import SimpleNamespace

import numpy as np
import pytest

from tactile_dynamics_ros.core.discrepancy.challenges import is_outdone, temper
from tactile_dynamics_ros.core.discrepancy.screening import Family, screen
from tactile_dynamics_ros.core.discrepancy.search import Step
from tactile_dynamics_ros.core.discrepancy.trials import Choice, dispersion, try_effect
from tactile_dynamics_ros.core.discrepancy.verdict.validation import fits_equally

DRAWS = 200
CHANNELS = 3


@dataclass(frozen=True)
class Linear:
    """A fitted model with one parameter, effects and laws, and a residual that is given."""

    raw: np.ndarray
    time: np.ndarray
    jacobian: np.ndarray
    effects: tuple[Family, ...] = ()
    laws: tuple[Family, ...] = ()
    freedom: float = 0.0
    lasting_freedom: int = 12

    @property
    def residual(self) -> np.ndarray:
        return self.raw - self.jacobian @ np.linalg.lstsq(self.jacobian, self.raw, rcond=None)[0]

    def families(self, names=None) -> list[Family]:
        return [family for family in self.effects if names is None or family.name in names]

    def library(self) -> tuple[Family, ...]:
        return self.laws

    def with_effect(self, family: Family, coefficients: np.ndarray) -> Linear:
        jacobian = np.concatenate([self.jacobian, family.columns], axis=1)
        return replace(self, jacobian=jacobian, freedom=self.freedom + len(family.kept))

    def without_effect(self, name: str) -> Linear:
        return replace(self, jacobian=self.jacobian[:, :1], freedom=0.0)

    def refined(self) -> Linear:
        return self


def family(name: str, columns: np.ndarray, choices: int = 1) -> Family:
    return Family(name, name, "", columns, tuple(range(columns.shape[1])), choices=choices)


def linear(rng: np.random.Generator, seconds: float = 15.0) -> Linear:
    time = np.repeat(np.arange(round(20 * seconds)) / 20, CHANNELS)
    return Linear(rng.normal(size=len(time)), time, rng.normal(size=(len(time), 1)))


def square(model: Linear) -> float:
    return float(model.residual @ model.residual)


@pytest.mark.parametrize("choices", [1, 50])
def test_a_law_outdoes_effects_that_cost_more_with_all_readings_that_were_sought(choices):
    rng = np.random.default_rng(1)
    model, floor = linear(rng), 0.9
    law = rng.normal(size=(len(model.time), 1))
    likeness = np.concatenate([0.9 * law, 0.0 * law, 0.0 * law, 0.0 * law], axis=1)
    likeness += 0.1 * rng.normal(size=(len(law), 4))
    model = replace(
        model,
        raw=model.raw + law[:, 0],
        effects=(family("e", likeness, choices),),
        laws=(family("x^3", law),),
    )
    [score] = screen(model, model.effects, floor)
    trial = try_effect(model, [score], "e", floor)
    rows = len(model.raw)
    reached = square(trial.model) / floor**2 + 4 * np.log(rows) + 2 * np.log(choices)
    beside = np.concatenate([model.jacobian, law], axis=1)
    left = square(replace(model, jacobian=beside))
    lead = reached - left / floor**2 - np.log(rows)
    assert lead > 0.0
    after = SimpleNamespace(within_stated=False, white=True)
    step = Step(Choice(trial.model, trial, (), 0.0), after)
    assert is_outdone(model, [step], floor, 0.999 * lead / 3.0)
    assert not is_outdone(model, [step], floor, 1.001 * lead / 3.0)


def test_dispersion_is_the_variance_of_sums_over_five_seconds():
    rng = np.random.default_rng(2)
    model = linear(rng, 40.0)
    means = rng.normal(size=(8, CHANNELS)) * [0.2, 1.0, 3.0]
    raw = np.repeat(means, 100, axis=0).ravel()
    model = replace(model, raw=raw, jacobian=np.zeros((len(raw), 1)))
    assert dispersion(model, 0.8) == pytest.approx(100 * np.mean(means**2) / 0.8**2)


def test_white_noise_is_hardly_dispersed():
    rng = np.random.default_rng(3)
    found = [dispersion(linear(rng, 30.0), 1.0) for _ in range(DRAWS)]
    assert np.min(found) >= 1.0
    assert np.mean(found) < 1.3  # a mean of 21 squares scatters by a third


@pytest.mark.parametrize("choices", [1, 50])
@pytest.mark.parametrize(("size", "winner"), [(0.6, "rich"), (0.03, "poor")])
def test_lasting_errors_make_squares_and_samples_count_less(size, winner, choices):
    """What six more parameters gain counts less by the dispersion, what was sought as much."""
    rng = np.random.default_rng(4)
    model, floor = linear(rng, 30.0), 0.7
    slow = np.repeat(rng.normal(size=(12, CHANNELS)), 50, axis=0).ravel()
    columns = rng.normal(size=(len(slow), 7))
    raw = 0.7 * rng.normal(size=len(slow)) + 0.4 * slow + columns @ [2.0, *6 * [size]]
    rich, poor = family("rich", columns), family("poor", columns[:, :1], choices)
    model = replace(model, raw=raw, effects=(rich, poor))
    scores = screen(model, model.effects, floor)
    best, rival = (try_effect(model, scores, name, floor) for name in ("rich", "poor"))
    structure = SimpleNamespace(floor=floor)
    after = SimpleNamespace(structure=structure, within_stated=True, significance=0.01)
    tempered = temper(Step(Choice(best.model, best, (rival,), 0.0), after)).choice
    close = [trial for trial in (best, rival) if fits_equally(best.held_out, trial.held_out)]
    assert len(close) == (1 if winner == "rich" else 2)
    ratio = max(dispersion(trial.model, floor) for trial in close)
    assert tempered.dispersion == pytest.approx(ratio)
    assert ratio > 3.0
    assert tempered.best.name == winner
    found = {trial.name: trial.criterion for trial in (tempered.best, *tempered.rivals)}
    samples = np.log(len(raw) / ratio)
    for trial, freedom, sought in ((best, 7, 1), (rival, 1, choices)):
        expected = square(trial.model) / floor**2 / ratio + freedom * samples + 2 * np.log(sought)
        assert found[trial.name] == pytest.approx(expected)
    assert tempered.without == pytest.approx(square(model) / floor**2 / ratio)
