"""The held object under the diagnosis: effects are added to and taken from a fitted model."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.hidden.recordings import generate
from benchmarks.hidden.scenario import ScenarioOptions
from tactile_dynamics_ros.core.discrepancy.screening import screen
from tactile_dynamics_ros.core.discrepancy.trials import try_effect
from tactile_dynamics_ros.core.inertia.batch import fit_body
from tactile_dynamics_ros.core.inertia.discrepancy_model import HeldObjectModel


@pytest.fixture(scope="module")
def tethered() -> HeldObjectModel:
    """With the spring that pulls at an object in a tilted world, but without the tilt."""
    options = ScenarioOptions(duration=6.0)
    recording = generate(328, {"tether_spring": 0.36, "gravity_tilt": 2.5}, options)
    model = HeldObjectModel.from_fit(fit_body(recording.streams))
    scores = screen(model, model.families(["tether_spring"]))
    return try_effect(model, scores, "tether_spring", 1.0).model.refined()


def white_rms(model: HeldObjectModel) -> float:
    return float(np.sqrt(np.mean(model.residual**2)))


def test_an_effect_that_moves_the_present_ones_far_is_fitted_jointly(tethered):
    score = screen(tethered, tethered.families(["gravity_tilt"]))[0]
    both = tethered.with_effect(score.family, score.coefficients)
    assert white_rms(tethered) > 1.15
    assert white_rms(both) < 1.05


def test_an_effect_is_taken_away_again(tethered):
    score = screen(tethered, tethered.families(["gravity_tilt"]))[0]
    both = tethered.with_effect(score.family, score.coefficients)
    left = both.without_effect("gravity_tilt")
    assert left.effect_names == ("tether_spring",)
    assert white_rms(left) == pytest.approx(white_rms(tethered), rel=0.02)
