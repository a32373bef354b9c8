"""What arm, hand and grip allow, as the share of a motion's amplitude that is possible."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.configuration import check_ranges, parameter
from tactile_dynamics_ros.core.inertia.excitation.grip import Grip
from tactile_dynamics_ros.core.inertia.excitation.trajectory import (
    CHANNELS,
    FourierOffsets,
    HeldPose,
)
from tactile_dynamics_ros.core.robot.hand_kinematics import HandKinematics
from tactile_dynamics_ros.core.robot.robot import column

Array = NDArray[np.float64]

_BISECTIONS = 12
"""Halvings of the interval in which the largest allowed amplitude lies: to 1 / 4096 of it, 0.02 mm
of 8 cm. Fewer leave part of the allowed motion unused (the lower end is taken), more cost an
evaluation of the motion each."""
_MORE_THAN_REST = 1.1
"""What a motion may take of the grip over what holding still takes, where that is more than the
share allowed. At 1 an object that a hand just holds could not be moved at all; more risks slip."""


@dataclass(frozen=True)
class MotionLimits:
    """Size of the motion and margins."""

    rotation: float = parameter(0.45, "largest turn about each axis", "rad", 0.0, 1.5)
    translation: float = parameter(0.05, "largest shift along each axis", "m", 0.0, 0.5)
    speed_share: float = parameter(0.8, "share of the joints' speed limits in use", "", 0.05, 1.0)
    grip_share: float = parameter(0.8, "share of the friction cones in use", "", 0.05, 1.0)

    def __post_init__(self) -> None:
        """Check ranges."""
        check_ranges(self)

    @property
    def amplitude(self) -> Array:
        """(6,) rad and m."""
        return np.repeat([self.rotation, self.translation], 3)


@dataclass(frozen=True)
class ArmLimits:
    """Joint limits of the arm near the start, to first order in the offsets.

    Attributes:
        jacobian: (6, J) [angular velocity, velocity] of the pivot by joint rates.
        position: (J,) rad; lower, upper: (J,) rad; velocity: (J,) rad/s.
    """

    jacobian: Array
    position: Array
    lower: Array
    upper: Array
    velocity: Array

    @classmethod
    def of_robot(cls, kinematics: HandKinematics, positions: Array, pivot: Array) -> ArmLimits:
        """Read limits and Jacobian of the robot's arm.

        Args:
            kinematics: kinematic model of the robot.
            positions: (J,) rad.
            pivot: (3,) m, world.
        """
        arm = kinematics.robot.arm
        return cls(
            kinematics.palm_jacobian(positions, pivot),
            np.asarray(positions, dtype=float)[: len(arm)],
            column(arm, "lower"),
            column(arm, "upper"),
            column(arm, "velocity"),
        )

    def share(self, offsets: Array, rates: Array, speed_share: float) -> float:
        """Largest factor on the motion that keeps all joints within limits.

        Args:
            offsets: (N, 6); rates: (N, 6) per s.
            rates: as above.
            speed_share: share of the velocity limits that may be used.
        """
        inverse = np.linalg.pinv(self.jacobian).T
        moved, speed = offsets @ inverse, np.abs(rates @ inverse).max(axis=0)
        tiny = 1e-12
        room = np.minimum(
            (self.upper - self.position) / np.maximum(moved.max(axis=0), tiny),
            (self.position - self.lower) / np.maximum(-moved.min(axis=0), tiny),
        )
        return float(min(room.min(), (speed_share * self.velocity / np.maximum(speed, tiny)).min()))


def fit_to_limits(
    motion: FourierOffsets,
    start: HeldPose,
    grip: Grip,
    phi: Array,
    limits: MotionLimits,
    arm: ArmLimits | None,
    time: Array,
) -> FourierOffsets:
    """Scale a motion to the largest that is allowed.

    Each axis is first scaled to its amplitude, the whole then to joint and grip limits. Where
    holding still takes more of the grip than the share allowed, a tenth more than that is allowed.

    Args:
        motion: candidate.
        start: pose of the object.
        grip: grip of the hand.
        phi: (10,) dynamic parameters presumed.
        limits: amplitudes and margins.
        arm: joint limits; None if the arm does not limit.
        time: (N,) s at which limits are checked.
    """
    peak = np.abs(motion.evaluate(time)).max(axis=0)
    fitted = motion.scaled(np.minimum(limits.amplitude / np.maximum(peak, 1e-12), 1.0))
    if arm is not None:
        step = 1e-3
        rates = (fitted.evaluate(time + step) - fitted.evaluate(time - step)) / (2.0 * step)
        share = arm.share(fitted.evaluate(time), rates, limits.speed_share)
        fitted = fitted.scaled(min(1.0, share))
    allowed = max(limits.grip_share, _MORE_THAN_REST * usage_at_rest(start, grip, phi))
    return fitted.scaled(_grip_share(fitted, start, grip, phi, allowed, time))


def usage_at_rest(start: HeldPose, grip: Grip, phi: Array) -> float:
    """Share of the friction cones that holding still takes."""
    nothing = np.zeros((CHANNELS, 1))
    still = FourierOffsets(1.0, np.ones(1), nothing, nothing)
    return grip.usage(grip.load(start.follow(still, np.array([0.5])), phi))


def _grip_share(
    motion: FourierOffsets, start: HeldPose, grip: Grip, phi: Array, allowed: float, time: Array
) -> float:
    def holds(share: float) -> bool:
        moved = start.follow(motion.scaled(share), time)
        return grip.usage(grip.load(moved, phi)) <= allowed

    if holds(1.0):
        return 1.0
    low, high = 0.0, 1.0
    for _ in range(_BISECTIONS):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if holds(middle) else (low, middle)
    return low
