"""Bad input ends in one line and exit code 2, without a traceback, and leaves nothing half done."""

from __future__ import annotations

import errno
import json
import shutil
from pathlib import Path

import pytest
from synthetic_recording import held_box

from tactile_dynamics_ros.cli import main as cli
from tactile_dynamics_ros.cli.main import main
from tactile_dynamics_ros.core.configuration import check_ranges, parameter
from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.files import written_whole
from tactile_dynamics_ros.core.tactile.analytic_force import create_force_estimator
from tactile_dynamics_ros.core.tactile.network.weights import SHIPPED_NETWORK, shipped_network
from tactile_dynamics_ros.recording import Recording
from tactile_dynamics_ros.share import share_file


@pytest.fixture
def here(tmp_path, monkeypatch) -> Path:
    """An empty working directory."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize(
    ("command", "said"),
    [
        ("synthetic held x --duration -5", "--duration: '-5', expected a number from 0.5 to 3600"),
        ("synthetic held x --duration 0", "--duration: '0', expected a number from 0.5"),
        ("synthetic held x --seed -1", "--seed: '-1', expected a whole number from 0"),
        ("synthetic held /proc/x.mcap", "'/proc/x.mcap': nothing can be written in /proc"),
        ("synthetic held x --magnitude nan", "--magnitude: 'nan', expected a number of at least 0"),
        ("synthetic held x --whitened-rms -1", "--whitened-rms: '-1', expected"),
        ("synthetic pushed x --count 0", "--count: '0', expected a whole number from 1"),
        ("synthetic pushed x --speed 0.2 0.03", "--speed 0.2 0.03: expected LOW before HIGH"),
        ("synthetic pushed x --variation -1", "--variation: '-1', expected a number of at least 0"),
        ("excite --object box_0 --mass -1", "--mass: '-1', expected a number above 0"),
        ("excite --object box_0 --out /proc/m.json", "nothing can be written in /proc"),
        ("excite --object box_0 --arm 1,2", "--arm goes with a recording"),
        ("excite run.mcap --mass 0.2", "--mass goes with --object"),
        ("excite run.mcap --arm 1,2", "--arm: 2 numbers, expected 7, one for each arm joint"),
        ("view --port 99999", "--port: '99999', expected a whole number from 0 to 65535"),
        ("train biotac --units 0", "--units: '0', expected a whole number of at least 1"),
        ("demo --hidden viscous", "did you mean 'viscous_drag'?"),
        ("demo --planar --hidden viscous", "did you mean 'viscous_support'?"),
        ("sim --hidden viscous", "did you mean 'viscous_drag'?"),
        ("sim --scene table --hidden viscous", "did you mean 'viscous_support'?"),
        ("demo --planar --object 9999", "planar object 9999: expected a number from 1"),
        ("demo --planar --object box", "--object box: expected a number"),
        ("demo --config nodes.yaml", "name yours under robot_sim in"),
        ("shape cloud.ply --out surface.doc", "expected a file that ends in .ply"),
        ("estimate run.mcap --prior run.mcap", "is a recording, expected a URDF, or a file that"),
        ("estimate run.mcap --tool run.mcap", "`tactile-dynamics estimate run.mcap --save FILE`"),
        ("estimate run.mcap --prior known.yam", "did you mean 'known.yaml'?"),
    ],
)
def test_a_command_says_in_one_line_what_is_wrong_and_leaves_nothing(here, command, said, capfd):
    held_box(seconds=3.0).to_bag(here / "run.mcap")
    (here / "known.yaml").touch()
    shutil.copy(share_file("config/panda_gripper.yaml"), here / "nodes.yaml")
    before = {path.name for path in here.iterdir()}
    assert main(command.split()) == 2
    captured = capfd.readouterr()
    beside = ("note: ", "pybullet build time")  # the second is the library's own greeting
    lines = [line for line in captured.err.splitlines() if not line.startswith(beside)]
    assert len(lines) == 1 and lines[0].startswith("error: ")
    assert said in lines[0]
    assert {path.name for path in here.iterdir()} == before


def test_what_the_system_refuses_is_one_line_too(monkeypatch, capsys):
    def work(args):
        raise PermissionError(errno.EACCES, "Permission denied", "/root/secret")

    monkeypatch.setattr("tactile_dynamics_ros.cli.effects.run", work)
    assert cli.main(["effects"]) == 2
    said = capsys.readouterr().err
    assert said == "error: Permission denied (/root/secret); choose a path that you may use\n"


FULL = OSError(errno.ENOSPC, "No space left on device")


def full(*_):
    raise FULL


@pytest.mark.parametrize("out", ["deep/new", "deep/new.mcap"])
@pytest.mark.parametrize("form", ["held --duration 2", "pushed --count 1"])
def test_a_full_disk_leaves_no_part_of_a_recording(here, form, out, monkeypatch, capsys):
    monkeypatch.setattr("rosbags.rosbag2.writer.Writer.write", full)
    assert main([*f"synthetic {form}".split(), out]) == 2
    said = capsys.readouterr().err
    assert said.startswith(f"error: {out} cannot be written: No space left on device; free space")
    assert said.count("\n") == 1
    assert list(here.iterdir()) == []


def test_a_truth_that_cannot_be_written_takes_no_recording_with_it(here, monkeypatch, capsys):
    monkeypatch.setattr(Path, "write_text", full)
    assert main(["synthetic", "held", "new", "--duration", "2"]) == 2
    assert "new.truth.json cannot be written" in capsys.readouterr().err
    assert list(here.iterdir()) == []


def test_a_file_is_written_whole_or_stays_as_it_was(tmp_path):
    old = tmp_path / "motion.json"
    old.write_text("old")
    told = r"motion\.json cannot be written: No space"
    with pytest.raises(BadInputError, match=told), written_whole(old) as part:
        part.write_text("half")
        raise FULL
    with pytest.raises(KeyboardInterrupt), written_whole(tmp_path / "a" / "b") as part:
        part.mkdir()
        raise KeyboardInterrupt
    assert old.read_text() == "old"
    assert list(tmp_path.iterdir()) == [old]
    with written_whole(tmp_path / "a" / "b") as part:
        part.write_text("whole")
    assert (tmp_path / "a" / "b").read_text() == "whole"
    assert [path.name for path in (tmp_path / "a").iterdir()] == ["b"]


def test_recordings_keep_their_names_though_they_are_written_elsewhere_first(tmp_path):
    for name in ("run", "run.mcap"):
        box = held_box(seconds=2.0)
        assert Recording.from_bag(box.to_bag(tmp_path / name)).duration == pytest.approx(2.0, 0.1)
    assert {path.name for path in tmp_path.iterdir()} == {"run", "run.mcap"}
    assert "path: run.mcap" in (tmp_path / "run" / "metadata.yaml").read_text()
    assert (tmp_path / "run.mcap").is_file()


def test_no_number_of_a_configuration_is_nan():
    from dataclasses import make_dataclass

    for bounds in ((0.0, 1.0), (None, 1.0), (None, None)):
        made = make_dataclass("Limits", [("share", float, parameter(0.5, "share", "", *bounds))])
        check_ranges(made())
        with pytest.raises(BadInputError, match=r"Limits\.share = nan"):
            check_ranges(made(float("nan")))


CLASS = """
from tactile_dynamics_ros.core.effects import LinearEffect, register_effect

@register_effect
class Mine(LinearEffect):
    name, family = "{name}", "user"
"""


@pytest.mark.parametrize("name", ["viscous_drag", "sensor_lag"])
def test_a_python_file_cannot_replace_an_effect_of_the_catalogue(tmp_path, name, capsys):
    from tactile_dynamics_ros.core.effects.registry import create_effect

    (tmp_path / "mine.py").write_text(CLASS.format(name=name))
    assert main(["effects", "--effect-file", str(tmp_path / "mine.py")]) == 2
    said = capsys.readouterr().err
    assert f"mine.py: effect '{name}' is in the catalogue already (model held)" in said
    assert type(create_effect(name)).__module__.startswith("tactile_dynamics_ros.")


def test_effects_of_pushes_and_of_friction_keep_their_names_too(tmp_path):
    from tactile_dynamics_ros.core.friction.effects import FRICTION
    from tactile_dynamics_ros.core.planar.effects.registry import PUSHED

    for registry in (FRICTION, PUSHED):
        name = registry.names()[0]
        with pytest.raises(BadInputError, match=f"'{name}' is in the catalogue already"):
            registry.register(type("Mine", (), {"name": name, "__module__": "mine"}))


def test_an_entry_point_cannot_replace_an_effect_of_the_catalogue(tmp_path, monkeypatch):
    from importlib.metadata import EntryPoint

    from tactile_dynamics_ros.core.effects import registry

    (tmp_path / "rude.py").write_text(CLASS.format(name="added_mass").replace("@register", "#"))
    monkeypatch.syspath_prepend(tmp_path)
    point = EntryPoint("rude", "rude:Mine", registry.ENTRY_POINT_GROUP)
    monkeypatch.setattr(registry, "entry_points", lambda group: [point])
    monkeypatch.setattr(registry.HELD, "_loaded", False)
    with pytest.raises(
        BadInputError, match=r"entry point 'rude' \(rude:Mine\).*'added_mass' is in"
    ):
        registry.registered_names()
    monkeypatch.setattr(registry.HELD, "_loaded", True)


def test_two_files_that_name_an_effect_alike_are_refused(tmp_path, capsys):
    text = (
        "effects: {windy: {parameters: {F: {unit: N, prior_std: 1}}, "
        'wrench: {axes: world, force: ["F", "0", "0"]}}}\n'
    )
    for name in ("a.yaml", "b.yaml"):
        (tmp_path / name).write_text(text)
    files = [f"--effect-file={tmp_path / name}" for name in ("a.yaml", "b.yaml")]
    assert main(["effects", *files]) == 2
    assert "b.yaml: effect 'windy' is in" in capsys.readouterr().err
    assert main(["effects", files[0], files[0], "windy"]) == 0


def test_weights_are_trained_into_new_files_only(here, capsys):
    for what, name in (
        (["biotac"], "force_network.npz"),
        (["pushing"], "graph_slow.npz"),
        (["pushing", "--action", "pull"], "graph_pull_slow.npz"),
        (["pushing", "--choice", "random"], "graph_slow.npz"),
        (["pushing", "--noise"], "noise.npz"),
        (["pushing", "--out", "mine.npz"], "mine.npz"),
    ):
        (here / name).touch()
        assert main(["train", *what]) == 2, what
        assert f"{name} exists already" in capsys.readouterr().err


def test_weights_of_a_file_work_as_a_model_of_the_force(here):
    shipped_network().save(here / "mine")
    shutil.move(here / "mine", here / "mine.npz")  # the file is named as was asked, without ending
    own = create_force_estimator("mine.npz").model.weights
    assert own.origin == shipped_network().origin
    (here / "other.npz").write_bytes(b"no archive")
    with pytest.raises(BadInputError, match=r"other\.npz.*expected a network"):
        create_force_estimator("other.npz")
    assert SHIPPED_NETWORK.is_file()


def test_a_motion_is_written_into_a_folder_that_is_made(here, monkeypatch):
    from types import SimpleNamespace

    plan = SimpleNamespace(motion_table=lambda: {"time": []}, to_json=dict)
    monkeypatch.setattr("tactile_dynamics_ros.cli.excite._plan", lambda args: plan)
    assert main(["excite", "--object", "box_0", "--out", "new/m.json", "--json"]) == 0
    assert json.loads((here / "new" / "m.json").read_text()) == {"time": []}
