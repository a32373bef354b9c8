"""What findings say: no condition that always holds, no fall that is none, before and after."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from types import SimpleNamespace

import numpy as np
import pytest
from synthetic_recording import held_box

import tactile_dynamics_ros as td
from benchmarks.friction.generator import draw_surface, generate_events
from tactile_dynamics_ros.api import discrepancies
from tactile_dynamics_ros.api.discrepancies import Comparison, Explanation
from tactile_dynamics_ros.api.estimates import Estimate
from tactile_dynamics_ros.api.properties import (
    Properties,
    before_and_after,
    properties_of,
    sentence_of,
)
from tactile_dynamics_ros.api.questions import Question
from tactile_dynamics_ros.cli.main import main
from tactile_dynamics_ros.core.discrepancy import documents
from tactile_dynamics_ros.core.discrepancy.comparison import Comparison as CoreComparison
from tactile_dynamics_ros.core.discrepancy.comparison import _places
from tactile_dynamics_ros.core.discrepancy.model.residual_model import Condition, Residuals
from tactile_dynamics_ros.core.errors import NotIdentifiableError
from tactile_dynamics_ros.core.friction.discrepancy_model import FrictionModel
from tactile_dynamics_ros.core.friction.slip_log import tabulate_slips
from tactile_dynamics_ros.core.inertia.batch.inertial_estimate import InertialEstimate, ModelError
from tactile_dynamics_ros.core.rigid_body.inertial_parameters import InertialParameters
from tactile_dynamics_ros.recording.pushed import PushedRecording
from tactile_dynamics_ros.report.discrepancy_report import (
    DiscrepancyFindings,
    write_discrepancy_report,
)
from tactile_dynamics_ros.synthetic import pushed
from tactile_dynamics_ros.synthetic.pushed.actions import ActionOptions
from tactile_dynamics_ros.synthetic.recordings import generate_at_whitened_rms, write_bag
from tactile_dynamics_ros.synthetic.scenario import ScenarioOptions

TIME = np.arange(3000) / 100.0
SPEED = np.random.default_rng(1).permutation(np.linspace(0.0, 1.0, len(TIME)))
HEADING = np.random.default_rng(2).permutation(np.linspace(-1.0, 1.0, len(TIME)))
CONDITIONS = (
    Condition("speed", "m/s", SPEED),
    Condition("heading cosine", "", HEADING, cosine_of="the heading from x"),
    Condition("time", "s", TIME),
)


def residuals(scale):
    noise = np.random.default_rng(0).normal(size=(len(TIME), 1))
    white = scale[:, None] * noise
    return Residuals(TIME, white, white, ("force x",), ("N",), conditions=CONDITIONS)


def test_an_error_that_is_always_there_has_no_condition():
    assert _places(residuals(np.full(len(TIME), 3.0)), 1.0) == ()


@pytest.mark.parametrize(
    ("where", "words"),
    [
        (SPEED > 0.67, "while speed is above 0.667 m/s"),
        (HEADING < -0.34, "while the heading from x is more than 109 deg"),
        (HEADING > 0.34, "while the heading from x is less than 71 deg"),
        (TIME > 20.0, "after 20.0 s"),
    ],
)
def test_a_condition_follows_its_error_occurs(where, words):
    worst = _places(residuals(np.where(where, 4.0, 1.0)), 1.0)[0]
    assert worst.condition.startswith(words)
    assert worst.share_of_error > 0.9


def compared(scale):
    found = residuals(scale)
    assessment = SimpleNamespace(white=False, p_value=0.0, structure=SimpleNamespace(floor=1.0))
    places = _places(found, 1.0)
    answer = CoreComparison(assessment, False, found, {"force x": 3.0}, places, ())
    error = {"whitened_rms": 3.0, "force_rms_n": 0.1, "torque_rms_nm": None}
    document = {"error": error} | answer.to_json()
    return Comparison(question(), answer, document)


def question():
    return Question(SimpleNamespace(residuals=lambda: residuals(SPEED)), "run.mcap", dict)


def test_compare_says_on_what_the_error_depends_or_that_it_does_not():
    always = str(compared(np.full(len(TIME), 3.0)))
    assert "the error does not depend on speed, the heading from x or time" in always
    assert "not adequate (p < 1e-16)" in always
    fast = str(compared(np.where(SPEED > 0.67, 4.0, 1.0)))
    assert "of its error occurs while speed is above" in fast
    assert "does not depend" not in fast


def properties(mass, std, star=""):
    rows = [(f"mass{star}", mass, std, "kg"), ("com_x", "1.0", "0.1", "mm")]
    return Properties({"mass": mass}, rows)


def test_a_table_has_the_object_before_and_after_with_intervals():
    known = [properties("0.462", "0.025", " *"), properties("0.45060", "0.00060")]
    rows = before_and_after("rigid body alone", ["viscous_drag", "hanging_cable"], known)
    assert rows[0] == ("", "rigid body alone", "with viscous_drag and hanging_cable", "unit")
    assert rows[1] == ("mass", "0.462 ± 0.025 *", "0.45060 ± 0.00060", "kg")
    assert sentence_of(rows) == (
        "With viscous_drag and hanging_cable the mass is 0.45060 ± 0.00060 kg instead of "
        "0.462 ± 0.025 kg."
    )
    alone = before_and_after("rigid body alone", [], known[:1])
    assert (alone[0], sentence_of(alone)) == (("", "rigid body alone", "unit"), "")


def explained(monkeypatch, effects=("viscous_drag",), in_turn=False, know=None):
    """An explanation by a core that is not asked here."""
    asked = []

    def estimated(asked_question, model, read, groups):
        asked.append((model, read, groups))
        return properties("0.40", f"0.0{len(asked)}")

    core = "tactile_dynamics_ros.core.discrepancy"
    answer = SimpleNamespace(
        effects=effects, in_turn=in_turn, conventions=("torque_unit",), model="with",
        first=SimpleNamespace(model="alone"),
        steps=[SimpleNamespace(name="viscous_drag", group=("viscous_drag", "force_bias"))],
    )  # fmt: skip
    monkeypatch.setattr(f"{core}.explanation.explain", None)
    monkeypatch.setattr(Question, "answer", lambda self, ask: (answer, ()))
    steps = [{"added": None, "error": 3.0}]
    document = {"steps": steps, "effects": list(effects), "error": {"noise_floor": 1.0}}
    monkeypatch.setattr(documents, "explanation_document", lambda _: document | {"sentence": "S."})
    monkeypatch.setattr(discrepancies, "properties_of", know or estimated)
    return Explanation.of(question()), asked


def test_an_explanation_estimates_the_object_by_both_models_as_the_recording_is_read(monkeypatch):
    found, asked = explained(monkeypatch)
    groups = {"viscous_drag": ("viscous_drag", "force_bias")}
    assert asked == [(model, ("torque_unit",), groups) for model in ("alone", "with")]
    assert found.to_json()["estimate"] == {"before": {"mass": "0.40"}, "after": {"mass": "0.40"}}
    assert "mass       0.40 ± 0.01        0.40 ± 0.02    kg" in " ".join(str(found).split("\n  "))
    [section] = found._section()
    assert section.header == ("", "the model alone", "with viscous_drag", "unit")
    assert "± one standard deviation" in section.sentences[1]


def test_where_nothing_was_added_the_object_is_told_once(monkeypatch):
    found, asked = explained(monkeypatch, effects=())
    assert len(asked) == 1
    assert found.to_json()["estimate"]["after"] is None
    assert found.properties()[0] == ("", "the model alone", "unit")


def test_readings_that_fit_in_turn_leave_the_object_unknown(monkeypatch):
    found, asked = explained(monkeypatch, in_turn=True)
    assert (asked, found.properties(), found._section()) == ([], [], [])


def test_an_estimate_that_fails_is_a_note_and_no_end(monkeypatch):
    def fails(asked_question, model, read, groups):
        raise NotIdentifiableError("it slides too little")

    found, _ = explained(monkeypatch, know=fails)
    assert found.notes == ("what the object is cannot be estimated: it slides too little",)
    assert found.to_json()["estimate"] == {"before": None, "after": None}
    assert str(found).endswith("S.")


@pytest.mark.parametrize(
    ("errors", "words"),
    [
        ([1.181, 1.179], "The error does not fall: it stays at 1.18; noise alone leaves 1.00."),
        ([1.181], "The error is 1.18; noise alone leaves 1.00."),
        ([3.1, 1.0], "The error falls from 3.10 to 1.00; noise alone leaves 1.00."),
    ],
)
def test_a_report_says_that_the_error_falls_only_if_it_does(errors, words, tmp_path):
    noise = np.random.default_rng(0).normal(size=(500, 1))
    steps = [{"added": f"effect_{k}" if k else None, "error": e} for k, e in enumerate(errors)]
    findings = DiscrepancyFindings(
        "run.mcap", "V.", True, np.arange(500) / 50.0, noise, ("force x",), ("N",),
        explanation={"steps": steps, "error": {"noise_floor": 1.0}},
    )  # fmt: skip
    assert words in write_discrepancy_report(findings, tmp_path).read_text()


def estimate(error):
    """An estimate whose fit blamed the sensors for 0.3 N."""
    body = InertialParameters(0.4, np.zeros(3), np.diag([9e-4, 7e-4, 5e-4]))
    found = InertialEstimate(
        body, 1e-10 * np.eye(10), {}, ModelError(0.3, 0.01, error), (), 1000, 10.0, True
    )
    model = SimpleNamespace(
        to_estimate=lambda: found,
        corrected_wrench=np.array([0.0, 0.0, 0.0, 0.3, 0.0, 0.0]),
        corrected_wrench_std=np.full(6, 0.01),
    )
    numbers = {"force_rms_n": 0.3, "torque_rms_nm": 0.01, "whitened_rms": error}
    question = Question(None, "box", lambda: numbers)
    question.__dict__["judgement"] = SimpleNamespace(adequate=error < 1.1)
    made = Estimate(held_box(seconds=1.0), model)
    made.__dict__["question"] = question
    return made


def test_an_offset_of_the_sensors_is_told_only_where_the_model_fits():
    assert "estimated sensor offset, subtracted: (0.300 ± 0.010," in str(estimate(1.02))
    assert "offset" not in str(estimate(2.85))


@pytest.mark.parametrize("form", ["urdf", "sdf", "mjcf", "ur", "franka"])
def test_an_export_of_a_model_that_does_not_fit_begins_with_a_warning(form):
    block = estimate(2.85).export(form)
    warning = "WARNING: the model does not fit: the error is 2.85 times the noise"
    assert warning in block.text.split("estimated from")[0]
    assert len(block.doubts) == 1
    assert "WARNING" not in estimate(1.02).export(form).text
    with pytest.raises(NotIdentifiableError, match="does not fit"):
        estimate(12.0).export(form)


@pytest.fixture(scope="module")
def drag(tmp_path_factory):
    """A recording with a drag that raises the error to 2.5, and its truth."""
    made = generate_at_whitened_rms(31, {"viscous_drag": 2.5}, ScenarioOptions(duration=8.0))
    folder = tmp_path_factory.mktemp("bags") / "drag"
    write_bag(made.streams, folder)
    return folder, made.truth()


def test_the_command_warns_of_what_it_exports(drag, capsys):
    assert main(["estimate", str(drag[0]), "--export", "ur"]) == 3
    captured = capsys.readouterr()
    assert "warning: the model does not fit" in captured.err
    assert "WARNING" in captured.out


def test_a_terminal_without_the_sign_gets_ascii(tmp_path):
    bag = held_box(seconds=3.0).to_bag(tmp_path / "box.mcap")
    command = [sys.executable, "-m", "tactile_dynamics_ros.cli.main", "estimate", str(bag)]
    surroundings = os.environ | {"PYTHONIOENCODING": "ascii"}
    done = subprocess.run(command, capture_output=True, env=surroundings, timeout=120)
    assert done.returncode == 0, done.stderr
    assert b"+- std" in done.stdout and b"kg mm^2" in done.stdout


def test_explain_prints_and_reports_the_object_before_and_after(drag, tmp_path, capsys):
    bag, whole = str(drag[0]), drag[1]
    arguments = ["explain", bag, "--out", str(tmp_path / "out")]
    assert main([*arguments, "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert document["effects"] == ["viscous_drag"]
    known = document["estimate"]
    truth = whole["mass"]
    assert known["after"]["mass"]["std"] < 0.5 * known["before"]["mass"]["std"]
    assert abs(known["after"]["mass"]["value"] - truth) < 4.0 * known["after"]["mass"]["std"]
    assert set(known["after"]["effects"]) == {"viscous_drag"}
    main(["estimate", bag, "--effects", "viscous_drag", "--json"])
    assert json.loads(capsys.readouterr().out)["mass"] == pytest.approx(known["after"]["mass"])
    page = (tmp_path / "out" / "report.html").read_text()
    assert "With viscous_drag the mass is " in page
    for name in ("mass", "com_z", "inertia_xy"):
        assert f"<td>{name}</td>" in page or f">{name}<" in page


def test_a_probed_surface_is_told_by_its_coefficients():
    model = FrictionModel.fit(tabulate_slips(generate_events(draw_surface("none", 501), 501)))
    known = properties_of(Question(model, "probe", dict), model)
    (static, std) = (known.document["coulomb"]["mu_static"][key] for key in ("value", "std"))
    cell = known.cells["mu_static"].split(" ± ")
    assert float(cell[0]) == pytest.approx(static, abs=0.1 * std)
    assert float(cell[1]) == pytest.approx(std, rel=0.05)
    assert known.units == {"mu_static": "", "mu_kinetic": ""}


def test_a_pushed_object_is_told_as_its_estimate_tells_it():
    actions = ActionOptions(count=2, speed=(0.08, 0.15), travel=0.05)
    [made] = pushed.generate([7], {}, pushed.PushOptions(actions=actions))
    recording = PushedRecording(made.streams, "made")
    model = SimpleNamespace(effect_names=())
    known = properties_of(Question(model, "made", dict, recording=recording), model)
    assert known.document == td.estimate(recording).to_json()
    assert {"friction force", "mass", "friction", "com_x", "inertia_zz"} <= set(known.cells)
    link = known.document["links"][0]["friction_force_n"]
    assert known.cells["friction force"].startswith(f"{link['value']:.2f}"[:3])
