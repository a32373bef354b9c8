"""Findings as the JSON documents that `diagnose` and `explain` print, with a plain sentence."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from tactile_dynamics_ros.core.discrepancy.diagnosis import Diagnosis
from tactile_dynamics_ros.core.discrepancy.explanation import Explanation
from tactile_dynamics_ros.core.discrepancy.model.residual_model import (
    Convention,
    ParameterTable,
    ResidualModel,
)
from tactile_dynamics_ros.core.discrepancy.regimes.finding import RegimeFinding
from tactile_dynamics_ros.core.discrepancy.screening import Score, best_by_effect
from tactile_dynamics_ros.core.discrepancy.search import explained_share
from tactile_dynamics_ros.core.discrepancy.signature import Signature
from tactile_dynamics_ros.core.discrepancy.trials import Choice, Trial
from tactile_dynamics_ros.core.discrepancy.verdict.materiality import Trace
from tactile_dynamics_ros.core.discrepancy.verdict.wording import (
    capitalise,
    join_names,
    write_fall,
    write_p_value,
    write_parameters,
    write_percent,
)

Document = dict[str, Any]

_REMAINS = 1.15
"""Held-out error over the noise floor from which a sentence says how much remains: a third of the
noise's variance. It changes no verdict. Lower says so where next to nothing is left, higher keeps
silent where a further cause is."""
_NOTABLE = 0.1
"""Share of an unexplained error from which the known effect that explains most of it is reported:
less would send people after effects that are not there. It changes no verdict."""


def diagnosis_document(diagnosis: Diagnosis) -> Document:
    """The document of `diagnose`."""
    signature = diagnosis.signature
    return {
        "verdict": diagnosis.verdict,
        "effect": diagnosis.effect,
        "regime": diagnosis.regime.to_json() if diagnosis.regime else None,
        "event": _event(diagnosis.explained_model, diagnosis.regime),
        "group": list(diagnosis.group),
        "separating_motion": diagnosis.separating_motion,
        "candidates": [] if diagnosis.convention else _candidates(diagnosis),
        "error": {
            "before": diagnosis.before.rms,
            "after": diagnosis.after.rms,
            "noise_floor": diagnosis.floor,
        },
        "unexplained": signature.to_json() if signature else None,
        "p_value": diagnosis.assessment.p_value,
        "trace": diagnosis.trace.to_json() if diagnosis.trace else None,
        "convention": _convention(diagnosis.convention),
        "sentence": diagnosis_sentence(diagnosis),
    }


def explanation_document(explanation: Explanation) -> Document:
    """The document of `explain`."""
    names = explanation.effects
    read = () if explanation.in_turn else explanation.conventions
    errors = [explanation.before.rms, *(c.error_after for c in read)]
    errors += [step.error for step in explanation.steps]
    added = [None, *(f"read as {c.name} ({c.change})" for c in read)]
    added += [step.name for step in explanation.steps]
    signature = explanation.signature
    return {
        "steps": [{"added": a, "error": e} for a, e in zip(added, errors, strict=True)],
        "verdict": explanation.verdict,
        "effects": list(names),
        "error": {
            "before": explanation.before.rms,
            "after": explanation.after.rms,
            "noise_floor": explanation.floor,
        },
        "parameters": explanation.model.parameters(),
        "regimes": {name: one.to_json() for name, one in explanation.regimes.items()},
        "event": _event(
            explanation.model, next((r for r in explanation.regimes.values() if r.event), None)
        ),
        "groups": {step.name: list(step.group) for step in explanation.steps if step.group},
        "unexplained": signature.to_json() if signature else None,
        "convention": _convention(read[0] if read else None),
        "sentence": explanation_sentence(explanation),
    }


def _event(model: ResidualModel, found: RegimeFinding | None) -> Document | None:
    """What changed at one time: what was found, or what the model knew before."""
    return (None if found is None else found.event_json()) or model.known_event


def _convention(convention: Convention | None) -> Document | None:
    """The entry of a convention."""
    if convention is None:
        return None
    return {
        "name": convention.name,
        "change": convention.change,
        "error_after": convention.error_after,
        "others": list(convention.others),
    }


def _candidates(diagnosis: Diagnosis) -> list[Document]:
    """Candidates of the first step, best first: those that were refitted, then the others."""
    scores = {s.family.name: s for s in best_by_effect(diagnosis.assessment.scores)}
    tests = len(diagnosis.assessment.scores)
    trials = _first_trials(diagnosis)
    rest = [name for name in scores if name not in {t.name for t in trials}]
    found = [_refitted(t, scores.get(t.name, t.source), diagnosis, tests) for t in trials]
    found += [_scored(scores[name], tests) for name in rest]
    return [entry | {"remark": _why_not(entry, diagnosis)} for entry in found]


def _why_not(candidate: Document, diagnosis: Diagnosis) -> str:
    """Why a significant candidate is not the answer where none is named; empty otherwise."""
    significant = candidate["p_value"] < diagnosis.assessment.significance
    if not significant or diagnosis.effect is not None or diagnosis.verdict != "adequate":
        return ""
    if diagnosis.trace is not None:
        return f"does not count: {diagnosis.trace.reason}"
    return "does not count: errors of this size are what the sensors report of themselves"


def _first_trials(diagnosis: Diagnosis) -> list[Trial]:
    """Refitted candidates; none where they were refitted beside effects that are not the cause."""
    if not diagnosis.steps or (diagnosis.effect is None and len(diagnosis.steps) > 1):
        return []
    choice: Choice = diagnosis.steps[0].choice
    return sorted([choice.best, *choice.rivals], key=lambda trial: trial.criterion)


def _refitted(trial: Trial, score: Score, diagnosis: Diagnosis, tests: int) -> Document:
    model: ResidualModel = trial.model
    if trial.name == diagnosis.effect:
        model = diagnosis.steps[-1].choice.model
    without = diagnosis.steps[0].choice.without
    return {
        **_scored(score, tests),
        "score": 0.5 * (without - trial.criterion),
        "reading": trial.label,
        "refitted_whitened_rms": float(np.sqrt(np.mean(trial.model.residual**2))),
        "parameters": model.parameters().get(trial.name, {}),
    }


def _scored(score: Score, tests: int) -> Document:
    return {
        "name": score.family.name,
        "score": 0.5 * (score.gain - score.freedom * float(np.log(len(score.family.columns)))),
        "p_value": min(1.0, score.p_value * tests),
        "predicted_whitened_rms": score.predicted_rms,
        "parameters": {},
        "reading": score.family.label,
    }


def diagnosis_sentence(diagnosis: Diagnosis) -> str:
    """The verdict for people, and what is to be known of an adequate model or one with an event."""
    model = diagnosis.explained_model
    worth_it = diagnosis.verdict == "adequate" or model.known_event is not None
    remark = model.remark if worth_it and diagnosis.convention is None else ""
    return " ".join(filter(None, (_verdict_sentence(diagnosis), remark)))


def _verdict_sentence(diagnosis: Diagnosis) -> str:
    if diagnosis.convention is not None:
        return _convention_sentence(diagnosis, diagnosis.convention)
    if diagnosis.trace is not None:
        return _trace_sentence(diagnosis.trace)
    if diagnosis.verdict == "adequate" and not diagnosis.assessment.white:
        return (
            "Nothing is known to be missing: the error is within the uncertainty that the sensors "
            f"report (whitened error {diagnosis.before.rms:.2f}), though it is more regular "
            f"than noise{_lead(diagnosis)}{_significant(diagnosis)}."
        )
    if diagnosis.verdict == "adequate":
        return (
            "Nothing is missing: the model explains the recording to within the stated noise "
            f"(whitened error {diagnosis.before.rms:.2f}, "
            f"{write_p_value(diagnosis.assessment.p_value)})."
        )
    if diagnosis.effect is None:
        return _unexplained_sentence(diagnosis)
    named = _effect_sentence(
        diagnosis.model, _fitted_together(diagnosis), diagnosis.effect, diagnosis.regime
    )
    share = explained_share(diagnosis.before.rms, diagnosis.after.rms, diagnosis.floor)
    text = f"{named} explains {write_percent(share)} of the excess error"
    alone = diagnosis.signature is None and len(diagnosis.steps) == 1
    if diagnosis.regime and alone and not diagnosis.regime.event:
        text += f"; {diagnosis.regime.elsewhere} nothing is missing"
    if len(diagnosis.steps) > 1:
        others = [step.name for step in diagnosis.steps[1:]]
        text += f"; {join_names(others, 'and')} {'is' if len(others) == 1 else 'are'} missing too"
    elif diagnosis.remaining > _REMAINS and not diagnosis.steps[0].after.within_stated:
        text += f"; what remains is {diagnosis.remaining:.1f} times the noise"
    if diagnosis.signature is not None:
        text += f"; {_facts(diagnosis.signature, 'what remains')}"
    clause = group_clause(diagnosis.verdict, diagnosis.group, diagnosis.separating_motion)
    return f"{text}; {clause}." if clause else f"{text}."


def _fitted_together(diagnosis: Diagnosis) -> ParameterTable:
    """Parameters of the named effect beside all others that are missing."""
    return diagnosis.steps[-1].choice.model.parameters()


def _trace_sentence(trace: Trace) -> str:
    text = (
        f"Nothing that matters is missing: the error is {trace.error:.3f} times the noise floor, "
        f"and what is significant ({write_p_value(trace.p_value)}) {trace.reason}"
    )
    if trace.name is None:
        return text + "."
    return (
        f"{text}. It looks most like {trace.name} ({write_parameters(trace.parameters)}) and moves "
        f"estimates by at most {trace.moved:.2g} of their standard deviation."
    )


def _effect_sentence(
    model: ResidualModel, parameters: ParameterTable, name: str, regime: RegimeFinding | None
) -> str:
    clause = model.sentence(name)
    where = clause if regime is None else f"{regime.words} {clause}"
    return f"{capitalise(where)}: {write_parameters(parameters.get(name, {}))}"


def _convention_sentence(diagnosis: Diagnosis, convention: Convention) -> str:
    before, after = diagnosis.before.rms, convention.error_after
    text = (
        f"The recording seems to use another convention ({convention.name}): "
        f"{convention.change}. The error "
    )
    unlike = ""
    if convention.others:
        unlike = f"; this recording cannot tell it from {join_names(convention.others)}"
    if diagnosis.remaining > _REMAINS:
        return (
            f"{text}was {before:.2f} and remains {after:.2f}, {diagnosis.remaining:.1f} times the "
            f"noise{unlike}. More may be wrong, of the recording or of the model: ask explain, "
            "which goes on, before you correct anything "
            f"(--assume {convention.name} reads it so)."
        )
    return (
        f"{text}{write_fall(before, after)}{unlike}. Correct the recording, or read it so with "
        f"--assume {convention.name}."
    )


def _unexplained_sentence(diagnosis: Diagnosis) -> str:
    if diagnosis.model.unreadable:
        return diagnosis.model.unreadable
    if not diagnosis.assessment.noise_stated_well and diagnosis.assessment.p_value >= (
        diagnosis.assessment.significance
    ):
        return (
            f"The residual is white noise, but {diagnosis.floor:.2f} times as large as the sensors "
            "state: correct the stated noise, or look for vibration."
        )
    assert diagnosis.signature is not None
    text = f"Something is missing that is not in the catalogue: {_facts(diagnosis.signature)}"
    return text + _lead(diagnosis) + _loud(diagnosis) + "."


def _loud(diagnosis: Diagnosis) -> str:
    """That even the quietest frequencies are louder than the sensors state, if they are."""
    if diagnosis.assessment.noise_stated_well:
        return ""
    return (
        f"; apart from that, noise is {diagnosis.floor:.2f} times what the sensors state: their "
        "noise is understated, or there is vibration (the report of --out has the spectrum)"
    )


def _significant(diagnosis: Diagnosis) -> str:
    """Why the likeliest candidate does not count although it is no chance."""
    entries = _candidates(diagnosis)
    if not entries or not entries[0]["remark"]:
        return ""
    best = entries[0]
    return f"; {best['name']} ({write_p_value(best['p_value'])}) {best['remark']}"


def _lead(diagnosis: Diagnosis) -> str:
    """How far the known effects that were tried get with a residual that they do not explain.

    Of several, each with its parameters, since any of them may be real and the rest another cause.
    """
    steps = [step for step in diagnosis.steps if step.choice.thorough] or diagnosis.steps[:1]
    if not steps:
        return ""
    share = explained_share(diagnosis.assessment.rms, steps[-1].after.rms, diagnosis.floor)
    if share < _NOTABLE:
        return ""
    names = join_names([step.name for step in steps], "and")
    if len(steps) == 1:
        return f"; of the known effects {names} explains most, {write_percent(share)} after a refit"
    fitted = steps[-1].choice.model.parameters()
    values = "; ".join(f"{s.name}: {write_parameters(fitted.get(s.name, {}))}" for s in steps)
    percent = write_percent(share)
    return f"; of the known effects {names} together explain {percent} of it ({values})"


def _facts(signature: Signature, subject: str = "the error") -> str:
    facts = [f"{subject} is in {_channels(signature.channels)}"]
    if signature.frame:
        facts.append(f"is simplest in the {signature.frame} frame")
    if signature.frequency_hz is not None:
        facts.append(f"oscillates at {signature.frequency_hz:.3g} Hz")
    if signature.intervals:
        count = len(signature.intervals)
        facts.append("comes in one burst" if count == 1 else f"comes in {count} bursts")
    if signature.correlates_with:
        facts.append(
            f"correlates with {signature.correlates_with.replace('_', ' ')} "
            f"({write_percent(signature.share)} of the excess error)"
        )
    if signature.change:
        verb = "ends" if signature.change.ends else "begins"
        facts.append(f"{verb} at {signature.change.time:.1f} s, as {signature.change.label} would")
    if signature.formula:
        facts.append(f"looks like {signature.formula}")
    return ", ".join(facts)


def _channels(names: Sequence[str]) -> str:
    return ", ".join(name.replace("_", " ") for name in names) or "all channels"


def explanation_sentence(explanation: Explanation) -> str:
    """The outcome of all steps for people."""
    if explanation.in_turn:
        return _in_turn_sentence(explanation.conventions)
    doubt = " (in doubt, since something remains)" if explanation.verdict == "unexplained" else ""
    read = "".join(f"Read as {c.name}{doubt}: {c.change}. " for c in explanation.conventions)
    return read + _outcome(explanation)


def _in_turn_sentence(read: Sequence[Convention]) -> str:
    """What is to be looked at where no reading is to be believed."""
    names = join_names(list(dict.fromkeys(one.name for one in read)), "and")
    return (
        f"Several readings of the numbers fit in turn ({names}), and none of them alone explains "
        "the recording: look at the units, signs, axes and orders of forces, torques and poses "
        "yourself."
    )


def _outcome(explanation: Explanation) -> str:
    before, after = explanation.before.rms, explanation.after.rms
    if not explanation.steps:
        return diagnosis_sentence(explanation.first)
    parameters = explanation.model.parameters()
    clauses = [
        _effect_sentence(explanation.model, parameters, name, explanation.regimes.get(name))
        for name in explanation.effects
    ]
    end = ""
    if explanation.signature is not None:
        end = f"; something else remains: {_facts(explanation.signature)}"
        end += _lead(explanation.last)
    return f"{'. '.join(clauses)}. The error {write_fall(before, after)}{end}."


def group_clause(verdict: str, group: Sequence[str], motion: Mapping[str, Any] | None) -> str:
    """What else may be the cause and what would tell, as a clause; empty without a group.

    Where one effect is named, the others contain what it does, with more parameters; otherwise they
    are as plausible.

    Args:
        verdict: of the diagnosis.
        group: the effect that is named, then the others.
        motion: that would separate them, if any does.
    """
    if len(group) < 2:
        return ""
    if verdict == "ambiguous":
        text = f"this recording cannot tell {join_names(group, 'and')} apart"
    else:
        text = f"the same could be done here, with more parameters, by {join_names(group[1:])}"
    if not motion:
        return f"{text}, and no motion was found that separates them"
    told = motion.get("separates_from", group)
    left = [name for name in group[1:] if name not in told]
    remains = f"; that does not separate {group[0]} from {join_names(left)}" if left else ""
    return f"{text}: {motion['description']}{remains}"
