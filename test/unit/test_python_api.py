"""The verbs from Python: the same documents as the command's, tables, figures, notebooks."""

from __future__ import annotations

import ast
import inspect
import json
import subprocess
import sys
import typing
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from synthetic_recording import held_box

import tactile_dynamics_ros as td
from tactile_dynamics_ros.api import verbs
from tactile_dynamics_ros.api.result import Result
from tactile_dynamics_ros.cli.main import main
from tactile_dynamics_ros.core.errors import BadInputError, NotIdentifiableError
from tactile_dynamics_ros.recording.pushed import PushedRecording
from tactile_dynamics_ros.synthetic import pushed
from tactile_dynamics_ros.synthetic.pushed.actions import ActionOptions

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"
PNG = b"\x89PNG"


@pytest.fixture(scope="module")
def bag(tmp_path_factory):
    return held_box(seconds=4.0).to_bag(tmp_path_factory.mktemp("bags") / "box.mcap")


@pytest.fixture(scope="module")
def recording(bag):
    return td.read(bag)


def printed(capsys, *arguments):
    main([*map(str, arguments), "--json"])
    return json.loads(capsys.readouterr().out)


def test_importing_the_package_imports_nothing_heavy():
    script = "import sys, tactile_dynamics_ros as td; print(td.__version__, 'numpy' in sys.modules)"
    out = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert out.stdout.split() == [td.__version__, "False"]


def test_estimators_start_without_the_statistics_that_take_as_long_to_import_as_the_rest():
    inertia = "tactile_dynamics_ros.core.inertia"
    modules = f"{inertia}.batch.knowledge, {inertia}.live.estimator, {inertia}.diagnosis.live_check"
    script = f"import sys, {modules}; print('scipy' in sys.modules, 'scipy.stats' in sys.modules)"
    out = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert out.stdout.split() == ["True", "False"]


def test_what_is_not_there_is_no_attribute():
    with pytest.raises(AttributeError, match="guess"):
        td.guess  # noqa: B018
    assert set(dir(td)) == set(td.__all__)


@pytest.mark.parametrize("verb", ["estimate", "compare", "diagnose"])
def test_a_verb_returns_the_document_of_the_command(verb, bag, recording, capsys):
    result = getattr(td, verb)(recording)
    assert json.loads(json.dumps(result.to_json())) == printed(capsys, verb, bag)
    main([verb, str(bag)])
    assert str(result) == capsys.readouterr().out.rstrip("\n")
    assert result.plot()._repr_png_().startswith(PNG)
    assert result.headline().split("<")[0][:20] in result._repr_html_()


@pytest.mark.parametrize("verb", ["check", "estimate", "compare", "diagnose", "explain"])
def test_a_verb_takes_a_path_as_it_takes_what_was_read_from_it(verb, bag, monkeypatch):
    for kind in ("Comparison", "Diagnosis", "Explanation", "Estimate"):
        monkeypatch.setattr(verbs, kind, FromRecording)
    monkeypatch.setattr("tactile_dynamics_ros.api.checks.check_recording", FromRecording)
    monkeypatch.setattr("tactile_dynamics_ros.core.inertia.estimate.estimate", FromRecording)
    monkeypatch.setattr(verbs, "question_held", lambda recording, effects: recording)
    for path in (str(bag), Path(bag)):
        found = getattr(td, verb)(path).recording
        np.testing.assert_array_equal(found.streams.pose.time, td.read(bag).streams.pose.time)


class FromRecording:
    """Stands for what is computed from a recording, and keeps that."""

    def __init__(self, recording, *others):
        self.recording = recording

    @classmethod
    def of(cls, recording):
        return cls(recording)


def test_units_are_found_out_by_diagnose_and_explain_alone_as_in_the_shell(monkeypatch):
    asked = {}
    monkeypatch.setattr(verbs, "read", lambda path, any_unit: asked.setdefault(verb, any_unit))
    monkeypatch.setattr(verbs, "_question", lambda recording, effects: recording)
    for kind in ("Comparison", "Diagnosis", "Explanation"):
        monkeypatch.setattr(verbs, kind, FromRecording)
    for verb in ("compare", "diagnose", "explain"):
        getattr(td, verb)("run.mcap")
    assert asked == {"compare": False, "diagnose": True, "explain": True}


def test_what_is_neither_a_path_nor_a_recording_is_refused():
    with pytest.raises(BadInputError, match="list; expected a path"):
        td.estimate(["a.mcap", "b.mcap"])


def test_every_result_and_recording_shows_lines_instead_of_its_arrays(recording, pushes):
    kinds = [getattr(td, name) for name in td.__all__ if name[0].isupper()]
    results = [kind for kind in kinds if issubclass(kind, Result)]
    assert len(results) == len(kinds) - 3, "all but recordings"
    assert {kind.__repr__ for kind in results} == {Result.__repr__}
    assert repr(recording).startswith("Recording(") and len(repr(recording)) < 200
    assert repr(td.read(pushes)).startswith("PushedRecording(")


class Lines(Result):
    """A result of so many lines."""

    def __init__(self, number):
        self.number = number

    def lines(self):
        return [f"line {k}" for k in range(self.number)]

    def headline(self):
        return "all in one"

    def to_json(self):
        return {}

    def rows(self):
        return []

    def draw(self):
        raise NotImplementedError


def test_a_long_result_is_cut_after_its_headline_and_says_how_to_see_all():
    assert repr(Lines(14)) == str(Lines(14))
    shown = repr(Lines(40)).splitlines()
    assert len(shown) == 14
    assert shown[:2] == ["all in one", "line 0"]
    assert shown[-1] == "... 40 lines: print(result) shows all"


@pytest.mark.parametrize("verb", ["check", "estimate", "compare", "diagnose"])
def test_a_result_shows_less_than_15_lines(verb, recording):
    assert len(repr(getattr(td, verb)(recording)).splitlines()) < 15


@pytest.mark.parametrize("name", [name for name in td.__all__ if name != "__version__"])
def test_exports_are_typed_to_the_last_argument(name):
    exported = getattr(td, name)
    members = [exported]
    if isinstance(exported, type):
        members = [member for key, member in vars(exported).items() if key[0] != "_"]
    for member in members:
        function = getattr(member, "__func__", getattr(member, "fget", member))
        function = getattr(member, "func", function)
        if inspect.isfunction(function):
            hints = typing.get_type_hints(function, named_in(function))
            arguments = {*inspect.signature(function).parameters} - {"self", "cls"}
            assert {*arguments, "return"} <= {*hints}, function.__qualname__


def named_in(function):
    """Names of a function's module, those included that only a type checker imports."""
    module = sys.modules[function.__module__]
    names = dict(vars(module))
    for node in ast.parse(inspect.getsource(module)).body:
        if isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING":
            exec(compile(ast.Module(node.body, []), module.__name__, "exec"), names)
    return names


def test_a_table_has_a_row_per_parameter_and_escapes_what_is_markup(recording):
    from tactile_dynamics_ros.api.result import html_table

    page = td.estimate(recording)._repr_html_()
    assert page.count("<tr>") == 11
    assert "<td>mass</td>" in page
    assert html_table([("a",), ("x < y",)]).count("x &lt; y") == 1
    assert html_table([("a",)]) == ""


def test_effects_are_names_in_a_line_in_a_list_or_objects(recording):
    from tactile_dynamics_ros.core.effects import create_effect

    masses = [
        td.estimate(recording, effects).to_json()["effects"]["viscous_drag"]["c"]["value"]
        for effects in ("viscous_drag", ["viscous_drag"], [create_effect("viscous_drag")])
    ]
    assert masses[0] == masses[1] == masses[2]
    with pytest.raises(BadInputError, match="named twice"):
        td.compare(recording, "viscous_drag,viscous_drag")


def test_several_recordings_are_read_as_one(bag):
    assert td.read(bag, bag).duration > 1.9 * td.read(bag).duration
    with pytest.raises(BadInputError, match="expected the path"):
        td.read()


def test_an_estimate_that_is_no_answer_says_so_in_its_headline(recording):
    from tactile_dynamics_ros.core.inertia.conventions.finder import assumed

    streams, _ = assumed(recording.streams, "gravity_direction")
    wrong = td.estimate(replace(recording, streams=streams))
    with pytest.raises(NotIdentifiableError, match="does not fit"):
        wrong.require_answer()
    assert "does not fit" in wrong._repr_html_()


def test_a_shape_is_drawn_and_tabulated(tmp_path):
    random = np.random.default_rng(0)
    face = random.uniform(-1.0, 1.0, (1500, 3))
    axis = random.integers(0, 3, 1500)
    face[np.arange(1500), axis] = np.sign(face[np.arange(1500), axis])
    points = face * [0.04, 0.03, 0.05] + [0.1, 0.2, 0.05] + 5e-4 * random.normal(size=face.shape)
    np.savetxt(tmp_path / "box.txt", points)
    found = td.shape(tmp_path / "box.txt", support=0.0)
    size = np.sort(found.to_json()["parts"][0]["semi_axes_m"])
    np.testing.assert_allclose(size, [0.03, 0.04, 0.05], atol=2e-3)
    assert "<table>" in found._repr_html_()
    assert found.plot()._repr_png_().startswith(PNG)
    with pytest.raises(BadInputError, match="the largest is 1"):
        td.shape(tmp_path / "box.txt", support=0.0, number=9)


@pytest.fixture(scope="module")
def pushes(tmp_path_factory):
    """A recording of two pushes that stop hard."""
    actions = ActionOptions(count=2, speed=(0.08, 0.15), travel=0.05)
    [made] = pushed.generate([7], {}, pushed.PushOptions(actions=actions))
    folder = tmp_path_factory.mktemp("pushes")
    return PushedRecording(made.streams, "made").to_bag(folder / "push.mcap")


@pytest.mark.parametrize("verb", ["estimate", "compare"])
def test_verbs_take_a_pushed_object_as_the_command_does(verb, pushes, capsys):
    result = getattr(td, verb)(td.read(pushes))
    assert json.loads(json.dumps(result.to_json())) == printed(capsys, verb, pushes)
    assert result.plot()._repr_png_().startswith(PNG)
    assert "<table>" in result._repr_html_()


def test_what_is_known_of_a_pushed_object_goes_into_its_next_recording(pushes, tmp_path):
    recording = td.read(pushes)
    first = td.estimate(recording)
    again = td.estimate(recording, prior=first.save(tmp_path / "thing.yaml"))
    assert again.notes[0].startswith("together with 1 recordings")
    both = again.found.values["friction_force_n"][1]
    assert both == pytest.approx(first.found.values["friction_force_n"][1] / np.sqrt(2), rel=0.05)
    with pytest.raises(BadInputError, match="another object"):
        replace(again, changed=("mass",)).save(tmp_path / "thing.yaml")


def test_the_page_of_pushes_tells_numbers_and_shows_forces(pushes, tmp_path):
    found = td.estimate(td.read(pushes))
    page = found.report(tmp_path).read_text()
    assert found.lines()[0].split("±")[0].split()[-1] in page
    assert (tmp_path / "pushes.png").exists() and (tmp_path / "forces.png").exists()
    rows = {row[0].removesuffix(" *"): row[1:] for row in found.rows()}
    force, std = found.found.values["friction_force_n"]
    assert float(rows["friction force"][0]) == pytest.approx(force, abs=std)
    assert rows["com_x"][2] == "mm"


def test_what_holds_for_held_objects_alone_is_refused_of_pushed_ones(pushes, bag, tmp_path):
    recording = td.read(pushes)
    with pytest.raises(BadInputError, match="not for an object on a support"):
        td.estimate(recording, tool=tmp_path / "gripper.urdf")
    assert td.read(pushes, pushes).duration > 2.0 * recording.duration
    with pytest.raises(BadInputError, match="expected auto, held, pushed or joints"):
        td.read(bag, model="thrown")
    assert type(td.read(bag)).__name__ == "Recording"


@pytest.mark.parametrize("path", sorted(EXAMPLES.glob("*.ipynb")), ids=lambda path: path.stem)
def test_a_notebook_runs_and_shows_what_its_cells_end_with(path):
    """Cells as a notebook runs them: in one namespace, the last expression is shown."""
    cells = json.loads(path.read_text())["cells"]
    names, shown = {}, []
    for cell in cells:
        source = "".join(cell["source"])
        if cell["cell_type"] == "code":
            assert cell["outputs"] == [], "outputs are not kept"
            shown.append(run_cell(source, names))
    assert sum(hasattr(value, "_repr_html_") for value in shown) >= 2
    pictures = [value for value in shown if hasattr(value, "_repr_png_")]
    assert len(pictures) >= 2
    assert all(picture._repr_png_().startswith(PNG) for picture in pictures)


def run_cell(source, names):
    """Run a cell and return the value of its last line, if it is an expression."""
    *body, last = ast.parse(source).body
    exec(compile(ast.Module(body, []), "cell", "exec"), names)
    if isinstance(last, ast.Expr):
        return eval(compile(ast.Expression(last.value), "cell", "eval"), names)
    exec(compile(ast.Module([last], []), "cell", "exec"), names)
    return None
