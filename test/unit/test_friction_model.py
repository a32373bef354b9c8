"""Coulomb friction under the discrepancy engine, and the recording that it comes from."""

import json

import numpy as np
import pytest

from benchmarks.friction.generator import Surface, draw_surface, generate_events
from tactile_dynamics_ros.cli.main import main
from tactile_dynamics_ros.core.discrepancy.diagnosis import diagnose
from tactile_dynamics_ros.core.errors import BadInputError, NotIdentifiableError
from tactile_dynamics_ros.core.friction.discrepancy_model import FrictionModel
from tactile_dynamics_ros.core.friction.effects import FRICTION
from tactile_dynamics_ros.core.friction.slip_log import SlipTable, tabulate_slips
from tactile_dynamics_ros.recording.probe_slips import holds_slips, read_slips, write_slips

SEED = 501


@pytest.fixture(scope="module")
def events():
    """Slips on a surface whose friction differs along and across its grain."""
    return generate_events(draw_surface("anisotropic_friction", SEED), SEED)


def ideal_slips(rng, count=24):
    normal = rng.uniform(0.4, 1.6, (count, 1)) * np.ones(2)
    return SlipTable(
        time=2.0 * np.arange(count),
        angle=rng.uniform(0.0, 2.0 * np.pi, count),
        normal=normal,
        tangential=normal * [0.8, 0.7],
        speed=rng.uniform(2e-3, 2e-2, count),
        memory_normal=rng.uniform(0.5, 1.5, count),
        memory_tangential=rng.uniform(0.1, 0.5, count),
    )


def test_effects_with_zero_parameters_are_absent():
    slips = ideal_slips(np.random.default_rng(0))
    mu = np.array([0.8, 0.7])
    for effect in FRICTION.create_all(FRICTION.names()):
        theta = np.zeros(len(effect.parameters))
        np.testing.assert_allclose(effect.factor(slips, theta), 1.0)
        np.testing.assert_allclose(effect.term(slips, mu, theta), 0.0, atol=1e-12)


def test_exact_slips_give_the_coefficients_and_no_residual():
    model = FrictionModel.fit(ideal_slips(np.random.default_rng(1)))
    np.testing.assert_allclose(model.mu, [0.8, 0.7], atol=1e-6)
    np.testing.assert_allclose(model.residual, 0.0, atol=1e-4)


def test_jacobian_is_the_derivative_of_the_residual(events):
    model = FrictionModel.fit(tabulate_slips(events), ["anisotropic_friction", "skin_creep"])
    step = 1e-4 * np.arange(1, 6)
    moved, _ = model.evaluate(model.x + step, model.effects)
    np.testing.assert_allclose(moved - model.residual, model.jacobian @ step, atol=1e-3)


def test_parameters_of_an_effect_are_recovered():
    rng = np.random.default_rng(2)
    slips = ideal_slips(rng, 40)
    slips.tangential[:] = slips.normal * [0.8, 0.7] * slips.normal ** -(1 / 3)
    slips.tangential[:] += rng.normal(0.0, 0.01, slips.tangential.shape)
    entry = FrictionModel.fit(slips, ["load_dependent_friction"]).parameters()
    power = entry["load_dependent_friction"]["p"]
    assert power["value"] == pytest.approx(1 / 3, abs=0.06)
    assert power["std"] < 0.06


def test_an_ordinary_surface_is_adequate():
    surface = draw_surface("none", SEED)
    model = FrictionModel.fit(tabulate_slips(generate_events(surface, SEED)))
    assert diagnose(model).verdict == "adequate"
    assert model.mu[0] == pytest.approx(surface.static, rel=0.08)


@pytest.mark.parametrize("hidden", ["load_dependent_friction", "normal_misalignment"])
def test_a_hidden_effect_is_named_alone_or_in_a_group(hidden):
    surface = draw_surface(hidden, SEED)
    found = diagnose(FrictionModel.fit(tabulate_slips(generate_events(surface, SEED))))
    assert hidden in (found.effect, *found.group)
    assert found.after.rms < found.before.rms


def test_too_few_slips_are_refused(events):
    with pytest.raises(NotIdentifiableError, match="3 slips"):
        tabulate_slips([e for e in events if np.isfinite(e.kinetic)][:3])


def test_slips_survive_a_recording(events, tmp_path):
    path = write_slips(events, tmp_path / "bag")
    assert holds_slips(path)
    assert not holds_slips(tmp_path)
    found = read_slips(path)
    assert len(found) == len(events)
    for name in ("time", "normal", "tangential", "memory_normal"):
        np.testing.assert_allclose(
            [getattr(e, name) for e in found], [getattr(e, name) for e in events]
        )
    with pytest.raises(BadInputError, match="exists"):
        write_slips(events, path)


def test_the_verbs_work_on_a_probe_recording(events, tmp_path, capsys):
    path = str(write_slips(events, tmp_path / "bag"))
    assert main(["compare", path, "--json"]) == 0
    compared = json.loads(capsys.readouterr().out)
    assert not compared["adequate"]
    assert set(compared["error"]["channels"]) == {"static", "kinetic"}
    assert main(["diagnose", path, "--json"]) == 0
    diagnosed = json.loads(capsys.readouterr().out)
    assert "anisotropic_friction" in (diagnosed["effect"], *diagnosed["group"])
    assert main(["explain", path]) == 0
    assert "Coulomb alone" in capsys.readouterr().out
    assert main(["compare", path, "--effects", "anisotropic_friction", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["adequate"]
    assert main(["compare", path, "--effects", "viscous_drag"]) == 2
    assert "unknown of model friction" in capsys.readouterr().err


@pytest.mark.parametrize("verb", ["compare", "diagnose", "explain"])
def test_the_report_is_drawn_of_a_probe_recording(verb, events, tmp_path):
    path = write_slips(events, tmp_path / "bag")
    assert main([verb, str(path), "--out", str(tmp_path / "out")]) == 0
    page = (tmp_path / "out" / "report.html").read_text()
    for words in ("normal forces of a probing finger", "static", "kinetic", str(path)):
        assert words in page
    for words in ("rigid body", "torque", "the contacts must apply", "in the body frame"):
        assert words not in page
    assert (tmp_path / "out" / "residuals.png").stat().st_size > 10_000


def test_the_generators_friction_is_static_at_rest_and_kinetic_when_fast():
    surface = Surface(0.8, 0.6)
    assert surface.bearable(0.5, 0.0, 0.0) == pytest.approx(0.4)
    assert surface.bearable(0.5, 0.05, 0.0) == pytest.approx(0.3)
