"""An arm's joint torques as a model that the diagnosis can question."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.discrepancy.model.residual_model import (
    Convention,
    Family,
    ParameterTable,
    Residuals,
)
from tactile_dynamics_ros.core.discrepancy.screening import screen
from tactile_dynamics_ros.core.discrepancy.trials import try_effect
from tactile_dynamics_ros.core.discrepancy.verdict.validation import held_out
from tactile_dynamics_ros.core.effects.parameter import EffectParameter
from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.joints.conventions import find_reading, reread
from tactile_dynamics_ros.core.joints.drive_effects import TorqueGain
from tactile_dynamics_ros.core.joints.effects import (
    JOINTS,
    GatedJointEffect,
    JointEffect,
    are_allowed,
    families_in,
    in_units,
)
from tactile_dynamics_ros.core.joints.excitation import Learned, plan_separation
from tactile_dynamics_ros.core.joints.live import KnownArm
from tactile_dynamics_ros.core.joints.per_joint import PerJointEffect
from tactile_dynamics_ros.core.joints.posterior import FittedArm
from tactile_dynamics_ros.core.joints.prior import (
    FRICTION_STD,
    USUAL_SHARE,
    BodyPrior,
    all_columns,
    basis_of,
    likeliest_share,
    seen_noise,
    stated_noise,
    whitener,
)
from tactile_dynamics_ros.core.joints.samples import BLOCK, JointSamples
from tactile_dynamics_ros.core.joints.situation import Situation, conditions_of

_ROUNDS = 4
"""Rounds of fit and noise: the floors of a residual settle to 1 % in three."""
_ALL = "all"
"""The reading of an effect on all joints."""
_OF_CURRENTS = ("torque_gain", "rotor_inertia")
"""Effects that are in the model where efforts were currents: their gains are uncertain, and they
drive the rotor as well."""
_BETTER = 0.7
"""Error of another reading of the torques over that as they are from which it is another
convention: half of the squares. Signs and units change errors by far more; gains that are off by a
third, which are an effect, by less."""
SHORTEST = 8.0
"""Length of a recording, s, below which "nothing is missing" means nothing: joints have turned back
only a few times by then."""


@dataclass(frozen=True, eq=False)
class JointsModel(FittedArm):
    """An arm's joint torques as a model that the diagnosis can question."""

    @classmethod
    def fit(
        cls,
        samples: JointSamples,
        effects: Sequence[str] = (),
        share: float | None = None,
        known_load: float | None = None,
    ) -> JointsModel:
        """Fit bodies, friction and named effects.

        Args:
            samples: of one recording or several.
            effects: names, with readings.
            share: how far the URDF's bodies may be off; as the recording says if None.
            known_load: mass of the payload, kg, if it was weighed.

        Raises:
            BadInputError: an effect is unknown.
        """
        if samples.gain_std is not None:
            own = [name for name in _OF_CURRENTS if not any(e.startswith(name) for e in effects)]
            effects = (*(f"{name}:{_ALL}" for name in own), *effects)
        JOINTS.create_all([label.partition(":")[0] for label in effects])
        prior, n = BodyPrior.of(samples.arm, known_load), len(samples.arm.names)
        if samples.gain_std is None and find_reading(samples) is not None:
            prior, share = prior.as_stated(), 1.0
        situation = Situation(samples, samples.arm.inertia, np.zeros(10), np.zeros((3, n)))
        effort_std = stated_noise(samples)
        whitening = whitener(samples, effort_std, situation.friction[0])
        basis = basis_of(samples, prior, share or USUAL_SHARE, whitening)
        parts, names = np.zeros(basis.columns.shape[1]), JOINTS.names()
        model = cls(samples, basis, parts, (), (), names, effort_std, whitening, situation)
        model = model.refined()._with_labels(effects)
        basis = basis_of(samples, prior, share or model._likeliest_share(prior), model.whitening)
        return replace(model, basis=basis, parts=np.zeros(basis.columns.shape[1])).refined()

    def _likeliest_share(self, prior: BodyPrior) -> float:
        """How far the URDF's bodies are off, as the recording says beside friction and effects."""
        own = len(self.parts)
        friction, bodies = all_columns(self.samples)
        white = -self.whiten(np.hstack([friction, bodies]))
        effects = self.jacobian[:, own:]
        at_urdf = self.residual - self.jacobian[:, :own] @ self.parts
        wide = np.append(np.full(friction.shape[1], FRICTION_STD), self.prior_stds(self.effects))
        columns = np.concatenate([white[:, : friction.shape[1]], effects], axis=1)
        bodies = white[:, friction.shape[1] :]
        return likeliest_share(prior, (columns, wide), bodies, at_urdf, self.dispersion)

    def _with_labels(self, labels: Sequence[str]) -> JointsModel:
        """The model with effects, each in the reading that is named or fits best.

        Raises:
            BadInputError: an effect has no such reading here.
        """
        model = self
        for label in labels:
            name, _, reading = label.partition(":")
            families = model.families_of(name)
            wanted = name if reading == _ALL else label
            own = [f for f in families if not reading or f.label == wanted]
            if not own:
                known = ", ".join(dict.fromkeys(f.label for f in families[: 2 * len(self.joints)]))
                raise BadInputError(f"effect '{label}': no such reading; expected {known} ...")
            tried = try_effect(model, screen(model, own), name, 1.0).model
            assert isinstance(tried, JointsModel)
            model = tried.refined()
        return model

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
        friction = np.full(3 * len(self.joints), FRICTION_STD)
        rest = np.ones(len(self.parts) - len(friction))
        stds = np.concatenate([friction, rest, *(self._prior_of(e)[0] for e in effects)])
        expected = np.concatenate([0.0 * self.parts, *(self._prior_of(e)[1] for e in effects)])
        weight = np.sqrt(self.misfit) / stds
        return np.diag(weight), -weight * expected

    def _prior_of(self, effect: JointEffect) -> tuple[Array, Array]:
        """Std (k,) and mean (k,) of an effect's parameters; of gains as the samples have them."""
        samples, stds = self.samples, self.prior_stds([effect])
        if not isinstance(effect, TorqueGain) or samples.gain_std is None:
            return stds, 0.0 * stds
        which, taken = list(effect.which), np.zeros(len(self.joints)) + samples.gain_taken
        return samples.gain_std[which], -taken[which]

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

    def convention(self) -> Convention | None:
        """Another reading of the torques, by the URDF's masses, that fits far better."""
        reading = find_reading(self.samples)
        if reading is None:
            return None
        model = JointsModel.fit(reread(self.samples, reading), [e.label for e in self.effects])
        after = held_out(model).rms
        if after > _BETTER * held_out(self).rms:
            return None
        return Convention(reading.name, reading.change, model, after)

    @property
    def too_short(self) -> str:
        """Why a short recording cannot show that nothing is missing."""
        lasts = len(self.samples.time) * self.samples.length
        if lasts >= SHORTEST:
            return ""
        return f"the recording has {lasts:.0f} s of motion; record {SHORTEST:.0f} s at least"

    @property
    def known(self) -> KnownArm:
        """What is kept for later use."""
        left = np.sqrt(np.mean(self.residuals().physical ** 2, axis=0))
        pairs = tuple(zip(self.effects, self.theta, strict=True))
        bodies, noise = (self.link_bodies, self.payload, self.friction), self.effort_std
        return KnownArm(self.joints, *bodies, noise, left, pairs)

    def tempered(self, effects: Sequence[str] = ()) -> JointsModel:
        """Fit with priors that count as much as the residual's independent parts do.

        Args:
            effects: that may be there as well, on all joints: their priors are in the covariance.
        """
        made = [JOINTS.create(name) for name in effects if name not in self.effect_names]
        doubts = [replace(e, named=self.joints) for e in made if isinstance(e, PerJointEffect)]
        zeros = [np.zeros(len(effect.parameters())) for effect in doubts]
        model = self
        if doubts:
            model = self.fitted_from((*self.effects, *doubts), (*self.theta, *zeros)).refined()
        model = replace(model, misfit=model.dispersion)
        return model.fitted_from(model.effects, model.theta)

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
        return are_allowed(self.effect_named(name).parameters(), list(table.values()))

    def parameters(self) -> ParameterTable:
        """Friction of each joint and effects; shapes as they are, in place of logarithms."""
        table = super().parameters()
        for effect in self.effects:
            scales = effect.scales()
            table[effect.name] = {
                scales[key][0] if key in scales else key: in_units(entry, scales.get(key))
                for key, entry in table[effect.name].items()
            }
        return table

    def sentence(self, name: str) -> str:
        """What an effect does, and on which joints."""
        effect = self.effect_named(name)
        where = effect.where(self.joints) if effect in self.effects else ""
        return effect.sentence + f" ({where})" * bool(where)

    def refined(self) -> JointsModel:
        """Fit again with noise, load and friction at what is found."""
        model = self
        for _ in range(_ROUNDS):
            fitted = model.fitted_from(model.effects, model.theta)
            situation = Situation(self.samples, fitted.link_bodies, fitted.payload, fitted.friction)
            white = fitted.residual.reshape(-1, len(fitted.joints))
            effort_std = seen_noise(fitted.samples, fitted.effort_std, white)
            whitening = whitener(fitted.samples, effort_std, situation.friction[0])
            model = replace(fitted, situation=situation, effort_std=effort_std, whitening=whitening)
        return model.fitted_from(model.effects, model.theta)

    def families_of(self, name: str) -> list[Family]:
        """Families of all readings of an effect; those of one group share columns."""
        left = self.lack(self.x, self.effects).reshape(-1, len(self.joints))
        return families_in(JOINTS.create(name), self.situation, left, self.whiten)

    def guess(self, family: Family, coefficients: Array) -> Array:
        """Start of an effect's parameters."""
        return np.asarray(family.source.start(coefficients))

    def residuals(self) -> Residuals:
        """Residuals of each joint, with what the joints that err most did, and the time."""
        samples, white = self.samples, self.residual.reshape(-1, len(self.joints))
        return Residuals(
            time=samples.time,
            white=white,
            physical=self.lack(self.x, self.effects).reshape(-1, len(self.joints)),
            channels=self.joints,
            units=samples.arm.units,
            conditions=conditions_of(samples, white, self._gated_by),
            drivers=np.concatenate([*samples.middle, np.sign(samples.middle[1])], axis=1),
            alone="rigid links and friction",
            about="The model predicts the torques of an arm's drives from its motion: rigid links "
            "near their URDF, a payload, and Coulomb and viscous friction and an offset of each "
            "joint.",
        )

    @property
    def _gated_by(self) -> list[str]:
        """Symbols of the scalars that bound regimes of the effects."""
        regimes = [e.regime for e in self.effects if isinstance(e, GatedJointEffect)]
        return [gate.symbol for regime in regimes for gate in regime.gates]

    @property
    def learned(self) -> Learned:
        """What the recording told, for motions that tell more."""
        friction, bodies = all_columns(self.samples)
        own = self.whiten(np.hstack([friction, bodies @ self.basis.root]))
        columns = np.hstack([own, -self.jacobian[:, len(self.parts) :]])
        stds = [np.full(friction.shape[1], FRICTION_STD), np.ones(bodies.shape[1])]
        prior = np.diag(np.concatenate([*stds, self.prior_stds(self.effects)]) ** -2.0)
        noise = self.effort_std * np.sqrt(self.samples.length / BLOCK)
        information = prior + columns.T @ columns / self.dispersion
        return Learned(self.known, self.basis.root, noise, information)

    def plan_against(self, rivals: Sequence[JointsModel]) -> dict[str, Any] | None:
        """The motion in joint space that refutes rivals, if there is one."""
        names = [rival.effects[-1].name for rival in rivals]
        others = [rival.learned for rival in rivals]
        return plan_separation(self.samples.arm, self.learned, others, names)
