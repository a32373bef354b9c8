"""What arm, hand and grip allow, as the share of a motion's amplitude."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.configuration import check_ranges, parameter
from tactile_dynamics_ros.core.contact.wrench_samples import GRAVITY_W, WrenchSamples
from tactile_dynamics_ros.core.inertia.excitation.trajectory import (
    CHANNELS,
    FourierOffsets,
    HeldPose,
    ObjectMotion,
)
from tactile_dynamics_ros.core.rigid_body.newton_euler import regressor
from tactile_dynamics_ros.core.rigid_body.rotation import skew
from tactile_dynamics_ros.core.robot.hand_kinematics import HandKinematics
from tactile_dynamics_ros.core.robot.robot import column

_HELD_PERCENTILE = 99.5
"""Percentile of the sliding ratios of all samples that the grip has shown to hold: the largest but
for one in 200, which may be noise of a single sample. At 100 one outlier would promise any
friction; at 90 motions become smaller than those that were held."""


@dataclass(frozen=True)
class Grip:
    """Contacts that hold the object, fixed in the body frame.

    Attributes:
        names: names of the C contacts.
        point: (C, 3) m; normal: (C, 3) unit, into the object.
        squeeze: (C, 3) N, forces that the contacts apply on the weightless object at rest.
        friction: coefficient.
    """

    names: tuple[str, ...]
    point: Array
    normal: Array
    squeeze: Array
    friction: float

    @classmethod
    def from_samples(cls, samples: WrenchSamples, phi: Array, friction: float) -> Grip:
        """Read the grip from measured contacts: what they apply beyond carrying the object.

        Args:
            samples: samples of the held object; the mean over samples in contact is taken.
            phi: (10,) dynamic parameters.
            friction: coefficient; raised to what the samples show to hold.
        """
        count = np.maximum(samples.in_contact.sum(axis=0), 1)[:, None]
        held = np.flatnonzero(samples.in_contact.mean(axis=0) > 0.5)
        point = (samples.contact_point.sum(axis=0) / count)[held]
        normal = samples.contact_rotation[..., 2].mean(axis=0)[held]
        normal = normal / np.linalg.norm(normal, axis=1, keepdims=True)
        names = tuple(samples.contact_names[k] for k in held)
        loose = cls(names, point, normal, np.zeros_like(point), friction)
        matrix = regressor(
            samples.specific_acceleration, samples.angular_velocity, samples.angular_acceleration
        )
        carried = loose.share(matrix @ phi)
        squeeze = (samples.contact_force[:, held] - carried).mean(axis=0)
        shown = float(np.percentile(_sliding_ratio(squeeze + carried, normal), _HELD_PERCENTILE))
        return cls(names, point, normal, squeeze, max(friction, shown))

    def share(self, wrench: Array) -> Array:
        """Smallest additional forces (N, C, 3) that apply wrenches (N, 6), beside the squeeze."""
        grasp = np.concatenate(
            [np.hstack(list(skew(self.point))), np.tile(np.eye(3), len(self.point))]
        )
        forces = np.asarray(wrench) @ np.linalg.pinv(grasp).T
        return np.asarray(self.squeeze + forces.reshape(len(wrench), -1, 3))

    def load(self, motion: ObjectMotion, phi: Array) -> WrenchSamples:
        """Samples of a motion with the forces that it needs for a body (10,)."""
        matrix = regressor(
            motion.specific_acceleration, motion.angular_velocity, motion.angular_acceleration
        )
        force = self.share(matrix @ phi)
        shape = (len(motion.time), len(self.names))
        return WrenchSamples(
            time=motion.time,
            position=motion.position,
            rotation=motion.rotation,
            velocity=motion.velocity,
            acceleration=motion.acceleration,
            angular_velocity=motion.angular_velocity,
            angular_acceleration=motion.angular_acceleration,
            contact_names=self.names,
            contact_point=np.broadcast_to(self.point, (*shape, 3)),
            contact_rotation=np.broadcast_to(_frames(self.normal), (*shape, 3, 3)),
            contact_force=force,
            contact_torque=np.zeros((*shape, 3)),
            in_contact=np.ones(shape, dtype=bool),
            gravity=GRAVITY_W,
        )

    def usage(self, samples: WrenchSamples) -> float:
        """Largest share of the friction cone in use; above 1 a finger slips."""
        return float(np.max(_sliding_ratio(samples.contact_force, self.normal)) / self.friction)


def _sliding_ratio(force: Array, normal: Array) -> Array:
    """Tangential over normal force, (N, C)."""
    pressing = np.sum(force * normal, axis=-1)
    sliding = np.linalg.norm(force - pressing[..., None] * normal, axis=-1)
    return np.asarray(sliding / np.maximum(pressing, 1e-6))


def _frames(normal: Array) -> Array:
    """Rotations (C, 3, 3) whose z axes are the normals."""
    helper = np.where(np.abs(normal[:, 2:]) < 0.9, [[0.0, 0.0, 1.0]], [[1.0, 0.0, 0.0]])
    x_axis = np.cross(helper, normal)
    x_axis /= np.linalg.norm(x_axis, axis=1, keepdims=True)
    return np.stack([x_axis, np.cross(normal, x_axis), normal], axis=2)


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
