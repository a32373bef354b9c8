"""The numbered examples run on a small recording and say what they promise."""

from __future__ import annotations

import importlib.util
import re
from pathlib import Path

import numpy as np
import pytest
from synthetic_recording import MASS, held_box

from tactile_dynamics_ros.core.effects import registered_names, registry

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"


@pytest.fixture(autouse=True)
def forget_user_effects(monkeypatch):
    """Effects that an example makes known are not candidates of other tests."""
    registered_names()
    monkeypatch.setattr(registry.HELD, "_known", dict(registry.HELD._known))


def _run(name: str, arguments: list[str], capsys) -> str:
    (path,) = EXAMPLES.glob(f"{name}_*.py")
    spec = importlib.util.spec_from_file_location(path.stem, path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    module.main(arguments)
    return capsys.readouterr().out


def _number(pattern: str, text: str, group: int = 1) -> float:
    return float(re.search(pattern, text)[group])


@pytest.fixture(scope="module")
def bag(tmp_path_factory) -> str:
    """Return a clean recording."""
    return str(held_box(seconds=8.0).to_bag(tmp_path_factory.mktemp("bags") / "box.mcap"))


def test_every_example_is_short_and_says_how_to_run_it():
    paths = sorted(EXAMPLES.glob("[0-9][0-9]_*.py"))
    assert paths
    for path in paths:
        text = path.read_text()
        assert 40 <= len(text.splitlines()) <= 130, path.name
        assert f"python examples/{path.name}" in text.split('"""')[1]


def test_01_estimates_a_recording(bag, tmp_path, capsys):
    text = _run("01", [bag, "--out", str(tmp_path)], capsys)
    assert _number(r"mass +([\d.]+)", text) == pytest.approx(MASS, rel=0.005)
    assert (tmp_path / "convergence.png").stat().st_size > 10_000


def test_02_brings_arrays(tmp_path, capsys):
    text = _run("02", ["--out", str(tmp_path / "own.mcap"), "--seconds", "6"], capsys)
    assert _number(r"mass ([\d.]+)", text) == pytest.approx(0.2, rel=0.01)
    assert (tmp_path / "own.mcap").exists()


def test_03_tells_a_sensors_bias_from_the_load(tmp_path, capsys):
    from scipy.spatial.transform import Rotation

    from tactile_dynamics_ros.recording import Recording

    time = np.arange(0.0, 6.0, 0.01)
    turn = np.stack([np.sin(time), 1.2 * np.sin(1.7 * time), np.sin(0.6 * time)], axis=1)
    rotation = Rotation.from_rotvec(turn)
    weight = 0.9 * rotation.inv().apply([0.0, 0.0, 9.81])
    random = np.random.default_rng(0)
    wrist = {
        "time": time,
        "force": weight + [5.0, -3.0, 2.0] + 0.03 * random.normal(size=weight.shape),
        "torque": np.cross([0.0, 0.01, 0.05], weight)
        + [0.3, 0.2, -0.1]
        + 1e-3 * random.normal(size=weight.shape),
        "force_std": 0.03,
        "position": [0.0, 0.0, 0.0],
        "rotation": np.eye(3),
    }
    imu = {
        "time": time,
        "specific_force": rotation.inv().apply([0.0, 0.0, 9.81])
        + 0.02 * random.normal(size=weight.shape),
        "specific_force_std": 0.02,
        "rotation": rotation.as_matrix(),
    }
    path = Recording.from_arrays({"wrist": wrist}, imu=imu, contact_frame="object").to_bag(
        tmp_path / "load.mcap"
    )
    text = _run("03", [str(path)], capsys)
    assert _number(r"error +([\d.]+)", text) < 3.0
    assert _number(r"mass +([\d.]+) ± ([\d.]+)", text) == pytest.approx(0.9, rel=0.01)
    assert _number(r"b_x +([-\d.]+)", text) == pytest.approx(5.0, abs=0.2)


def test_04_finds_honest_uncertainty_on_a_clean_recording(bag, capsys):
    text = _run("04", [bag, "--parts", "4"], capsys)
    assert 0.4 < _number(r"overall normalised scatter: ([\d.]+)", text) < 1.7


def test_05_adds_the_effect_that_was_hidden(tmp_path, capsys):
    from tactile_dynamics_ros.synthetic import ScenarioOptions, generate_at_whitened_rms
    from tactile_dynamics_ros.synthetic.recordings import write_bag

    made = generate_at_whitened_rms(5, {"viscous_drag": 3.0}, ScenarioOptions(duration=8.0))
    path = write_bag(made.streams, tmp_path / "run")
    choice = "--try=viscous_drag,gravity_tilt"
    text = _run("05", [str(path), choice, "--out", str(tmp_path)], capsys)
    assert _number(r"rigid body alone: ([\d.]+)", text) > 2.0
    assert _number(r"added viscous_drag: ([\d.]+)", text) < 1.15
    assert (tmp_path / "steps.png").exists()


def _hide(name: str, folder: Path) -> str:
    from tactile_dynamics_ros.synthetic import ScenarioOptions, generate_at_whitened_rms
    from tactile_dynamics_ros.synthetic.recordings import write_bag

    made = generate_at_whitened_rms(3, {name: 3.0}, ScenarioOptions(duration=8.0))
    return str(write_bag(made.streams, folder / "run"))


def test_06_fits_an_effect_of_its_own_class(tmp_path, capsys):
    text = _run("06", [_hide("cross_talk", tmp_path)], capsys)
    assert "all requirements hold" in text
    assert _number(r"rigid body alone: ([\d.]+)", text) > 2.0
    assert _number(r"with crosstalk: +([\d.]+)", text) < 1.15
    shares = [float(share) for share in re.findall(r"([-\d.]+) ±", text)]
    assert len(shares) == 12
    assert sum(share > 1.5 for share in shares) == 4, "each finger reads one other"
    assert all(abs(share) < 1.5 for share in sorted(shares)[:8])


def test_07_fits_an_effect_from_a_formula(tmp_path, capsys):
    path = tmp_path / "rubbing.yaml"
    text = _run("07", [_hide("dry_rubbing", tmp_path), "--out", str(path)], capsys)
    assert "all requirements hold" in text
    assert re.search(r"refused: .*wrong.yaml: dry_friction.wrench.force: has the unit", text)
    errors = dict(re.findall(r"  (rigid body alone|\w+) +([\d.]+)\n", text))
    assert float(errors["dry_friction"]) < 1.15 < 0.9 * float(errors["viscous_drag"])
    assert _number(r"friction ([\d.]+)", text) > 0.05
    assert "dry_friction" in path.read_text()


def test_08_an_admittance_controller_does_not_drift(capsys):
    pytest.importorskip("pybullet")
    text = _run("08", ["--seconds", "7"], capsys)
    moved = [list(map(float, re.findall(r"([\d.]+) mm", line))) for line in text.splitlines()[-2:]]
    (before, by_push, after), (weight, *_) = moved
    assert before < 2.0 and after < 2.0 and by_push == pytest.approx(335.0, rel=0.02)
    assert weight > 100.0
