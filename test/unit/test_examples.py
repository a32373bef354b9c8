"""The numbered examples run and print what they promise."""

from __future__ import annotations

import importlib.util
import re
import runpy
import sys
from pathlib import Path

import numpy as np
import pytest

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


def test_every_example_is_short_and_says_how_to_run_it():
    paths = sorted(EXAMPLES.glob("[0-9][0-9]_*.py"))
    index = (EXAMPLES / "README.md").read_text()
    assert len(paths) == len({path.name[:2] for path in paths}) >= 25
    for path in paths:
        text = path.read_text()
        assert len(text.splitlines()) <= (40 if int(path.name[:2]) < 31 else 130), path.name
        assert f"python examples/{path.name}" in text.split('"""')[1]
        assert index.count(f"]({path.name})") == 1, path.name


def test_the_gallery_shows_what_an_example_draws(tmp_path, monkeypatch):
    from docs import example_pictures

    shown = re.findall(r'\]\((\d\d)_.*src="\.\./(.*?)"', (EXAMPLES / "README.md").read_text())
    assert len(shown) >= 15
    assert all((EXAMPLES.parent / picture).is_file() for _, picture in shown)
    monkeypatch.setattr(example_pictures, "PICTURES", tmp_path)
    assert example_pictures.main(["16"]) == 0
    assert (tmp_path / "16.png").read_bytes().startswith(b"\x89PNG")


def _print(name: str, capsys, monkeypatch, folder: Path) -> str:
    """Run a short example as its first line says, and return what it prints."""
    (path,) = EXAMPLES.glob(f"{name}_*.py")
    monkeypatch.chdir(folder)
    monkeypatch.setattr(sys, "argv", [path.name])
    runpy.run_path(str(path), run_name="__main__")
    return capsys.readouterr().out


def _numbers(pattern: str, text: str) -> list[float]:
    """Return what the groups of a pattern match, wherever it does."""
    return [float(value) for found in re.findall(pattern, text) for value in np.atleast_1d(found)]


SAYS = {
    "05": "brush: all requirements hold",
    "06": "thumb +sensor at x",
    "07": r"run_1.mcap,\w+,done,0\.4576.*\n.*run_2.mcap,\w+,done,0\.52",
    "08": "the model is not adequate",
    "09": "verdict missing_effect, effect viscous_drag",
    "10": r"viscous_drag error 1\.0",
    "11": r"\['unsensed_contact', 'force_bias'\]\n.*grasp it at another point",
    "16": "a cylinder 60 x 60 x 100 mm",
    "23": "turning about x .*\n(.*\n)*not ready",
    "24": r"\(force_sign\)(.*\n)*verdict convention",
    "25": r"index: sample is not finite .*: 10\n.*stamp repeats .*: 1",
    "26": "viscous_drag +f = -c v",
}
"""What short examples print that hide or design something."""
SLOW = ("07", "11")
"""Examples that take more than 5 s of an idle core."""


@pytest.mark.parametrize(
    "name", [pytest.param(n, marks=[pytest.mark.long] * (n in SLOW)) for n in SAYS]
)
def test_a_short_example_finds_what_is_hidden_in_its_input(name, capsys, monkeypatch, tmp_path):
    text = _print(name, capsys, monkeypatch, tmp_path)
    assert re.search(SAYS[name], text), text


NUMBERS = {
    "01": (r"mass +([\d.]+)  [\d.]+ +kg(?:.*\n)*true mass ([\d.]+)", 0.003),
    "03": (r"force +([\d.]+) ±(?:.*\n)*true friction force ([\d.]+)", 0.2),
    "14": (r'mass value="([\d.]+)"(?:.*\n)*set_target_payload\(([\d.]+),', 1e-9),
}
"""Pattern of an estimate and of what it should be, and their largest relative distance."""


@pytest.mark.parametrize("name", NUMBERS)
def test_a_short_example_estimates_what_is_true(name, capsys, monkeypatch, tmp_path):
    pattern, most = NUMBERS[name]
    found, true = _numbers(pattern, _print(name, capsys, monkeypatch, tmp_path))
    assert found == pytest.approx(true, rel=most)


KNOWN = {
    "02": (r"mass +([\d.]+)", [1.2], 2e-3),
    "17": (r"mu ([\d.]+)", [0.6], 0.03),
    "20": (r"mass +([\d.]+)", [1.2], 2e-3),
    "22": (r"contact \[ *([-\d.]+)", [0.0, 0.0, 5.0, 5.0], 0.05),
}
"""Pattern of numbers, what was put in, and their largest relative distance."""


@pytest.mark.parametrize("name", KNOWN)
def test_a_short_example_finds_what_was_put_in(name, capsys, monkeypatch, tmp_path):
    pattern, values, most = KNOWN[name]
    found = _numbers(pattern, _print(name, capsys, monkeypatch, tmp_path))
    np.testing.assert_allclose(found, values, rtol=most, atol=0.2 if 0.0 in values else 0.0)


def test_04_fits_only_with_the_effect(capsys, monkeypatch, tmp_path):
    without, fitted = _numbers(r"\nerror: ([\d.]+)", _print("04", capsys, monkeypatch, tmp_path))
    assert without > 2.5 and fitted < 1.15


def test_12_takes_the_mass_of_the_gripper_out(capsys, monkeypatch, tmp_path):
    both, load = _numbers(r"mass +([\d.]+)", _print("12", capsys, monkeypatch, tmp_path))
    assert both - load == pytest.approx(0.2, abs=2e-5)


def test_13_combines_one_object_and_notices_another(capsys, monkeypatch, tmp_path):
    lines = _print("13", capsys, monkeypatch, tmp_path).splitlines()
    first, both, _ = (_numbers(r"± ([\d.]+)", line)[0] for line in lines)
    assert both < 0.8 * first
    assert [line.partition("changed: ")[2] == "nothing" for line in lines] == [True, True, False]


def test_15_narrows_every_parameter(capsys, monkeypatch, tmp_path):
    text = _print("15", capsys, monkeypatch, tmp_path)
    stds = np.reshape(_numbers(r"(\S+) -> +(\S+) ", text), (-1, 2))
    assert len(stds) == 10 and np.all(stds[:, 1] < 0.1 * stds[:, 0])


def test_18_narrows_the_mass_with_a_second_recording(capsys, monkeypatch, tmp_path):
    first, second, both = _numbers(r"± ([\d.]+)", _print("18", capsys, monkeypatch, tmp_path))
    assert both < 0.85 * min(first, second)


def test_19_holds_most_true_values(capsys, monkeypatch, tmp_path):
    inside, of = _numbers(r"(\d+) of (\d+) true", _print("19", capsys, monkeypatch, tmp_path))
    assert of == 24 and inside >= 18


def test_21_reads_the_mass_from_a_node(capsys, monkeypatch, tmp_path):
    rclpy = pytest.importorskip("rclpy")
    try:
        text = _print("21", capsys, monkeypatch, tmp_path)
    finally:
        rclpy.try_shutdown()
    assert _number(r"mass ([\d.]+)", text) == pytest.approx(0.4577, rel=0.01)


def test_27_scatters_as_stated(capsys, monkeypatch, tmp_path):
    text = _print("27", capsys, monkeypatch, tmp_path)
    assert 0.4 < _number(r"scatter ([\d.]+)", text) < 1.7


def test_31_brings_arrays(tmp_path, capsys):
    text = _run("31", ["--out", str(tmp_path / "own.mcap"), "--seconds", "6"], capsys)
    assert _number(r"mass ([\d.]+)", text) == pytest.approx(0.2, rel=0.01)
    assert (tmp_path / "own.mcap").exists()


def test_32_tells_a_sensors_bias_from_the_load(tmp_path, capsys):
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
    text = _run("32", [str(path)], capsys)
    assert _number(r"error +([\d.]+)", text) < 3.0
    assert _number(r"mass +([\d.]+) ± ([\d.]+)", text) == pytest.approx(0.9, rel=0.01)
    assert _number(r"b_x +([-\d.]+)", text) == pytest.approx(5.0, abs=0.2)


def _hide(name: str, folder: Path) -> str:
    from tactile_dynamics_ros.synthetic import ScenarioOptions, generate_at_whitened_rms
    from tactile_dynamics_ros.synthetic.recordings import write_bag

    made = generate_at_whitened_rms(3, {name: 3.0}, ScenarioOptions(duration=8.0))
    return str(write_bag(made.streams, folder / "run"))


def test_33_fits_an_effect_of_its_own_class(tmp_path, capsys):
    text = _run("33", [_hide("cross_talk", tmp_path)], capsys)
    assert "all requirements hold" in text
    assert _number(r"rigid body alone: ([\d.]+)", text) > 2.0
    assert _number(r"with crosstalk: +([\d.]+)", text) < 1.15
    shares = [float(share) for share in re.findall(r"([-\d.]+) ±", text)]
    assert len(shares) == 12
    assert sum(share > 1.5 for share in shares) == 4, "each finger reads one other"
    assert all(abs(share) < 1.5 for share in sorted(shares)[:8])


def test_34_fits_an_effect_from_a_formula(tmp_path, capsys):
    path = tmp_path / "rubbing.yaml"
    text = _run("34", [_hide("dry_rubbing", tmp_path), "--out", str(path)], capsys)
    assert "all requirements hold" in text
    assert re.search(r"refused: .*wrong.yaml: dry_friction.wrench.force: has the unit", text)
    errors = dict(re.findall(r"  (rigid body alone|\w+) +([\d.]+)\n", text))
    assert float(errors["dry_friction"]) < 1.15 < 0.9 * float(errors["viscous_drag"])
    assert _number(r"friction ([\d.]+)", text) > 0.05
    assert "dry_friction" in path.read_text()


def test_35_an_admittance_controller_does_not_drift(capsys):
    pytest.importorskip("pybullet")
    text = _run("35", ["--seconds", "7"], capsys)
    moved = [list(map(float, re.findall(r"([\d.]+) mm", line))) for line in text.splitlines()[-2:]]
    (before, by_push, after), (weight, *_) = moved
    assert before < 2.0 and after < 2.0 and by_push == pytest.approx(335.0, rel=0.02)
    assert weight > 100.0
