"""Contacts that the hand tells, carried to where vision shows the object.

Contact points and forces get into the world through the joints of arm and hand, whose errors move
and turn them as the arm moves. The pose H that the hand alone tells of the object moves and turns
alike, while the fused pose X is held by vision, so that object and contacts would shift against
each other. X H^-1 moves the contacts with X. What was wrong with the first pose of H goes along.

That holds only as long as the object has not slipped, which moves X but not the hand: a motion that
is larger than joints can be off by is taken for slip, and contacts stay.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.rigid_body.rotation import exp_so3, log_so3
from tactile_dynamics_ros.core.streams.streams import (
    ContactStream,
    PoseStream,
    Streams,
    nearest_samples,
)

JOINT_TURN, JOINT_SHIFT = np.deg2rad(0.8), 2.5e-3
"""What joints may turn and shift the object by, rad and m; at twice as much all of it is slip.
Offsets of 0.2 deg and play of 0.1 deg in eleven joints make about so much. Smaller leaves errors of
the hand in the contacts, larger moves contacts with an object that slipped."""
SAME_TIME = 1e-6
"""Poses whose stamps differ by less belong together, s: stamps are nanoseconds in messages and
doubles here, which round by less. Less misses pairs by rounding; from the period of the poses (10
ms) on poses of different times are compared, and motion shows as slip."""
LASTING = 0.1
"""For how long the motion found at one time holds, s: joints' errors change with the posture,
slowly, and poses come at 100 Hz. Beyond it contacts are not moved. Shorter leaves contacts where
the joints have them during gaps of vision, longer carries an error along that the posture has
changed."""


def hand_motions(fused: Array, hand: Array) -> Array:
    """Return X H^-1, less of it where it is large, and the identity where the object has slipped.

    The turn is about the object's origin. Between once and twice what joints may be off by, the
    motion fades, so that contacts do not leap.

    Args:
        fused: (N, 4, 4) X_WO.
        hand: (N, 4, 4) X_WO as the hand alone tells it, at the same times.

    Returns:
        (N, 4, 4) motions of the world.
    """
    turn = log_so3(fused[:, :3, :3] @ np.swapaxes(hand[:, :3, :3], 1, 2))
    shift = fused[:, :3, 3] - hand[:, :3, 3]
    sizes = np.linalg.norm(turn, axis=1) / JOINT_TURN, np.linalg.norm(shift, axis=1) / JOINT_SHIFT
    share = np.clip(2.0 - np.maximum(*sizes), 0.0, 1.0)[:, None]
    motions = np.tile(np.eye(4), (len(fused), 1, 1))
    motions[:, :3, :3] = exp_so3(share * turn)
    origin = np.einsum("nij,nj->ni", motions[:, :3, :3], hand[:, :3, 3])
    motions[:, :3, 3] = hand[:, :3, 3] + share * shift - origin
    return motions


def carry_contacts(streams: Streams, hand: PoseStream) -> Streams:
    """Return the streams with contacts where the fused pose, that of the streams, has them.

    Args:
        streams: with a pose.
        hand: pose of the object by the hand alone. Where most of its stamps are not those of the
            fused pose, contacts stay as they are.
    """
    fused = streams.pose
    if fused is None:
        return streams
    nearest = nearest_samples(fused.time, hand.time)
    paired = np.abs(fused.time[nearest] - hand.time) < SAME_TIME
    inside = (hand.time >= fused.time[0]) & (hand.time <= fused.time[-1])
    if not paired.any() or np.mean(paired[inside]) < 0.5:
        return streams
    motions = hand_motions(_matrices(fused)[nearest[paired]], _matrices(hand)[paired])
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
