"""Contacts whose places are published through the tracked pose, and so carry its noise.

A simulator, or a driver that knows where its sensor sits on the object, puts p_c = X_WO b_c with
the tracked X_WO. The place b_c = X_WO^-1 p_c on the object is then free of the pose's noise, and so
is the lever of the force about the body origin; the force itself and gravity are turned into body
axes by the noisy rotation all the same. Points that are measured for themselves (by the joints of a
hand) scatter on the object by the pose's noise beside their own. Which it is shows in that scatter:

    independent: var(X^-1 p) = var_pose + var_own      carried: var(X^-1 p) = var_own
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.numerics.noise import white_noise_std, white_pose_noise_std
from tactile_dynamics_ros.core.rigid_body.rotation import turned_between
from tactile_dynamics_ros.core.streams.streams import (
    ContactStream,
    PoseStream,
    Streams,
    enclosing_steps,
)

_LESS = 0.35
"""Variance of the places on the object over that of the pose's noise there, below which the noise
is common. Independent noise leaves 1 at least; of 1000 samples either variance is known to 8 %, of
50 to 40 %. A smaller share misses points that have noise of their own beside poses whose stamps
they do not share, a larger one takes independent points of short recordings for carried ones."""
_OWN = 3.0
"""Noise of the points in the world over that of the poses there, up to which it is asked whether
the places on the object scatter less than the points do in the world. That difference is twice the
pose's variance; beyond 3 it is less than the scatter of either, and it matters no more."""
_SLOWEST = 0.05
"""Period of poses, s, up to which their scatter shows their noise where none is stated. Sixth
differences of 20 Hz leave 0.1 of a motion of 2.5 Hz; slower poses would take motion for noise, and
with it all points for carried. A shorter bound reads quick poses without stated noise as
independent."""
_FEWEST = 50
"""Samples of a contact from which its noise is compared: a variance is then known to 40 %, so that
independent noise seldom passes for common. Shorter recordings are read as independent. Far fewer
decide by chance, far more leave the common noise of short recordings out."""
_SAME_STAMP = 1e-6
"""Difference of stamps, s, of a contact and of the pose that carries it; rounding of stamps in
seconds of an epoch is 2e-7. Less misses pairs by rounding, more than half a period of the poses
pairs contacts with poses that did not carry them."""


@dataclass(frozen=True)
class CarriedPlace:
    """Where a contact is on the object, at the stamps of its poses.

    Attributes:
        position: (M, 3) m, body frame.
        rotation: (M, 3, 3) R_OC.
    """

    position: Array
    rotation: Array


def carried_places(streams: Streams) -> dict[str, CarriedPlace]:
    """Contacts that carry the noise of the tracked poses, by name.

    Args:
        streams: a recording.

    Returns:
        Empty where there are no poses, or all contacts are measured for themselves.
    """
    pose = streams.pose
    if pose is None or len(pose.time) < _FEWEST:
        return {}
    noise = _pose_noise(pose)
    if noise is None:
        return {}
    found = {}
    for name, contact in streams.contacts.items():
        place = _carried(contact, pose, *noise)
        if place is not None:
            found[name] = place
    return found


def _pose_noise(pose: PoseStream) -> tuple[float, float] | None:
    """White noise (rad, m) of the poses: what is stated, or less if less is seen; None if unknown.

    A tracker states slow errors too. What is seen is no more than what is there.
    """
    seen = white_pose_noise_std(pose.time, pose.rotation, pose.position)
    if pose.covariance is None:
        fast = float(np.median(np.diff(pose.time))) <= _SLOWEST
        return seen if fast and min(seen) > 0.0 else None
    variances = np.median(np.einsum("nii->ni", pose.covariance), axis=0)
    stated = np.array([variances[:3].mean(), variances[3:].mean()])
    stated = np.sqrt(np.where(stated > 0.0, stated, np.inf))  # what cannot be is not stated
    return min(seen[0], float(stated[0])), min(seen[1], float(stated[1]))


def _carried(
    contact: ContactStream, pose: PoseStream, rotation_std: float, position_std: float
) -> CarriedPlace | None:
    """Place of a contact on the object if its scatter there says that it is carried by the pose.

    Publishers take the pose at the stamp, between two of them, or the latest one.
    """
    within = (contact.pose_time >= pose.time[0]) & (contact.pose_time <= pose.time[-1])
    if within.sum() < _FEWEST:
        return None
    time = contact.pose_time[within]
    left, step = enclosing_steps(pose.time, contact.pose_time)
    share = np.clip((contact.pose_time - pose.time[left]) / step, 0.0, 1.0)
    shown = white_noise_std(time, contact.position[within]) ** 2
    for weight in (share, np.floor(share + _SAME_STAMP / step)):
        place = _on_object(contact, pose, left, weight)
        held = place.position[within]
        lever = float(np.mean(np.sum(held**2, axis=1)))
        common = position_std**2 + 2.0 / 3.0 * lever * rotation_std**2
        common *= _seen_of_unit_noise(time, left[within], weight[within])
        own = white_noise_std(time, held) ** 2
        if own < _LESS * common or own < shown < _OWN**2 * common and _is_shared(weight):
            return place
    return None


def _is_shared(weight: Array) -> bool:
    """Whether contact and pose bear the same stamps."""
    return float(np.mean(np.minimum(weight, 1.0 - weight) < 1e-3)) > 0.9


def _seen_of_unit_noise(time: Array, left: NDArray[np.int64], weight: Array) -> float:
    """Variance that unit noise of the poses shows when they are read between their stamps."""
    noise = np.random.default_rng(0).normal(size=(int(left.max()) + 2, 3))
    read = (1.0 - weight)[:, None] * noise[left] + weight[:, None] * noise[left + 1]
    return white_noise_std(time, read) ** 2


def _on_object(
    contact: ContactStream, pose: PoseStream, left: NDArray[np.int64], weight: Array
) -> CarriedPlace:
    """Contact frames in the body, by poses on lines between those that are tracked.

    Args:
        contact: stream of M poses.
        pose: tracked.
        left: (M,) pose before each of them.
        weight: (M,) share of the pose after it.
    """
    share = weight[:, None]
    rotation = turned_between(pose.rotation[left], pose.rotation[left + 1], weight)
    position = (1.0 - share) * pose.position[left] + share * pose.position[left + 1]
    to_body = np.swapaxes(rotation, 1, 2)
    point = np.einsum("nij,nj->ni", to_body, contact.position - position)
    return CarriedPlace(point, to_body @ contact.rotation)
