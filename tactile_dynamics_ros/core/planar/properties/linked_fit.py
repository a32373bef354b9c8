"""Maximum a posteriori fit of two parts on their latent motion."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.errors import NotIdentifiableError
from tactile_dynamics_ros.core.numerics.bordered import Solution
from tactile_dynamics_ros.core.planar.effects.acting import described
from tactile_dynamics_ros.core.planar.effects.effect import PushEffect
from tactile_dynamics_ros.core.planar.effects.part import instances
from tactile_dynamics_ros.core.planar.linked.rows import PairPatch
from tactile_dynamics_ros.core.planar.mechanics.linkage import turned
from tactile_dynamics_ros.core.planar.properties.balance import sliding
from tactile_dynamics_ros.core.planar.properties.latent_model import ELSEWHERE, Sharpness
from tactile_dynamics_ros.core.planar.properties.linked_jointed import JointedModel
from tactile_dynamics_ros.core.planar.properties.linked_model import PairModel
from tactile_dynamics_ros.core.planar.properties.linked_pair import Pair, PairData
from tactile_dynamics_ros.core.planar.properties.linked_rigid import RigidModel
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

Mask = NDArray[np.bool_]

_REFIT = 60
"""Iterations of a refit with another variation or effect, at most: after 15 eight of nine jointed
recordings made for tuning had 0.6 to 7 std still to go."""
_TURNING = 0.06
"""Relative rate from which a joint turns, rad/s: three times what noise makes of a held one."""
_ITERATIONS = (8, 8, 8, 30)
"""Iterations of each stage, at most; of a single part the last has 40."""


@dataclass(frozen=True, eq=False)
class PairFit:
    """Common numbers of two parts, averaged over variations of friction by evidence.

    Attributes:
        model: residuals. common: (p,) by the model's names, then parameters of its effects.
        nodes: (N, D + l) of the likeliest variation of friction.
        variation: relative, of friction from place to place.
        covariance: (p, p) about the table, which differs from the places that were pushed.
        whitened_rms: error over the noise. converged: whether the optimiser came to its end.
    """

    model: PairModel
    nodes: Array
    common: Array
    covariance: Array
    variation: float
    whitened_rms: float
    converged: bool

    @property
    def names(self) -> tuple[str, ...]:
        """(p,) of the common numbers and of the effects' parameters."""
        told = [f"{e.name}.{p.name}" for e in self.model.effects for p in e.parameters]
        return (*self.model.names, *told)

    @property
    def effects(self) -> dict[str, dict[str, dict[str, Any]]]:
        """{effect: {parameter: {"value", "std", "unit"}}}."""
        first = len(self.model.names)
        std = np.sqrt(np.diag(self.covariance))[first:]
        return described(self.model.effects, self.common[first:], std)

    def value(self, name: str) -> float:
        """One of the common numbers."""
        return float(self.common[self.model.at(name)])

    def std(self, name: str) -> float:
        """Its standard deviation."""
        at = self.model.at(name)
        return float(np.sqrt(self.covariance[at, at]))


def fit_jointed(pair: Pair, effects: Sequence[PushEffect] = ()) -> PairFit:
    """Fit two parts on a joint, with effects.

    Raises:
        NotIdentifiableError: they slide too little at the same time, or the equations are singular.
    """
    coordinates = np.column_stack([pair.nodes[0], pair.nodes[1][:, 2]])
    spread = np.column_stack([pair.spread[0], pair.spread[1][:, 2]])
    hinge = pair.structure.hinge
    model = JointedModel(_data(pair, spread), hinge=hinge)
    return _with_effects(model, coordinates, effects)


def fit_rigid(pair: Pair, effects: Sequence[PushEffect] = ()) -> PairFit:
    """Fit two parts as one body, with effects.

    Raises:
        NotIdentifiableError: it slides too little, or the equations are singular.
    """
    offset = pair.structure.offset
    second = pair.outlines[1]
    placed = offset[:2] + turned(second, np.full(len(second), offset[2]))
    patch = PairPatch(pair.outlines[0], other=placed)
    model = RigidModel(_data(pair, pair.spread[0]), patch, offset)
    return _with_effects(model, pair.nodes[0], effects)


def _with_effects(model: PairModel, coordinates: Array, effects: Sequence[PushEffect]) -> PairFit:
    """Fit with effects; errors of sensors, sudden ones and those of one part are added to a fit.

    A fit that lacks a lean finds a heavy object on ice, from which no path leads back.
    """
    structure = "jointed" if isinstance(model, JointedModel) else "rigid"
    starts = model.intervals.push_starts
    choices = [(effect, instances(effect, structure, starts)) for effect in effects]
    late = [(e, made) for e, made in choices if e.lasting or e.sudden or len(made) != 1]
    early = tuple(e for e, made in choices if (e, made) not in late)
    fit = _fitted(replace(model, effects=early), coordinates)
    for effect, trials in late:
        fit = with_expected_force(fit)
        start = np.append(fit.common, np.zeros(len(effect.parameters)))
        if not trials:
            raise NotIdentifiableError(f"{effect.name}: one push tells no change; push again")
        hopes = []
        for trial in trials:
            model = replace(fit.model, effects=(*fit.model.effects, trial))
            hopes.append(_hope(model, fit.nodes, start, fit.variation))
        best = trials[int(np.argmax(hopes))]
        fit = refit_pair(fit, (*fit.model.effects, best), start, fit.variation)
    return fit


def _hope(model: PairModel, nodes: Array, common: Array, variation: float) -> float:
    """Fall of the cost that one Gauss-Newton step promises."""
    equations = model.linearise(nodes, common, final_sharpness(variation))
    by_nodes, by_common = model.factor(equations).step()
    fall = np.sum(by_nodes * equations.gradient) + by_common @ equations.common_gradient
    return -float(fall)


def with_expected_force(fit: PairFit) -> PairFit:
    """The fit with what it expects of the forces, which differs from them by their noise."""
    model, cut = fit.model, fit.model.intervals
    motion = model.motion_of(fit.nodes)
    slip = final_sharpness(fit.variation).slip
    friction = model.linear_friction(fit.common, motion, slip)
    expected = cut.force.copy()
    expected[model.middle, :2] += model.lack(motion, fit.common, friction)[:, :2]
    data = replace(model.data, intervals=replace(cut, expected=expected))
    return replace(fit, model=replace(model, data=data))


def refit_pair(
    fit: PairFit, effects: tuple[PushEffect, ...], common: Array, variation: float
) -> PairFit:
    """Fit a model with effects from a fit without them.

    Args:
        fit: start of the motion.
        effects: of the model.
        common: (p,) start of the common numbers and of the effects' parameters.
        variation: relative standard deviation of friction from place to place.

    Raises:
        NotIdentifiableError: the equations are singular.
    """
    model, sharp = replace(fit.model, effects=effects), final_sharpness(variation)
    try:
        start = model.minimised(fit.nodes, common, sharp, _REFIT)
        slope = model.volume_slope(start.nodes, start.common, sharp)
        return _averaged(model, [_optimum(model, start, variation, slope)])
    except np.linalg.LinAlgError as error:
        raise NotIdentifiableError(SINGULAR) from error


def final_sharpness(variation: float) -> Sharpness:
    """How strictly the last stage takes a model."""
    return _sharpness(len(STAGES) - 1, variation)


def _data(pair: Pair, spread: Array) -> PairData:
    cut, streams = pair.intervals, pair.streams
    first, second = (sliding(cut, pair.patches[k], pair.nodes[k]) for k in (0, 1))
    mask = first & second
    if int(mask.sum()) < LEAST_INTERVALS:
        raise NotIdentifiableError(
            f"both parts slide at the same time in {int(mask.sum())} intervals of {cut.step:g} s "
            f"only, expected {LEAST_INTERVALS} at least; push further"
        )
    height, std = heights(streams, cut)
    moved = [np.linalg.norm(np.diff(n[:, :2], axis=0), axis=1) for n in pair.nodes]
    rate = pair.nodes[1][:, 2] - pair.nodes[0][:, 2]
    turning = np.zeros(len(cut), dtype=bool)
    turning[1:-1] = np.abs(rate[2:] - rate[:-2]) / (2.0 * cut.step) > _TURNING
    size = float(np.sqrt(np.mean([patch.gyration for patch in pair.patches])))
    return PairData(
        intervals=cut,
        patches=pair.patches,
        gravity=streams.gravity,
        com_height=height,
        com_height_std=std,
        mask=mask,
        spread=allowed(cut, spread, size),
        travelled=0.5 * (moved[0] + moved[1]),
        touched=pair.touched,
        turning=turning,
    )


def _fitted(model: PairModel, coordinates: Array) -> PairFit:
    nodes = np.column_stack([coordinates, np.zeros((len(coordinates), model.locals))])
    common = model.prior[0].copy()
    found: Solution | None = None
    for stage, iterations in enumerate(_ITERATIONS):
        sharp = _sharpness(stage, FIRST_VARIATION)
        found = model.minimised(nodes, common, sharp, iterations)
        nodes, common = found.nodes, found.common
    assert found is not None
    return _averaged(model, _refitted(model, found))


def _refitted(model: PairModel, start: Solution) -> list[Optimum]:
    """Optima of the variations of friction that promise about as much evidence as the best."""
    sharp = final_sharpness(FIRST_VARIATION)
    slope = model.volume_slope(start.nodes, start.common, sharp)
    begun = []
    for variation in VARIATIONS:
        sharp = final_sharpness(variation)
        equations = model.linearise(start.nodes, start.common, sharp, slope)
        begun.append(_weighed(model, replace(start, equations=equations), variation))
    best = max(trial.evidence for trial in begun)
    return [
        _optimum(model, start, variation, slope)
        for variation, trial in zip(VARIATIONS, begun, strict=True)
        if trial.evidence > best - HOPELESS
    ]


def _sharpness(stage: int, variation: float) -> Sharpness:
    slip, floor = STAGES[stage]
    return Sharpness(slip, floor, variation)


def _optimum(model: PairModel, start: Solution, variation: float, slope: Array) -> Optimum:
    """Refit with another variation of friction, with its evidence."""
    sharp = final_sharpness(variation)
    found = model.minimised(start.nodes, start.common, sharp, _REFIT, slope)
    return _weighed(model, found, variation)


def _weighed(model: PairModel, found: Solution, variation: float) -> Optimum:
    sharp = final_sharpness(variation)
    factor = model.factor(found.equations)
    evidence = model.evidence(sharp, found.equations.cost, factor)
    return Optimum.of(found, factor, evidence, variation)


def _averaged(model: PairModel, trials: list[Optimum]) -> PairFit:
    """Mean over variations by their evidence."""
    wide = [k for k, n in enumerate(model.names) if n.startswith(("ln_mass", "ln_inertia"))]
    likeliest, common, covariance = average(trials, wide)
    return PairFit(
        model=model,
        nodes=likeliest.solution.nodes,
        common=common,
        covariance=covariance + np.diag(np.square(_place_std(model, likeliest.solution.nodes))),
        variation=likeliest.variation,
        whitened_rms=likeliest.misfit,
        converged=likeliest.is_answer,
    )


def _place_std(model: PairModel, nodes: Array) -> Array:
    """(p,) std of the common numbers that stem from where the parts slid, as of one part."""
    local = nodes[model.middle, model.freedoms :]
    differ = np.sqrt(np.mean(local**2, axis=0)).reshape(-1, 3)
    std = np.zeros(len(model.prior[0]))
    sizes = [float(np.sqrt(patch.gyration)) for patch in model.bodies]
    for row, end, unit in zip(differ, model.endings, sizes, strict=True):
        own = ELSEWHERE * row * np.array([1.0, unit, unit])
        for name, value in zip(("ln_product", "com_x", "com_y"), own, strict=True):
            std[model.at(name + end)] = value
    return std
