"""Effects of single drives: friction beyond Coulomb and viscous, gears, torque sensors."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import ClassVar

import numpy as np

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.effects.parameter import EffectParameter
from tactile_dynamics_ros.core.joints.effects import JOINTS, JointReading, ReadingGroup
from tactile_dynamics_ros.core.joints.per_joint import PerJointEffect
from tactile_dynamics_ros.core.joints.samples import JointSamples
from tactile_dynamics_ros.core.joints.situation import Situation

_RIPPLES = np.arange(6.0, 341.0)
"""Waves per turn of a joint that are tried: from what no rigid body or payload makes (1 and 2 a
turn, with room) to two for each turn of a motor behind a gear of 160, the most of usual arms."""

_ROUNDED = 0.02
"""Rounding of the corner at which play ends, as a share of its width: derivatives stay smooth. It
changes torques there by a hundredth; without it fits of the width stop at samples."""
_FAR = 10.0
"""Widths of a play beyond which a joint is far from its last reversal; play has long ended."""


@JOINTS.register
@dataclass(frozen=True)
class StribeckFriction(PerJointEffect):
    """Friction rises towards standstill, where the lubricant's film breaks down."""

    name = "stribeck_friction"
    regional = True
    family = "friction"
    formula = "F exp(-(q'/v)^2) sign(q')"
    looks_like = "Slow motion needs more torque than Coulomb and viscous friction say."
    sentence = "friction rises towards standstill"
    remedy = "Add it to the friction model, or leave slow motion out of identification."
    amplitudes: ClassVar = (EffectParameter("F", "N m", 2.0, "extra friction at standstill", 1.0),)
    shape: ClassVar = EffectParameter("v", "rad/s", 0.1, "the speed at which it has faded")
    grid: ClassVar = (0.04, 0.08, 0.16)

    def column(self, situation: Situation, joint: int, shape: float) -> Array:
        """Mean of the law over each block."""
        samples = situation.samples
        slow = np.exp(-((samples.dq[:, :, joint] / shape) ** 2))
        return np.asarray(np.mean(slow * samples.direction[:, :, joint], axis=1)[:, None])


@JOINTS.register
@dataclass(frozen=True)
class LoadDependentFriction(PerJointEffect):
    """Gears and bearings rub more under load."""

    name = "load_dependent_friction"
    regional = True
    family = "friction"
    formula = "c |tau_load| sign(q')"
    looks_like = "Friction is larger where gravity loads the joint, in either direction."
    sentence = "friction grows with the load on the gear"
    remedy = "Add it: otherwise a payload looks lighter on the way down than on the way up."
    amplitudes: ClassVar = (EffectParameter("c", "", 0.1, "friction over load", 0.05, least=0.0),)

    def column(self, situation: Situation, joint: int, shape: float) -> Array:
        """Mean of |load| times direction over each block."""
        load = np.abs(situation.load[:, :, joint])
        return np.asarray(np.mean(load * situation.samples.direction[:, :, joint], axis=1)[:, None])


@JOINTS.register
@dataclass(frozen=True)
class DirectionalFriction(PerJointEffect):
    """Viscous friction differs between the directions."""

    name = "directional_friction"
    regional = True
    family = "friction"
    formula = "d |q'|"
    looks_like = "Fast motion one way needs more torque than the same motion back."
    sentence = "viscous friction differs between the two directions"
    remedy = "Give each direction a coefficient of its own."
    amplitudes: ClassVar = (
        EffectParameter("d", "N m s/rad", 2.0, "half of the difference of the coefficients", 1.0),
    )

    def column(self, situation: Situation, joint: int, shape: float) -> Array:
        """Mean of |speed| over each block."""
        return np.asarray(np.mean(np.abs(situation.samples.dq[:, :, joint]), axis=1)[:, None])


@JOINTS.register
@dataclass(frozen=True)
class RotorInertia(PerJointEffect):
    """The rotor behind the gear is accelerated too; URDFs leave it out."""

    name = "rotor_inertia"
    family = "drive"
    formula = "J q''"
    looks_like = "Torque in excess in proportion to the joint's own acceleration, in any pose."
    sentence = "the rotor behind the gear has inertia of its own"
    remedy = "Add the rotor's inertia times the square of the gear ratio to the joint's model."
    amplitudes: ClassVar = (
        EffectParameter("J", "kg m^2", 1.0, "inertia of the rotor at the joint", 0.2, least=0.0),
    )

    def column(self, situation: Situation, joint: int, shape: float) -> Array:
        """Mean acceleration of each block."""
        return np.asarray(situation.samples.ddq[:, :, joint].mean(axis=1)[:, None])


@JOINTS.register
@dataclass(frozen=True)
class JointElasticity(PerJointEffect):
    """Gears wind up under load, and the encoders sit on the motors' side.

    The links are at q - c tau; torques are those of the rigid bodies there, to first order in c.
    """

    name = "joint_elasticity"
    family = "drive"
    formula = "tau(q - c tau, ...) - tau(q, ...)"
    looks_like = "Errors follow the load and its second derivative in all joints further in."
    sentence = "gears wind up under load, so that links are not where the encoders say"
    remedy = "Use encoders behind the gears, or correct positions by torque over stiffness."
    amplitudes: ClassVar = (
        EffectParameter("c", "rad s^2/kg m^2", 1e-3, "compliance, rad per N m", 1e-4, least=0.0),
    )

    def column(self, situation: Situation, joint: int, shape: float) -> Array:
        """On its own joint only; `_columns` and `torque` have the others."""
        return situation.wound_up[:, joint, joint, None]

    def torque(self, situation: Situation, theta: Array) -> Array:
        """Change of all torques by the wound-up joints."""
        return np.asarray(self.jacobian(situation, theta) @ theta)

    def jacobian(self, situation: Situation, theta: Array) -> Array:
        """Derivative of all torques by each joint's compliance."""
        return situation.wound_up[:, :, list(self.which)]

    def _columns(self, situation: Situation, shape: float) -> Array:
        return situation.wound_up


@JOINTS.register
@dataclass(frozen=True)
class Backlash(PerJointEffect):
    """Play: after a reversal friction turns only once a width has been travelled."""

    name = "backlash"
    family = "drive"
    formula = "-F (1 - s/w) sign(q') while the travel s since a reversal is below w"
    looks_like = "Torque is missing just after each reversal, over the same angle."
    sentence = "after each reversal play is crossed before friction turns"
    remedy = "Have the gear adjusted, approach poses from one side, or leave reversals out."
    amplitudes: ClassVar = (
        EffectParameter("F", "N m", 4.0, "torque that is missing at a reversal", 1.0, least=0.0),
    )
    shape: ClassVar = EffectParameter("w", "rad", 0.05, "width of the play")
    grid: ClassVar = (0.02, 0.05, 0.12)

    def column(self, situation: Situation, joint: int, shape: float) -> Array:
        """Mean over each block."""
        samples = situation.samples
        left = 1.0 - np.minimum(samples.since_reversal[:, :, joint] / shape, _FAR)
        missing = 0.5 * (left + np.sqrt(left**2 + _ROUNDED**2))
        return np.asarray(-np.mean(missing * np.sign(samples.dq[:, :, joint]), axis=1)[:, None])


@JOINTS.register
@dataclass(frozen=True)
class TorqueDrift(PerJointEffect):
    """The zero of a torque sensor, or of a current, wanders."""

    name = "torque_drift"
    family = "sensor"
    formula = "r (t - t_middle)"
    looks_like = "The error of a joint grows steadily with time, whatever the arm does."
    sentence = "the zero of the torque wanders with time"
    remedy = "Let the drive warm up, and zero its torque before each recording."
    amplitudes: ClassVar = (EffectParameter("r", "N m/s", 0.1, "rate of the offset", 0.02),)

    def column(self, situation: Situation, joint: int, shape: float) -> Array:
        """Time from the middle of the recording."""
        time = situation.samples.time
        return np.asarray((time - 0.5 * (time[0] + time[-1]))[:, None])


@JOINTS.register
@dataclass(frozen=True)
class TorqueGain(PerJointEffect):
    """A torque reads too much or too little, or the constant of a motor is another."""

    name = "torque_gain"
    family = "sensor"
    formula = "g tau"
    looks_like = "One joint's error is proportional to its torque, bodies and friction alike."
    sentence = "the torque reads too much by a factor"
    remedy = "Calibrate the drive with a known load (`estimate` of a pair of recordings)."
    amplitudes: ClassVar = (EffectParameter("g", "", 0.3, "share that is read too much", 0.1),)

    def column(self, situation: Situation, joint: int, shape: float) -> Array:
        """Torque of the model."""
        return situation.total[:, joint, None]


@JOINTS.register
@dataclass(frozen=True)
class TorqueRipple(PerJointEffect):
    """Cogging of the motor, teeth of the gear, or an eccentric sensor: waves along the angle."""

    name = "torque_ripple"
    family = "drive"
    formula = "a cos(k q) + b sin(k q)"
    looks_like = "The error is a wave along the joint's angle, at any speed."
    sentence = "torque rises and falls with the angle of the motor or the gear"
    remedy = "Compensate it by a table over the angle, or average over whole waves."
    amplitudes: ClassVar = (
        EffectParameter("a", "N m", 2.0, "size of the cosine", 0.5),
        EffectParameter("b", "N m", 2.0, "size of the sine", 0.5),
    )
    grid: ClassVar = tuple(float(k) for k in _RIPPLES)
    searched: ClassVar = len(_RIPPLES)

    def column(self, situation: Situation, joint: int, shape: float) -> Array:
        """Mean wave of each block."""
        phase = shape * situation.samples.q[:, :, joint]
        return np.stack([np.cos(phase).mean(axis=1), np.sin(phase).mean(axis=1)], axis=1)

    def groups_for(self, situation: Situation, residual: Array) -> list[ReadingGroup]:
        """One reading for each joint: the waves that its residual (K, n) follows best."""
        names, found = situation.samples.arm.names, []
        for j, name in enumerate(names):
            waves = _waves(situation.samples, j)
            power = np.sum((waves @ residual[:, j]) ** 2, axis=1)
            shape = float(_RIPPLES[np.argmax(power / np.sum(waves[:, 0] ** 2 + waves[:, 1] ** 2))])
            own = TorqueRipple((j,), (shape,), tuple(names))
            columns = np.zeros((*residual.shape, 2))
            columns[:, j] = self.column(situation, j, shape)
            label = f"{self.name}:{name}"
            found.append(ReadingGroup(columns, (JointReading(own, label, (0, 1)),), label))
        return found


@lru_cache(maxsize=16)
def _waves(samples: JointSamples, joint: int) -> Array:
    """(W, 2, K) mean cosine and sine of each number of waves per turn, of unit power on average."""
    q = samples.q[:, :, joint]
    found = np.empty((len(_RIPPLES), 2, len(q)))
    for k, times in enumerate(_RIPPLES):
        found[k] = np.cos(times * q).mean(axis=1), np.sin(times * q).mean(axis=1)
    found -= found.mean(axis=2, keepdims=True)
    size = np.sqrt((found**2).sum(axis=(1, 2), keepdims=True))
    return np.asarray(found / np.maximum(size, 1e-9))
