"""A pushed object as a model that the diagnosis can question."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.discrepancy.model.least_squares import LeastSquaresModel
from tactile_dynamics_ros.core.discrepancy.model.residual_model import (
    Condition,
    Family,
    ParameterTable,
    Residuals,
)
from tactile_dynamics_ros.core.effects.parameter import EffectParameter
from tactile_dynamics_ros.core.errors import NotIdentifiableError
from tactile_dynamics_ros.core.planar.diagnosis.conditions import (
    push_conditions,
    push_residuals,
)
from tactile_dynamics_ros.core.planar.diagnosis.innovations import Innovations
from tactile_dynamics_ros.core.planar.diagnosis.rows import PushRows, linear_rows
from tactile_dynamics_ros.core.planar.diagnosis.separating_push import plan_push, plan_wider
from tactile_dynamics_ros.core.planar.diagnosis.variation import (
    SLOPE,
    VARIATION,
    Table,
    field_rows,
    likeliest_table,
)
from tactile_dynamics_ros.core.planar.effects.effect import PushEffect
from tactile_dynamics_ros.core.planar.effects.gated import can_be_gated
from tactile_dynamics_ros.core.planar.effects.registry import PUSHED
from tactile_dynamics_ros.core.planar.properties.balance import NAMES, Friction, Kinematics
from tactile_dynamics_ros.core.planar.properties.fit import (
    final_sharpness,
    fit_push,
    refit,
    with_expected_force,
)
from tactile_dynamics_ros.core.planar.properties.push_model import (
    USUAL_FRICTION,
    PushFit,
    Sharpness,
)
from tactile_dynamics_ros.core.planar.streams import PushedStreams

Array = NDArray[np.float64]

_FRICTION_SPREAD = 0.4
"""Standard deviation of the logarithm of friction beforehand: nearly all tables within 0.1 and 0.9.
Narrower than in an estimate, since a fit at fixed whitening does not see that heavy objects on ice
explain whatever the model lacks."""
_OWN = 4
"""Common numbers that a fit at fixed whitening may change: product, mass and centre of mass. The
others are known beforehand to within their priors, which is part of the whitening."""
_LARGEST_GUESS = 1.5
"""Largest start of an effect's parameter, in standard deviations of its prior: linear forms
overshoot where an effect is large. At 3 some fits began where friction is negative."""
_OF_WHITENING = (
    *("_sharp", "_rows", "_filter", "_lasting"),
    *("_spread", "_at_fit", "_motion", "_friction"),
)
"""What is computed of the linearisation alone, and handed on to models at the same whitening; what
is left out is computed again, at half a second each."""
_STEP = 1e-3
"""Step of the difference quotient by an effect's parameters, in their prior's standard deviations:
laws bend by far less than a thousandth over it, rounding is a millionth of it."""


@dataclass(frozen=True)
class PushDiscrepancy(LeastSquaresModel[PushEffect]):
    """Innovations of the poses of a pushed object, with x = [ln q, ln m, com x, com y, theta ...].

    The motion, local friction and what is known of lasting errors of height, place, clock and
    pressure are integrated out along a linearisation: the residual says what each pose adds to
    those before it and to the forces.

    Attributes:
        fit: motion and common numbers at which the rows were linearised; with all effects.
        values: (4,) own parameters.
        effects: of the model. theta: their parameters.
        catalogue: names of the effects that may be tried.
        table: how friction differs from place to place, by which residuals are made white.
    """

    fit: PushFit
    values: Array
    effects: tuple[PushEffect, ...]
    theta: tuple[Array, ...]
    catalogue: tuple[str, ...]
    table: Table

    @classmethod
    def of_streams(cls, streams: PushedStreams, names: Sequence[str] = ()) -> PushDiscrepancy:
        """Fit a model with named effects.

        Raises:
            BadInputError: an effect is unknown, or nothing is touched while poses are known.
            NotIdentifiableError: nothing slides long enough, or there are two parts.
        """
        if len(streams.links) > 1:
            raise NotIdentifiableError(
                f"{len(streams.links)} parts: what a model lacks is told of one; record the parts "
                "one by one, or ask `estimate`, which tells whether their joint has play"
            )
        effects = PUSHED.create_all(names)
        found = with_expected_force(fit_push(streams, effects))
        first, *theta = np.split(found.common, len(NAMES) + _ends(effects))
        model = cls(
            *(found, first[:_OWN], found.model.effects, tuple(theta), PUSHED.names()),
            table=Table(found.variation),
        )
        return replace(model, table=model._likeliest_table()).settled()

    @property
    def own(self) -> Array:
        """(4,) ln of product (kg) and mass (kg), centre of mass from the centroid, m."""
        return self.values

    @property
    def own_scales(self) -> Array:
        """(4,) plausible change of each."""
        reach = float(np.sqrt(self.fit.model.plate))
        return np.array([0.3, 0.6, 0.5 * reach, 0.5 * reach])

    @property
    def own_names(self) -> tuple[tuple[str, str, str], ...]:
        """Logarithms stay unnamed: the estimate tells these numbers."""
        return ()

    @cached_property
    def _sharp(self) -> Sharpness:
        return final_sharpness(self.fit.model, self.fit.nodes, self.table.along)

    @cached_property
    def _rows(self) -> PushRows:
        return linear_rows(self.fit.model, self.fit.nodes, self.fit.common, self._sharp)

    @cached_property
    def _filter(self) -> Innovations:
        return Innovations.of(self._rows)

    @cached_property
    def _lasting(self) -> tuple[Array, Array]:
        """Innovations (M, k) per standard deviation of lasting errors, and what is found (k,).

        Height, place, clock and pressure; and friction over the table, of which nothing is found.
        """
        mean, std = self.fit.model.prior
        chosen = slice(_OWN, len(NAMES))
        motion, poses = self._lasting_rows
        found = (self.fit.common[chosen] - mean[chosen]) / std[chosen]
        if self.table.field:
            field = self.table.field * self._field(self.table.length)
            motion = np.concatenate([motion, field], axis=2)
            more = field.shape[2]
            poses = np.concatenate([poses, np.zeros((*poses.shape[:2], more))], axis=2)
            found = np.append(found, np.zeros(more))
        return self._innovations(motion, poses), found

    @property
    def _lasting_rows(self) -> tuple[Array, Array]:
        """Rows (N, 3, 7) and (P, 3, 7) per standard deviation of errors that last."""
        std, rows = self.fit.model.prior[1], self._rows
        chosen = slice(_OWN, len(NAMES))
        poses = np.zeros((*rows.pose.shape, len(NAMES) - _OWN))
        poses[:, :, -1] = rows.pose_by_delay
        return rows.motion_by_common[:, :, chosen] * std[chosen], poses * std[chosen]

    def _field(self, length: float) -> Array:
        """Rows (N, 3, K) by spots of a table whose friction differs over a length, m."""
        return field_rows(self.fit.model, self._motion, self.fit.common, self._sharp, length)

    @cached_property
    def _spread(self) -> tuple[Array, Array]:
        """Directions U (M, k) of lasting errors and their variances."""
        vectors, sizes, _ = np.linalg.svd(self._lasting[0], full_matrices=False)
        return vectors, np.square(sizes)

    def _innovations(self, motion: Array, poses: Array) -> Array:
        """(M, c) of rows (N, 3, c) of the motion and (P, 3, c) of poses alone."""
        local = np.zeros((*self._rows.local.shape, motion.shape[2]))
        return self._filter.white(motion, local, poses).reshape(-1, motion.shape[2])

    @cached_property
    def _at_fit(self) -> Array:
        """(M,) innovations at the linearisation, for lasting errors of zero."""
        rows = self._rows
        parts = (rows.motion[..., None], rows.local[..., None], rows.pose[..., None])
        columns, found = self._lasting
        return np.asarray(self._filter.white(*parts).reshape(-1) - columns @ found)

    @cached_property
    def _motion(self) -> Kinematics:
        model = self.fit.model
        return Kinematics.of_nodes(self.fit.nodes, model.middle, model.intervals.step)

    @cached_property
    def _friction(self) -> Friction:
        balance = self.fit.model.balance
        return balance.linear_friction(self._motion, self.fit.common, self._sharp.slip)

    def evaluate(self, x: Array, effects: tuple[PushEffect, ...]) -> tuple[Array, Array]:
        """White residual (M,) and its derivative (M, p), in one run of the filter."""
        white = self.whiten(self._innovations(*self._slopes(x, effects)))
        return self.whiten(self._at_fit) + white[:, 0], white[:, 1:]

    def _slopes(self, x: Array, effects: tuple[PushEffect, ...]) -> tuple[Array, Array]:
        """`_changed` (N, 3, 1 + p) and (P, 3, 1 + p), followed by its derivative."""
        sizes = _STEP * self.scales(effects)
        here = self._changed(x, effects)
        moved = [self._changed(x + step, effects) for step in np.diag(sizes)]
        motion, poses = (
            np.stack(
                [part, *((there[k] - part) / h for there, h in zip(moved, sizes, strict=True))], -1
            )
            for k, part in enumerate(here)
        )
        return motion, poses

    def _changed(self, x: Array, effects: Sequence[PushEffect]) -> tuple[Array, Array]:
        """Change of rows (N, 3) of the motion and (P, 3) of poses from where they were taken."""
        model, rows = self.fit.model, self._rows
        balance = model.balance_with(tuple(effects))
        common = np.concatenate([x[:_OWN], self.fit.common[_OWN : len(NAMES)], x[_OWN:]])
        lack = balance.lack(self._motion, common, self._friction) / model.noise(self._sharp.floor)
        motion = np.zeros_like(rows.motion)
        motion[model.middle] = lack - rows.motion[model.middle]
        delay = NAMES.index("delay")
        late = balance.numbers(common)[delay] - model.balance.numbers(self.fit.common)[delay]
        return motion, rows.pose_by_delay * late

    @property
    def time(self) -> Array:
        """(M,) s."""
        times = self._rows.pose_time[self._filter.order]
        return np.repeat(times - times[0], 3)

    @property
    def measured(self) -> Array:
        """(M,) innovations of the poses at the linearisation."""
        return self._at_fit

    def predict(self, x: Array, effects: Sequence[PushEffect]) -> Array:
        """(M,) what other parameters change about them."""
        motion, poses = self._changed(x, effects)
        return -self._innovations(motion[..., None], poses[..., None])[:, 0]

    def whiten(self, rows: Array) -> Array:
        """White form of innovations (M, ...), whose lasting errors have the spread of the prior."""
        vectors, variances = self._spread
        flat = rows.reshape(len(rows), -1)
        shrunk = (1.0 - 1.0 / np.sqrt(1.0 + variances))[:, None] * (vectors.T @ flat)
        return np.asarray((flat - vectors @ shrunk).reshape(rows.shape))

    def draw_noise(self, random: np.random.Generator) -> Array:
        """(M,) innovations of noise, and one draw of lasting errors."""
        columns = self._lasting[0]
        draw = columns @ random.normal(size=columns.shape[1])
        return np.asarray(random.normal(size=len(columns)) + draw)

    def prior_rows(self, effects: tuple[PushEffect, ...]) -> tuple[Array, Array]:
        """Those of effects, the usual friction, and a centre of mass under the footprint."""
        rows, values = super().prior_rows(effects)
        own = np.zeros((3, rows.shape[1]))
        own[0, :2] = 1.0 / _FRICTION_SPREAD, -1.0 / _FRICTION_SPREAD
        own[1, 2] = own[2, 3] = 1.0 / self.own_scales[2]
        usual = np.array([-np.log(USUAL_FRICTION) / _FRICTION_SPREAD, 0.0, 0.0])
        return np.concatenate([rows, own]), np.append(values, usual)

    def parameters_of(self, effect: PushEffect) -> tuple[EffectParameter, ...]:
        """Parameters of an effect."""
        return effect.parameters

    def with_parameters(
        self, own: Array, effects: tuple[PushEffect, ...], theta: tuple[Array, ...]
    ) -> PushDiscrepancy:
        """The model at other parameters, at the same whitening."""
        made = replace(self, values=own, effects=effects, theta=theta)
        known = {name: self.__dict__[name] for name in _OF_WHITENING if name in self.__dict__}
        made.__dict__.update(known)
        return made

    def effect_named(self, name: str) -> PushEffect:
        """An effect of the catalogue."""
        return PUSHED.create(name)

    def is_possible(self, name: str) -> bool:
        """Whether the parameters of an effect that the model has are such as can exist."""
        pairs = zip(self.effects, self.theta, strict=True)
        return all(e.is_possible(theta) for e, theta in pairs if e.name == name)

    def refined(self) -> PushDiscrepancy:
        """Fit motion and all numbers with the effects, and linearise there.

        Effects far from the data have no such fit; the one at fixed whitening then stands for it.
        """
        start = np.concatenate([self.values, self.fit.common[_OWN : len(NAMES)], *self.theta])
        try:
            found = refit(self.fit, self.effects, start, self.table.total)
        except NotIdentifiableError:
            return self.settled()
        first, *theta = np.split(found.common, len(NAMES) + _ends(self.effects))
        made = replace(self, fit=found, values=first[:_OWN], theta=tuple(theta))
        return replace(made, table=made._likeliest_table(self.table)).settled()

    def settled(self) -> PushDiscrepancy:
        """Fit at fixed whitening."""
        return self.fitted_from(self.effects, self.theta)

    def families_of(self, name: str) -> list[Family]:
        """What an effect that the model lacks makes of the innovations."""
        instances = self._instances(self.effect_named(name))
        return [self._family(instance, len(instances)) for instance in instances]

    def _instances(self, effect: PushEffect) -> list[PushEffect]:
        """An effect, or for sudden ones one for each push with which it may begin; or none."""
        return effect.beginnings(self.fit.model.intervals.push_starts) if effect.told else []

    def _family(self, effect: PushEffect, choices: int) -> Family:
        at = "" if effect.start is None else f" at {effect.start:.2f} s"
        columns = -self.whiten(self._innovations(*self._spanned(effect)))
        kept = tuple(range(columns.shape[1]))
        return Family(
            effect.name, effect.name + at, effect.name, columns, kept, choices, source=effect,
            lasting=effect.lasting, regional=can_be_gated(effect) and effect.start is None,
        )  # fmt: skip

    def _spanned(self, effect: PushEffect) -> tuple[Array, Array]:
        """Changes of rows (N, 3, m) and (P, 3, m) by what spans an effect."""
        sizes = np.array([p.prior_std for p in effect.parameters])
        steps, scale = effect.family_thetas(), 1.0
        if steps is None:
            steps, scale = np.diag(_STEP * sizes), _STEP
        before, found = self._changed(self.x, self.effects), []
        for k, step in enumerate(steps):
            after = self._changed(np.append(self.x, step), (*self.effects, effect))
            size = scale * sizes[k] if scale < 1.0 else 1.0
            found.append([(new - old) / size for new, old in zip(after, before, strict=True)])
        motion, poses = zip(*found, strict=True)
        return np.stack(motion, axis=-1), np.stack(poses, axis=-1)

    def guess(self, family: Family, coefficients: Array) -> Array:
        """Parameters from the coefficients, no larger than effects are."""
        effect: PushEffect = family.source
        most = _LARGEST_GUESS * np.array([p.prior_std for p in effect.parameters])
        least = np.array([p.least for p in effect.parameters])
        return np.asarray(np.maximum(np.clip(effect.guess(coefficients), -most, most), least))

    def parameters(self) -> ParameterTable:
        """{effect: {parameter: {"value", "std", "unit"}}}, with the time of sudden ones."""
        table = super().parameters()
        for effect in self.effects:
            if effect.start is not None:
                start = {"value": effect.start, "std": self._gap(effect.start), "unit": "s"}
                table[effect.name]["time"] = start
        return table

    def _gap(self, start: float) -> float:
        """Time before a push in which something may have changed, s, as a standard deviation."""
        times = self._rows.pose_time[self._filter.order]
        before = times[times < start]
        return float(start - before[-1]) / np.sqrt(12.0) if len(before) else 0.0

    def conditions(self) -> list[Condition]:
        """Speed, force, place and time."""
        model, rows = self.fit.model, self._rows
        at = np.searchsorted(model.middle, rows.pose_middle[self._filter.order])
        force = np.linalg.norm(model.intervals.force[model.middle, :2], axis=1)
        return push_conditions(model.balance.motion(self._motion), force, at)

    def residuals(self) -> Residuals:
        """Innovations of the pose, with what was going on."""
        white = self.residual.reshape(-1, 3)
        return push_residuals(self.time[::3], white, self._rows.pose_std, self.conditions())

    def lacking(self) -> Array:
        """(R, 3) force, N, and torque about the contact, N m, that the fitted motion lacks."""
        fit = self.fit
        return fit.model.balance.lack(self._motion, fit.common, self._friction)

    @property
    def remark(self) -> str:
        """How friction differs over the table, if it does."""
        return self.table.remark

    def imitators(self, name: str) -> tuple[str, ...]:
        """Friction that differs from place to place may look like a slope."""
        return (VARIATION,) if name == SLOPE and self.table.imitates_slope else ()

    def plan_against(self, rivals: Sequence[PushDiscrepancy]) -> dict[str, Any] | None:
        """The push that would tell this model from others."""
        named = {rival.effect_names[-1]: rival._pushed for rival in rivals if rival.effects}
        if not named and self.imitators(SLOPE):
            return plan_wider(self.fit.model)
        return plan_push(self._pushed, named, self.fit.model, self.table.total)

    def _pushed(self, predict: Any) -> Array:
        common = np.concatenate([self.values, self.fit.common[_OWN : len(NAMES)], *self.theta])
        return np.asarray(predict(common, self.effects))

    def _likeliest_table(self, most: Table | None = None) -> Table:
        """Variations of friction that are likeliest beside single effects of plausible sizes.

        Args:
            most: those that none exceeds, where nothing else is thought to be missing.
        """
        sizes = self.scales(self.effects)
        slopes = [rows[:, :, 1:] * sizes for rows in self._slopes(self.x, self.effects)]
        parts = zip(slopes, self._lasting_rows, strict=True)
        motion, poses = (np.concatenate(part, axis=2) for part in parts)
        effects = []
        missing = [] if most else [n for n in self.catalogue if n not in self.effect_names]
        for name in missing:
            for effect in self._instances(self.effect_named(name)):
                by_motion, by_poses = self._spanned(effect)
                size = _sizes(effect, by_motion.shape[2])
                effects.append((name, (by_motion * size, by_poses * size)))
        return likeliest_table(self._whitened, (motion, poses), effects, self._field, most)

    def _whitened(self, along: float, motion: Array, poses: Array) -> tuple[Array, Array, float]:
        """Residual, innovations of rows and log volume at a variation along the way."""
        there = replace(self, table=Table(along))
        return there._at_fit, there._innovations(motion, poses), there._filter.log_volume


def _ends(effects: Sequence[PushEffect]) -> NDArray[np.intp]:
    """Where parameters of effects begin, from the first one's."""
    counts = [len(effect.parameters) for effect in effects]
    return np.cumsum([0, *counts])[: len(counts)]


def _sizes(effect: PushEffect, count: int) -> Array:
    """Plausible sizes (m,) of the coefficients of what spans an effect."""
    sizes = np.array([p.prior_std for p in effect.parameters])
    return sizes if count == len(sizes) else np.full(count, float(np.max(sizes[:2])))
