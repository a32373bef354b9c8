"""Contacts that the hand tells, carried to where vision shows the object.

Contact points and forces get into the world through the joints of arm and hand, whose errors move
and turn them. The pose H that the hand alone tells of the object has the same errors, the fused
pose X has most of them corrected, so X H^-1 is the motion that corrects the contacts too. Without
it, object and contacts shift against each other as vision corrects the pose.

That holds only as long as the object has not slipped, which moves X but not the hand. What lies
within the covariance of H is taken for an error of the hand, what lies beyond for slip.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.rigid_body.rotation import log_so3
from tactile_dynamics_ros.core.streams import ContactStream, PoseStream, Streams, nearest_samples
from tactile_dynamics_ros.core.tracking.pose_fusion import CHI2_6_9999

Array = NDArray[np.float64]

SAME_TIME = 1e-3
"""Poses whose stamps differ by less belong together, s."""
LASTING = 0.1
"""For how long the motion found at one time holds, s."""
_TINY = 1e-14


def hand_motions(fused: Array, hand: Array, covariance: Array) -> Array:
    """Return X H^-1, or the identity where the object has slipped.

    Args:
        fused: (N, 4, 4) X_WO.
        hand: (N, 4, 4) X_WO as the hand alone tells it, at the same times.
        covariance: (N, 6, 6) of `hand` [rotation, position], world axes.

    Returns:
        (N, 4, 4) motions of the world.
    """
    turn = fused[:, :3, :3] @ np.swapaxes(hand[:, :3, :3], 1, 2)
    apart = np.concatenate([log_so3(turn), fused[:, :3, 3] - hand[:, :3, 3]], axis=1)
    spread = covariance + _TINY * np.eye(6)
    misfit = np.sum(apart * np.linalg.solve(spread, apart[..., None])[..., 0], axis=1)
    motions = np.tile(np.eye(4), (len(fused), 1, 1))
    motions[:, :3, :3] = turn
    motions[:, :3, 3] = fused[:, :3, 3] - np.einsum("nij,nj->ni", turn, hand[:, :3, 3])
    motions[misfit > CHI2_6_9999] = np.eye(4)
    return motions


def carry_contacts(streams: Streams, hand: PoseStream) -> Streams:
    """Return the streams with contacts where the fused pose, that of the streams, has them.

    Args:
        streams: with a pose.
        hand: pose of the object by the hand alone. Without covariance nothing can be told from
            slip, and contacts stay as they are.
    """
    fused = streams.pose
    if fused is None or hand.covariance is None:
        return streams
    nearest = nearest_samples(fused.time, hand.time)
    paired = np.abs(fused.time[nearest] - hand.time) < SAME_TIME
    if not paired.any():
        return streams
    both = _matrices(fused)[nearest[paired]], _matrices(hand)[paired]
    motions = hand_motions(*both, hand.covariance[paired])
    time = hand.time[paired]
    carried = {name: _carried(c, time, motions) for name, c in streams.contacts.items()}
    return replace(streams, contacts=carried)


def _carried(contact: ContactStream, time: Array, motions: Array) -> ContactStream:
    place = _motions_at(time, motions, contact.pose_time)
    turn = _motions_at(time, motions, contact.time)[:, :3, :3]
    return replace(
        contact,
        force=np.einsum("nij,nj->ni", turn, contact.force),
        torque=np.einsum("nij,nj->ni", turn, contact.torque),
        position=np.einsum("nij,nj->ni", place[:, :3, :3], contact.position) + place[:, :3, 3],
        rotation=place[:, :3, :3] @ contact.rotation,
    )


def _motions_at(time: Array, motions: Array, wanted: Array) -> Array:
    nearest = nearest_samples(time, wanted)
    found = motions[nearest]
    found[np.abs(time[nearest] - wanted) > LASTING] = np.eye(4)
    return found


def _matrices(pose: PoseStream) -> Array:
    matrices = np.tile(np.eye(4), (len(pose.time), 1, 1))
    matrices[:, :3, :3], matrices[:, :3, 3] = pose.rotation, pose.position
    return matrices
