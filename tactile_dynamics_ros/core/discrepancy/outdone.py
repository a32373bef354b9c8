"""Effects that explain a residual, held against laws of named quantities and against changes."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tactile_dynamics_ros.core.discrepancy.change import find_change
from tactile_dynamics_ros.core.discrepancy.model import ResidualModel
from tactile_dynamics_ros.core.discrepancy.screening import Score, best_by_effect, screen
from tactile_dynamics_ros.core.discrepancy.search import Step
from tactile_dynamics_ros.core.discrepancy.trials import square, try_effect

_CLEARLY = 3.0
"""In units of what does not decide."""
_MANY = 3.5
"""Parameters that effects have at least together if something unknown may do the same."""
_HALF = 0.5
"""Of a parameter: numbers of those that data determine are no integers."""


def is_outdone(
    model: ResidualModel, steps: Sequence[Step], floor: float, indifference: float
) -> bool:
    """Whether a law of named quantities, or a change at one time, does the same more simply.

    What leaves more than noise is held against laws where it is at home itself. Many parameters
    can imitate what is none of the known effects even if they leave nothing: they are held against
    laws and changes as quick fits at the whitening of the model without effects.

    Args:
        model: without the effects.
        steps: that explain its residual.
        floor: white RMS of the noise alone.
        indifference: difference of -2 log evidence that does not decide.
    """
    last = steps[-1]
    if last.after.within_stated:
        return False
    clearly = _CLEARLY * indifference
    if not last.after.white and _is_outdone_at_home(steps, floor, clearly):
        return True
    return last.choice.model.freedom >= model.freedom + _MANY and _is_outdone_without(
        model, steps, floor, clearly
    )


def _is_outdone_at_home(steps: Sequence[Step], floor: float, clearly: float) -> bool:
    """By a law with no more parameters, at the whitening of the model with the effects."""
    full = bare = steps[-1].choice.model
    for step in steps:
        bare = bare.without_effect(step.name)
    families = [step.choice.best.source for step in steps]
    reached = square(full) / floor**2 + _price(bare, full, families)
    return _has_law(bare, floor, reached - clearly, full.freedom - bare.freedom + _HALF)


def _is_outdone_without(
    model: ResidualModel, steps: Sequence[Step], floor: float, clearly: float
) -> bool:
    """By a law or a change, at the whitening of the model without effects."""
    full, families = model, []
    for step in steps:
        trial = try_effect(full, screen(full, full.families([step.name]), floor), step.name, floor)
        full = trial.model
        families.append(trial.source)
    price = _price(model, full, families)
    if _has_law(model, floor, square(full) / floor**2 + price - clearly):
        return True
    change = find_change(model, full.residual, price, floor)
    return change is not None and change.criterion < -clearly


def _price(bare: ResidualModel, full: ResidualModel, added: Sequence[Score]) -> float:
    """Of the parameters of effects, in units of -2 log evidence."""
    extra, choices = full.freedom - bare.freedom, [score.family.choices for score in added]
    return float(extra * np.log(len(full.residual)) + 2.0 * np.sum(np.log(choices)))


def _has_law(model: ResidualModel, floor: float, limit: float, freedom: float = np.inf) -> bool:
    """Whether a law of at most so many parameters has a lower criterion, and no effect does.

    What an effect of the catalogue does as well is nothing unknown.
    """
    laws = [law for law in screen(model, model.library(), floor) if law.freedom <= freedom]
    if min((law.criterion for law in laws), default=np.inf) >= limit:
        return False
    effects = screen(model, model.families(), floor)
    return min((score.criterion for score in effects), default=np.inf) >= limit


def follows_other_law(step: Step, floor: float, indifference: float) -> bool:
    """Whether a law of named quantities explains most of what is left, better than any effect.

    Args:
        step: the last one.
        floor: white RMS of the noise alone.
        indifference: difference of -2 log evidence that does not decide.
    """
    model = step.choice.model
    laws = best_by_effect(screen(model, model.library(), floor))
    effects = best_by_effect(step.after.scores)
    if not laws:
        return False
    left = square(model) - floor**2 * len(model.residual)
    known = effects[0].criterion if effects else float("inf")
    return laws[0].gain > 0.5 * left and laws[0].criterion < known - indifference
