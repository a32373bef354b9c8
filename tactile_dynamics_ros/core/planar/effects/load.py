"""Effects on the object: springs, cables, hands and a load that changes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.effects.parameter import EffectParameter
from tactile_dynamics_ros.core.planar.effects.effect import PushEffect
from tactile_dynamics_ros.core.planar.effects.registry import PUSHED
from tactile_dynamics_ros.core.planar.effects.situation import PlanarMotion, Situation
from tactile_dynamics_ros.core.planar.mechanics.linkage import cross, turned

SPAN = 0.05
"""Arm at which the families of forces at points of the object are computed, m: half a small object.
Families are linear in it, so that another one changes nothing but rounding."""


_REACH = 0.1
"""Distance over which an object is pushed, m, by which the torques of a spring and of a pull are
weighed for the start of a fit; another one begins it elsewhere and ends in the same place."""
_LEAST_PULL = 0.01
"""Pull below which its point means nothing, N: a third of the noise of one force. The fit then
begins at the centroid."""


def at_point(force: Array, point: Array, yaw: Array) -> Array:
    """Wrench (R, 3) about the centroid of forces (R, 2) at a point (2,) m of the object."""
    arm = turned(np.broadcast_to(point, force.shape), yaw)
    return np.column_stack([force, cross(arm, force)])


def _point(
    pull: Array, torques: Array, stiffness: float = 0.0, springs: Array | None = None
) -> Array:
    """Point (2,) m of the object at which a pull and a spring have the torques that are seen.

    A pull along x at (s, 0) and (0, s) has torques by the sine and cosine of the yaw; coefficients
    t of these are [[f_x, f_y], [-f_y, f_x]] b = s t, those of springs there k b = s u.

    Args:
        pull: (2,) f, N.
        torques: (2,) t.
        stiffness: k, N/m.
        springs: (2,) u.
    """
    matrix = np.array([[pull[0], pull[1]], [-pull[1], pull[0]]])
    shares = np.zeros(2) if springs is None else springs
    size = float(pull @ pull) + (stiffness * _REACH) ** 2
    if size < _LEAST_PULL**2:
        return np.zeros(2)
    seen = matrix.T @ torques + stiffness * _REACH**2 * shares
    return np.asarray(SPAN * seen / size)


@PUSHED.register
class TetherSpring(PushEffect):
    """A spring from the table to a point of the object."""

    name = "tether_spring"
    family = "environment"
    formula = "force f - k p at a point b, p from the middle of the recording"
    looks_like = "The object is pulled the more the farther it is pushed from one place."
    sentence = "something elastic ties the object to one place"
    remedy = "Free the object, or keep the spring."
    parameters = (
        EffectParameter("k", "N/m", 20.0, "stiffness", 5.0, least=0.0),
        EffectParameter("f_x", "N", 2.0, "pull in the middle of the recording", 0.4),
        EffectParameter("f_y", "N", 2.0, "pull in the middle of the recording", 0.4),
        EffectParameter("b_x", "m", 0.1, "point of the object from its centroid", 0.02),
        EffectParameter("b_y", "m", 0.1, "point of the object from its centroid", 0.02),
    )

    def wrench(self, motion: PlanarMotion, theta: Array) -> Array:
        """F = f - k (p + R b) at b."""
        point = turned(np.broadcast_to(theta[3:], motion.place.shape), motion.yaw)
        force = theta[1:3] - theta[0] * (motion.away + point)
        return at_point(force, theta[3:], motion.yaw)

    def family_thetas(self) -> Array:
        """Spring and pulls at the centroid, and at two points beside it."""
        rows = [(k, x, y, 0.0, 0.0) for k, x, y in np.eye(3)]
        rows += [(1.0, 0.0, 0.0, SPAN, 0.0), (1.0, 0.0, 0.0, 0.0, SPAN)]
        rows += [(0.0, 1.0, 0.0, SPAN, 0.0), (0.0, 1.0, 0.0, 0.0, SPAN)]
        return np.array(rows)

    def guess(self, coefficients: Array) -> Array:
        """Point from the torques, in the sense of least squares."""
        c = coefficients
        stiffness = max(c[0] + c[3] + c[4], 0.1)
        pull = np.array([c[1] + c[5] + c[6], c[2]])
        return np.array([stiffness, *pull, *_point(pull, c[5:7], stiffness, c[3:5])])


@PUSHED.register
class ConstantPull(PushEffect):
    """A cable pulls at a point of the object, always the same way."""

    name = "constant_pull"
    family = "environment"
    formula = "force f at a point b of the object, axes of the table"
    looks_like = "Pushes one way need less force than the opposite way, and the object turns."
    sentence = "something pulls at the object, always the same way"
    remedy = "Free the cable, or keep the pull."
    parameters = (
        EffectParameter("f_x", "N", 2.0, "pull", 0.3),
        EffectParameter("f_y", "N", 2.0, "pull", 0.3),
        EffectParameter("b_x", "m", 0.1, "point of the object from its centroid", 0.02),
        EffectParameter("b_y", "m", 0.1, "point of the object from its centroid", 0.02),
    )

    def wrench(self, motion: PlanarMotion, theta: Array) -> Array:
        """F at b."""
        force = np.broadcast_to(theta[:2], motion.place.shape)
        return at_point(force, theta[2:], motion.yaw)

    def family_thetas(self) -> Array:
        """Pulls at the centroid, and at two points beside it."""
        rows = [(1.0, 0.0, 0.0, 0.0), (0.0, 1.0, 0.0, 0.0)]
        rows += [(1.0, 0.0, SPAN, 0.0), (1.0, 0.0, 0.0, SPAN)]
        return np.array(rows)

    def guess(self, coefficients: Array) -> Array:
        """Point from the torques, in the sense of least squares."""
        pull = np.array([coefficients[0] + coefficients[2] + coefficients[3], coefficients[1]])
        return np.array([*pull, *_point(pull, coefficients[2:4])])


@PUSHED.register
class UnsensedContact(PushEffect):
    """Something that moves with the object pushes at it: a second finger, a hose it carries."""

    name = "unsensed_contact"
    family = "environment"
    formula = "force and torque constant in axes of the object"
    looks_like = "The missing force turns with the object."
    sentence = "something that moves along pushes at the object, unsensed"
    remedy = "Remove it, or give it a sensor."
    parameters = (
        EffectParameter("f_x", "N", 2.0, "force, axes of the object", 0.3),
        EffectParameter("f_y", "N", 2.0, "force, axes of the object", 0.3),
        EffectParameter("torque", "N m", 0.1, "torque about the footprint's centroid", 0.01),
    )

    def wrench(self, motion: PlanarMotion, theta: Array) -> Array:
        """Turned with the object."""
        force = turned(np.broadcast_to(theta[:2], motion.place.shape), motion.yaw)
        return np.column_stack([force, np.full(len(force), theta[2])])


@PUSHED.register
class LoadChange(PushEffect):
    """The load changes at one time: something is put on, taken off, or spilled."""

    name = "load_change"
    family = "load"
    formula = "mass m (1 + d) and centre of mass + s, from one time on"
    looks_like = "From one push on all pushes need more force, and the object turns otherwise."
    sentence = "the load changed at one time"
    remedy = "Estimate before and after separately."
    parameters = (
        EffectParameter("d", "", 0.5, "relative change of the mass", 0.2, least=-0.9),
        EffectParameter("s_x", "m", 0.02, "shift of the centre of mass, axes of the link", 0.004),
        EffectParameter("s_y", "m", 0.02, "shift of the centre of mass, axes of the link", 0.004),
    )
    sudden = True

    def changed(self, situation: Situation, theta: Array) -> Situation:
        """Mass and centre of mass by time."""
        after = self.since(situation.time)
        return replace(
            situation,
            mass=situation.mass * np.maximum(1.0 + theta[0] * after, 0.1),
            com=situation.com + after[:, None] * theta[1:],
        )
