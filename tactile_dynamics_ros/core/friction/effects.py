"""What Coulomb's law may lack: effects on the tangential force at which a fingertip slips."""

from __future__ import annotations

from abc import ABC
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.friction.slip_table import SlipTable

Array = NDArray[np.float64]

REFERENCE_SPEED = 5e-3
STATIC, KINETIC = 0, 1


@dataclass(frozen=True)
class EffectParameter:
    """One parameter of an effect; zero is absent.

    Attributes:
        name: of it. unit: SI. prior_std: typical size.
    """

    name: str
    unit: str
    prior_std: float


class FrictionEffect(ABC):
    """Change of the predicted tangential force, mu N times a factor plus a term.

    Attributes:
        name: of the effect. formula: what it is. sentence: what it does, as a clause.
        parameters: theirs; all zero is absent.
    """

    name: ClassVar[str]
    formula: ClassVar[str]
    sentence: ClassVar[str]
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


class Adhesion(FrictionEffect):
    """The skin sticks to the surface as if an extra force pressed it on."""

    name = "adhesion"
    formula = "T = mu (N + A)"
    sentence = "the skin sticks as if an extra normal force pressed it on"
    parameters = (EffectParameter("A", "N", 0.3),)

    def term(self, slips: SlipTable, mu: Array, theta: Array) -> Array:
        """Mu A."""
        return np.broadcast_to(mu * theta[0], slips.normal.shape)


class LoadDependentFriction(FrictionEffect):
    """A soft sphere's contact area grows with less than the load: mu ~ N^-p, p = 1/3 for Hertz."""

    name = "load_dependent_friction"
    formula = "mu ~ (N / 1 N)^-p"
    sentence = "the coefficient falls as the fingertip presses harder"
    parameters = (EffectParameter("p", "", 0.3),)

    def factor(self, slips: SlipTable, theta: Array) -> Array:
        """N^-p."""
        return np.asarray(np.maximum(slips.normal, 0.02) ** -theta[0])


class VelocityWeakening(FrictionEffect):
    """Sliding friction falls with the logarithm of the speed."""

    name = "velocity_weakening"
    formula = "mu_k = mu_0 (1 - w ln(v / 5 mm/s))"
    sentence = "friction falls as the fingertip slides faster"
    parameters = (EffectParameter("w", "", 0.2),)

    def factor(self, slips: SlipTable, theta: Array) -> Array:
        """Of the sliding force alone."""
        factor = np.ones_like(slips.normal)
        factor[:, KINETIC] = 1.0 - theta[0] * np.log(slips.speed / REFERENCE_SPEED)
        return factor


class AnisotropicFriction(FrictionEffect):
    """Friction along the grain differs from that across it."""

    name = "anisotropic_friction"
    formula = "mu (1 + a cos 2 phi + b sin 2 phi)"
    sentence = "the surface holds better along one direction than across it"
    parameters = (EffectParameter("a", "", 0.15), EffectParameter("b", "", 0.15))

    def factor(self, slips: SlipTable, theta: Array) -> Array:
        """Second harmonic of the direction."""
        twice = 2.0 * slips.angle
        wave = 1.0 + theta[0] * np.cos(twice) + theta[1] * np.sin(twice)
        return np.repeat(wave[:, None], 2, axis=1)


class NormalMisalignment(FrictionEffect):
    """The surface is turned against the mesh: slips need more force one way than the other."""

    name = "normal_misalignment"
    formula = "T = N tan(atan mu + t_1 cos phi + t_2 sin phi)"
    sentence = "the contact normal is not where the mesh says"
    parameters = (EffectParameter("t_1", "rad", 0.2), EffectParameter("t_2", "rad", 0.2))

    def term(self, slips: SlipTable, mu: Array, theta: Array) -> Array:
        """What a cone that leans towards the pull bears more."""
        lean = theta[0] * np.cos(slips.angle) + theta[1] * np.sin(slips.angle)
        slope = np.tan(np.clip(np.arctan(mu) + lean[:, None], -1.4, 1.4))
        return np.asarray(slips.normal * (slope - mu))

    def curvature(self, slips: SlipTable, mu: Array) -> Array:
        """The square of a lean has the second harmonic and a constant, which mu takes up."""
        twice = np.stack([np.cos(2.0 * slips.angle), np.sin(2.0 * slips.angle)], axis=-1)
        return np.asarray((mu * slips.normal)[..., None] * twice[:, None, :])


class SkinCreep(FrictionEffect):
    """The measured force carries a share of what pressed before: f = f_true + c memory."""

    name = "skin_creep"
    formula = "f_measured = f + c memory(f)"
    sentence = "the skin creeps, so that the sensor still feels part of what pressed before"
    parameters = (EffectParameter("c", "", 0.15),)

    def term(self, slips: SlipTable, mu: Array, theta: Array) -> Array:
        """C (memory of T - mu memory of N)."""
        memory = slips.memory_tangential[:, None] - mu * slips.memory_normal[:, None]
        return np.asarray(theta[0] * memory)


CATALOGUE: dict[str, FrictionEffect] = {
    effect.name: effect
    for effect in (
        Adhesion(),
        LoadDependentFriction(),
        VelocityWeakening(),
        AnisotropicFriction(),
        NormalMisalignment(),
        SkinCreep(),
    )
}


def friction_effect(name: str) -> FrictionEffect:
    """Return an effect by its name.

    Raises:
        BadInputError: there is no such effect.
    """
    if name not in CATALOGUE:
        raise BadInputError(
            f"effect '{name}' is none of friction: expected one of {', '.join(CATALOGUE)}"
        )
    return CATALOGUE[name]
