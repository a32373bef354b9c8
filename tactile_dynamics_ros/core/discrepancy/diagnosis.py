"""Which effect is missing: score tests, refits, held-out validation, honest verdict."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

from tactile_dynamics_ros.core.discrepancy.challenges import follows_other_law, is_outdone, temper
from tactile_dynamics_ros.core.discrepancy.model.residual_model import Convention, ResidualModel
from tactile_dynamics_ros.core.discrepancy.regimes.finding import RegimeFinding, regime_of
from tactile_dynamics_ros.core.discrepancy.regimes.step import add_regional_effects
from tactile_dynamics_ros.core.discrepancy.search import (
    DiagnosisConfig,
    Step,
    dominates,
    explained_share,
    find_effects,
    find_vibration,
    is_noise,
    is_settled,
)
from tactile_dynamics_ros.core.discrepancy.signature import Signature, describe_residual
from tactile_dynamics_ros.core.discrepancy.simpler import on_fewer_sensors, with_equals
from tactile_dynamics_ros.core.discrepancy.trials import Trial, contains
from tactile_dynamics_ros.core.discrepancy.verdict.adequacy import (
    Assessment,
    assess,
    is_within_stated,
)
from tactile_dynamics_ros.core.discrepancy.verdict.judgement import Judgement, judge
from tactile_dynamics_ros.core.discrepancy.verdict.materiality import (
    NEAR_FLOOR,
    Trace,
    explain_most,
    find_idle,
)
from tactile_dynamics_ros.core.discrepancy.verdict.validation import HeldOut, fits_equally, held_out
from tactile_dynamics_ros.core.progress import tell

_NOTHING = 0.02
"""Share of the excess error of held-out samples that an effect explains at least to be named, where
the error is not next to the floor. Less names what makes an error of 1167.8 one of 1167.5, higher
may miss the first of many effects."""


@dataclass(frozen=True)
class Diagnosis:
    """Outcome of `diagnose`.

    Attributes:
        verdict: adequate, convention, missing_effect, ambiguous or unexplained.
        effect: the missing effect, or None.
        group: effects that the data cannot tell from it, itself first; empty where there is none.
        model: the model that was diagnosed.
        assessment: of that model.
        steps: the effects that were added one after the other to explain the residual.
        before: held-out error of the model.
        after: held-out error with the missing effect (of the model if there is none).
        floor: white RMS of the noise alone.
        signature: of what no effect explains, or None.
        trace: what is significant and does not matter, where the verdict is adequate; or None.
        convention: other reading of the recording, where the verdict is convention; or None.
    """

    verdict: str
    effect: str | None
    group: tuple[str, ...]
    model: ResidualModel
    assessment: Assessment
    steps: tuple[Step, ...]
    before: HeldOut
    after: HeldOut
    floor: float
    signature: Signature | None = None
    trace: Trace | None = None
    convention: Convention | None = None

    @property
    def remaining(self) -> float:
        """Held-out error with the missing effect, over the noise floor."""
        return self.after.rms / self.floor

    @property
    def leaves_noise(self) -> bool:
        """Whether the residual, with all that was added, is the white noise that was stated."""
        return (self.steps[-1].after if self.steps else self.assessment).white

    @cached_property
    def separating_motion(self) -> dict[str, Any] | None:
        """Plan of the motion that would tell the group apart, or None."""
        if not self.group:
            return None
        tell("planning what would tell " + " and ".join(self.group) + " apart")
        choice = self.steps[0].choice
        rivals = [rival.model for rival in choice.named(self.group)]
        return choice.best.model.separating_motion(rivals)

    @cached_property
    def regime(self) -> RegimeFinding | None:
        """Where the missing effect acts; None if that is everywhere."""
        return regime_of(self.explained_model, self.effect) if self.effect else None

    @property
    def explained_model(self) -> ResidualModel:
        """The model with the missing effect, or as it was."""
        return self.steps[0].choice.model if self.effect else self.model


def diagnose(
    model: ResidualModel,
    config: DiagnosisConfig | None = None,
    judgement: Judgement | None = None,
) -> Diagnosis:
    """Find out whether an effect is missing from a fitted model, and which.

    The residual is tested; what is significant and does not matter is a trace beside an adequate
    model. If something is missing, other readings of the recording are tried first; then effects
    are added until nothing is. One effect that leaves nothing, or dominates all else, is the
    answer. If several are needed, the first is the answer provided that together they explain the
    residual. Otherwise the cause is none of the known effects, unless the residual is within the
    uncertainty that the sensors report: then nothing is known to be missing. Where effects that act
    everywhere leave more than noise, one that acts in a regime only is the answer if it explains
    the residual and they do not. What explains nine tenths of the error is named all the same, and
    the rest is described.

    Args:
        model: fitted.
        config: levels and depths.
        judgement: of the model, if there is one already.

    Raises:
        NotIdentifiableError: nothing is seen to be missing, in too short a recording.
    """
    config = config or DiagnosisConfig()
    tell("testing what the model leaves")
    judgement = judgement or judge(model, config.significance)
    first = judgement.assessment
    before = held_out(model)

    def unnamed(verdict: str, steps: tuple[Step, ...], floor: float) -> Diagnosis:
        signature = describe_residual(first) if verdict == "unexplained" else None
        return Diagnosis(verdict, None, (), model, first, steps, before, before, floor, signature)

    if judgement.adequate:
        judgement.require_length()
        found = unnamed("adequate", (), first.structure.floor)
        return replace(found, trace=judgement.trace)
    tell("reading signs, units, axes and clocks otherwise")
    convention = model.convention()
    if convention is not None:
        return _misread(model, first, before, convention)
    if model.unreadable:
        return unnamed("unexplained", (), first.structure.floor)
    steps = find_effects(model, first, config)
    floor = min([first.structure.floor] + [s.after.structure.floor for s in steps])
    accounted = _accounts_for(model, steps, first, floor, config) and not is_outdone(
        model, steps, floor, config.indifference
    )
    regional = add_regional_effects(model, first, steps, accounted, config)
    if regional:
        steps = regional
    elif not accounted:
        if first.within_stated:
            return unnamed("adequate", steps, floor)
        partial = explain_most(model, steps, first, floor, config)
        if not partial:
            return unnamed("unexplained", steps, floor)
        steps = partial
    if len(steps) == 1:
        steps = (replace(steps[0], choice=with_equals(steps[0].choice)),)
        if steps[0].after.within_stated:
            steps = (temper(steps[0]),)
    step = steps[0]
    group, ambiguous = find_group(step, config, first.within_stated)
    if first.within_stated and any(r.source.family.lasting for r in step.choice.named(group)):
        return unnamed("adequate", steps, floor)
    if len(steps) == 1:
        best, left = step.choice.best, step.after.structure.floor
        own = on_fewer_sensors(best, step.choice.model, left, exchange=True)
        if own.model is not step.choice.model:
            rivals = tuple(rival for rival in step.choice.rivals if rival.name != own.name)
            choice = replace(step.choice, model=own.model, best=own, rivals=rivals)
            step = Step(choice, assess(own.model, config.significance))
            steps = (step,)
            group = (own.name, *(name for name in group if name not in (own.name, best.name)))
            group = group if len(group) > 1 else ()
            ambiguous = ambiguous and bool(group)
    after = held_out(step.choice.model)
    idle = find_idle(first, step.choice, before, after)
    if idle is not None:
        return replace(unnamed("adequate", steps, floor), trace=idle)
    far = before.rms > NEAR_FLOOR * floor
    if far and explained_share(before.rms, after.rms, floor) < _NOTHING:
        return unnamed("unexplained", steps, floor)
    remains = steps[-1].after
    settled = is_noise(first, steps, config) or remains.rms <= NEAR_FLOOR * floor
    return Diagnosis(
        verdict="ambiguous" if ambiguous else "missing_effect",
        effect=step.name,
        group=group,
        model=model,
        assessment=first,
        steps=steps,
        before=before,
        after=after,
        floor=floor,
        signature=None if settled else describe_residual(remains),
    )


def _misread(
    model: ResidualModel, first: Assessment, before: HeldOut, convention: Convention
) -> Diagnosis:
    """Diagnosis of a recording whose numbers fit once they are read another way."""
    floor = assess(convention.model, first.significance).structure.floor
    return Diagnosis(
        verdict="convention",
        effect=None,
        group=(),
        model=model,
        assessment=first,
        steps=(),
        before=before,
        after=held_out(convention.model),
        floor=floor,
        convention=convention,
    )


def _accounts_for(
    model: ResidualModel,
    steps: tuple[Step, ...],
    first: Assessment,
    floor: float,
    config: DiagnosisConfig,
) -> bool:
    """Whether the added effects are the cause.

    They explain the residual; a vibration that the motion does not have needs an effect that can
    ring; and what is left is next to nothing, or not the trace of another law. An effect that
    dominates need not explain the rest.
    """
    if dominates(steps, first, floor, config):
        return True
    if not steps or not is_settled(first, steps, floor, config):
        return False
    if is_noise(first, steps, config):
        return True
    vibrates = find_vibration(model, floor) is not None
    if vibrates and not any(step.choice.best.source.family.rings for step in steps):
        return False
    share = explained_share(first.rms, steps[-1].after.rms, floor)
    return share >= config.complete or not follows_other_law(steps[-1], floor, config.indifference)


def find_group(
    step: Step, config: DiagnosisConfig, within_stated: bool
) -> tuple[tuple[str, ...], bool]:
    """Rivals that the data cannot tell from the best, and whether one of them is as plausible.

    They fit held-out blocks as well, and are as plausible or contain what the best explains: more
    data along the same motion could not refute them either. What the model knows to imitate the
    best is as plausible. What equals the best at its own whitening is as plausible; where lasting
    errors remain, so is all that fits held-out blocks, and all that leaves no more than sensors
    state: a drift of each of them takes up their own errors too, a load that changes does not. One
    that merely contains another of them, as a drift contains a bias, says no more than that and is
    left out.

    Args:
        step: the best effect and its rivals.
        config: of the diagnosis.
        within_stated: whether sensors account for the residual of the model without any of them.
    """
    choice, floor = step.choice, step.after.structure.floor
    best, lasting = choice.best, choice.dispersion > 1.0
    leaves_more = lasting and not within_stated

    def is_plausible(rival: Trial) -> bool:
        close = rival.criterion < best.criterion + config.indifference
        return close or rival.name in choice.equals

    def is_equal(rival: Trial) -> bool:
        if rival.name in choice.equals or (lasting and is_plausible(rival)):
            return True
        if leaves_more and is_within_stated(rival.model, floor):
            return True
        if not fits_equally(best.held_out, rival.held_out):
            return False
        return lasting or is_plausible(rival) or contains(choice, rival)

    equal = [r for r in choice.rivals if is_equal(r) and r.model.is_possible(r.name)]
    named = {best.name, *(rival.name for rival in equal)}
    equal = [rival for rival in equal if rival.source.family.contains not in named]
    beside = [name for rival in equal for name in rival.model.imitators(rival.name)]
    alike = [name for name in (*choice.model.imitators(best.name), *beside) if name != best.name]
    ambiguous = bool(alike) or any(lasting or is_plausible(rival) for rival in equal)
    names = tuple(dict.fromkeys([best.name, *(r.name for r in equal), *alike]))
    return names if len(names) > 1 else (), ambiguous
