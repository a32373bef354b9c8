"""Signs that a recording was not made to the contract: units, axes, sign of forces, dead trackers.

None of them is proof: a note is given, and the recording is used as it is.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.rigid_body.rotation import log_so3
from tactile_dynamics_ros.core.streams.streams import ContactStream, PoseStream, Streams, on_lines

Array = NDArray[np.float64]

_FEWEST = 10
_FARTHEST = 3.0
"""Distance of a contact from the object's origin that no held object has, m."""
_FARTHEST_STEP, _WIDEST_STEP = 0.1, 0.5
"""Median step from one pose to the next that no hand makes, m and rad."""
_STEADY = 0.9
"""Length of the mean net force over its mean length, from which its direction is steady."""
_UPWARD = 0.5
"""Cosine of the angle between the mean net force and up, below which it does not carry."""


def doubtful_conventions(streams: Streams) -> list[str]:
    """Return one line for each thing that a recording made to the contract does not show.

    Args:
        streams: cleaned measurements.
    """
    doubts = [_doubt_forces(list(streams.contacts.values()))]
    if streams.pose is not None and len(streams.pose.time) >= _FEWEST:
        units = _doubt_units(streams.pose, list(streams.contacts.values()))
        doubts += [units or _doubt_order(streams.pose), _doubt_tracker(streams.pose)]
    return [doubt for doubt in doubts if doubt]


def _doubt_forces(contacts: list[ContactStream]) -> str:
    """Where the net force of the contacts steadily points anywhere but up."""
    net = _net_force([c for c in contacts if len(c.time) >= _FEWEST])
    if not len(net):
        return ""
    mean = net.mean(axis=0)
    size = float(np.linalg.norm(mean))
    if size < _STEADY * np.linalg.norm(net, axis=1).mean() or mean[2] > _UPWARD * size:
        return ""
    x, y, z = np.round(mean / size, 1) + 0.0
    return (
        f"the contact forces add up to {size:.2g} N along ({x:.1f}, {y:.1f}, {z:.1f}), but to "
        "carry the object they should point up, (0, 0, 1): negate them if they are forces on the "
        "fingers; check that z of the world is up; or something else carries the object"
    )


def _net_force(contacts: list[ContactStream]) -> Array:
    """Sum of the forces (N, 3) while any contact touches, in world axes."""
    if not contacts:
        return np.zeros((0, 3))
    time = max((c.time for c in contacts), key=len)
    each = [on_lines(c.time, c.force, time) for c in contacts]
    total = np.asarray(np.sum(each, axis=0))
    return total[np.any(each, axis=(0, 2))]


def _doubt_units(pose: PoseStream, contacts: list[ContactStream]) -> str:
    """Where contacts lie metres away from the object."""
    for contact in contacts:
        if not len(contact.pose_time):
            continue
        points = on_lines(contact.pose_time, contact.position, pose.time)
        distance = float(np.median(np.linalg.norm(points - pose.position, axis=1)))
        if distance > _FARTHEST:
            return (
                f"contact {contact.name} is {distance:.3g} m from the object's origin: positions "
                "must be in metres, of the same world frame for object and contacts"
            )
    return ""


def _doubt_order(pose: PoseStream) -> str:
    """Where poses jump from sample to sample."""
    step = float(np.median(np.linalg.norm(np.diff(pose.position, axis=0), axis=1)))
    turns = log_so3(pose.rotation[1:] @ np.swapaxes(pose.rotation[:-1], 1, 2))
    turn = float(np.median(np.linalg.norm(turns, axis=1)))
    if step < _FARTHEST_STEP and turn < _WIDEST_STEP:
        return ""
    return (
        f"the object's pose jumps by {step:.2g} m and {turn:.2g} rad from one sample to the next: "
        "check that stamps are those of the measurement and the tracker follows one object"
    )


def _doubt_tracker(pose: PoseStream) -> str:
    """Where the pose is the same to the last digit all along."""
    if np.any(pose.position != pose.position[0]) or np.any(pose.rotation != pose.rotation[0]):
        return ""
    return (
        f"the object's pose never changes ({len(pose.time)} equal samples): check the tracker; "
        "an object at rest shows no inertia"
    )
