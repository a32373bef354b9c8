"""Effects of the table: how it leans, and how its friction differs from one coefficient."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.effects.parameter import EffectParameter
from tactile_dynamics_ros.core.planar.effects.effect import PushEffect
from tactile_dynamics_ros.core.planar.effects.registry import PUSHED
from tactile_dynamics_ros.core.planar.effects.situation import PlanarMotion, Situation

_HALF_SPEED = 0.05
"""Typical speed at which half of what `velocity_weakening` takes away is gone, m/s: of plastic and
wood. It is only where the fit begins and the middle of what is plausible."""
_LEAST_FACTOR = 0.05
"""Least share of friction that effects of the table leave: a law far from where it was fitted must
not make friction push. No fit to data comes near it."""


def scaled(factor: Array) -> Array:
    """Matrices (R, 2, 2) of factors (R,)."""
    return np.asarray(np.maximum(factor, _LEAST_FACTOR)[:, None, None] * np.eye(2))


@PUSHED.register
class SupportTilt(PushEffect):
    """The table leans: gravity pulls the object to one side."""

    name = "support_tilt"
    family = "support"
    formula = "force m g (t_x, t_y)"
    looks_like = "Pushes one way need less force than pushes the opposite way, by twice m g sin."
    sentence = "the table leans"
    remedy = "Level the table, or tell its normal in /support/pose."
    parameters = (
        EffectParameter("t_x", "rad", 0.1, "lean towards x: down where x grows", 0.035),
        EffectParameter("t_y", "rad", 0.1, "lean towards y: down where y grows", 0.035),
    )
    of_parts = True

    def changed(self, situation: Situation, theta: Array) -> Situation:
        """Gravity with horizontal components."""
        size = float(np.linalg.norm(situation.gravity))
        flat = situation.gravity[:2] + size * theta
        down = -np.sqrt(max(size**2 - float(flat @ flat), 0.25 * size**2))
        return replace(situation, gravity=np.append(flat, down))


@PUSHED.register
class ViscousSupport(PushEffect):
    """Beside dry friction something between object and table resists in proportion to speed."""

    name = "viscous_support"
    family = "support"
    formula = "force -c v, torque -c r^2 omega, r radius of gyration of the footprint"
    looks_like = "Fast pushes need more force than slow ones, in proportion to the speed."
    sentence = "a film between object and table resists the faster it slides"
    remedy = "Clean and dry the table; keep the term if the film belongs to the task."
    parameters = (EffectParameter("c", "N s/m", 10.0, "force over speed", 3.0, least=0.0),)
    of_parts = True

    def wrench(self, motion: PlanarMotion, theta: Array) -> Array:
        """-c (v, r^2 omega)."""
        turning = motion.gyration * motion.rate
        return np.asarray(-theta[0] * np.column_stack([motion.velocity, turning]))


@PUSHED.register
class VelocityWeakening(PushEffect):
    """Friction falls with speed: mu (1 - a v / (v + v_half))."""

    name = "velocity_weakening"
    family = "support"
    formula = "mu (1 - a v / (v + 0.05 m/s exp(b)))"
    looks_like = "Fast pushes need less force than slow ones, and less and less so."
    sentence = "friction falls with speed"
    remedy = "Push at the speed at which the coefficient is wanted, or keep the law."
    parameters = (
        EffectParameter("a", "", 0.5, "share that is lost at high speed", 0.2, least=0.0),
        EffectParameter("b", "", 0.7, "logarithm of the speed of half the loss over 0.05 m/s", 0.3),
    )
    of_parts = True

    def friction(self, motion: PlanarMotion, theta: Array) -> Array:
        """Factor by speed."""
        half = _HALF_SPEED * np.exp(theta[1])
        return scaled(1.0 - theta[0] * motion.speed / (motion.speed + half))


@PUSHED.register
class AnisotropicSupport(PushEffect):
    """Friction along the grain of the table differs from that across it."""

    name = "anisotropic_support"
    family = "support"
    formula = "friction times [[1 + a, b], [b, 1 - a]], axes of the table"
    looks_like = "Force rises and falls twice a turn with the direction of the push."
    sentence = "the table resists more along one direction than across it"
    remedy = "Push along and across the grain, or keep the law."
    parameters = (
        EffectParameter("a", "", 0.3, "share by which x resists more, and y less", 0.12),
        EffectParameter("b", "", 0.3, "the same of the diagonals", 0.12),
    )
    of_parts = True

    def friction(self, motion: PlanarMotion, theta: Array) -> Array:
        """One matrix for all."""
        a, b = theta
        return np.broadcast_to(np.array([[1 + a, b], [b, 1 - a]]), (len(motion.yaw), 2, 2))


@PUSHED.register
class FrictionGradient(PushEffect):
    """Friction rises over the table."""

    name = "friction_gradient"
    family = "support"
    formula = "mu (1 + g . p), p from the middle of the recording"
    looks_like = "The same push needs more force on one side of the table than on the other."
    sentence = "friction rises over the places that were pushed"
    remedy = "Push over more of the table to see whether it goes on; keep the slope if it does."
    parameters = (
        EffectParameter("g_x", "1/m", 2.0, "relative rise of friction along x", 0.8),
        EffectParameter("g_y", "1/m", 2.0, "relative rise of friction along y", 0.8),
    )
    of_parts = True

    def friction(self, motion: PlanarMotion, theta: Array) -> Array:
        """Factor by place."""
        return scaled(1.0 + motion.away @ theta)

    def rise(self, motion: PlanarMotion, theta: Array) -> Array:
        """The side of the object that lies higher up resists more."""
        factor = np.maximum(1.0 + motion.away @ theta, _LEAST_FACTOR)
        return np.asarray(theta / factor[:, None])


@PUSHED.register
class ConcentratedPressure(PushEffect):
    """The object rests on its rim, on feet or on its middle, not evenly."""

    name = "concentrated_pressure"
    family = "support"
    formula = "points that carry are exp(s) times as far from the middle as the footprint's"
    looks_like = "Turning resists more (rim, feet) or less (middle) than an even face would."
    sentence = "the object does not rest on its face evenly"
    remedy = "Keep the scale of the part that carries."
    parameters = (EffectParameter("s", "", 0.5, "ln of the size of the part that carries", 0.2),)
    of_parts = True
    adds_to = "ln_scale"


@PUSHED.register
class FrictionChange(PushEffect):
    """Friction changes at one time: dust, a liquid, another table."""

    name = "friction_change"
    family = "support"
    formula = "mu (1 + d) from one time on"
    looks_like = "From one push on, all pushes need more force, or less."
    sentence = "friction changed at one time"
    remedy = "Estimate before and after separately."
    parameters = (EffectParameter("d", "", 0.5, "relative change of friction", 0.2, least=-0.9),)
    of_parts = True
    sudden = True

    def friction(self, motion: PlanarMotion, theta: Array) -> Array:
        """Factor by time."""
        return scaled(1.0 + theta[0] * self.since(motion.time))
