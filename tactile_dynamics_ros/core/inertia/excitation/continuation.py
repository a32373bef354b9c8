"""What a recording would get if it went on with a motion: simulated streams with its own noise."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.contact.wrench_samples import WrenchSamples
from tactile_dynamics_ros.core.inertia.batch.batch import BatchConfig, read_stretches
from tactile_dynamics_ros.core.inertia.batch.fitted_model import FittedModel
from tactile_dynamics_ros.core.inertia.excitation.limits import Grip
from tactile_dynamics_ros.core.inertia.excitation.trajectory import FourierOffsets, HeldPose
from tactile_dynamics_ros.core.inertia.residuals.sampled_signals import SampledSignals
from tactile_dynamics_ros.core.rigid_body.newton_euler import regressor
from tactile_dynamics_ros.core.rigid_body.rotation import exp_so3
from tactile_dynamics_ros.core.streams.streams import ContactStream, ImuStream, PoseStream, Streams

_FRICTION = 0.6
"""Coefficient presumed between fingertips and object, as `excite` does; raised to what the
recording shows to hold. Lower leaves out motions that the grip would bear, higher proposes some
that slip."""


@dataclass(frozen=True)
class Continuation:
    """A held object as a recording leaves it, ready to be moved on.

    Attributes:
        streams: the recording.
        model: fitted to it; the body is taken from it.
        raw: its last stretch on the grid, with the noise that each signal has.
        grip: how it is held.
        start: pose from which it is moved.
    """

    streams: Streams
    model: FittedModel
    raw: SampledSignals
    grip: Grip
    start: HeldPose

    @classmethod
    def of(cls, streams: Streams, model: FittedModel) -> Continuation:
        """Hold the object as in the last stretch, in the recorded pose nearest to the mean."""
        samples = model.samples[-1]
        grip = Grip.from_samples(samples, model.phi, _FRICTION)
        if len(grip.names) == 1:
            grip = replace(grip, squeeze=np.zeros_like(grip.squeeze))
        mean = samples.rotation.mean(axis=0)
        nearest = int(np.argmin(np.sum((samples.rotation - mean) ** 2, axis=(1, 2))))
        turn, place = samples.rotation[nearest], samples.position.mean(axis=0)
        raw = read_stretches(streams, BatchConfig())[-1].raw
        return cls(streams, model, raw, grip, HeldPose(turn, place, place))

    @property
    def carries_torque(self) -> NDArray[np.bool_]:
        """(C,) contacts of the grip that measure torque."""
        return np.array([self.streams.contacts[name].carries_torque for name in self.grip.names])

    @property
    def force_std(self) -> float:
        """Median standard deviation of a force axis, N."""
        factors = [contact.signals["force"].noise_factor for contact in self.raw.contacts]
        stds = np.concatenate([np.sqrt(np.einsum("kij,kij->k", f, f) / 3.0) for f in factors])
        return max(float(np.median(stds)), 1e-4)

    def squeezed(self, factor: float) -> Continuation:
        """The same with a harder grip."""
        return replace(self, grip=replace(self.grip, squeeze=factor * self.grip.squeeze))

    def holds(self, offsets: FourierOffsets, time: Array) -> bool:
        """Whether no finger slips more than it was seen to bear."""
        return bool(self.carries_torque.any() or self.grip.usage(self.move(offsets, time)) <= 1.0)

    def move(self, offsets: FourierOffsets, time: Array) -> WrenchSamples:
        """Exact samples of a motion with the wrenches that contacts need for it."""
        motion = self.start.follow(offsets, time)
        samples = self.grip.load(motion, self.model.phi)
        carriers = self.carries_torque
        if not carriers.any():
            return samples
        matrix = regressor(
            motion.specific_acceleration, motion.angular_velocity, motion.angular_acceleration
        )
        wrench = matrix @ self.model.phi
        force = self.grip.squeeze + wrench[:, None, 3:] / len(self.grip.names)
        lacking = wrench[:, :3] - np.cross(self.grip.point, force).sum(axis=1)
        torque = np.where(carriers[:, None], lacking[:, None] / carriers.sum(), 0.0)
        return samples.with_forces(force, torque)

    def record(self, offsets: FourierOffsets, seed: int = 0) -> Streams:
        """Streams of a motion at the rates and with the noise of the recording."""
        rng = np.random.default_rng(seed)
        pose = self._pose(offsets, rng)
        contacts = {
            name: self._contact(k, name, offsets, pose, rng)
            for k, name in enumerate(self.grip.names)
        }
        return Streams(pose, contacts, self._imu(offsets, rng))

    def _pose(self, offsets: FourierOffsets, rng: np.random.Generator) -> PoseStream | None:
        recorded = self.streams.pose
        if recorded is None:
            return None
        time = _clock(recorded.time, offsets.duration)
        moved = self.move(offsets, time)
        turn = self._noise("orientation", len(time), rng)
        shift = self._noise("position", len(time), rng)
        return PoseStream(
            time,
            moved.position + shift,
            exp_so3(turn) @ moved.rotation,
            _again(recorded.covariance, len(time)),
            recorded.white,
        )

    def _contact(
        self,
        k: int,
        name: str,
        offsets: FourierOffsets,
        pose: PoseStream | None,
        rng: np.random.Generator,
    ) -> ContactStream:
        """One contact; points that are published through the tracked pose have its noise."""
        recorded = self.streams.contacts[name]
        time = _clock(recorded.time, offsets.duration)
        moved = self.move(offsets, time)
        place = _clock(recorded.pose_time, offsets.duration)
        held = self.move(offsets, place)
        rotation, position = held.rotation, held.position
        if pose is not None and self._is_carried(name) and len(pose.time) == len(place):
            rotation, position = pose.rotation, pose.position
        points = position + rotation @ self.grip.point[k]
        force = np.einsum("nij,nj->ni", moved.rotation, moved.contact_force[:, k])
        torque = np.einsum("nij,nj->ni", moved.rotation, moved.contact_torque[:, k])
        if recorded.carries_torque:
            torque = torque + self._noise("torque", len(time), rng, name)
        return replace(
            recorded,
            time=time,
            force=force + self._noise("force", len(time), rng, name),
            torque=torque,
            force_std=_again(recorded.force_std, len(time)),
            pose_time=place,
            position=points + self._noise("point", len(place), rng, name),
            rotation=rotation @ held.contact_rotation[:, k],
        )

    def _imu(self, offsets: FourierOffsets, rng: np.random.Generator) -> ImuStream | None:
        recorded = self.streams.imu
        if recorded is None:
            return None
        time = _clock(recorded.time, offsets.duration)
        moved, count = self.move(offsets, time), len(time)
        turn = exp_so3(self._noise("orientation", count, rng)) @ moved.rotation
        rate = moved.angular_velocity + self._noise("gyro", count, rng)
        return ImuStream(
            time,
            None if recorded.rotation is None else turn,
            None if recorded.angular_velocity is None else rate,
            moved.specific_acceleration + self._noise("specific_force", count, rng),
            recorded.specific_force_std,
        )

    def _is_carried(self, name: str) -> bool:
        return any(contact.name == name and contact.carried for contact in self.raw.contacts)

    def _noise(self, signal: str, count: int, rng: np.random.Generator, contact: str = "") -> Array:
        """Noise (count, 3) of a signal as the fit took it to be; none where it took none."""
        signals = self.raw.motion.signals
        if contact:
            signals = next(c.signals for c in self.raw.contacts if c.name == contact)
        if signal not in signals:
            return np.zeros((count, 3))
        factors = signals[signal].noise_factor[_cycle(len(signals[signal].noise_factor), count)]
        return np.asarray(np.einsum("nij,nj->ni", factors, rng.normal(size=(count, 3))))


def _clock(recorded: Array, duration: float) -> Array:
    """Stamps of a stream that goes on at its median rate, s."""
    return np.arange(0.0, duration, float(np.median(np.diff(recorded))))


def _again(rows: Array | None, count: int) -> Array | None:
    """Rows of a recording, repeated until there are enough."""
    return None if rows is None else rows[_cycle(len(rows), count)]


def _cycle(rows: int, count: int) -> NDArray[np.intp]:
    return np.arange(count) % rows
