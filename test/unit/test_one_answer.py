"""One recording, one answer: error, verdict and advice of all verbs, for every kind of model."""

from __future__ import annotations

from dataclasses import dataclass, replace
from types import SimpleNamespace

import numpy as np
import pytest
from test_diagnosis_engine import SlidingBlock, slide
from test_lasting_errors import slide_with_lasting_error

import tactile_dynamics_ros as td
from benchmarks.inertia.boxes import wrist_recording
from tactile_dynamics_ros.api.discrepancies import Comparison, Diagnosis
from tactile_dynamics_ros.api.estimates import Estimate
from tactile_dynamics_ros.api.pushed_estimates import EstimateOfPushes
from tactile_dynamics_ros.api.questions import Question, question_held, question_pushed
from tactile_dynamics_ros.core.discrepancy.comparison import compare
from tactile_dynamics_ros.core.discrepancy.diagnosis import diagnose
from tactile_dynamics_ros.core.discrepancy.documents import diagnosis_document
from tactile_dynamics_ros.core.discrepancy.explanation import explain
from tactile_dynamics_ros.core.discrepancy.verdict.judgement import FAR, Judgement, judge
from tactile_dynamics_ros.core.errors import NotIdentifiableError
from tactile_dynamics_ros.core.planar.diagnosis import one_part
from tactile_dynamics_ros.core.planar.properties import fit as fitting
from tactile_dynamics_ros.core.streams.joining import cut_streams
from tactile_dynamics_ros.recording import Recording
from tactile_dynamics_ros.recording.pushed import PushedRecording
from tactile_dynamics_ros.synthetic import ScenarioOptions, generate, pushed
from tactile_dynamics_ros.synthetic.recordings import generate_at_whitened_rms

SHORT = ScenarioOptions(duration=8.0)
TWO_PUSHES = pushed.PushOptions(actions=pushed.ActionOptions(count=2))
WEAK, NAMED = 0.004, 0.012
"""Sizes of a zero error that tests find beside 30 s of noise, N: a diagnosis names the larger."""


def wrist():
    streams, _ = wrist_recording("box_0", 1)
    first = streams.pose.time[0]
    return Recording(cut_streams(streams, first, first + 8.0), "wrist")


def pushes(seed, hidden):
    return PushedRecording(pushed.generate([seed], hidden, TWO_PUSHES)[0].streams, "pushes")


MADE = {
    "held": lambda: Recording(generate(31, {}, SHORT).streams, "held"),
    "held with a drag": lambda: Recording(
        generate_at_whitened_rms(31, {"viscous_drag": 2.85}, SHORT).streams, "drag"
    ),
    "wrist": wrist,
    "pushed": lambda: pushes(110, {}),
    "pushed on a table that leans": lambda: pushes(112, {"support_tilt": 1.35}),
}


@dataclass(frozen=True)
class Answers:
    """What the verbs say of one recording."""

    estimate: Estimate | EstimateOfPushes
    check: td.Check
    compare: Comparison
    diagnose: Diagnosis


@pytest.fixture(scope="module")
def fitted_once():
    """Pushes are fitted once, whoever asks: the same streams and effects give the same fit."""
    made, fit = {}, fitting.fit_push

    def fit_once(streams, effects=(), known=None):
        key = id(streams), tuple(effect.label for effect in effects)
        if key not in made:
            made[key] = streams, fit(streams, effects, known)
        return made[key][1]

    with pytest.MonkeyPatch.context() as patch:
        for module in (fitting, one_part):
            patch.setattr(module, "fit_push", fit_once)
        yield


@pytest.fixture(scope="module", params=list(MADE))
def answers(request, fitted_once):
    recording = MADE[request.param]()
    ask = question_pushed if isinstance(recording, PushedRecording) else question_held
    question = ask(recording)  # compare and diagnose fit alike
    return Answers(
        td.estimate(recording),
        td.check(recording),
        Comparison.of(question),
        Diagnosis.of(question),
    )


def test_all_verbs_tell_one_error_and_one_verdict(answers, request):
    hidden = "with" in request.node.callspec.id or "leans" in request.node.callspec.id
    compared, diagnosed = answers.compare.to_json(), answers.diagnose.to_json()
    error = compared["error"]["whitened_rms"]
    assert compared["adequate"] is not hidden
    assert (error > FAR) is hidden
    told = [answers.estimate.to_json()["error"], answers.check.to_json()["error"]]
    numbers = [one if isinstance(one, float) else one["whitened_rms"] for one in told]
    np.testing.assert_allclose(numbers, error, rtol=1e-6)
    held_out = diagnosed["error"]["before"]  # of samples that the fit has not seen
    assert 0.99 * error < held_out < (np.inf if hidden else 1.06 * error)
    assert (diagnosed["verdict"] == "adequate") is compared["adequate"]
    assert diagnosed["p_value"] == pytest.approx(compared["p_value"])


def test_advice_follows_from_the_verdict(answers):
    estimate, check = "\n".join(answers.estimate.lines()), "\n".join(answers.check.lines())
    unfit = "the model does not fit: the error is"
    if answers.compare.adequate:
        assert unfit not in estimate + check
        return
    for said in (estimate, check):
        assert unfit in said and "`tactile-dynamics diagnose`" in said
        assert "push" not in said.replace("pushe", "") and "would bring it" not in said
        assert "helps" not in said and "read too much" not in said
    assert any(unfit in fault for fault in answers.check.faults) and not answers.check.ready
    with pytest.raises(NotIdentifiableError, match=unfit):
        answers.estimate.require_answer()


@pytest.mark.parametrize(("size", "adequate"), [(WEAK, True), (NAMED, False)])
def test_what_no_effect_could_be_named_for_is_a_trace_for_all(size, adequate):
    """Both are significant, next to the floor, and would move the estimate."""
    model = SlidingBlock(slide(13, zero_error=size))
    found, compared = diagnose(model), compare(model)
    assert found.assessment.p_value < 0.01 and found.assessment.rms < 1.02 * found.floor
    assert (found.verdict == "adequate", compared.adequate) == (adequate, adequate)
    assert (compared.trace is not None) is adequate
    if adequate:
        assert compared.trace.moved > 0.5
        assert "is too little for any known effect" in diagnosis_document(found)["sentence"]


def test_an_effect_within_what_sensors_state_is_adequate_for_none():
    model = SlidingBlock(slide_with_lasting_error(0, 0.1, viscous_friction=0.03))
    assert judge(model).assessment.within_stated and judge(model).adequate is None
    assert (compare(model).adequate, diagnose(model).effect) == (False, "viscous_friction")
    question = Question(model, "slide", lambda: {"whitened_rms": 0.9})
    assert "yet an effect may be seen in it" in question.misfit and not question.is_far


def test_what_promises_little_of_a_stated_error_is_not_searched(monkeypatch):
    first = judge(SlidingBlock(slide_with_lasting_error(1, 0.6))).assessment
    assert first.within_stated and not first.white
    excess = (first.rms**2 - first.structure.floor**2) * len(first.model.residual)
    for share, adequate in ((0.4, True), (0.6, None)):
        found = replace(first)
        found.__dict__["scores"] = (SimpleNamespace(gain=share * excess, p_value=0.0),)
        assert Judgement(found).adequate is adequate


@pytest.mark.parametrize(("cubic", "verdict"), [(0.008, "adequate"), (0.018, "unexplained")])
def test_explanations_end_with_the_verdict_on_their_last_model(cubic, verdict):
    """A drag is found; of what it leaves, the larger is 2.1 % above the floor."""
    block = slide(4, viscous_friction=0.1, cubic_drag=cubic)
    found = explain(SlidingBlock(block, known=("viscous_friction",)))
    assert (found.verdict, found.effects) == (verdict, ("viscous_friction",))
    assert compare(found.model).adequate is (verdict == "adequate")


def test_a_friction_force_that_is_unknown_is_advised_by_check(answers):
    if not isinstance(answers.estimate, EstimateOfPushes) or not answers.compare.adequate:
        pytest.skip("of pushes whose model fits")
    vague = replace(answers.estimate.found, undetermined=("friction_force_n",))
    with pytest.raises(NotIdentifiableError, match="`tactile-dynamics check` says which pushes"):
        replace(answers.estimate, found=vague).require_answer()
