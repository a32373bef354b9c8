"""An arm's joint torques as a model that the diagnosis can question."""

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
from tactile_dynamics_ros.core.discrepancy.screening import screen
from tactile_dynamics_ros.core.discrepancy.trials import try_effect
from tactile_dynamics_ros.core.effects.parameter import EffectParameter
from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.joints.drive_effects import TorqueRipple
from tactile_dynamics_ros.core.joints.effects import JointEffect, ReadingGroup
from tactile_dynamics_ros.core.joints.noise import whitener
from tactile_dynamics_ros.core.joints.prior import SHARES, USUAL_SHARE, BodyPrior
from tactile_dynamics_ros.core.joints.registry import JOINTS
from tactile_dynamics_ros.core.joints.samples import JointSamples
from tactile_dynamics_ros.core.joints.situation import Situation
from tactile_dynamics_ros.core.numerics.banded import BandedWhitener
from tactile_dynamics_ros.core.numerics.noise import white_noise_std

Array = NDArray[np.float64]

_TOLD = 0.02
"""Information of a recording on a direction of the bodies' parameters, over that of the prior, from
which the model has a parameter for it: below, data move it by a hundredth of its prior std."""
_FRICTION_STD = 100.0
"""Prior std of Coulomb and viscous friction and of an offset, N m, N m s/rad and N m: nothing is
known of them. Less would pull them to zero on large arms."""
_ROUNDS = 4
"""Rounds of fit and noise: the floors of a residual settle to 1 % in three."""
_LEAST_NOISE = 1e-6
"""Noise of a mean torque at least, N m: data without any noise stay finite."""
_FEW = 12
"""Readings of an effect that a message lists: those of all joints and of each one."""
_CHANCE = 2.0
"""Standard deviations by which a parameter may be beyond what is possible: noise moves one of zero
so far in 2 % of recordings."""
_SHORT = 8.0
"""Length of a recording, s, below which "nothing is missing" means nothing: joints have turned back
only a few times by then."""


@dataclass(frozen=True, eq=False)
class Basis:
    """What a recording lets be told of bodies: tau = start + columns [friction, z].

    Attributes:
        start: (M,) torques of the URDF's bodies, N m.
        columns: (M, 3 n + q) torques per friction parameter and per direction z.
        back: (P, q) parameters of bodies per direction z, prior N(0, 1).
        mean: (P,) parameters of the bodies where z = 0.
        root: (P, P) of the prior's covariance.
        kept: (P, q) orthonormal directions z in units of the prior.
        share: how far the URDF's bodies may be off.
    """

    start: Array
    columns: Array
    back: Array
    mean: Array
    root: Array
    kept: Array
    share: float


@dataclass(frozen=True, eq=False)
class JointsModel(LeastSquaresModel[JointEffect]):
    """Mean joint torques of blocks: rigid bodies, plain friction, effects.

    tau = Y phi + F sign(q') + B q' + o + sum of effects; phi of links and payload by the URDF's
    prior. Own parameters are [F, B, o of each joint, z].

    Attributes:
        samples: what was measured.
        basis: of the bodies' parameters.
        parts: own parameters.
        effects: of the model. theta: their parameters.
        catalogue: names of the effects that may be tried.
        effort_std: (n,) noise of a block's mean torque, N m.
        whitening: of the rows.
        situation: that effects act on.
    """

    samples: JointSamples
    basis: Basis
    parts: Array
    effects: tuple[JointEffect, ...]
    theta: tuple[Array, ...]
    catalogue: tuple[str, ...]
    effort_std: Array
    whitening: BandedWhitener
    situation: Situation

    @classmethod
    def fit(
        cls, samples: JointSamples, effects: Sequence[str] = (), share: float | None = None
    ) -> JointsModel:
        """Fit bodies, friction and named effects.

        Args:
            samples: of one recording or several.
            effects: names, with readings.
            share: how far the URDF's bodies may be off; as the recording says if None.

        Raises:
            BadInputError: an effect is unknown.
        """
        JOINTS.create_all([label.partition(":")[0] for label in effects])
        prior, n = BodyPrior.of(samples.arm), len(samples.arm.names)
        situation = Situation(samples, samples.arm.inertia, np.zeros((3, n)))
        effort_std = np.maximum(samples.effort_std, _LEAST_NOISE)
        whitening = _whitener(samples, effort_std, situation)
        basis = _basis(samples, prior, share or USUAL_SHARE, whitening)
        parts, names = np.zeros(basis.columns.shape[1]), JOINTS.names()
        model = cls(samples, basis, parts, (), (), names, effort_std, whitening, situation)
        model = model.refined()._with_labels(effects)
        basis = _basis(samples, prior, share or _likeliest_share(model, prior), model.whitening)
        return replace(model, basis=basis, parts=np.zeros(basis.columns.shape[1])).refined()

    def _with_labels(self, labels: Sequence[str]) -> JointsModel:
        """The model with effects, each in the reading that is named or fits best.

        Raises:
            BadInputError: an effect has no such reading here.
        """
        model = self
        for label in labels:
            if "[" in label:
                raise BadInputError(f"effect '{label}': no regimes here; leave the regime out")
            name, _, reading = label.partition(":")
            families = model.families_of(name)
            own = [f for f in families if not reading or f.label == label]
            if not own:
                known = ", ".join(dict.fromkeys(f.label for f in families[:_FEW]))
                raise BadInputError(f"effect '{label}': no such reading; expected {known} ...")
            tried = try_effect(model, screen(model, own), name, 1.0).model
            assert isinstance(tried, JointsModel)
            model = tried.refined()
        return model

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of the joints."""
        return self.samples.arm.names

    @property
    def own(self) -> Array:
        """(3 n + q,) friction and what the bodies are."""
        return self.parts

    @property
    def own_names(self) -> Sequence[tuple[str, str, str]]:
        """Friction of each joint, as a table of its name."""
        kinds = (("coulomb", ""), ("viscous", " s/rad"), ("offset", ""))
        return [
            (joint, kind, f"{unit}{per}".replace("N s/rad", "N s/m"))
            for kind, per in kinds
            for joint, unit in zip(self.joints, self.samples.arm.units, strict=True)
        ]

    @property
    def own_scales(self) -> Array:
        """Friction in N m; directions of the bodies in units of the prior."""
        return np.ones(len(self.parts))

    @cached_property
    def time(self) -> Array:
        """(K n,) s."""
        return np.repeat(self.samples.time, len(self.joints))

    @property
    def measured(self) -> Array:
        """(K n,) mean torques of blocks, N m."""
        return self.samples.effort.reshape(-1)

    def predict(self, x: Array, effects: Sequence[JointEffect]) -> Array:
        """(K n,) the same for [own, theta ...]."""
        own = len(self.parts)
        found = self.basis.start + self.basis.columns @ x[:own]
        for effect in effects:
            count = len(effect.parameters())
            found = found + effect.torque(self.situation, x[own : own + count]).reshape(-1)
            own += count
        return np.asarray(found)

    @cached_property
    def _own_white(self) -> Array:
        return self.whiten(self.basis.columns)

    def evaluate(self, x: Array, effects: tuple[JointEffect, ...]) -> tuple[Array, Array]:
        """White residual and its derivative."""
        own, blocks = len(self.parts), [-self._own_white]
        for effect in effects:
            count = len(effect.parameters())
            by_theta = effect.jacobian(self.situation, x[own : own + count])
            blocks.append(-self.whiten(by_theta.reshape(len(self.time), count)))
            own += count
        return self.whiten(self.lack(x, effects)), np.concatenate(blocks, axis=1)

    def prior_rows(self, effects: tuple[JointEffect, ...]) -> tuple[Array, Array]:
        """Friction hardly known, directions of the bodies as in the URDF, effects by their own."""
        friction = np.full(3 * len(self.joints), _FRICTION_STD)
        stds = np.concatenate(
            [friction, np.ones(len(self.parts) - len(friction)), self.prior_stds(effects)]
        )
        return np.diag(1.0 / stds), np.zeros(len(stds))

    def whiten(self, rows: Array) -> Array:
        """White form of rows (K n, ...)."""
        return self.whitening.whiten(rows)

    def draw_noise(self, random: np.random.Generator) -> Array:
        """(K n,) one draw of noise of sensors, accelerations and reversals."""
        return self.whitening.colour(random.normal(size=len(self.time)))

    @cached_property
    def noise_level(self) -> float:
        """Mean logarithm of the standard deviations."""
        return float(np.mean(np.log(self.whitening.band[0])))

    @property
    def too_short(self) -> str:
        """Why a short recording cannot show that nothing is missing."""
        lasts = len(self.samples.time) * self.samples.length
        if lasts >= _SHORT:
            return ""
        return f"the recording has {lasts:.0f} s of motion; record {_SHORT:.0f} s at least"

    @property
    def friction(self) -> Array:
        """(3, n) Coulomb friction, viscous friction, offset."""
        return self.parts[: 3 * len(self.joints)].reshape(3, -1)

    @property
    def bodies(self) -> Array:
        """(P,) dynamic parameters of links and payload, links in their own frames."""
        return self.basis.mean + self.basis.back @ self.parts[3 * len(self.joints) :]

    @cached_property
    def link_bodies(self) -> Array:
        """(n, 10) dynamic parameters of the links, with the payload in the last."""
        found = self.bodies[:-10].reshape(-1, 10).copy()
        found[-1] += self.samples.arm.to_last_link @ self.bodies[-10:]
        return found

    def bodies_covariance(self) -> Array:
        """(P, P) of `bodies`, widened by the misfit; the prior's where nothing is told."""
        first, kept, root = 3 * len(self.joints), self.basis.kept, self.basis.root
        last = len(self.parts)
        told = self.covariance[first:last, first:last]
        whole = np.eye(len(root)) - kept @ kept.T + kept @ told @ kept.T
        return np.asarray(root @ whole @ root.T)

    @property
    def covariance(self) -> Array:
        """(p, p) of all parameters, widened by the misfit and by how far it is correlated."""
        jacobian, (rows, _) = self.jacobian, self.prior_rows(self.effects)
        return np.asarray(self.dispersion * np.linalg.inv(jacobian.T @ jacobian + rows.T @ rows))

    @cached_property
    def dispersion(self) -> float:
        """Factor on variances: mean square of the residual times its correlation time."""
        white = self.residual.reshape(-1, len(self.joints))
        centred = white - white.mean(axis=0)
        power = np.sum(centred**2)
        longest = min(round(1.0 / self.samples.length), len(white) // 4)
        apart = [np.sum(centred[k:] * centred[:-k]) / power for k in range(1, longest)]
        total = 1.0
        for correlation in apart:
            if correlation <= 2.0 / np.sqrt(white.size):
                break
            total += 2.0 * float(correlation)
        return max(1.0, float(np.mean(white**2))) * total

    def parameters_of(self, effect: JointEffect) -> tuple[EffectParameter, ...]:
        """Parameters of an effect."""
        return effect.parameters()

    def with_parameters(
        self, own: Array, effects: tuple[JointEffect, ...], theta: tuple[Array, ...]
    ) -> JointsModel:
        """The model at other parameters, at the same whitening."""
        return replace(self, parts=own, effects=effects, theta=theta)

    def effect_named(self, name: str) -> JointEffect:
        """An effect of the catalogue, or the reading of it that the model has."""
        own = next((effect for effect in self.effects if effect.name == name), None)
        return own or JOINTS.create(name)

    def is_possible(self, name: str) -> bool:
        """Whether all parameters of an effect are within their bounds, or chance from them."""
        table = super().parameters()[name]
        return all(
            p.allows(entry["value"] + sign * _CHANCE * entry["std"])
            for p, entry in zip(self.effect_named(name).parameters(), table.values(), strict=True)
            for sign in (1.0 if entry["value"] < p.least else -1.0,)
            if not p.allows(entry["value"])
        )

    def parameters(self) -> ParameterTable:
        """Friction of each joint and effects; shapes as they are, in place of logarithms."""
        table = super().parameters()
        for effect in self.effects:
            scales = effect.scales()
            table[effect.name] = {
                scales[key][0] if key in scales else key: _plain(entry, scales.get(key))
                for key, entry in table[effect.name].items()
            }
        return table

    def sentence(self, name: str) -> str:
        """What an effect does, and on which joints."""
        effect = self.effect_named(name)
        where = effect.where(self.joints) if effect in self.effects else ""
        return f"{effect.sentence} ({where})" if where else effect.sentence

    def refined(self) -> JointsModel:
        """Fit again with noise, load and friction at what is found."""
        model = self
        for _ in range(_ROUNDS):
            fitted = model.fitted_from(model.effects, model.theta)
            situation = Situation(fitted.samples, fitted.link_bodies, fitted.friction)
            effort_std = _seen_noise(fitted)
            whitening = _whitener(fitted.samples, effort_std, situation)
            model = replace(fitted, situation=situation, effort_std=effort_std, whitening=whitening)
        return model.fitted_from(model.effects, model.theta)

    def families_of(self, name: str) -> list[Family]:
        """Families of all readings of an effect; those of one group share columns."""
        effect = JOINTS.create(name)
        groups, found = self._groups(effect), []
        for group in groups:
            columns = self.whiten(group.columns.reshape(len(self.time), -1))
            alike = [len(reading.kept) for one in groups for reading in one.readings]
            for reading in group.readings:
                choices = alike.count(len(reading.kept)) * self._searched(effect)
                found.append(
                    Family(
                        name,
                        reading.label,
                        group.reading,
                        columns,
                        reading.kept,
                        choices,
                        reading.effect,
                    )
                )
        return found

    def _groups(self, effect: JointEffect) -> list[ReadingGroup]:
        if isinstance(effect, TorqueRipple):
            left = self.lack(self.x, self.effects).reshape(-1, len(self.joints))
            return effect.strongest(self.situation, left)
        return effect.groups(self.situation)

    def _searched(self, effect: JointEffect) -> int:
        """Shapes that were looked through before a group was made."""
        return len(effect.grid) if isinstance(effect, TorqueRipple) else 1

    def guess(self, family: Family, coefficients: Array) -> Array:
        """Start of an effect's parameters."""
        return np.asarray(family.source.start(coefficients))

    def conditions(self) -> list[Condition]:
        """Time alone can bound a regime."""
        return [Condition("time", "s", self.samples.time, symbol="t")]

    def residuals(self) -> Residuals:
        """Residuals of each joint, with its speed, direction and position, and the time."""
        samples, middle = self.samples, self.samples.nodes[:, :, 1]
        found = [Condition("time", "s", samples.time, symbol="t")]
        for j, name in enumerate(self.joints):
            found.append(Condition(f"speed of {name}", "rad/s", np.abs(middle[1, :, j])))
            found.append(Condition(f"velocity of {name}", "rad/s", middle[1, :, j]))
            found.append(Condition(f"position of {name}", "rad", middle[0, :, j]))
        return Residuals(
            time=samples.time,
            white=self.residual.reshape(-1, len(self.joints)),
            physical=self.lack(self.x, self.effects).reshape(-1, len(self.joints)),
            channels=self.joints,
            units=samples.arm.units,
            conditions=tuple(found),
            drivers=np.concatenate([*middle, np.sign(middle[1])], axis=1),
            alone="rigid links and friction",
            about="The model predicts the torques of an arm's drives from its motion: rigid links "
            "near their URDF, a payload, and Coulomb and viscous friction and an offset of each "
            "joint.",
        )

    def plan_against(self, rivals: Sequence[JointsModel]) -> dict[str, Any] | None:
        """None: no motion is planned yet."""
        return None


def _plain(entry: dict[str, Any], scale: tuple[str, float, str] | None) -> dict[str, Any]:
    """A parameter's value; that of a logarithm as a number with its unit."""
    if scale is None:
        return entry
    value = scale[1] * float(np.exp(entry["value"]))
    return {"value": value, "std": value * float(entry["std"]), "unit": scale[2]}


def _whitener(samples: JointSamples, effort_std: Array, situation: Situation) -> BandedWhitener:
    matrix = samples.arm.mass_matrix(samples.motions[1], samples.arm.inertia)
    return whitener(samples, effort_std, np.abs(situation.friction[0]), matrix)


def _seen_noise(model: JointsModel) -> Array:
    """(n,) noise of torques at which what changes from block to block has a variance of 1.

    What the model misses follows the motion or jumps at reversals: differences of high order and
    their median see little of it, whatever it is, so that models with more effects are held against
    the same noise.
    """
    white = model.residual.reshape(-1, len(model.joints))
    seen = np.array([white_noise_std(model.samples.time, one[:, None]) for one in white.T])
    least = np.maximum(0.5 * model.samples.effort_std, _LEAST_NOISE)
    return np.maximum(model.effort_std * seen, least)


def _all_columns(samples: JointSamples) -> tuple[Array, Array]:
    """Columns (M, 3 n) of friction and (M, P) of bodies."""
    count, n = samples.effort.shape
    shapes = [samples.direction.mean(axis=1), samples.dq.mean(axis=1), np.ones((count, n))]
    friction = np.concatenate([one[:, :, None] * np.eye(n) for one in shapes], axis=2)
    links = samples.regressor
    load = links[:, :, -10:] @ samples.arm.to_last_link
    load = load * samples.loaded[:, None, None]
    bodies = np.concatenate([links, load], axis=2)
    return friction.reshape(count * n, -1), bodies.reshape(count * n, -1)


def _basis(
    samples: JointSamples, prior: BodyPrior, share: float, whitening: BandedWhitener
) -> Basis:
    friction, bodies = _all_columns(samples)
    root = prior.root(share)
    felt = bodies @ root
    white = whitening.whiten(felt)
    values, vectors = np.linalg.eigh(white.T @ white)
    kept = vectors[:, values > _TOLD]
    columns = np.concatenate([friction, felt @ kept], axis=1)
    return Basis(bodies @ prior.mean, columns, root @ kept, prior.mean, root, kept, share)


def _likeliest_share(model: JointsModel, prior: BodyPrior) -> float:
    """How far the URDF's bodies are off, by the evidence of the recording.

    -2 log p = r^T r - b^T (G + P)^-1 b + ln det(G + P) - ln det P of [friction, bodies, effects],
    with G and b of white columns and P the prior's precision.
    """
    friction, bodies = _all_columns(model.samples)
    own = len(model.parts)
    effects = model.jacobian[:, own:]
    at_urdf = model.measured - model.basis.start
    left = model.whiten(at_urdf) if not model.effects else model.residual
    if model.effects:
        left = left - model.jacobian[:, :own] @ model.parts
    matrix = np.concatenate([-model.whiten(np.hstack([friction, bodies])), effects], axis=1)
    gram, side = matrix.T @ matrix, matrix.T @ left
    wide = 1.0 / _FRICTION_STD**2 * np.eye(friction.shape[1])
    own_effects = np.diag(1.0 / model.prior_stds(model.effects) ** 2)

    def minus_twice_log(share: float) -> float:
        inverse = np.linalg.inv(prior.root(share))
        total = gram.copy()
        a, b = friction.shape[1], friction.shape[1] + bodies.shape[1]
        total[:a, :a] += wide
        total[a:b, a:b] += inverse.T @ inverse
        total[b:, b:] += own_effects
        scale = 1.0 / np.sqrt(np.diag(total))
        scaled = total * np.outer(scale, scale)
        determinant = float(np.linalg.slogdet(scaled)[1]) - 2.0 * float(np.sum(np.log(scale)))
        fall = float((side * scale) @ np.linalg.solve(scaled, side * scale))
        of_prior = 2.0 * len(prior.links) * float(np.log(share))
        return -fall / model.dispersion + determinant + of_prior

    return min(SHARES, key=minus_twice_log)
