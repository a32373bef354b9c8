"""`tactile-dynamics compare | diagnose | explain`: what is missing from the model?"""

from __future__ import annotations

import json
import sys
from argparse import Namespace, _SubParsersAction
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tactile_dynamics_ros.cli.friction_recording import (
    Question,
    add_model_argument,
    is_probe_recording,
    question_friction,
)
from tactile_dynamics_ros.cli.recordings import (
    add_recording_arguments,
    read_effects,
    read_recording,
)

if TYPE_CHECKING:
    from tactile_dynamics_ros.core.inertia.batch.fitted_model import FittedModel


def add_parser(verbs: _SubParsersAction[Any]) -> None:
    """Add the three verbs."""
    texts: dict[str, tuple[str, Callable[[Namespace], int]]] = {
        "compare": ("how far the model is from a recording, and where it fails", run_compare),
        "diagnose": ("which effect is missing from the model of a recording", run_diagnose),
        "explain": ("add missing effects one by one and watch the error fall", run_explain),
    }
    for name, (text, run) in texts.items():
        parser = verbs.add_parser(name, help=text)
        add_recording_arguments(parser)
        add_model_argument(parser)
        parser.add_argument("--out", metavar="DIR", help="also write DIR/report.html with figures")
        parser.set_defaults(run=run)


def run_compare(args: Namespace) -> int:
    """Compare and print."""
    from tactile_dynamics_ros.core.discrepancy.comparison import compare

    question = _ask(args)
    comparison = compare(question.model)
    error = question.error()
    error["channels"] = comparison.channel_rms
    document = {"error": error} | comparison.to_json()
    _print(args, document, _compare_lines(document))
    if args.out:
        from tactile_dynamics_ros.report.discrepancy_findings import findings_of_comparison

        _write(args, findings_of_comparison(question.source, document, comparison))
    return 0


def run_diagnose(args: Namespace) -> int:
    """Diagnose and print."""
    from tactile_dynamics_ros.core.discrepancy.diagnosis import diagnose
    from tactile_dynamics_ros.core.discrepancy.documents import diagnosis_document

    question = _ask(args)
    diagnosis = _answer(question, diagnose)
    document = diagnosis_document(diagnosis)
    _print(args, document, _diagnose_lines(document))
    if args.out:
        from tactile_dynamics_ros.report.discrepancy_findings import findings_of_diagnosis

        _write(args, findings_of_diagnosis(question.source, document, diagnosis))
    return 0


def run_explain(args: Namespace) -> int:
    """Explain and print."""
    from tactile_dynamics_ros.core.discrepancy.documents import explanation_document
    from tactile_dynamics_ros.core.discrepancy.explanation import explain

    question = _ask(args)
    explanation = _answer(question, explain)
    document = explanation_document(explanation)
    _print(args, document, _explain_lines(document, question.model.residuals().alone))
    if args.out:
        from tactile_dynamics_ros.report.discrepancy_findings import findings_of_explanation

        _write(args, findings_of_explanation(question.source, document, explanation))
    return 0


def _ask(args: Namespace) -> Question:
    """Fit the model that suits the recording."""
    if is_probe_recording(args):
        return question_friction(args)
    from tactile_dynamics_ros.core.inertia.diagnosis.misreading import question
    from tactile_dynamics_ros.core.inertia.diagnosis.readings import (
        fit_with_readings,
        model_with_seen_noise,
    )

    recording, effects = read_recording(args), read_effects(args)
    fitted = fit_with_readings(recording.streams, effects)
    _note(fitted)

    model = question(recording.streams, effects, fitted)
    return Question(
        model,
        recording.source,
        lambda: dict(fitted.to_estimate().error.to_json()),
        lambda: model_with_seen_noise(model, recording.streams, effects),
    )


def _answer(question: Question, ask: Callable[[Any], Any]) -> Any:
    """Diagnose or explain; where that fails, once more with the noise that the samples show."""
    from tactile_dynamics_ros.core.discrepancy.explanation import ask_twice

    answer, model = ask_twice(ask, question.model, question.otherwise)
    if model is not question.model:
        _note(model.fitted)
    return answer


def _note(fitted: FittedModel) -> None:
    """Say what was not taken as it is recorded."""
    from tactile_dynamics_ros.core.inertia.residuals.stated_noise import remark_on

    if fitted.survey is not None:
        print(f"note: {fitted.survey.remark}", file=sys.stderr)
    if fitted.restated:
        print(f"note: {remark_on(fitted.restated)}", file=sys.stderr)


def _print(args: Namespace, document: dict[str, Any], lines: list[str]) -> None:
    print(json.dumps(document) if args.json else "\n".join(lines))


def _write(args: Namespace, findings: Any) -> None:
    from tactile_dynamics_ros.report.discrepancy_report import write_discrepancy_report

    page = write_discrepancy_report(findings, Path(args.out), f"tactile-dynamics {args.verb} ...")
    print(f"report: {page}", file=sys.stderr)


def _compare_lines(document: dict[str, Any]) -> list[str]:
    error = document["error"]
    torque = error["torque_rms_nm"]
    lines = [
        f"error: {error['whitened_rms']:.2f} times the stated sensor noise (whitened RMS), "
        f"{error['force_rms_n']:.3g} N" + ("" if torque is None else f", {torque:.3g} N m"),
        f"the model is {'adequate' if document['adequate'] else 'not adequate'} ({_why(document)})",
    ]
    for place in document["fails_where"]:
        share = 100.0 * place["share_of_error"]
        lines.append(f"  {place['channel']}: {share:.0f} % of its error {place['condition']}")
    return lines


def _why(document: dict[str, Any]) -> str:
    p_value = f"p = {document['p_value']:.2g}"
    if document.get("trace"):
        return f"{p_value}, but it moves no estimate by half its standard deviation"
    if document["adequate"] and not document["white"]:
        return f"{p_value}, but within the uncertainty that the sensors report"
    return p_value


def _diagnose_lines(document: dict[str, Any]) -> list[str]:
    error = document["error"]
    lines = [
        document["sentence"],
        f"held-out error {error['before']:.3f} -> {error['after']:.3f}, "
        f"noise floor {error['noise_floor']:.3f}",
    ]
    if document["verdict"] not in ("adequate", "convention"):
        lines.append("candidates, best first (error expected before refitting):")
        lines += [
            f"  {c['name']:<18} {c['predicted_whitened_rms']:.3f}  p = {c['p_value']:.2g}"
            for c in document["candidates"][:5]
        ]
    return lines


def _explain_lines(document: dict[str, Any], alone: str) -> list[str]:
    lines = [
        f"  {step['added'] or alone:<22} error {step['error']:.3f}" for step in document["steps"]
    ]
    floor = document["error"]["noise_floor"]
    return [*lines, f"  {'noise floor':<22} error {floor:.3f}", document["sentence"]]
