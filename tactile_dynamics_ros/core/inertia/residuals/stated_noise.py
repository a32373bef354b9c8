"""Noise that a recording states, held against the scatter of its samples."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.numerics.noise import (
    noise_along_axes,
    white_noise_std,
    white_pose_noise_std,
)
from tactile_dynamics_ros.core.streams.streams import ContactStream, PoseStream, Streams

Array = NDArray[np.float64]

_TOLERANCE = 1.2
"""Seen over stated noise, or its inverse, up to which they agree. Over 400 samples the seen one
scatters by 5 % (largest of 200 draws: 1.12), so that 1.2 is no chance; nearer to 1 stated
deviations are replaced for nothing."""
_FEWEST = 400
"""Samples that a force/torque sensor needs before the noise of its axes is compared: then it is
known to 5 %, and `_TOLERANCE` is four of these. With fewer, axes that are alike would differ by
chance."""


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
