"""Laws that no catalogue has: learn one from what a model leaves, or say why there is none."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, cast

import numpy as np

from tactile_dynamics_ros.core.discrepancy.diagnosis import Diagnosis
from tactile_dynamics_ros.core.discrepancy.laws.search import (
    Find,
    FittableModel,
    LawForm,
    Search,
    fit_law,
    search_laws,
)
from tactile_dynamics_ros.core.discrepancy.model.residual_model import ResidualModel
from tactile_dynamics_ros.core.discrepancy.screening import best_by_effect, screen
from tactile_dynamics_ros.core.discrepancy.search import DiagnosisConfig, explained_share
from tactile_dynamics_ros.core.discrepancy.trials import (
    CHANCE,
    Trial,
    dispersion,
    evidence,
    rematch,
    try_effects,
)
from tactile_dynamics_ros.core.discrepancy.verdict.adequacy import (
    is_within_stated,
    noise_floor,
    stated_limit,
)
from tactile_dynamics_ros.core.discrepancy.verdict.validation import HeldOut, fits_equally, held_out
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
_MOST_TERMS = 2
"""Forms, or a form and a known effect, that are added up at most: each costs a search of all forms,
and three forms with free exponents imitate much that they are not."""


@dataclass(frozen=True)
class Law:
    """A law that was learnt.

    Attributes:
        forms: of its terms, which add up; one for most laws.
        beside: known effects that were found to act as well.
        base: the model without it, with its known effects.
        model: thoroughly fitted with all of them.
        before: held-out error without it.
        after: held-out error with it.
        floor: white RMS of the noise alone.
        p_value: chance that noise alone gives such a find, the whole search counted.
        close_to: the known effect that does best in place of a term, or None.
        others: forms that explain the recording as well in place of the last term.
    """

    forms: tuple[LawForm, ...]
    beside: tuple[str, ...]
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
    near the noise that the model states, and no known effect in its place does as well. Where a
    known effect explains a part, a law in its place is tried, then one beside it.

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
    known = _names(diagnosis)
    found = _learn(cast(FittableModel, diagnosis.model), forms, known)
    if isinstance(found, Law) or not diagnosis.steps:
        return found
    if named is not None and diagnosis.signature is None:
        return found
    beside = _learn(cast(FittableModel, diagnosis.steps[0].choice.model), forms, known)
    return beside if isinstance(beside, Law) else found


@dataclass(frozen=True)
class _Sum:
    """Terms that are added to a model one after the other.

    Attributes:
        base: without them.
        model: thoroughly fitted with them.
        terms: those that are laws, each with the search that found it.
        p_value: largest of all searches.
    """

    base: FittableModel
    model: FittableModel
    terms: tuple[tuple[LawForm, Search], ...] = ()
    p_value: float = 0.0

    @property
    def forms(self) -> tuple[LawForm, ...]:
        """Of the terms."""
        return tuple(form for form, _ in self.terms)

    @cached_property
    def after(self) -> HeldOut:
        """Held-out error with all terms."""
        return held_out(self.model)

    @cached_property
    def floor(self) -> float:
        """White RMS of the noise alone."""
        return noise_floor(self.model)

    @property
    def explains(self) -> bool:
        """Whether held-out blocks are explained to the noise that the model states.

        That is white noise, or where sensors state errors that last as well, these too, provided
        that most of the error has gone, as `is_noise` asks of known effects.
        """
        rms = self.after.rms
        if rms <= (_REMAINS + 2.0 * _floor_spread(self.after.rows)) * self.floor:
            return True
        limit = stated_limit(self.model, self.floor)
        if limit is None or rms**2 > limit or not is_within_stated(self.model, self.floor):
            return False
        share = explained_share(held_out(self.base).rms, rms, self.floor)
        return share >= DiagnosisConfig().beyond_stated

    def without(self, form: LawForm, model: ResidualModel | None = None) -> _Sum:
        """The same without one term, or with a model that has something else for it."""
        bare = cast(FittableModel, (model or self.model.without_effect(form.name)).refined())
        return replace(self, model=bare, terms=tuple(t for t in self.terms if t[0] is not form))


def _learn(
    base: FittableModel, forms: Sequence[LawForm], known: Sequence[str]
) -> Law | NothingLearnt:
    """Add terms to a model until they explain it; judge what is found."""
    present, refusal = _Sum(base, base), ""
    for _ in range(_MOST_TERMS):
        step = _step(present, forms, known)
        if isinstance(step, str):
            return NothingLearnt(refusal or step)
        present = step
        if present.explains:
            return _judged(present, known)
        ratio = present.after.rms / present.floor
        refusal = refusal or (
            f"no law of these forms is the cause: the best, {present.forms[0].name}, leaves a "
            f"held-out error of {present.after.rms:.2f}, {ratio:.2f} times its floor"
        )
    return NothingLearnt(refusal)


def _step(present: _Sum, forms: Sequence[LawForm], known: Sequence[str]) -> _Sum | str:
    """One more term: the best form, or beside another one a known effect; or why there is none."""
    model, floor = present.model, noise_floor(present.model)
    search = search_laws(model, [f for f in forms if f.name not in model.effect_names], floor)
    best = search.finds[0] if search.finds and search.p_value <= _SIGNIFICANCE else None
    trials: list[Trial] = []
    if present.forms:
        names = [name for name in known if name not in model.effect_names]
        trials = try_effects(model, screen(model, model.families(names), floor), floor)
    reached = min(best.criterion if best else np.inf, evidence(model, floor) - CHANCE)
    if trials and trials[0].criterion < reached:
        return replace(present, model=cast(FittableModel, trials[0].model.refined()))
    if best is None:
        chance = f"{100.0 * search.p_value:.0f} % of all recordings"
        return f"noise alone gives as good a law in {chance}" if search.finds else "no form fits"
    tell(f"fitting a law thoroughly: {best.form.name}")
    refined = cast(FittableModel, best.model.refined())
    p_value = max(present.p_value, search.p_value)
    return _Sum(present.base, refined, (*present.terms, (best.form, search)), p_value)


def _judged(found: _Sum, known: Sequence[str]) -> Law | NothingLearnt:
    """The law, unless it does with fewer terms or a known effect in place of one does as well."""
    if len(found.forms) > 1 and (fewer := found.without(found.forms[0])).explains:
        found = fewer
    model, floor, (last, search) = found.model, found.floor, found.terms[-1]
    ratio, before = dispersion(model, floor), held_out(found.base)
    reached = evidence(model, floor, search.tried, ratio)
    if before.losses.sum() - found.after.losses.sum() < CHANCE * floor**2:
        return NothingLearnt(f"held-out blocks are predicted as well without {last.name}")
    trials = []
    for form in found.forms:
        rival = _known(model, form.name, known, floor, ratio)
        if rival is not None and rival.criterion < reached + CHANCE:
            if len(found.forms) > 1 and (other := found.without(form, rival.model)).explains:
                return _judged(other, known)
            return NothingLearnt(f"{rival.name} of the catalogue does as well as {form.name}")
        trials += [rival] if rival is not None else []
    bare = cast(FittableModel, model.without_effect(last.name))
    others = [
        replace(other, criterion=evidence(other.model, floor, search.tried, ratio))
        for find in search.finds
        if find.form is not last
        for other in [fit_law(bare, find.form, [find.theta], floor, search.tried)]
    ]
    equal = [
        other
        for other in others
        if other.criterion < reached + CHANCE and fits_equally(found.after, held_out(other.model))
    ]
    laws = {form.name for form in found.forms}
    added = set(model.effect_names) - set(found.base.effect_names) - laws
    return Law(
        found.forms, tuple(sorted(added)), found.base, model, before, found.after,
        floor, found.p_value, min(trials, key=lambda t: t.criterion, default=None), tuple(equal),
    )  # fmt: skip


def _floor_spread(rows: int) -> float:
    """Relative standard deviation of a floor: of the median of rows / 2 exponential variates."""
    return float(0.5 / (np.log(2.0) * np.sqrt(0.5 * rows)))


def _names(diagnosis: Diagnosis) -> list[str]:
    """Known effects that have the best claim to be the cause."""
    best = [score.family.name for score in best_by_effect(diagnosis.assessment.scores)[:_RIVALS]]
    named = [diagnosis.effect] if diagnosis.effect else []
    return list(dict.fromkeys([*named, *diagnosis.group, *best]))


def _known(
    model: FittableModel, law: str, names: Sequence[str], floor: float, ratio: float
) -> Trial | None:
    """The known effect that does best in place of a law, squares counted as of the law's model."""
    wanted = [name for name in names if name not in model.effect_names]
    _, trials = rematch(model, law, wanted, floor)
    found = [
        replace(t, criterion=evidence(t.model, floor, t.source.family.choices, ratio))
        for t in trials
    ]
    return min(found, key=lambda trial: trial.criterion, default=None)
