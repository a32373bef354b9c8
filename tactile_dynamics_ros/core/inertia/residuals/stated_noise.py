"""Noise that a recording states, held against the scatter of its samples."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.inertia.residuals.contact_grid import POINT_STD_FLOOR
from tactile_dynamics_ros.core.inertia.residuals.motion import OVERSTATED
from tactile_dynamics_ros.core.numerics.noise import (
    noise_along_axes,
    white_noise_std,
    white_pose_noise_std,
)
from tactile_dynamics_ros.core.streams.streams import ContactStream, PoseStream, Streams

_TOLERANCE = 1.2
"""Seen over stated noise, or its inverse, up to which they agree. Over 400 samples the seen one
scatters by 5 % (largest of 200 draws: 1.12), so that 1.2 is no chance; nearer to 1 stated
deviations are replaced for nothing."""
_FEWEST = 400
"""Samples that a force/torque sensor needs before the noise of its axes is compared: then it is
known to 5 %, and `_TOLERANCE` is four of these. With fewer, axes that are alike would differ by
chance."""
_SHARED = 0.5
"""Share of the stated noise that grows with the load from which sensors count as such: calibrated
fingertips have 0.7 to 1, sensors of constant noise 0, or 0.1 by chance where few samples are
averaged. Any bound between does the same."""


def restate_noise(streams: Streams) -> tuple[Streams, dict[str, float]]:
    """State the white noise that samples show where they scatter unlike what is stated.

    Fingertips may state more, since they have errors that last; a vibration scatters as well. So
    use the result only where it leaves nothing to be explained.

    Args:
        streams: measurements of a recording.

    Returns:
        The streams, and seen over stated noise of those that were changed: names of contacts,
        "pose". Of a force/torque sensor that of its loudest axis, over that of all.
    """
    uneven = {name: _unevenness(contact) for name, contact in streams.contacts.items()}
    changed = {name: ratio for name, ratio in uneven.items() if ratio > _TOLERANCE}
    contacts = {
        name: replace(contact, own_axes=name in changed)
        for name, contact in streams.contacts.items()
    }
    ratios = {
        name: _force_ratio(contact) for name, contact in contacts.items() if not contact.own_axes
    }
    for name, ratio in ratios.items():
        stated = contacts[name].force_std
        if _differs(ratio) and stated is not None:
            changed[name] = ratio
            contacts[name] = replace(contacts[name], force_std=ratio * stated)
    pose = streams.pose
    if pose is not None and (ratio := _pose_ratio(pose)) > _TOLERANCE:
        changed["pose"] = ratio
        pose = replace(pose, covariance=None)
    return replace(streams, contacts=contacts, pose=pose), changed


def states_shares(loads: Sequence[Array], stated: Sequence[Array]) -> bool:
    """Whether the noise that sensors state grows with what they carry.

    Args:
        loads: (K, 3) N, forces of each sensor while it carries any.
        stated: (K, ..) the standard deviations that it states of them.
    """
    shares = []
    for force, std in zip(loads, stated, strict=True):
        load = np.linalg.norm(force, axis=1)
        if len(load) < 2 or np.ptp(load) == 0.0:
            continue
        noise = np.linalg.norm(std.reshape(len(load), -1), axis=1)
        if noise.any():
            slope = float(np.polyfit(load - load.mean(), noise, 1)[0])
            shares.append(slope * load.mean() / noise.mean())
    return len(shares) > 0 and float(np.mean(shares)) > _SHARED


def remark_on(ratios: dict[str, float]) -> str:
    """Say in one line which noise is not used as stated.

    Args:
        ratios: seen over stated.
    """
    parts = ", ".join(f"{name} {ratio:.2g} times" for name, ratio in ratios.items())
    return (
        f"the samples scatter unlike the standard deviations that the recording states, or unlike "
        f"along different axes ({parts} the stated ones); the scatter is used"
    )


def _differs(ratio: float) -> bool:
    return not 1.0 / _TOLERANCE <= ratio <= _TOLERANCE


def _unevenness(contact: ContactStream) -> float:
    """Noise of the loudest axis over that of all, of a force/torque sensor; 1 of others.

    Standard deviations in world axes cannot state what the axes of a turning sensor differ by.
    """
    if not contact.carries_torque or len(contact.time) < _FEWEST:
        return 1.0
    found = [noise_along_axes(contact, values) for values in (contact.force, contact.torque)]
    return max(float(s.max() / np.sqrt(np.mean(s**2))) if s.all() else 1.0 for s in found)


def _force_ratio(contact: ContactStream) -> float:
    """Seen over stated noise of the forces; 1 where either is unknown."""
    if contact.force_std is None or not np.all(contact.force_std > 0):
        return 1.0
    loaded = contact.force.any(axis=1)
    seen = white_noise_std(contact.time[loaded], contact.force[loaded])
    return seen / float(np.sqrt(np.median(contact.force_std**2))) if seen > 0.0 else 1.0


def _pose_ratio(pose: PoseStream) -> float:
    """The larger of seen over stated noise of position and orientation; 1 where unknown.

    Poses that scatter less than they state are used as they scatter anyway.
    """
    if pose.covariance is None:
        return 1.0
    variances = np.median(np.einsum("nii->ni", pose.covariance), axis=0)
    seen = white_pose_noise_std(pose.time, pose.rotation, pose.position)
    stated = np.sqrt([variances[:3].mean(), variances[3:].mean()])
    return max(s / t for s, t in zip(seen, stated, strict=True)) if stated.all() else 1.0


_FORCE_STD_FLOOR, _TORQUE_STD_FLOOR = 1e-4, 1e-6
"""Scatter of a force, N, and of a torque, N m, from which it is taken for the sensor's noise; of
less what is configured stays. Below the resolution of tactile sensors (0.01 N), above rounding.
Higher, good sensors keep the configured noise, which makes their intervals too wide; at rounding a
simulation without noise gets unlimited weight."""
_LEAST_FORCE_STD = 1e-5
"""Standard deviation of a force that is a mistake as long as no scatter was seen, N: a hundredth of
the best force sensors' at 100 Hz. A simulation without noise is believed after half a second; at
1e-3 good sensors would wait, at 0 a noise of 1e-9 N is off by 90 deviations until then."""
_UNDERSTATED = 0.01
"""Stated over seen noise of a force from which the statement is no statement but a mistake. Sensors
state at least their noise; a hundredth of it is a unit that is off or zeros. Nearer to 1 honest
statements of quiet moments are thrown away."""

_NOISE_FLOOR = (1e-5, 1e-6)
"""Noise of poses, rad and m, that is presumed at least: what is smoother than this was filtered or
generated, and would get unlimited weight. 0.6 mdeg and 1 um are far below any tracker. Higher
overstates the noise of good trackers in simulation and widens intervals; at zero poses without
noise make the weights overflow."""

_MOST_SCATTER = 20.0
"""Scatter of poses over what is assumed of them up to which it is noise: 1 cm and 1.1 deg are the
worst depth cameras. Higher takes poses in mm for noisy ones, lower doubts those cameras."""


class SensorNoise:
    """Standard deviations (C,) of the readings of contacts, as configured until they are seen.

    Args:
        count: contacts.
        point: m, configured.
        force: N, configured.
        torque: N m, configured.
    """

    def __init__(self, count: int, point: float, force: float, torque: float) -> None:
        self.point, self.force = np.full(count, point), np.full(count, force)
        self.torque = np.full(count, torque)
        self._least_point = point
        self._measured, self._looked = np.zeros(count, dtype=bool), np.zeros(count, dtype=bool)

    def measure(self, slot: int, time: Array, point: Array, force: Array, torque: Array) -> None:
        """Take the scatter of one contact, N readings; of its point at least what is configured.

        Args:
            slot: of the contact.
            time: (N,) s.
            point: (N, 3) m.
            force: (N, 3) N.
            torque: (N, 3) N m.
        """
        self._looked[slot] = True
        seen_point, seen_force, seen_torque = (
            white_noise_std(time, values) for values in (point, force, torque)
        )
        if seen_point > POINT_STD_FLOOR:
            self.point[slot] = max(seen_point, self._least_point)
        if seen_force > _FORCE_STD_FLOOR:
            self.force[slot], self._measured[slot] = seen_force, True
        if seen_torque > _TORQUE_STD_FLOOR:
            self.torque[slot] = seen_torque

    @property
    def least_force(self) -> Array:
        """Standard deviation (C,) of a force, N, below which a statement is a mistake."""
        early = np.where(self._looked, 0.0, _LEAST_FORCE_STD)
        return np.where(self._measured, _UNDERSTATED * self.force, early)


class PoseScatter:
    """Scatter of the poses beside the noise that they state, or that is assumed of them.

    Assumed noise becomes that of the scatter. So does stated noise that is far above it: a
    tracker's covariance also covers slow errors, which differentiation does not see.
    """

    def __init__(self) -> None:
        self._seen = np.zeros(2)
        self._scale = np.ones((2, 2))

    def measure(
        self, time: Array, rotation: Array, position: Array, noise: Array, stated: Array
    ) -> None:
        """Take the scatter of N poses.

        Args:
            time: (N,) s.
            rotation: (N, 3, 3).
            position: (N, 3) m.
            noise: (N, 2, 3, 3) square roots of the covariances, stated or assumed.
            stated: (N,) 1 where they are stated, else 0.
        """
        seen = np.array(white_pose_noise_std(time, rotation, position))
        self._seen = np.maximum(seen, _NOISE_FLOOR)
        for kind in (0, 1):
            chosen = noise[stated == kind]
            if len(chosen):
                ratio = self._seen / np.median(_levels(chosen), axis=0)
                ratio = np.minimum(ratio, _MOST_SCATTER)
                far = ratio < OVERSTATED if kind else seen > 0.0
                self._scale[kind] = np.where(far, ratio, 1.0)

    def scaled(self, noise: Array, stated: Array) -> Array:
        """Noise (N, 2, 3, 3) of poses as it is to be believed; none is moved beyond the scatter."""
        scale = self._scale[stated.astype(int)]
        own = self._seen / _levels(noise)
        factor = np.clip(own, np.minimum(scale, 1.0), np.maximum(scale, 1.0))
        return np.asarray(factor[..., None, None] * noise)


def _levels(noise: Array) -> Array:
    """Standard deviations (N, 2) of rotation and position, means of the axes."""
    return np.asarray(np.sqrt(np.einsum("nsij,nsij->ns", noise, noise) / 3.0))
