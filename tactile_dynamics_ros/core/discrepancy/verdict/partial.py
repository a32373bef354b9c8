"""Effects that explain most of a residual, though not all of it: named, and the rest described."""

from __future__ import annotations

from collections.abc import Sequence

from tactile_dynamics_ros.core.discrepancy.challenges import (
    is_outdone_by_change,
    is_outdone_by_law,
)
from tactile_dynamics_ros.core.discrepancy.model.residual_model import ResidualModel
from tactile_dynamics_ros.core.discrepancy.screening import screen
from tactile_dynamics_ros.core.discrepancy.search import DiagnosisConfig, Step, explained_share
from tactile_dynamics_ros.core.discrepancy.signature import find_formula
from tactile_dynamics_ros.core.discrepancy.trials import at_home, in_place, rematch, try_effect
from tactile_dynamics_ros.core.discrepancy.verdict.adequacy import Assessment, assess


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
