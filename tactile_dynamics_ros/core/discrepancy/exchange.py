"""Reconsider every effect of a model beside the others: stepwise selection with exchanges."""

from __future__ import annotations

from collections.abc import Sequence

from tactile_dynamics_ros.core.discrepancy.choice import Choice
from tactile_dynamics_ros.core.discrepancy.model import ResidualModel
from tactile_dynamics_ros.core.discrepancy.screening import screen
from tactile_dynamics_ros.core.discrepancy.trials import (
    Trial,
    decisive,
    evidence,
    in_place,
    try_effects,
)

_REACH = 0.05


def exchange(
    model: ResidualModel, added: Sequence[Trial], floor: float, indifference: float
) -> tuple[ResidualModel, tuple[Choice, ...]]:
    """Remove effects that the others make needless, replace those that another betters.

    Effects that were added first had to account for what was still missing then; with it in the
    model another effect, or another reading of the same, may fit better.

    Args:
        model: thoroughly fitted with all added effects.
        added: the effects that may be exchanged.
        floor: white RMS of the noise alone.
        indifference: difference of `evidence` that does not decide.

    Returns:
        The model and the choice of each of its effects beside the others.

    Source: Miller 2002, Subset Selection in Regression, 3.3 (sequential replacement).
    """
    present = list(added)
    changes = len(present)
    choices: list[Choice] = []
    while len(choices) < len(present):
        place = len(choices)
        bare = model.without_effect(present[place].name)
        own, without = in_place(present[place], model, floor), evidence(bare, floor)
        margin = max(indifference, decisive(model, floor))
        scores = screen(bare, bare.families(), floor)
        trials = try_effects(bare, scores, floor, _REACH, own.criterion)
        if changes and len(present) > 1 and without < own.criterion + indifference:
            model = bare.refined()
            del present[place]
        elif changes and trials and trials[0].criterion < own.criterion - margin:
            present[place] = trials[0]
            model = trials[0].model.refined()
        else:
            rivals = tuple(trial for trial in trials if trial.name != own.name)
            choices.append(Choice(model, own, rivals, without))
            continue
        changes, choices = changes - 1, []
    return model, tuple(choices)
