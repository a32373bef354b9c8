"""Learn a law from what a model leaves, or say why there is none to be learnt."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, cast

import numpy as np

from tactile_dynamics_ros.core.discrepancy.diagnosis import Diagnosis
from tactile_dynamics_ros.core.discrepancy.laws.form import FittableModel, LawForm
from tactile_dynamics_ros.core.discrepancy.laws.search import Find, fit_law, search_laws
from tactile_dynamics_ros.core.discrepancy.screening import best_by_effect
from tactile_dynamics_ros.core.discrepancy.trials import CHANCE, Trial, evidence, rematch
from tactile_dynamics_ros.core.discrepancy.verdict.adequacy import noise_floor
from tactile_dynamics_ros.core.discrepancy.verdict.validation import (
    HeldOut,
    fits_equally,
    held_out,
)
from tactile_dynamics_ros.core.progress import tell

_SIGNIFICANCE = 0.015
"""Chance of such a find on noise alone below which a law may be learnt: none of the 99 draws may
reach it, which gives 0.01."""
_REMAINS = 1.05
"""Held-out error over its floor, beside two standard deviations of the floor, up to which a law
counts as the cause: a tenth of the noise's variance may be left. Of 12 hidden effects (seed 11)
right laws left 1.01 at most, and what merely goes with the cause 1.13 at least; higher learns such
laws, lower refuses right ones by chance."""
_RIVALS = 4
"""Known effects that are fitted in place of a law, those with the best scores: the law must beat
each. More cost a fit each."""


@dataclass(frozen=True)
class Law:
    """A law that was learnt.

    Attributes:
        form: of the law.
        base: the model without it, with its known effects.
        model: thoroughly fitted with it; the law is its last effect.
        before: held-out error without it.
        after: held-out error with it.
        floor: white RMS of the noise alone.
        p_value: chance that noise alone gives such a find, the whole search counted.
        close_to: the known effect that does best in its place, or None.
        others: forms that explain the recording as well.
    """

    form: LawForm
    base: FittableModel
    model: FittableModel
    before: HeldOut
    after: HeldOut
    floor: float
    p_value: float
    close_to: Trial | None
    others: tuple[Find, ...]

    @cached_property
    def separating_motion(self) -> dict[str, Any] | None:
        """Plan of the motion that would tell it from the others, or None."""
        if not self.others:
            return None
        tell("planning what would tell the laws apart")
        return self.model.separating_motion([other.model for other in self.others])


@dataclass(frozen=True)
class NothingLearnt:
    """Why there is no law.

    Attributes:
        reason: as a clause.
    """

    reason: str


def learn_law(diagnosis: Diagnosis, forms: Sequence[LawForm]) -> Law | NothingLearnt:
    """Learn the law of what a diagnosis does not explain, jointly with the model.

    A law is learnt only if noise alone never gives such a find, held-out blocks are explained to
    near the floor with it, and no known effect in its place does as well. Where a known effect is
    named and does not explain all, a law in its place is tried, then one beside it.

    Args:
        diagnosis: of a fitted model.
        forms: of laws that are tried.
    """
    if diagnosis.convention is not None:
        return NothingLearnt(f"the recording reads otherwise: {diagnosis.convention.change}")
    if diagnosis.verdict == "adequate":
        return NothingLearnt("nothing is missing")
    if diagnosis.model.unreadable:
        return NothingLearnt(diagnosis.model.unreadable.rstrip("."))
    named = diagnosis.effect
    if named is not None and diagnosis.leaves_noise:
        return NothingLearnt(f"{named} of the catalogue explains the recording")
    found = _learn(cast(FittableModel, diagnosis.model), diagnosis, forms)
    if isinstance(found, Law) or named is None or diagnosis.signature is None:
        return found
    return _learn(cast(FittableModel, diagnosis.explained_model), diagnosis, forms)


def _learn(
    base: FittableModel, diagnosis: Diagnosis, forms: Sequence[LawForm]
) -> Law | NothingLearnt:
    """Search beside the effects of a model; judge what is found."""
    forms = [form for form in forms if form.name not in base.effect_names]
    search = search_laws(base, forms, noise_floor(base))
    if search.p_value > _SIGNIFICANCE:
        return NothingLearnt(
            f"noise alone gives as good a law in {100.0 * search.p_value:.0f} % of all recordings"
        )
    if not search.finds:
        return NothingLearnt("no form of law fits")
    first = search.finds[0]
    tell(f"fitting a law thoroughly: {first.form.name}")
    model = cast(FittableModel, first.model.refined())
    after, floor = held_out(model), noise_floor(model)
    if after.rms > (_REMAINS + 2.0 * _floor_spread(after.rows)) * floor:
        return NothingLearnt(
            f"no law of these forms is the cause: the best, {first.form.name}, leaves a held-out "
            f"error of {after.rms:.2f}, {after.rms / floor:.2f} times its floor"
        )
    reached = evidence(model, floor, search.tried)
    bare = cast(FittableModel, model.without_effect(first.form.name))
    known = _known(model, first.form.name, _names(diagnosis), floor)
    if known is not None and known.criterion < reached + CHANCE:
        return NothingLearnt(
            f"{known.name} of the catalogue does as well in place of {first.form.name}"
        )
    others = [
        fit_law(bare, find.form, [find.theta], floor, search.tried) for find in search.finds[1:]
    ]
    equal = [
        other
        for other in others
        if other.criterion < reached + CHANCE and fits_equally(after, held_out(other.model))
    ]
    before = held_out(base)
    return Law(first.form, base, model, before, after, floor, search.p_value, known, tuple(equal))


def _floor_spread(rows: int) -> float:
    """Relative standard deviation of a floor: of the median of rows / 2 exponential variates."""
    return float(0.5 / (np.log(2.0) * np.sqrt(0.5 * rows)))


def _names(diagnosis: Diagnosis) -> list[str]:
    """Known effects that have the best claim to be the cause."""
    best = [score.family.name for score in best_by_effect(diagnosis.assessment.scores)[:_RIVALS]]
    named = [diagnosis.effect] if diagnosis.effect else []
    return list(dict.fromkeys([*named, *diagnosis.group, *best]))


def _known(model: FittableModel, law: str, names: Sequence[str], floor: float) -> Trial | None:
    """The known effect that does best in place of a law."""
    wanted = [name for name in names if name not in model.effect_names]
    _, trials = rematch(model, law, wanted, floor)
    return trials[0] if trials else None
