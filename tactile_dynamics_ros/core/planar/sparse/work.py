"""Friction force from the work of a push between two rests, whatever the speed in between."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.errors import NotIdentifiableError
from tactile_dynamics_ros.core.planar.mechanics.linkage import turned
from tactile_dynamics_ros.core.planar.mechanics.support import SupportPatch
from tactile_dynamics_ros.core.planar.streams import PushContact, PushedStreams

Array = NDArray[np.float64]

_INTERVAL = 0.04
"""Length of the intervals whose ways are added up, s. At 10 ms the noise of poses (0.1 mm) adds 3 %
to the way of a foot; at 0.1 s paths that bend are 1 % too short."""
_MOVES = 1e-3
"""Way of a foot in an interval, m, from which the object moves (25 mm/s): of slower intervals, work
and way are left out, as noise is all that a resting object seems to move. Pushes at 25 to 40 mm/s
would come out 20 % too low; `fit_sparse` is for those."""
_ABOVE_NOISE = 4.0
"""Way over the stated noise of poses from which the object moves; noise of 0.5 mm at rest looks
like ways of up to 1.5 mm."""


def product_between_rests(streams: PushedStreams) -> float:
    """Product q = m mu g, N, as work of the contacts over the way that friction resists.

    q = sum F . dx / sum p_i |dx_i|: kinetic energy is the same (none) before and after, so that
    neither mass nor accelerations are needed. The pressure is taken as even.

    Raises:
        NotIdentifiableError: the object does not move, or nothing pushes it while it does.
    """
    link = streams.links[0]
    count = max(2, int((link.time[-1] - link.time[0]) / _INTERVAL))
    time = np.linspace(link.time[0], link.time[-1], count)
    pose = np.stack([np.interp(time, link.time, part) for part in link.pose.T], axis=1)
    patch = SupportPatch(np.asarray(link.footprint, dtype=np.float64))
    feet = [_ways(pose, np.tile(point, (count, 1))) for point in patch.offset + patch.centroid]
    travel = patch.share @ np.linalg.norm(feet, axis=2)
    noise = 0.0 if link.pose_std is None else float(link.pose_std[0])
    moves = travel > max(_MOVES, _ABOVE_NOISE * noise)
    work = sum(_work(contact, time, pose) for contact in streams.contacts.values())
    done = float(np.sum(work * moves))
    if done <= 0.0:
        raise NotIdentifiableError(
            f"contacts do {done:.2g} J on the object, expected more than none; push it, and check "
            "the sign of forces (on the object) and their frame"
        )
    return done / float(travel[moves].sum())


def _work(contact: PushContact, time: Array, pose: Array) -> Array:
    """Work (N - 1,) of a contact in each interval, J."""
    place = np.stack([np.interp(time, contact.pose_time, p) for p in contact.point.T[:2]], axis=1)
    own = turned(place - pose[:, :2], -pose[:, 2])
    middle = 0.5 * (own[:-1] + own[1:])
    way = _ways(pose, np.concatenate([middle, middle[-1:]]))
    force = np.zeros((len(time) - 1, 2))
    slot = np.searchsorted(time, contact.time, side="right") - 1
    inside = (slot >= 0) & (slot < len(force))
    np.add.at(force, slot[inside], contact.force[inside, :2])
    samples = np.bincount(slot[inside], minlength=len(force)).clip(1)
    return np.asarray(np.sum(force / samples[:, None] * way, axis=1))


def _ways(pose: Array, point: Array) -> Array:
    """Ways (N - 1, 2) of points (N, 2) of the link during each interval."""
    before = pose[:-1, :2] + turned(point[:-1], pose[:-1, 2])
    return np.asarray(pose[1:, :2] + turned(point[:-1], pose[1:, 2]) - before)
