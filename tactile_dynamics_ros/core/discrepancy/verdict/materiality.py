"""What is significant and yet does not matter, and what explains most though not all.

Long or precise recordings show effects that nobody need model. A finding is a trace if the error
is next to the noise floor and every effect that could be its cause leaves all estimates in place,
has too little evidence to be named, or does not predict data that it was not fitted to.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from tactile_dynamics_ros.core.discrepancy.challenges import (
    is_outdone_by_change,
    is_outdone_by_law,
)
from tactile_dynamics_ros.core.discrepancy.model.residual_model import ResidualModel
from tactile_dynamics_ros.core.discrepancy.screening import best_by_effect, screen
from tactile_dynamics_ros.core.discrepancy.search import DiagnosisConfig, Step, explained_share
from tactile_dynamics_ros.core.discrepancy.signature import find_formula
from tactile_dynamics_ros.core.discrepancy.trials import (
    Choice,
    Trial,
    at_home,
    evidence,
    in_place,
    rematch,
    try_effect,
    try_effects,
)
from tactile_dynamics_ros.core.discrepancy.verdict.adequacy import Assessment, assess
from tactile_dynamics_ros.core.discrepancy.verdict.validation import HeldOut, fits_equally

NEAR_FLOOR = 1.02
"""White RMS over its floor up to which a finding may be a trace, and what a named effect leaves is
not described: 4 % of the noise's variance. The floor is known to 1 % from 15 s at 100 Hz; less
calls clean recordings of such length back, more hides effects that double the intervals of what
they move."""
_MOVED = 0.5
"""Change of an estimate, in its standard deviations, from which an effect matters: its bias then
takes the share of true values within 95 % intervals to 92 %. Twice as much takes it to 83 %."""
_AS_LIKELY = DiagnosisConfig().indifference
"""Difference of -2 log evidence to the best within which another effect may be the cause as well,
that which does not decide for the diagnosis either: all of them must leave the estimates where they
are. Lower calls a finding a trace though a likely rival moves the estimates; higher asks of so many
rivals that traces are reported as missing effects."""

_WEAK = "is too little for any known effect to be named"
"""Reason of a trace that an effect could make which would move estimates, had it any evidence."""
_IDLE = "predicts nothing of the samples that it was not fitted to"
"""Reason of a trace that one effect explains, and does not explain in held-out samples."""


@dataclass(frozen=True)
class Trace:
    """A significant finding that does not matter.

    Attributes:
        name: the effect that it looks most like; None where it looks like none.
        parameters: {parameter: {"value", "std", "unit"}} of that effect.
        p_value: of the finding.
        error: white RMS over the noise floor.
        moved: largest change of an estimate, in standard deviations, if an effect is added.
        reason: why it does not matter, as a clause about the finding.
    """

    name: str | None
    parameters: dict[str, dict[str, Any]]
    p_value: float
    error: float
    moved: float
    reason: str = "moves no estimate by half its standard deviation"

    def to_json(self) -> dict[str, Any]:
        """Part `trace` of the documents of `compare` and `diagnose`."""
        return {
            "name": self.name,
            "parameters": self.parameters,
            "p_value": self.p_value,
            "error_over_floor": self.error,
            "largest_change_in_std": self.moved,
            "reason": self.reason,
        }


def find_trace(assessment: Assessment) -> Trace | None:
    """The finding of an assessment if it does not matter; None if it may.

    An effect matters that moves an estimate, provided that a diagnosis could name it: one with less
    evidence only takes on what chance left.

    Args:
        assessment: of a model that is not white.
    """
    if not is_near_floor(assessment):
        return None
    model, floor = assessment.model, assessment.structure.floor
    without = evidence(model, floor)
    trials = [t for t in _suspects(assessment) if t.criterion < without]
    error = assessment.rms / floor
    moved = max((model.moved_by(trial.model) for trial in trials), default=0.0)
    if moved > _MOVED:
        named = any(trial.criterion < without - _AS_LIKELY for trial in trials)
        return None if named else Trace(None, {}, assessment.p_value, error, moved, _WEAK)
    name = trials[0].name if trials else None
    found = trials[0].model.parameters().get(trials[0].name, {}) if trials else {}
    return Trace(name, found, assessment.p_value, error, moved)


def is_near_floor(assessment: Assessment) -> bool:
    """Whether the error is so close to the floor of a well stated noise that it hardly matters."""
    near = assessment.rms <= NEAR_FLOOR * assessment.structure.floor
    return near and assessment.noise_stated_well


def find_idle(
    assessment: Assessment, choice: Choice, before: HeldOut, after: HeldOut
) -> Trace | None:
    """The effect that was chosen, if the error is next to the floor and stays where it is.

    Held-out blocks then cost as much with it as without: it explains what it was fitted to alone.

    Args:
        assessment: of a model that is not white.
        choice: the effect, refitted with all numbers.
        before: held-out error without it.
        after: the same with it.
    """
    if not is_near_floor(assessment) or not fits_equally(after, before, tolerance=0.0):
        return None
    model, best = assessment.model, choice.best
    found = choice.model.parameters().get(best.name, {})
    moved = model.moved_by(best.model)
    error = assessment.rms / assessment.structure.floor
    return Trace(best.name, found, assessment.p_value, error, moved, _IDLE)


def _suspects(assessment: Assessment) -> list[Trial]:
    """Effects that may be the cause of a finding, the likeliest first."""
    tests, limit = len(assessment.scores), assessment.significance
    names = {
        score.family.name
        for score in best_by_effect(assessment.scores)
        if score.p_value * tests < limit
    }
    scores = [score for score in assessment.scores if score.family.name in names]
    trials = try_effects(assessment.model, scores, assessment.structure.floor)
    return [t for t in trials if t.criterion < trials[0].criterion + _AS_LIKELY]


def explain_most(
    model: ResidualModel,
    steps: Sequence[Step],
    first: Assessment,
    floor: float,
    config: DiagnosisConfig,
) -> tuple[Step, ...]:
    """Effects that explain nine tenths of the excess error; none if there are no such.

    One effect alone, unless a law of named quantities or a change at one time does better: it would
    only imitate what is unknown. So may an error of sensors that report others of their own, unless
    it dominates. Or several that are the terms of the shortest such law.

    Args:
        model: without them.
        steps: the effects that the search ended with.
        first: assessment of the model.
        floor: white RMS of the noise alone.
        config: levels and depths.
    """
    alone = _alone(steps, first, floor, config)
    return alone or _by_terms(model, first, floor, config)


def _alone(
    steps: Sequence[Step], first: Assessment, floor: float, config: DiagnosisConfig
) -> tuple[Step, ...]:
    """The first effect by itself, fitted thoroughly."""
    if not steps or not steps[0].choice.thorough:
        return ()
    step, share = steps[0], explained_share(first.rms, steps[0].after.rms, floor)
    if len(steps) > 1 and share >= config.mostly:
        step = _refitted(step, floor)
        share = explained_share(first.rms, step.after.rms, floor)
    imitates = step.choice.best.source.family.lasting and step.after.lasting_is_stated
    if share < (config.dominating if imitates else config.mostly):
        return ()
    of_any_size = share < config.dominating
    outdone = is_outdone_by_law(step, floor, config.indifference, of_any_size)
    outdone = outdone or is_outdone_by_change(step, floor, config.indifference)
    return () if outdone else (step,)


def _refitted(step: Step, floor: float) -> Step:
    """A step whose quick fit beside other effects is made thorough without them."""
    model, best = step.choice.model.refined(), step.choice.best
    names = [best.name, *(rival.name for rival in step.choice.rivals)]
    choice = at_home(in_place(best, model, floor), *rematch(model, best.name, names, floor), floor)
    return Step(choice, assess(model, step.after.significance))


def _by_terms(
    model: ResidualModel, first: Assessment, floor: float, config: DiagnosisConfig
) -> tuple[Step, ...]:
    """The effects that the terms of the residual's formula are, most important first."""
    formula = find_formula(model, floor)
    names = [family.effect for family in formula.families] if formula else []
    if not names or not all(names) or set(names) & set(model.effect_names):
        return ()
    steps: list[Step] = []
    for name in dict.fromkeys(names):
        scores = screen(model, model.families([name]), floor)
        if not scores:
            return ()
        trial = try_effect(model, scores, name, floor)
        model = trial.model.refined()
        if not model.is_possible(name):
            return ()
        own = in_place(trial, model, floor)
        choice = at_home(own, *rematch(model, name, [name], floor), floor)
        steps.append(Step(choice, assess(model, first.significance)))
    share = explained_share(first.rms, steps[-1].after.rms, floor)
    return tuple(steps) if share >= config.mostly else ()
