"""Sensors of a robot: fingertips (BioTacs, flat pads), encoders, a marker tracker, the wrist."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.configuration import check_ranges, parameter
from tactile_dynamics_ros.core.rigid_body.rotation import cross, exp_so3, log_so3
from tactile_dynamics_ros.core.robot.robot import Robot, column
from tactile_dynamics_ros.sim.bodies import ContactReading
from tactile_dynamics_ros.sim.sensors.biotac import BioTacArray, BioTacConfig


@dataclass(frozen=True)
class PadConfig:
    """Errors of a six-axis sensor behind a pad, tared before it touches.

    Source: sizes of what six-axis sensors of 17 mm (ATI Nano17) resolve, 3 mN and 0.02 mN m, times
    ten for a driver without averaging.
    """

    force_noise: float = parameter(0.03, "white noise of a force axis", "N", 0.0, 10.0)
    torque_noise: float = parameter(2e-4, "white noise of a torque axis", "N m", 0.0, 1.0)

    def __post_init__(self) -> None:
        check_ranges(self)


class ForceTorquePads:
    """Sensors of all pads.

    Args:
        fingers: names of the pads.
        config: errors.
        seed: of the noise.
    """

    def __init__(
        self, fingers: Sequence[str], config: PadConfig | None = None, seed: int = 0
    ) -> None:
        self.config = config or PadConfig()
        self._fingers = tuple(fingers)
        self._rng = np.random.default_rng([seed, 17])

    @property
    def force_std(self) -> Array:
        """(3,) standard deviation of a reported force, N."""
        return np.full(3, max(self.config.force_noise, 1e-4))

    def read(self, contacts: Mapping[str, ContactReading], poses: Array) -> Array:
        """Return the wrenches (F, 6) [torque, force] on the object about the frames' origins.

        Args:
            contacts: true ones by finger, world axes.
            poses: (F, 4, 4) true X_WS of the sensor frames.
        """
        std = np.repeat([self.config.torque_noise, self.config.force_noise], 3)
        wrenches = std * self._rng.standard_normal((len(self._fingers), 6))
        for row, finger, pose in zip(wrenches, self._fingers, poses, strict=True):
            contact = contacts[finger]
            if contact.in_contact:
                torque = contact.torque + cross(contact.point - pose[:3, 3], contact.force)
                row += np.concatenate([torque @ pose[:3, :3], contact.force @ pose[:3, :3]])
        return wrenches


class TipContact(Protocol):
    """What is needed of a contact: mean force on the object and place, world axes."""

    @property
    def force(self) -> Array:
        """(3,) N."""

    @property
    def point(self) -> Array:
        """(3,) m."""

    @property
    def in_contact(self) -> bool:
        """Whether anything is touched."""


class Fingertips:
    """BioTacs of all fingers.

    Args:
        fingers: their names, in the order of the rows of the image.
        config: of the sensors.
        seed: of the noise.
        unit_seed: of the units' constants: the same hand has the same fingertips.
    """

    def __init__(
        self,
        fingers: Sequence[str],
        config: BioTacConfig | None = None,
        seed: int = 0,
        unit_seed: int = 0,
    ) -> None:
        self._fingers = tuple(fingers)
        self.array = BioTacArray(len(self._fingers), config, seed, unit_seed)
        self._last: Array | None = None

    def read(
        self,
        contacts: Mapping[str, TipContact],
        poses: Array,
        object_pose: Array,
        object_twist: tuple[Array, Array],
        dt: float = 0.01,
    ) -> NDArray[np.uint16]:
        """Return raw counts (F, 44) in the order of the fingers.

        Args:
            contacts: by finger; forces on the object, world axes.
            poses: (F, 4, 4) true X_WS of the sensor frames.
            object_pose: (4, 4) true X_WO.
            object_twist: angular velocity and velocity of the object's origin, world axes.
            dt: time since the last reading, s.
        """
        touching = [k for k, finger in enumerate(self._fingers) if _touches(contacts.get(finger))]
        count = len(self._fingers)
        force, point, slip = np.zeros((count, 3)), np.zeros((count, 3)), np.zeros(count)
        if touching:
            where = np.stack([contacts[self._fingers[k]].point for k in touching])
            pushed = np.stack([contacts[self._fingers[k]].force for k in touching])
            rotation = poses[touching, :3, :3]
            force[touching] = _turn_back(rotation, pushed)
            point[touching] = _turn_back(rotation, where - poses[touching, :3, 3])
            if self._last is not None:
                velocity = _velocity(self._last[touching], poses[touching], where, dt)
                arm = where - object_pose[:3, 3]
                slipping = object_twist[1] + cross(np.asarray(object_twist[0]), arm) - velocity
                slip[touching] = _tangential(slipping, where - poses[touching, :3, 3])
        self._last = poses.copy()
        return self.array.measure(force, point, slip_speed=slip, dt=dt)


def _touches(contact: TipContact | None) -> bool:
    return contact is not None and contact.in_contact


def _turn_back(rotation: Array, vector: Array) -> Array:
    """Return R^T v of rotations (K, 3, 3) and vectors (K, 3)."""
    return np.einsum("kij,ki->kj", rotation, vector)


def _velocity(before: Array, after: Array, point: Array, dt: float) -> Array:
    """Return the velocity (K, 3) of points on tips that moved between two poses (K, 4, 4)."""
    turned = after[:, :3, :3] @ np.swapaxes(before[:, :3, :3], -1, -2)
    angular = log_so3(turned) / dt
    linear = (after[:, :3, 3] - before[:, :3, 3]) / dt
    return np.asarray(linear + cross(angular, point - after[:, :3, 3]))


def _tangential(velocity: Array, outward: Array) -> Array:
    """Return the speed (K,) of velocities (K, 3) across the directions ``outward`` (K, 3)."""
    length = np.linalg.norm(outward, axis=1, keepdims=True)
    normal = outward / np.maximum(length, 1e-9)
    along = np.sum(velocity * normal, axis=1, keepdims=True) * normal
    return np.asarray(np.linalg.norm(velocity - along, axis=1))


PLAY_TORQUE = 0.01
"""Torque at which a gear's play is half taken up, N m."""


@dataclass(frozen=True)
class EncoderConfig:
    """Errors of joint readings.

    Source: Allegro driver (16-bit counts over 333.3 deg), noise 2e-4 rad; absolute accuracy is
    0.5 to 1 deg and play 0.3 to 0.5 deg as delivered, the defaults hold for a calibrated hand.
    """

    hand_noise: float = parameter(2e-4, "white noise of a hand joint", "rad", 0.0, 0.1)
    hand_offset_deg: float = parameter(0.2, "std of the offsets of hand joints", "deg", 0.0, 10.0)
    hand_play_deg: float = parameter(0.1, "gear play of a hand joint", "deg", 0.0, 10.0)
    arm_noise: float = parameter(1e-5, "white noise of an arm joint", "rad", 0.0, 0.1)
    arm_offset: float = parameter(5e-5, "std of the offsets of arm joints", "rad", 0.0, 0.1)
    slide_noise: float = parameter(1e-5, "white noise of a joint that slides", "m", 0.0, 0.01)
    slide_offset: float = parameter(1e-4, "std of the offsets of joints that slide", "m", 0.0, 0.05)

    def __post_init__(self) -> None:
        check_ranges(self)


class JointEncoders:
    """What the drivers report for true joint positions of arm and hand.

    Args:
        robot: whose joints they read.
        config: errors.
        seed: of noise and of the constant offsets.
    """

    def __init__(self, robot: Robot, config: EncoderConfig | None = None, seed: int = 0) -> None:
        self.config = config = config or EncoderConfig()
        self._rng = np.random.default_rng([seed, 11])
        in_arm = np.arange(robot.dof) < robot.arm_dof
        slides = column(robot.joints, "slides") > 0.0

        def each(arm: float, hand: float, slide: float | None = None) -> Array:
            turning = np.where(in_arm, arm, hand)
            return turning if slide is None else np.where(slides, slide, turning)

        self._noise = each(config.arm_noise, config.hand_noise, config.slide_noise)
        self._resolution = each(robot.arm_resolution, robot.hand_resolution)
        offset = np.deg2rad(config.hand_offset_deg)
        scale = each(config.arm_offset, float(offset), config.slide_offset)
        self.offset = scale * self._rng.standard_normal(robot.dof)
        self._play = each(0.0, float(np.deg2rad(config.hand_play_deg)), 0.0)

    def read(self, position: Array, effort: Array | None = None) -> Array:
        """Return reported positions (J,) rad.

        The encoder sits on the motor's side of the gear, which leads the link by half the play in
        the direction of the torque.

        Args:
            position: (J,) true link positions, rad.
            effort: (J,) drive torques, N m; no play without them.
        """
        reported = position + self.offset + self._noise * self._rng.standard_normal(len(position))
        if effort is not None:
            reported = reported + 0.5 * self._play * effort / (np.abs(effort) + PLAY_TORQUE)
        return np.asarray(np.rint(reported / self._resolution) * self._resolution)


@dataclass(frozen=True)
class MarkerTrackerConfig:
    """Errors of the tracked pose."""

    position_noise: float = parameter(5e-4, "white noise of position", "m", 0.0, 0.1)
    rotation_noise_deg: float = parameter(0.2, "white noise of rotation", "deg", 0.0, 45.0)
    position_bias: float = parameter(2e-4, "std of the constant error of position", "m", 0.0, 0.1)
    rotation_bias_deg: float = parameter(0.05, "std of that of rotation", "deg", 0.0, 45.0)
    loss_probability: float = parameter(0.0, "share of frames without a pose", "", 0.0, 1.0)

    def __post_init__(self) -> None:
        check_ranges(self)


class MarkerTracker:
    """Reports noisy poses of the object.

    Args:
        config: errors.
        seed: of noise, bias and losses.

    Attributes:
        covariance: (6, 6) of a reported pose [rotation, position], world axes.
    """

    def __init__(self, config: MarkerTrackerConfig | None = None, seed: int = 0) -> None:
        self.config = config = config or MarkerTrackerConfig()
        self._rng = np.random.default_rng([seed, 17])
        noise = [np.deg2rad(config.rotation_noise_deg)] * 3 + [config.position_noise] * 3
        bias = [np.deg2rad(config.rotation_bias_deg)] * 3 + [config.position_bias] * 3
        self._noise = np.array(noise)
        self._bias = np.array(bias) * self._rng.standard_normal(6)
        self.covariance = np.diag(self._noise**2 + np.array(bias) ** 2)

    def read(self, pose: Array) -> Array | None:
        """Return the reported X_WO (4, 4), or None where tracking was lost.

        Args:
            pose: (4, 4) true X_WO.
        """
        if self._rng.random() < self.config.loss_probability:
            return None
        error = self._bias + self._noise * self._rng.standard_normal(6)
        reported = np.array(pose, dtype=float)
        reported[:3, :3] = exp_so3(error[:3]) @ reported[:3, :3]
        reported[:3, 3] += error[3:]
        return reported


RANGE = np.array([10.0, 10.0, 6.5, 200.0, 200.0, 200.0])
"""Nominal range [torque N m, force N]."""

RESOLUTION = np.array([1e-5, 1e-5, 1e-5, 1e-4, 1e-4, 1e-4])


@dataclass(frozen=True)
class WristSensorConfig:
    """Errors of the sensor.

    Source: HEX-E v2 noise-free resolution 0.2 N (xy), 0.8 N (z), 0.010 and 0.002 N m, a sixth of it
    as standard deviation with the 15 Hz filter; drift of the same order as reported over minutes.
    """

    force_noise_xy: float = parameter(0.035, "noise of lateral force", "N", 0.0, 10.0)
    force_noise_z: float = parameter(0.13, "noise of axial force", "N", 0.0, 10.0)
    torque_noise_xy: float = parameter(1.7e-3, "noise of bending torque", "N m", 0.0, 1.0)
    torque_noise_z: float = parameter(3.5e-4, "noise of axial torque", "N m", 0.0, 1.0)
    force_drift: float = parameter(5e-3, "random walk of force", "N/sqrt(s)", 0.0, 1.0)
    torque_drift: float = parameter(1e-4, "random walk of torque", "N m/sqrt(s)", 0.0, 1.0)
    filter_hz: float = parameter(15.0, "low-pass of the sensor", "Hz", 0.1, 1000.0)

    def __post_init__(self) -> None:
        check_ranges(self)


class WristSensor:
    """Reports a wrench [torque, force] with the sensor's dynamics and errors.

    Args:
        config: errors.
        seed: of noise and drift.
    """

    def __init__(self, config: WristSensorConfig | None = None, seed: int = 0) -> None:
        self.config = config = config or WristSensorConfig()
        self._rng = np.random.default_rng([seed, 13])
        torque = [config.torque_noise_xy, config.torque_noise_xy, config.torque_noise_z]
        force = [config.force_noise_xy, config.force_noise_xy, config.force_noise_z]
        self.noise = np.array(torque + force)
        self._walk = np.array([config.torque_drift] * 3 + [config.force_drift] * 3)
        self._drift = np.zeros(6)
        self._filtered: Array | None = None

    def read(self, wrench: Array, dt: float) -> tuple[Array, bool]:
        """Return the reported wrench (6,) [torque, force] and whether it is saturated.

        Args:
            wrench: (6,) true [torque, force], sensor frame.
            dt: time since the last reading, s.
        """
        wrench = np.asarray(wrench, dtype=float)
        if self._filtered is None:
            self._filtered = wrench.copy()
        share = 1.0 - np.exp(-2.0 * np.pi * self.config.filter_hz * dt)
        self._filtered = self._filtered + share * (wrench - self._filtered)
        self._drift = self._drift + self._walk * np.sqrt(dt) * self._rng.standard_normal(6)
        reported = self._filtered + self._drift + self.noise * self._rng.standard_normal(6)
        limited = np.clip(reported, -RANGE, RANGE)
        saturated = bool(np.any(limited != reported))
        return np.rint(limited / RESOLUTION) * RESOLUTION, saturated
