"""What a model of pushes lacks: white where nothing does, named where something does."""

import json

import numpy as np
import pytest

from tactile_dynamics_ros.cli.main import main
from tactile_dynamics_ros.core.planar.diagnosis.discrepancy_model import PushDiscrepancy
from tactile_dynamics_ros.core.planar.effects.effect import PUSHED
from tactile_dynamics_ros.core.planar.properties.estimate import estimate
from tactile_dynamics_ros.recording.pushed import PushedRecording
from tactile_dynamics_ros.synthetic import pushed
from tactile_dynamics_ros.synthetic.pushed.actions import ActionOptions

FOUR = ActionOptions(count=4, speed=(0.06, 0.2), travel=0.06)


@pytest.fixture(scope="module")
def model():
    """Four pushes in which nothing is hidden, fitted."""
    made = pushed.generate([41], {}, pushed.PushOptions(actions=FOUR))[0]
    return PushDiscrepancy.of_streams(made.streams)


@pytest.fixture(scope="module")
def viscous():
    """Four pushes over a viscous film."""
    return pushed.generate([42], {"viscous_support": 1.5}, pushed.PushOptions(actions=FOUR))[0]


def test_innovations_of_a_right_model_are_white(model):
    white = model.residual.reshape(-1, 3)
    assert np.sqrt(np.mean(white**2, axis=0)) == pytest.approx(1.0, abs=0.15)
    rho = np.mean(white[1:] * white[:-1], axis=0) / np.mean(white**2, axis=0)
    assert np.max(np.abs(rho)) < 4.0 / np.sqrt(len(white))
    assert model.variation <= 0.02


@pytest.mark.parametrize("name", PUSHED.names())
def test_effects_are_absent_at_zero_and_lie_in_their_families(model, name):
    effect = PUSHED.create(name)
    if effect.sudden:
        effect = effect.from_time(float(model.fit.model.intervals.time.mean()))
    zero = np.append(model.x, np.zeros(len(effect.parameters)))
    before = model.lack(model.x, ())
    assert np.allclose(model.lack(zero, (effect,)), before, atol=1e-9)
    small = 1e-3 * np.array([p.typical for p in effect.parameters])
    change = model.whiten(model.lack(np.append(model.x, small), (effect,)) - before)
    families = model.families_of(name)
    assert bool(families) == effect.told
    if not families or effect.sudden:
        return
    columns = families[0].columns
    left = change - columns @ np.linalg.lstsq(columns, change, rcond=None)[0]
    assert np.linalg.norm(left) < 0.05 * np.linalg.norm(change) + 1e-9


def test_a_hidden_effect_is_named_added_and_the_error_falls(viscous, tmp_path, capsys):
    bag = tmp_path / "bag"
    PushedRecording(viscous.streams, "made").to_bag(bag)
    assert main(["diagnose", str(bag), "--json", "--out", str(tmp_path / "report")]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["verdict"] == "missing_effect"
    assert found["effect"] == "viscous_support"
    assert found["error"]["before"] > 1.05 > found["error"]["after"]
    assert (tmp_path / "report" / "report.html").is_file()


def test_an_effect_in_the_model_brings_the_friction_right(viscous):
    truth = viscous.truth()["links"][0]["friction_force_n"]
    without = estimate(viscous.streams).values["friction_force_n"][0]
    found = estimate(viscous.streams, ["viscous_support"])
    value, std = found.values["friction_force_n"]
    assert abs(value - truth) < 0.3 * abs(without - truth)
    assert abs(value - truth) < 4.0 * std
    coefficient = found.effects["viscous_support"]["c"]
    assert coefficient["value"] == pytest.approx(6.0, abs=4.0 * coefficient["std"])
