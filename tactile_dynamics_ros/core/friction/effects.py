"""What Coulomb's law may lack: effects on the tangential force at which a fingertip slips."""

from __future__ import annotations

from abc import ABC
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.effects.parameter import EffectParameter
from tactile_dynamics_ros.core.effects.registry import CatalogueEntry, EffectRegistry, entry_of
from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.friction.slip_log import SlipTable, slip_scalars
from tactile_dynamics_ros.core.numerics.regime import Regime

REFERENCE_SPEED = 5e-3
"""Speed of sliding at which `velocity_weakening` leaves the kinetic coefficient as it is, m/s; the
slides of a probe have 3 to 14 mm/s. Another one only shifts the coefficient that is reported."""
STATIC, KINETIC = 0, 1
"""Columns of the forces of a slip: just before it began, and while it went on. They number the
arrays of a `SlipTable` and mean nothing elsewhere."""


class FrictionEffect(ABC):
    """Change of the predicted tangential force, mu N times a factor plus a term.

    Attributes:
        name: API name. family: group in the catalogue.
        formula: the law in one line.
        looks_like: one plain sentence on the residual that it leaves.
        sentence: subject and verb for a verdict.
        remedy: what to do about it.
        parameters: theirs; all zero is absent.
    """

    name: ClassVar[str]
    family: ClassVar[str]
    formula: ClassVar[str]
    looks_like: ClassVar[str]
    sentence: ClassVar[str]
    remedy: ClassVar[str]
    parameters: ClassVar[tuple[EffectParameter, ...]]

    def factor(self, slips: SlipTable, theta: Array) -> Array:
        """Factor (N, 2) on mu N."""
        return np.ones_like(slips.normal)

    def term(self, slips: SlipTable, mu: Array, theta: Array) -> Array:
        """Added force (N, 2), N, for coefficients ``mu`` (2,)."""
        return np.zeros_like(slips.normal)

    def curvature(self, slips: SlipTable, mu: Array) -> Array:
        """Columns (N, 2, m) that the effect also fills where it is too large to be linear."""
        return np.zeros((*slips.normal.shape, 0))


def _inside(regime: Regime, slips: SlipTable) -> NDArray[np.bool_]:
    """(N,) slips of a regime.

    Raises:
        BadInputError: slips have no scalar of that symbol.
    """
    known = slip_scalars(slips)

    def values(symbol: str) -> Array:
        if symbol not in known:
            raise BadInputError(f"regime: '{symbol}' is unknown; there are {', '.join(known)}")
        return known[symbol][2]

    return regime.inside(values)


def _gated(effect: FrictionEffect, regime: Regime) -> FrictionEffect:
    """An effect on the slips of a regime, with the name ``name[regime]``."""
    kind = type(effect)

    def factor(self: FrictionEffect, slips: SlipTable, theta: Array) -> Array:
        """Factor of the effect, 1 outside."""
        acts = _inside(regime, slips)[:, None]
        return np.where(acts, kind.factor(self, slips, theta), 1.0)

    def term(self: FrictionEffect, slips: SlipTable, mu: Array, theta: Array) -> Array:
        """Term of the effect, 0 outside."""
        return np.where(_inside(regime, slips)[:, None], kind.term(self, slips, mu, theta), 0.0)

    def curvature(self: FrictionEffect, slips: SlipTable, mu: Array) -> Array:
        """Columns of the effect, 0 outside."""
        acts = _inside(regime, slips)[:, None, None]
        return np.where(acts, kind.curvature(self, slips, mu), 0.0)

    body = {"factor": factor, "term": term, "curvature": curvature}
    name = f"{effect.name}[{regime}]"
    gated: FrictionEffect = type("Gated" + kind.__name__, (kind,), {**body, "name": name})()
    return gated


FRICTION: EffectRegistry[FrictionEffect] = EffectRegistry("friction", gate=_gated)
"""Effects that Coulomb's law of a probed surface may lack. Without it the diagnosis of a surface
has no effects to name."""


@FRICTION.register
class Adhesion(FrictionEffect):
    """The skin sticks to the surface as if an extra force pressed it on."""

    name = "adhesion"
    family = "surface"
    formula = "T = mu (N + A)"
    looks_like = (
        "The forces at slip exceed mu N by the same amount whether the finger presses hard or not."
    )
    sentence = "the skin sticks as if an extra normal force pressed it on"
    remedy = (
        "Clean the surface and the skin, or count on the coefficient at the force with "
        "which you grip."
    )
    parameters = (EffectParameter("A", "N", 0.3, "extra normal force"),)

    def term(self, slips: SlipTable, mu: Array, theta: Array) -> Array:
        """Mu A."""
        return np.broadcast_to(mu * theta[0], slips.normal.shape)


@FRICTION.register
class LoadDependentFriction(FrictionEffect):
    """A soft sphere's contact area grows with less than the load: mu ~ N^-p, p = 1/3 for Hertz."""

    name = "load_dependent_friction"
    family = "surface"
    formula = "mu ~ (N / 1 N)^-p"
    looks_like = "Hard presses slip at a lower ratio of the forces than light ones."
    sentence = "the coefficient falls as the fingertip presses harder"
    remedy = "Use the coefficient at the normal force of the grasp, not the mean of all."
    parameters = (EffectParameter("p", "", 0.3, "power of the load, 1/3 for a soft sphere"),)

    def factor(self, slips: SlipTable, theta: Array) -> Array:
        """N^-p."""
        return np.asarray(np.maximum(slips.normal, 0.02) ** -theta[0])


@FRICTION.register
class VelocityWeakening(FrictionEffect):
    """Sliding friction falls with the logarithm of the speed."""

    name = "velocity_weakening"
    family = "surface"
    formula = "mu_k = mu_0 (1 - w ln(v / 5 mm/s))"
    looks_like = "Fast slides need less force than slow ones; the forces at slip are explained."
    sentence = "friction falls as the fingertip slides faster"
    remedy = "Compare slides of one speed, or state the speed with the coefficient."
    parameters = (
        EffectParameter("w", "", 0.2, "share of the coefficient lost for each e-fold of the speed"),
    )

    def factor(self, slips: SlipTable, theta: Array) -> Array:
        """Of the sliding force alone."""
        factor = np.ones_like(slips.normal)
        factor[:, KINETIC] = 1.0 - theta[0] * np.log(slips.speed / REFERENCE_SPEED)
        return factor


@FRICTION.register
class AnisotropicFriction(FrictionEffect):
    """Friction along the grain differs from that across it."""

    name = "anisotropic_friction"
    family = "surface"
    formula = "mu (1 + a cos 2 phi + b sin 2 phi)"
    looks_like = (
        "The ratio of the forces rises and falls twice a turn with the direction of the pull."
    )
    sentence = "the surface holds better along one direction than across it"
    remedy = "Probe along and across the grain and grip along the direction that holds."
    parameters = (
        EffectParameter("a", "", 0.15, "share that goes with cos 2 phi"),
        EffectParameter("b", "", 0.15, "share that goes with sin 2 phi"),
    )

    def factor(self, slips: SlipTable, theta: Array) -> Array:
        """Second harmonic of the direction."""
        twice = 2.0 * slips.angle
        wave = 1.0 + theta[0] * np.cos(twice) + theta[1] * np.sin(twice)
        return np.repeat(wave[:, None], 2, axis=1)


@FRICTION.register
class NormalMisalignment(FrictionEffect):
    """The surface is turned against the mesh: slips need more force one way than the other."""

    name = "normal_misalignment"
    family = "geometry"
    formula = "T = N tan(atan mu + t_1 cos phi + t_2 sin phi)"
    looks_like = "Slips one way need more force than the opposite way, once a turn."
    sentence = "the contact normal is not where the mesh says"
    remedy = "Correct the mesh or the pose of the object; opposite slips cancel the error."
    parameters = (
        EffectParameter("t_1", "rad", 0.2, "lean of the normal along phi = 0"),
        EffectParameter("t_2", "rad", 0.2, "lean of the normal along phi = 90 deg"),
    )

    def term(self, slips: SlipTable, mu: Array, theta: Array) -> Array:
        """What a cone that leans towards the pull bears more."""
        lean = theta[0] * np.cos(slips.angle) + theta[1] * np.sin(slips.angle)
        slope = np.tan(np.clip(np.arctan(mu) + lean[:, None], -1.4, 1.4))
        return np.asarray(slips.normal * (slope - mu))

    def curvature(self, slips: SlipTable, mu: Array) -> Array:
        """The square of a lean has the second harmonic and a constant, which mu takes up."""
        twice = np.stack([np.cos(2.0 * slips.angle), np.sin(2.0 * slips.angle)], axis=-1)
        return np.asarray((mu * slips.normal)[..., None] * twice[:, None, :])


@FRICTION.register
class SkinCreep(FrictionEffect):
    """The measured force carries a share of what pressed before: f = f_true + c memory."""

    name = "skin_creep"
    family = "sensor"
    formula = "f_measured = f + c memory(f)"
    looks_like = (
        "The ratio of the forces differs between slips soon after a hard press and those "
        "after a rest."
    )
    sentence = "the skin creeps, so that the sensor still feels part of what pressed before"
    remedy = "Let the finger rest before a slip, or model the memory of the skin."
    parameters = (
        EffectParameter("c", "", 0.15, "share of the remembered force in what is measured"),
    )

    def term(self, slips: SlipTable, mu: Array, theta: Array) -> Array:
        """C (memory of T - mu memory of N)."""
        memory = slips.memory_tangential[:, None] - mu * slips.memory_normal[:, None]
        return np.asarray(theta[0] * memory)


def describe_friction_effect(name: str) -> CatalogueEntry:
    """Entry of an effect in the catalogue."""
    effect = FRICTION.create(name)
    return entry_of(effect, FRICTION.model, effect.parameters, (name,))
