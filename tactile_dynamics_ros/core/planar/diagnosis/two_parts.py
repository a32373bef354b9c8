"""Pushes of two parts, rigidly joined or on a joint, as the diagnosis asks of them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.errors import BadInputError, NotIdentifiableError
from tactile_dynamics_ros.core.planar.diagnosis.fitted import FittedPushes
from tactile_dynamics_ros.core.planar.diagnosis.rows import PushRows, rows_of_two
from tactile_dynamics_ros.core.planar.diagnosis.separating_pair_push import (
    JointedPushes,
    RigidPushes,
)
from tactile_dynamics_ros.core.planar.diagnosis.separating_push import SLIP, Predicted
from tactile_dynamics_ros.core.planar.effects.effect import PushEffect
from tactile_dynamics_ros.core.planar.effects.part import has_law, instances
from tactile_dynamics_ros.core.planar.effects.registry import PUSHED
from tactile_dynamics_ros.core.planar.effects.situation import PlanarMotion
from tactile_dynamics_ros.core.planar.linked.description import remedies
from tactile_dynamics_ros.core.planar.linked.pushes import KnownPair, PairPushes
from tactile_dynamics_ros.core.planar.linked.rows import PairFriction
from tactile_dynamics_ros.core.planar.properties.intervals import Intervals
from tactile_dynamics_ros.core.planar.properties.latent_model import Motion, Sharpness
from tactile_dynamics_ros.core.planar.properties.linked_estimate import TURNED
from tactile_dynamics_ros.core.planar.properties.linked_fit import (
    PairFit,
    final_sharpness,
    fit_jointed,
    fit_rigid,
    refit_pair,
    with_expected_force,
)
from tactile_dynamics_ros.core.planar.properties.linked_model import PairModel
from tactile_dynamics_ros.core.planar.properties.linked_pair import Pair, PairData
from tactile_dynamics_ros.core.planar.properties.linked_rigid import RigidModel
from tactile_dynamics_ros.core.planar.streams import PushedStreams

Index = NDArray[np.intp]


@dataclass(frozen=True, eq=False)
class TwoParts(FittedPushes):
    """A fit of two parts."""

    fit: PairFit

    @classmethod
    def of_streams(
        cls, streams: PushedStreams, effects: Sequence[PushEffect], fit: PairFit | None = None
    ) -> TwoParts:
        """Fit the structure that the motion tells, with effects.

        Args:
            streams: forces, contact points and poses of both.
            effects: of the model.
            fit: of it, if there is one already.

        Raises:
            BadInputError: nothing is touched while poses are known, or an effect has no law for
                these parts.
            NotIdentifiableError: the parts slide too little, or what they are to each other is
                undecided, or they are separate, or the joint has play.
        """
        pair = Pair.of_streams(streams)
        structure = _decided(pair)
        for effect in effects:
            if not has_law(effect, structure):
                raise BadInputError(
                    f"{effect.name}: has no law for {structure} parts, expected one of "
                    + ", ".join(_catalogue(structure))
                )
        fit = fit or (fit_rigid if structure == "rigid" else fit_jointed)(pair, effects)
        return cls(with_expected_force(fit))

    @property
    def structure(self) -> str:
        """What the parts are to each other."""
        return "rigid" if isinstance(self.fit.model, RigidModel) else "jointed"

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the common numbers."""
        return self.fit.model.names

    @property
    def own(self) -> Index:
        """Those of which hardly anything is known before the data."""
        return np.array([self.fit.model.at(name) for name in self.fit.model.unknown])

    @property
    def frictions(self) -> list[tuple[int, int]]:
        """Of each body."""
        return self.fit.model.frictions

    @property
    def catalogue(self) -> tuple[str, ...]:
        """Names of the effects whose law can be stated for these parts."""
        return _catalogue(self.structure)

    def sharp(self, along: float) -> Sharpness:
        """How strictly the model is taken."""
        return final_sharpness(along)

    def rows(self, sharp: Sharpness) -> PushRows:
        """Linearisation."""
        return rows_of_two(self.fit.model, self.fit.nodes, self.fit.common, sharp)

    @cached_property
    def kinematics(self) -> Motion:
        """Motion of the intervals that count."""
        return self.fit.model.motion_of(self.fit.nodes)

    def friction(self, sharp: Sharpness) -> PairFriction:
        """Friction to first order around the motion."""
        return self.fit.model.linear_friction(self.fit.common, self.kinematics, sharp.slip)

    def lack(self, common: Array, effects: tuple[PushEffect, ...], friction: PairFriction) -> Array:
        """(R, D) force, N, torque about the contact, N m, and about the joint."""
        return replace(self.fit.model, effects=effects).lack(self.kinematics, common, friction)

    def delay(self, common: Array, effects: tuple[PushEffect, ...]) -> float:
        """Delay of the stamps of the forces, s."""
        model = replace(self.fit.model, effects=effects)
        return float(np.sum(common[model.delayers]))

    def feet(self) -> Array:
        """Places (R, n, 2) of the points that carry, of both parts, m."""
        model, common = self.fit.model, self.fit.common
        friction = model.linear_friction(common, self.kinematics, SLIP)
        pressed = model.pressed(self.kinematics, common, friction)
        return np.concatenate([body.feet for body in pressed], axis=1)

    def lack_by_shares(self, sharp: Sharpness, shares: Iterable[Array]) -> Array:
        """Change (R, D, K) of `lack` by relative changes of friction (R, n) under the points."""
        model, friction = self.fit.model, self.friction(sharp)
        return model.lack_by_shares(self.kinematics, self.fit.common, friction, shares)

    def motion(self) -> PlanarMotion:
        """Motion of the first body's centroid."""
        model, common = self.fit.model, self.fit.common
        friction = model.linear_friction(common, self.kinematics, SLIP)
        first = model.pressed(self.kinematics, common, friction)[0]
        return model.planar_motion(first.part, first.patch)

    def refitted(
        self, effects: tuple[PushEffect, ...], common: Array, variation: float
    ) -> TwoParts:
        """The same pushes fitted with effects."""
        return TwoParts(refit_pair(self.fit, effects, common, variation))

    def families(self, effect: PushEffect) -> Sequence[PushEffect]:
        """One for each push with which it may begin, and for each part on which it may act."""
        starts = self.intervals.push_starts
        return instances(effect, self.structure, starts) if effect.identifiable else []

    def steady(self) -> Predicted:
        """Both parts in pushes that were not made."""
        model = self.fit.model
        return self._rigid() if isinstance(model, RigidModel) else self._jointed()

    def _rigid(self) -> RigidPushes:
        """They do not turn, so that nothing but the speed has to be foretold."""
        model = self.fit.model
        assert isinstance(model, RigidModel)
        first, second = (patch.outline for patch in model.data.patches)

        def lacking(
            cut: Intervals,
            pose: Array,
            velocity: Array,
            common: Array,
            effects: tuple[PushEffect, ...],
        ) -> Array:
            made = _in_pushes(model, replace(model.data, intervals=cut), effects)
            motion = _lasting(pose, velocity, model.locals)
            return made.lack(motion, common, made.linear_friction(common, motion, SLIP))

        return RigidPushes(
            intervals=model.intervals,
            typical_force=model.typical_force,
            middle=model.middle_place,
            centroid=model.patch.centroid,
            size=model.size,
            lacking=lacking,
            outlines=(first, second),
            offset=model.offset,
            com=model.patch.centroid + self.common[[model.at("com_x"), model.at("com_y")]],
        )

    def _jointed(self) -> JointedPushes:
        """The joint turns; how fast follows from the friction that was found."""
        model, common = self.fit.model, self.common
        gravity = -float(model.data.gravity[2])
        forces = gravity * np.exp([common[product] for product, _ in model.frictions])
        at = [model.at(f"joint_at_{axis}_{k}") for k in (1, 2) for axis in ("x", "y")]
        torque = float(np.exp(common[model.at("ln_joint_torque")]))
        first, second = model.data.patches

        def lacking(
            cut: Intervals,
            pushes: PairPushes,
            velocity: Array,
            common: Array,
            effects: tuple[PushEffect, ...],
        ) -> Array:
            touched, turning = pushes.part.astype(np.float64), np.ones(len(pushes), dtype=bool)
            data = replace(model.data, intervals=cut, touched=touched, turning=turning)
            made = _in_pushes(model, data, effects)
            motion = _lasting(pushes.pose, velocity, model.locals)
            return made.lack(motion, common, made.linear_friction(common, motion, SLIP))

        return JointedPushes(
            intervals=model.intervals,
            typical_force=model.typical_force,
            middle=model.middle_place,
            size=model.size,
            pair=KnownPair((first, second), forces, common[at].reshape(2, 2), torque),
            outlines=(first.outline, second.outline),
            lacking=lacking,
        )


def _in_pushes(model: PairModel, data: PairData, effects: tuple[PushEffect, ...]) -> PairModel:
    """A model of the same parts in intervals that all count, about the same middle."""
    made = replace(model, data=data, effects=effects)
    here = np.arange(len(data.intervals.time))
    made.__dict__.update(middle=here, middle_place=model.middle_place)
    return made


def _lasting(pose: Array, velocity: Array, count: int) -> Motion:
    """Motion without acceleration, where friction is as everywhere."""
    return Motion(pose, velocity, np.zeros_like(pose), np.zeros((len(pose), count)))


def _catalogue(structure: str) -> tuple[str, ...]:
    return tuple(n for n in PUSHED.names() if has_law(PUSHED.create(n), structure))


def _decided(pair: Pair) -> str:
    """What the parts are to each other, where a model of both can be questioned.

    Raises:
        NotIdentifiableError: it is undecided, they are separate, or the joint has play
            or hardly turned.
    """
    structure = pair.structure
    if structure.slack is not None:
        raise NotIdentifiableError(
            f"the parts move as on a joint with play (about {1e3 * structure.slack.play[0]:.1f} "
            "mm), effect loose_joint: `estimate --effects loose_joint` measures it; beside it "
            "nothing else is identifiable, so tighten the joint and push again"
        )
    if structure.name == "undecided":
        told = ", ".join(f"{name} {p:.2f}" for name, p in structure.probability.items())
        action = remedies("undecided", False, (), push=pair.telling_push)[0]
        raise NotIdentifiableError(
            f"what the two parts are to each other is undecided ({told}), and no missing effect "
            f"can be named for a guess: {action}"
        )
    if structure.name == "separate":
        raise NotIdentifiableError(
            "the two parts are separate objects: record each with its own pushes, one by one"
        )
    if structure.name == "jointed" and structure.hinge.turned < TURNED:
        further = remedies("jointed", True, ("link_1.mass",), push=pair.telling_push)
        raise NotIdentifiableError(
            f"the joint turned by {np.degrees(structure.hinge.turned):.1f} degrees only, expected "
            f"{np.degrees(TURNED):.0f}: {further[0]}"
        )
    return structure.name
