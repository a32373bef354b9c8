"""Maximum a posteriori fit of one pushed link on its latent motion."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.errors import BadInputError, NotIdentifiableError
from tactile_dynamics_ros.core.numerics.bordered import Solution
from tactile_dynamics_ros.core.planar.effects.effect import PushEffect
from tactile_dynamics_ros.core.planar.known import KnownPushed
from tactile_dynamics_ros.core.planar.mechanics.support import SupportPatch
from tactile_dynamics_ros.core.planar.properties.balance import (
    NAMES,
    foot_speeds,
    sliding,
)
from tactile_dynamics_ros.core.planar.properties.intervals import (
    COARSE,
    Intervals,
    cut_intervals,
    smoothed,
)
from tactile_dynamics_ros.core.planar.properties.latent_model import (
    FRICTION_SPREAD,
    USUAL_FRICTION,
    PushData,
    Sharpness,
)
from tactile_dynamics_ros.core.planar.properties.optimum import (
    FIRST_VARIATION,
    HOPELESS,
    LEAST_INTERVALS,
    SINGULAR,
    STAGES,
    VARIATIONS,
    Optimum,
    allowed,
    average,
    heights,
)
from tactile_dynamics_ros.core.planar.properties.push_model import PushFit, PushModel
from tactile_dynamics_ros.core.planar.streams import PushedStreams

_START = 0.3
"""Friction coefficient at which the fit begins; from 0.15 and 0.8 the stages lead to the same
place."""
_FITTED = 1.5
"""Misfit from which the next plan is tried: clean recordings have 0.8 to 1, optima that are missed
2 to 50. At 1 noise would double the time."""
_PLANS = (((8, 8, 8, 40), (3, 4), 0.0), ((30, 30, 30, 40), (1, 2), HOPELESS))
"""Iterations of each stage, stages before which it is judged anew, by the forces too, what slides,
where 4 is after the last, and log evidence that is asked of an even table. The first suffices where
the tip stays in touch. One that bounces stops and starts objects between two poses: there the first
stages need 30, with one mask fits miss the optimum, and an even table wins by chance (by 47 on one
recording, whose product was then 2.6 std off). The second plan alone misses one recording in four
of the others."""
_VOLUME_ROUNDS = 2
"""Refits with a new slope of the volume of motions; the second moves masses by a tenth of the
first."""
_REFIT = 90
"""Iterations of a refit with another variation, at most; from a neighbour's optimum 6 to 15 do.
Where the model lacks something it takes up to 80; 30 left two of fifteen live fits unfinished."""
_ODD = 1.5
"""Std beforehand of friction, inertia, delay and such from which a fit is made again from what is
usual, as it may have stopped short: of two that were, with masses 2 and 4 std off, inertia was 3
std off. Where the data say so both come to the same place; 1 would double the time of most fits."""
_SAME = 0.5
"""Change of the common numbers, in std, up to which two optima are one."""
_WITHOUT = ((1, 8), (2, 8), (3, 60))
"""Stages and iterations of a fit from which effects are taken out: straight at the last it needs
90; on one of seven recordings 30 in the last left the error a tenth too large."""
_UNEVEN, _ASIDE = 0.3, 0.03
"""Std of the pressure from point to point of a face, relative, and of the middle of what carries,
over the radius of gyration. Flat faces touch in places: where an object turns about one of them,
such a place holds it. At 0 and 0 one in eight centres of short pushes was 2.5 std off; twice as
much widens centres of six pushes by 1.7."""
_TOLD = 10.0
"""Log evidence by which an even table must lead to be reported: of 13 recordings of two pushes on
tables that vary by 10 % none led by more than 3 where the mass was known. Larger is wider."""
_MASS_KNOWN = 0.2
"""Std of ln mass from which no table is reported even: one that varies by 10 % led by 16 with a
mass that was 44 % off at 0.28, its product then 5.7 std off. After two pushes nine
of 13 even ones have 0.13 to 0.2; less widens more of their products."""


def fit_push(
    streams: PushedStreams, effects: Sequence[PushEffect] = (), known: KnownPushed | None = None
) -> PushFit:
    """Fit the first link.

    Effects are there from the first stage on: a fit that lacks a lean finds a heavy object on ice,
    from which no path leads back. Gains of sensors need to know the force without its noise, and
    sudden effects the push with which they begin; they are added to such a fit one by one.

    Args:
        streams: forces, contact points and poses at 5 Hz or more.
        effects: of the model.
        known: of the object before all that is in the streams; sudden effects then begin before it.

    Raises:
        BadInputError: nothing is touched while poses are known, or an effect is one of two parts.
        NotIdentifiableError: nothing slides long enough.
    """
    for effect in effects:
        if effect.of_joint:
            raise BadInputError(f"{effect.name}: for two parts on a joint, here is one")
    cut = cut_intervals(streams)
    patch = SupportPatch(np.asarray(streams.links[0].footprint, dtype=float))
    curve, spread = smoothed(cut, cut.poses[0])
    nodes = np.column_stack([curve, np.zeros_like(curve)])
    model = _prepared(streams, cut, patch, nodes, spread)
    late = [e for e in effects if e.lasting or (e.sudden and known is None)]
    model = replace(model, effects=tuple(e for e in effects if e not in late))
    if known is not None:
        gravity = -streams.gravity[2]
        first, root = known.beforehand(USUAL_FRICTION * gravity, FRICTION_SPREAD)
        model = replace(model, known=(first - [np.log(gravity), 0.0, *patch.centroid], root))
    fit = _best_planned(model, nodes)
    for effect in late:
        fit = _extended(with_expected_force(fit), effect)
    return fit


def _extended(fit: PushFit, effect: PushEffect) -> PushFit:
    """Fit with one more effect; a sudden one begins with the push that promises most."""
    start = np.append(fit.common, np.zeros(len(effect.parameters)))
    trials = effect.beginnings(fit.model.intervals.push_starts)
    if not trials:
        raise NotIdentifiableError(f"{effect.name}: one push tells no change; push again")
    promises = []
    for trial in trials:
        model = replace(fit.model, effects=(*fit.model.effects, trial))
        promises.append(_hope(model, (fit.nodes, start), fit.variation))
    best = trials[int(np.argmax(promises))]
    return refit(fit, (*fit.model.effects, best), start, fit.variation)


def _optima(model: PushModel, start: Solution, doubt: float) -> list[Optimum]:
    """Refits with each variation of friction, but for those that are hopeless beforehand."""
    tried = VARIATIONS[model.intervals.step > COARSE :]
    hopes = [_hope(model, (start.nodes, start.common), v) for v in tried]
    limit = HOPELESS if model.known is None else 0.0  # what is known is near the optimum already
    chosen = [v for v, hope in zip(tried, hopes, strict=True) if hope >= max(hopes) - limit]
    found = [_optimum(model, start, variation) for variation in chosen]
    if doubt and found[0].variation == VARIATIONS[0]:
        found[0] = replace(found[0], evidence=found[0].evidence - doubt)
    return found if model.known is not None else found + _other(model, found)


def _other(model: PushModel, found: Sequence[Optimum]) -> list[Optimum]:
    """Another optimum near usual numbers, where the likeliest one is odd."""
    best = max(found, key=lambda optimum: optimum.evidence)
    common, (mean, std) = best.solution.common, model.prior
    rest = slice(4, len(NAMES))
    friction = (common[0] - common[1] - np.log(USUAL_FRICTION)) / FRICTION_SPREAD
    if np.abs(np.append((common - mean)[rest] / std[rest], friction)).max() < _ODD:
        return []
    usual = common.copy()
    usual[1], usual[rest] = common[0] - np.log(USUAL_FRICTION), mean[rest]
    sharp = final_sharpness(model, best.solution.nodes, best.variation)
    start = model.minimised(best.solution.nodes, usual, sharp, _REFIT)
    other = _optimum(model, start, best.variation)
    moved = np.abs(other.solution.common - common) / np.sqrt(np.diag(best.covariance))
    return [other] if moved.max() > _SAME else []


def _hope(model: PushModel, start: tuple[Array, Array], variation: float) -> float:
    """Evidence that one Gauss-Newton step towards the optimum promises.

    Args:
        model: to be fitted.
        start: nodes and common numbers.
        variation: relative standard deviation of friction from place to place.
    """
    sharp = final_sharpness(model, start[0], variation)
    equations = model.linearise(*start, sharp)
    factor = model.factor(equations)
    nodes, common = factor.step()
    fall = -float(np.sum(nodes * equations.gradient) + common @ equations.common_gradient)
    return model.evidence(sharp, equations.cost - fall, factor)


def _prepared(
    streams: PushedStreams, cut: Intervals, patch: SupportPatch, nodes: Array, spread: Array
) -> PushModel:
    mask = sliding(cut, patch, nodes)
    if int(mask.sum()) < LEAST_INTERVALS:
        raise NotIdentifiableError(
            f"the object slides in {int(mask.sum())} intervals of {cut.step:g} s only, expected "
            f"{LEAST_INTERVALS} at least; push it further"
        )
    height, std = heights(streams, cut)
    size = float(np.sqrt(patch.gyration))
    moved = np.linalg.norm(np.diff(nodes[:, :2], axis=0), axis=1)
    return PushModel(
        PushData(
            intervals=cut,
            patches=(patch,),
            gravity=streams.gravity,
            com_height=height,
            com_height_std=std,
            mask=mask,
            travelled=moved + size * np.abs(np.diff(nodes[:, 2])),
            spread=allowed(cut, spread, size),
        )
    )


def _sharpness(model: PushModel, nodes: Array, stage: int, variation: float) -> Sharpness:
    speed = foot_speeds(model.intervals, model.patch, nodes)
    share = min(1.0, float(np.median(speed[model.data.mask])) / 0.05)
    slip, floor = STAGES[stage]
    return Sharpness(slip * share, floor, variation)


def _best_planned(model: PushModel, nodes: Array) -> PushFit:
    """The fit of the first plan that ends with a small misfit, or the best."""
    found, error = [], None
    for iterations, masked, doubt in _PLANS:
        try:
            staged, start = _staged(model, nodes, iterations, masked)
            found.append(_averaged(staged, _optima(staged, start, doubt)))
        except np.linalg.LinAlgError as singular:
            error = singular
            continue
        if found[-1].converged and found[-1].whitened_rms < _FITTED:
            return found[-1]
    if not found:
        raise NotIdentifiableError(SINGULAR) from error
    return min(found, key=lambda fit: (not fit.converged, fit.whitened_rms))


def _staged(
    model: PushModel, nodes: Array, iterations: Sequence[int], masked: Sequence[int]
) -> tuple[PushModel, Solution]:
    """Fit through all stages of a plan; the model has the mask of the last one."""
    common = model.prior[0].copy()
    common[0] = np.log(model.typical_force / -model.data.gravity[2])
    common[1] = common[0] - np.log(_START)
    if model.known is not None:
        common[:4] = model.known[0]
    start, found, first = nodes, None, model.data.mask

    def judged(nodes: Array) -> PushModel:
        mask = first & sliding(model.intervals, model.patch, nodes)
        return replace(model, data=replace(model.data, mask=mask))

    for stage, most in enumerate(iterations):
        if stage in masked:
            model = judged(nodes)
        sharp = _sharpness(model, start, stage, FIRST_VARIATION)
        found = model.minimised(nodes, common, sharp, most)
        nodes, common = found.nodes, found.common
    assert found is not None
    return judged(nodes) if len(iterations) in masked else model, found


def final_sharpness(model: PushModel, nodes: Array, variation: float) -> Sharpness:
    """How strictly the last stage takes a model."""
    return _sharpness(model, nodes, len(STAGES) - 1, variation)


def with_expected_force(fit: PushFit) -> PushFit:
    """The fit with what it expects of the forces, which differs from them by their noise."""
    model, cut = fit.model, fit.model.intervals
    kinematics = model.motion_of(fit.nodes)
    slip = final_sharpness(model, fit.nodes, fit.variation).slip
    friction = model.balance.linear_friction(kinematics, fit.common, slip)
    expected = cut.force.copy()
    expected[model.middle, :2] += model.balance.lack(kinematics, fit.common, friction)[:, :2]
    data = replace(model.data, intervals=replace(cut, expected=expected))
    return replace(fit, model=replace(model, data=data))


def refit(
    fit: PushFit, effects: tuple[PushEffect, ...], common: Array, variation: float
) -> PushFit:
    """Fit a model with effects from a fit without them.

    Args:
        fit: start of the motion.
        effects: of the model.
        common: (p,) start of the common numbers and of the effects' parameters.
        variation: relative standard deviation of friction from place to place.

    Raises:
        NotIdentifiableError: the equations are singular.
    """
    model = replace(fit.model, effects=effects)
    sharp = final_sharpness(model, fit.nodes, variation)
    try:
        start = model.minimised(fit.nodes, common, sharp, _REFIT)
        return _averaged(model, [_optimum(model, start, variation)])
    except np.linalg.LinAlgError as error:
        raise NotIdentifiableError(SINGULAR) from error


def error_without_effects(fit: PushFit) -> float:
    """Error over the noise that a fit without its effects leaves, at the same variation.

    A fit of its own would take what is missing for friction that differs more from place to place.
    """
    model = replace(fit.model, effects=())
    nodes, common = fit.nodes, fit.common[: len(NAMES)]
    for stage, most in _WITHOUT:
        sharp = _sharpness(model, nodes, stage, fit.variation)
        found = model.minimised(nodes, common, sharp, most)
        nodes, common = found.nodes, found.common
    return found.misfit


def _optimum(model: PushModel, start: Solution, variation: float) -> Optimum:
    """Refit with another variation of friction, with its evidence."""
    sharp = final_sharpness(model, start.nodes, variation)
    found, slope = start, np.zeros(len(start.common))
    for _ in range(_VOLUME_ROUNDS):
        slope = model.volume_slope(found.nodes, found.common, sharp)
        found = model.minimised(found.nodes, found.common, sharp, _REFIT, slope)
    factor = model.factor(found.equations)
    cost = found.equations.cost + 2.0 * float(slope @ found.common)
    evidence = model.evidence(sharp, cost, factor)
    evidence += model.log_jacobian(found.nodes, found.common, sharp)
    return Optimum.of(found, factor, evidence, variation)


def _averaged(model: PushModel, trials: list[Optimum]) -> PushFit:
    """Mean over variations by their evidence."""
    wide = [NAMES.index("ln_mass"), NAMES.index("ln_inertia")]
    likeliest, common, covariance = average(trials, wide)
    covariance += _by_face(model, likeliest)
    return PushFit(
        model=model,
        nodes=likeliest.solution.nodes,
        common=common,
        covariance=covariance,
        whitened_rms=likeliest.misfit,
        variation=likeliest.variation,
        converged=likeliest.is_answer,
        told_even=_is_told_even(likeliest, trials, covariance),
    )


def _is_told_even(likeliest: Optimum, trials: Sequence[Optimum], covariance: Array) -> bool:
    """Whether the data tell that friction is the same at all places of the table.

    Friction that differs along a short push looks like inertia, so the mass has to be known.
    """
    place = NAMES.index("ln_mass")
    rivals = [t.evidence for t in trials if t.variation != likeliest.variation]
    leads = likeliest.evidence > max(rivals, default=-np.inf) + _TOLD
    known = covariance[place, place] < _MASS_KNOWN**2
    return bool(likeliest.variation == VARIATIONS[0] and leads and known)


def _by_face(model: PushModel, found: Optimum) -> Array:
    """Covariance (p, p) that stems from where within its outline the face carries."""
    nodes, common = found.solution.nodes, found.solution.common
    sharp = final_sharpness(model, nodes, found.variation)
    kinematics = model.motion_of(nodes)
    lack = model.balance.lack_by_face(kinematics, common, sharp.slip, _UNEVEN, _ASIDE)
    rows = lack / model.noise(sharp.floor)[:, :, None]
    _, by_nodes, by_common = model.dynamics(nodes, common, sharp)
    factor = model.factor(found.solution.equations)
    moved = factor.moved_by(model.middle, rows, by_nodes, by_common)
    return np.asarray(moved @ moved.T)
