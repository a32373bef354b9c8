"""A pushed object as a model that the diagnosis can question."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import islice
from typing import Any

import numpy as np

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.discrepancy.model.least_squares import LeastSquaresModel
from tactile_dynamics_ros.core.discrepancy.model.residual_model import (
    Condition,
    Family,
    ParameterTable,
    Residuals,
)
from tactile_dynamics_ros.core.discrepancy.screening import orthonormal
from tactile_dynamics_ros.core.effects.parameter import EffectParameter
from tactile_dynamics_ros.core.errors import NotIdentifiableError
from tactile_dynamics_ros.core.planar.diagnosis.fitted import FRICTION_SPREAD, FittedPushes
from tactile_dynamics_ros.core.planar.diagnosis.innovations import (
    push_conditions,
    push_residuals,
)
from tactile_dynamics_ros.core.planar.diagnosis.linearisation import Linearisation
from tactile_dynamics_ros.core.planar.diagnosis.one_part import OnePart
from tactile_dynamics_ros.core.planar.diagnosis.separating_push import (
    Predict,
    plan_push,
    plan_wider,
)
from tactile_dynamics_ros.core.planar.diagnosis.twins import lean_of
from tactile_dynamics_ros.core.planar.diagnosis.two_parts import TwoParts
from tactile_dynamics_ros.core.planar.diagnosis.variation import (
    SLOPE,
    VARIATION,
    Table,
    hidden_slope,
    likeliest_table,
)
from tactile_dynamics_ros.core.planar.effects.acting import Acting
from tactile_dynamics_ros.core.planar.effects.effect import PushEffect
from tactile_dynamics_ros.core.planar.effects.gated import can_be_gated
from tactile_dynamics_ros.core.planar.effects.regional import plain_name
from tactile_dynamics_ros.core.planar.effects.registry import PUSHED
from tactile_dynamics_ros.core.planar.misreading import check_reading
from tactile_dynamics_ros.core.planar.properties.latent_model import USUAL_FRICTION
from tactile_dynamics_ros.core.planar.properties.linked_fit import PairFit
from tactile_dynamics_ros.core.planar.properties.push_model import PushFit
from tactile_dynamics_ros.core.planar.streams import PushedStreams

_LARGEST_GUESS = 1.5
"""Largest start of an effect's parameter, in standard deviations of its prior: linear forms
overshoot where an effect is large. At 3 some fits began where friction is negative."""
_LEAST_JUDGED = 30
"""Poses while the object slides from which a model is judged: three stretches of the ten samples in
which bursts are looked for. With fewer anything is adequate."""
_STEP = 1e-3
"""Step of the difference quotient by an effect's parameters, in their prior's standard deviations:
laws bend by far less than a thousandth over it, rounding is a millionth of it."""


@dataclass(frozen=True)
class PushDiscrepancy(LeastSquaresModel[PushEffect]):
    """Innovations of the poses of a pushed object, with x = [ln q, ln m, com x, com y, theta ...].

    Of two parts on a joint x has the numbers of both, and ln of the joint's friction.
    The motion, local friction and what is known of lasting errors of height, place, clock and
    pressure are integrated out along a linearisation: the residual says what each pose adds to
    those before it and to the forces.

    Attributes:
        linear: motion and common numbers at which the rows were linearised, with all effects, and
            the table by which residuals are made white.
        values: (q,) own parameters.
        effects: of the model. theta: their parameters.
        catalogue: names of the effects that may be tried.
    """

    linear: Linearisation
    values: Array
    effects: tuple[PushEffect, ...]
    theta: tuple[Array, ...]
    catalogue: tuple[str, ...]

    @classmethod
    def of_streams(
        cls,
        streams: PushedStreams,
        names: Sequence[str] = (),
        fit: PushFit | PairFit | None = None,
    ) -> PushDiscrepancy:
        """Fit a model with named effects.

        Args:
            streams: forces, contact points and poses of one part or two.
            names: of the effects.
            fit: of that model, if there is one already.

        Raises:
            BadInputError: an effect is unknown or has no law for two parts, nothing is touched
                while poses are known, or signs, units or axes are other ones.
            NotIdentifiableError: nothing slides long enough, there are more than two parts, or
                what two are to each other is not known.
        """
        check_reading(streams)
        kind: Any = OnePart if len(streams.links) == 1 else TwoParts
        first: FittedPushes = kind.of_streams(streams, PUSHED.create_all(names), fit)
        model = cls._of_pushes(first, names)
        pushes = first.suspecting(streams, model.table.suspects)
        model = model if pushes is first else cls._of_pushes(pushes, names)
        judged = len(model.linear.times)
        if judged < _LEAST_JUDGED:
            raise NotIdentifiableError(
                f"{judged} poses while the object slides, expected {_LEAST_JUDGED} at least; "
                "push it further, or send poses more often"
            )
        return model

    @classmethod
    def _of_pushes(cls, pushes: FittedPushes, names: Sequence[str]) -> PushDiscrepancy:
        """The model with named effects at the motion that a fit found, perhaps with others."""
        values, theta = _split(pushes)
        linear = Linearisation(pushes, Table(pushes.variation))
        model = cls(linear, values, pushes.effects, theta, pushes.catalogue)
        for name in set(model.effect_names) - set(names):
            model = model.without_effect(name)
        return model.on_table(model._likeliest_table()).settled()

    @property
    def pushes(self) -> FittedPushes:
        """Motion and common numbers at which the rows were linearised."""
        return self.linear.pushes

    @property
    def table(self) -> Table:
        """How friction differs from place to place."""
        return self.linear.table

    def on_table(self, table: Table) -> PushDiscrepancy:
        """The model whitened for another table, not fitted again."""
        return replace(self, linear=Linearisation(self.pushes, table))

    @property
    def fit(self) -> PushFit | PairFit:
        """Motion and common numbers."""
        found: PushFit | PairFit = self.pushes.fit
        return found

    @property
    def own(self) -> Array:
        """(q,) ln of product (kg) and mass (kg), centre of mass from the centroid, m, ..."""
        return self.values

    @cached_property
    def own_scales(self) -> Array:
        """(q,) plausible change of each."""
        pushes = self.pushes
        scales = pushes.prior[1].copy()
        for product, mass in pushes.frictions:
            scales[[product, mass]] = 0.3, 0.6
        return scales[pushes.own]

    @property
    def own_names(self) -> tuple[tuple[str, str, str], ...]:
        """Logarithms stay unnamed: the estimate tells these numbers."""
        return ()

    def evaluate(self, x: Array, effects: tuple[PushEffect, ...]) -> tuple[Array, Array]:
        """White residual (M,) and its derivative (M, p), in one run of the filter."""
        linear = self.linear
        white = linear.whiten(linear.innovations(*self._slopes(x, effects)))
        return linear.whiten(linear.innovated) + white[:, 0], white[:, 1:]

    def _slopes(self, x: Array, effects: tuple[PushEffect, ...]) -> tuple[Array, Array]:
        """Change (N, D, 1 + p) and (P, 3, 1 + p) of the rows, followed by its derivative."""
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

    def _changed(self, x: Array, effects: tuple[PushEffect, ...]) -> tuple[Array, Array]:
        return self.linear.changed(self._common(x), effects)

    def _common(self, x: Array) -> Array:
        """(p + k,) all numbers for x = [own, theta ...]; the others are as they were found."""
        pushes = self.pushes
        count = len(pushes.own)
        common = np.append(pushes.common[: len(pushes.names)], x[count:])
        common[pushes.own] = x[:count]
        return common

    @property
    def time(self) -> Array:
        """(M,) s."""
        times = self.linear.times
        return np.repeat(times - times[0], 3 * self.linear.filter.order.shape[1])

    @property
    def measured(self) -> Array:
        """(M,) innovations of the poses at the linearisation."""
        return self.linear.innovated

    def predict(self, x: Array, effects: Sequence[PushEffect]) -> Array:
        """(M,) what other parameters change about them."""
        motion, poses = self._changed(x, tuple(effects))
        return -self.linear.innovations(motion[..., None], poses[..., None])[:, 0]

    def whiten(self, rows: Array) -> Array:
        """White form of innovations (M, ...)."""
        return self.linear.whiten(rows)

    def draw_noise(self, random: np.random.Generator) -> Array:
        """(M,) innovations of noise, and one draw of lasting errors."""
        return self.linear.draw_noise(random)

    def prior_rows(self, effects: tuple[PushEffect, ...]) -> tuple[Array, Array]:
        """Those of effects, the usual friction, and a centre of mass under the footprint."""
        rows, values = super().prior_rows(effects)
        pushes, (mean, std) = self.pushes, self.pushes.prior
        pick = np.zeros((len(mean), rows.shape[1]))
        pick[pushes.own, np.arange(len(pushes.own))] = 1.0
        bound = [pair for pair in pushes.frictions if pair[1] in pushes.own]
        free = np.setdiff1d(pushes.own, bound)
        usual = [(pick[product] - pick[mass]) / FRICTION_SPREAD for product, mass in bound]
        far = np.full(len(bound), -np.log(USUAL_FRICTION) / FRICTION_SPREAD)
        rows = np.concatenate([rows, *(row[None] for row in usual), pick[free] / std[free, None]])
        return rows, np.concatenate([values, far, -mean[free] / std[free]])

    def parameters_of(self, effect: PushEffect) -> tuple[EffectParameter, ...]:
        """Parameters of an effect."""
        return effect.parameters

    def with_parameters(
        self, own: Array, effects: tuple[PushEffect, ...], theta: tuple[Array, ...]
    ) -> PushDiscrepancy:
        """The model at other parameters, at the same whitening."""
        return replace(self, values=own, effects=effects, theta=theta)

    def effect_named(self, name: str) -> PushEffect:
        """An effect of the catalogue."""
        return PUSHED.create(name)

    def sentence(self, name: str) -> str:
        """What an effect does, as a clause; of one in the model with the part on which it acts."""
        own = next((e for e in self.effects if e.name == name), None)
        return super().sentence(name) if own is None else own.sentence

    def is_possible(self, name: str) -> bool:
        """Whether the parameters of an effect that the model has are such as can exist."""
        pairs = zip(self.effects, self.theta, strict=True)
        return all(e.is_possible(theta) for e, theta in pairs if e.name == name)

    def refined(self) -> PushDiscrepancy:
        """Fit motion and all numbers with the effects, and linearise there.

        Effects far from the data have no such fit; the one at fixed whitening then stands for it.
        """
        try:
            found = self.pushes.refitted(self.effects, self._common(self.x), self.table.total)
        except NotIdentifiableError:
            return self.settled()
        values, theta = _split(found)
        linear = Linearisation(found, self.table)
        made = replace(self, linear=linear, values=values, theta=theta)
        return made.on_table(made._likeliest_table(self.table)).settled()

    def settled(self) -> PushDiscrepancy:
        """Fit at fixed whitening."""
        return self.fitted_from(self.effects, self.theta)

    def families_of(self, name: str) -> list[Family]:
        """What an effect that the model lacks makes of the innovations."""
        instances = self.pushes.families(self.effect_named(name))
        return [self._family(instance, len(instances)) for instance in instances]

    def _family(self, effect: PushEffect, choices: int) -> Family:
        columns = self.columns_of(effect)
        kept = tuple(range(columns.shape[1]))
        return Family(
            effect.name, effect.label, effect.name, columns, kept, choices, source=effect,
            lasting=effect.lasting, regional=can_be_gated(effect) and effect.start is None,
        )  # fmt: skip

    def columns_of(self, effect: PushEffect) -> Array:
        """White columns (M, m) of what spans an effect."""
        return -self.whiten(self.linear.innovations(*self._spanned(effect)))

    def law_forms(self) -> Sequence[Any]:
        """Laws of an object of one part."""
        from tactile_dynamics_ros.core.planar.diagnosis.law_forms import pushed_forms

        return pushed_forms() if isinstance(self.pushes, OnePart) else ()

    def _spanned(self, effect: PushEffect) -> tuple[Array, Array]:
        """Changes of rows (N, D, m) and (P, 3, m) by what spans an effect."""
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
        """{effect: {parameter: {"value", "std", "unit"}}}, with time or part that was chosen."""
        table = super().parameters()
        for effect in self.effects:
            for name, chosen in effect.choices.items():
                table[effect.name][name] = {"value": chosen, "std": 0.0, "unit": ""}
        for effect in self.effects:
            if effect.start is not None:
                start = {"value": effect.start, "std": self._gap(effect.start), "unit": "s"}
                table[effect.name]["time"] = start
        return table

    @property
    def covariance(self) -> Array:
        """(p, p) of all parameters, widened by the field that could be there beside effects."""
        found = super().covariance
        size = self.table.imitating if SLOPE in self.effect_names else 0.0
        size = max(size, self.table.unsure)
        if not self.effects or not size:
            return found
        moved = size * self._moved_by_field
        return np.asarray(found + moved @ moved.T)

    @cached_property
    def _moved_by_field(self) -> Array:
        """Changes (p, K) of all parameters by spots of a field with standard deviation 1."""
        linear = self.linear
        field = linear.field(self.table.length)
        none = np.zeros((*linear.rows.poses.residual.shape, field.shape[2]))
        white = self.whiten(linear.innovations(field, none))
        jacobian, (rows, _) = self.jacobian, self.prior_rows(self.effects)
        information = jacobian.T @ jacobian + rows.T @ rows
        return np.asarray(np.linalg.solve(information, jacobian.T @ white))

    def _gap(self, start: float) -> float:
        """Time before a push in which something may have changed, s, as a standard deviation."""
        before = self.linear.times[self.linear.times < start]
        return float(start - before[-1]) / np.sqrt(12.0) if len(before) else 0.0

    def conditions(self) -> list[Condition]:
        """Speed, force, place and time."""
        pushes, linear = self.pushes, self.linear
        nodes = linear.rows.poses.middle[linear.filter.order[:, 0]]
        at = np.searchsorted(pushes.middle, nodes)
        force = np.linalg.norm(pushes.intervals.force[pushes.middle, :2], axis=1)
        return push_conditions(pushes.motion(), force, at)

    def residuals(self) -> Residuals:
        """Innovations of the pose, with what was going on."""
        order = self.linear.filter.order
        white = self.residual.reshape(len(order), -1)
        std = self.linear.rows.poses.std[order].reshape(white.shape)
        time = self.time[:: white.shape[1]]
        return push_residuals(time, white, std, self.conditions())

    def lacking(self) -> Array:
        """(R, 3) force, N, and torque about the contact, N m, that the fitted motion lacks."""
        pushes = self.pushes
        return pushes.lack(pushes.common, pushes.effects, self.linear.friction)[:, :3]

    @property
    def remark(self) -> str:
        """How friction differs over the table if it does, and what slope would look the same."""
        steady = self.pushes.steady()
        if not self.table.field or steady is None:
            return self.table.remark
        size = self.effect_named(SLOPE).parameters[0].prior_std
        [family] = self.families_of(SLOPE)
        basis = orthonormal(self.jacobian)
        hidden = size * hidden_slope(-family.columns * size, basis, self.residual)
        return (
            f"{self.table.remark} A slope of up to {hidden:.2g} per metre would look the same: "
            f"{plan_wider(steady)['description']}."
        )

    def imitators(self, name: str) -> tuple[str, ...]:
        """Friction that differs by place may look like a slope, and a pull like a lean.

        What is clearly likelier in a regime, before any refit, is not ruled out by a fit with what
        acts everywhere. Beside a field that no real table has, part of the cause is in the field:
        what would do the same as it, is as likely.
        """
        imitated = name == SLOPE and self.table.imitating
        varied: tuple[str, ...] = (VARIATION,) if imitated else ()
        if self.table.is_rougher_than_tables:
            others = (s for s in self.table.suspects if plain_name(s) != plain_name(name))
            varied = (VARIATION, *islice(others, 1))
        other = plain_name(name) != plain_name(self.table.regional)
        regional = (self.table.regional,) if self.table.regional and other else ()
        return (*varied, *regional, *self.pushes.imitators(name), *self._leans(name))

    def _leans(self, name: str) -> tuple[str, ...]:
        """A table that leans, where the point of a pull may be the centre of mass."""
        own = [self.pushes.names[place] for place in self.pushes.own]
        if "com_x" not in own:  # of two parts
            return ()
        rows = [own.index("com_x"), own.index("com_y")]
        present = dict(zip(self.effect_names, self.theta, strict=True))
        return lean_of(name, self.values[rows], rows, present, self.covariance)

    def plan_against(self, rivals: Sequence[PushDiscrepancy]) -> dict[str, Any] | None:
        """The push that would tell this model from others."""
        named = {rival.effect_names[-1]: rival._pushed for rival in rivals if rival.effects}
        steady = self.pushes.steady()
        if steady is None:
            return None
        if not named and self.imitators(SLOPE):
            return plan_wider(steady)
        return plan_push(self._pushed, named, steady, self.table.total)

    def _pushed(self, predict: Predict) -> Array:
        return predict(self._common(self.x), self.effects)

    def _likeliest_table(self, most: Table | None = None) -> Table:
        """Variations of friction that are likeliest beside single effects of plausible sizes.

        Args:
            most: those that none exceeds, where nothing else is thought to be missing.
        """
        sizes = self.scales(self.effects)
        slopes = [rows[:, :, 1:] * sizes for rows in self._slopes(self.x, self.effects)]
        parts = zip(slopes, self.linear.lasting_rows, strict=True)
        motion, poses = (np.concatenate(part, axis=2) for part in parts)
        effects = []
        missing = [] if most else [n for n in self.catalogue if n not in self.effect_names]
        single = [e for name in missing for e in self.pushes.families(self.effect_named(name))]
        for effect in (*single, *([] if most else self.pushes.regional())):
            by_motion, by_poses = self._spanned(effect)
            size = _sizes(effect, by_motion.shape[2])
            effects.append((effect.name, (by_motion * size, by_poses * size)))
        return likeliest_table(self._whitened, (motion, poses), effects, self.linear.field, most)

    @cached_property
    def _present(self) -> tuple[Array, Array]:
        """Changes (N, D, 1) and (P, 3, 1) of the rows from where they are linear to the model."""
        motion, poses = self._changed(self.x, self.effects)
        return motion[..., None], poses[..., None]

    def _whitened(self, along: float, motion: Array, poses: Array) -> tuple[Array, Array, float]:
        """Residual, innovations of rows and log volume at a variation along the way.

        An effect that helped to find the motion and is not in the model is not in the residual.
        """
        there = Linearisation(self.pushes, Table(along))
        residual = there.innovated + there.innovations(*self._present)[:, 0]
        return residual, there.innovations(motion, poses), there.filter.log_volume


def _split(pushes: FittedPushes) -> tuple[Array, tuple[Array, ...]]:
    """Own parameters, and those of each effect."""
    acting = Acting(pushes.effects, pushes.common[len(pushes.names) :])
    return pushes.common[pushes.own], tuple(theta for _, theta in acting)


def _sizes(effect: PushEffect, count: int) -> Array:
    """Plausible sizes (m,) of the coefficients of what spans an effect."""
    sizes = np.array([p.prior_std for p in effect.parameters])
    return sizes if count == len(sizes) else np.full(count, float(np.max(sizes[:2])))
