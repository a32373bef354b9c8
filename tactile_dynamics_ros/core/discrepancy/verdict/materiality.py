"""What is significant and yet does not matter: traces that move neither the error nor an estimate.

Long or precise recordings show effects that nobody need model. A finding is a trace if the error
is next to the noise floor and every effect that could be its cause leaves all estimates in place,
or does not foretell data that it was not fitted to.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from tactile_dynamics_ros.core.discrepancy.model.residual_model import Misfit
from tactile_dynamics_ros.core.discrepancy.screening import best_by_effect
from tactile_dynamics_ros.core.discrepancy.search import DiagnosisConfig
from tactile_dynamics_ros.core.discrepancy.selection import Choice
from tactile_dynamics_ros.core.discrepancy.trials import Trial, evidence, try_effects
from tactile_dynamics_ros.core.discrepancy.validation import HeldOut, fits_equally
from tactile_dynamics_ros.core.discrepancy.verdict.adequacy import Assessment

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
rivals that traces are told as missing effects."""


@dataclass(frozen=True)
class Trace:
    """A significant finding that does not matter.

    Attributes:
        name: the effect that it looks most like; None where it looks like none.
        parameters: {parameter: {"value", "std", "unit"}} of that effect.
        p_value: of the finding.
        error: white RMS over the noise floor.
        moved: largest change of an estimate, in standard deviations, if an effect is added.
        idle: whether it explains nothing that it was not fitted to.
    """

    name: str | None
    parameters: dict[str, dict[str, Any]]
    p_value: float
    error: float
    moved: float
    idle: bool = False

    def to_json(self) -> dict[str, Any]:
        """Part `trace` of the documents of `compare` and `diagnose`."""
        return {
            "name": self.name,
            "parameters": self.parameters,
            "p_value": self.p_value,
            "error_over_floor": self.error,
            "largest_change_in_std": self.moved,
        }


def find_trace(assessment: Assessment) -> Trace | None:
    """The finding of an assessment if it does not matter; None if it may.

    Args:
        assessment: of a model that is not white.
    """
    model, floor = assessment.model, assessment.structure.floor
    error = Misfit.of(model).rms / floor
    if error > NEAR_FLOOR or not assessment.noise_stated_well:
        return None
    without = evidence(model, floor)
    trials = [t for t in _suspects(assessment) if t.criterion < without]
    moved = max((model.moved_by(trial.model) for trial in trials), default=0.0)
    if moved > _MOVED:
        return None
    name = trials[0].name if trials else None
    found = trials[0].model.parameters().get(trials[0].name, {}) if trials else {}
    return Trace(name, found, assessment.p_value, error, moved)


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
    model, best = assessment.model, choice.best
    error = Misfit.of(model).rms / assessment.structure.floor
    if error > NEAR_FLOOR or not fits_equally(after, before, tolerance=0.0):
        return None
    found = choice.model.parameters().get(best.name, {})
    moved = model.moved_by(best.model)
    return Trace(best.name, found, assessment.p_value, error, moved, idle=True)


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
