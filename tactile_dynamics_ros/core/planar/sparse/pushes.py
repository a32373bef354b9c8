"""Pieces of a recording from one known pose to the next, with the pusher's path between them."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.errors import BadInputError, NotIdentifiableError
from tactile_dynamics_ros.core.planar.mechanics.linkage import turned
from tactile_dynamics_ros.core.planar.mechanics.outline import edge_normals, nearest_edge
from tactile_dynamics_ros.core.planar.streams import LinkStream, PushContact, PushedStreams

STEPS = 48
"""Steps of the pusher in one piece: 0.3 mm each in 16 mm. Against 96 steps they move yaw and slip
of 50 recorded pushes by 0.04 deg and 0.05 mm (medians), 24 steps by 0.08 deg and 0.15 mm."""
STEADY = 0.4
"""Share of the travel after which the force is averaged: before it the tip comes near and friction
builds up, so that means from 0.2 on have the first touch of slow pushes in them."""
_TRAVEL = 0.015
"""Travel of the pusher, m, at which a piece ends. Much shorter ones turn the object by no more than
the noise of its pose; much longer ones sum up what the model lacks."""
_REACH = 0.004
"""Distance of the pusher from the outline at the end of a piece, m, up to which it touches: the
radius of a tip that was not taken off and errors of calibration."""
_FEWEST = 3
"""Places of the pusher in a piece at least; of fewer, its path is not known."""


@dataclass(frozen=True, eq=False)
class Pushes:
    """K pieces in which the pusher moves the object.

    Attributes:
        start: (K, 3) pose of the link before, m and rad.
        end: (K, 3) pose after, yaw continuous with that before.
        path: (K, STEPS + 1, 2) m, places of the contact, moved onto the outline at the end.
        normal: (K, 2) of the touched edge into the object, axes of the link.
        force: (K, 2) N on the object, mean of the steady part; NaN where none was measured.
        height: (K,) m of the contact above the support.
        speed: (K,) m/s of the pusher.
    """

    start: Array
    end: Array
    path: Array
    normal: Array
    force: Array
    height: Array
    speed: Array

    def __len__(self) -> int:
        return len(self.start)

    @property
    def touched(self) -> Array:
        """(K, 2) m, link frame, the point that is touched at the end."""
        return turned(self.path[:, -1] - self.end[:, :2], -self.end[:, 2])

    @property
    def _chord(self) -> Array:
        first = self.start[:, :2] + turned(self.touched, self.start[:, 2])
        return np.asarray(self.path[:, -1] - first)

    @property
    def way(self) -> Array:
        """(K,) m, how far the touched point of the object moves."""
        return np.asarray(np.linalg.norm(self._chord, axis=1))

    @property
    def drag(self) -> Array:
        """(K,) N, work of the force on the object per way of the touched point."""
        return np.asarray(np.sum(self.force * self._chord, axis=1) / self.way)

    def taken(self, chosen: NDArray[np.intp]) -> Pushes:
        """Some of the pieces."""
        return replace(
            self, **{name: getattr(self, name)[chosen] for name in self.__dataclass_fields__}
        )


def cut_pushes(streams: PushedStreams) -> Pushes:
    """Pieces of all contacts with the first link.

    Raises:
        BadInputError: there is no contact.
        NotIdentifiableError: in no piece the pusher touches the object.
    """
    if not streams.contacts:
        raise BadInputError("contacts: none; expected the path of a pusher, such as /pusher/pose")
    link, pieces = streams.links[0], []
    for contact in streams.contacts.values():
        for first, last in _spans(link, contact, streams.session_starts):
            piece = _piece(link, contact, first, last)
            if piece is not None:
                pieces.append(piece)
    if not pieces:
        raise NotIdentifiableError(
            f"the pusher touches the outline after no piece of {1e3 * _TRAVEL:.0f} mm; push "
            "further or check footprint, units and frames"
        )
    return Pushes(*(np.array(part) for part in zip(*pieces, strict=True)))


def _spans(
    link: LinkStream, contact: PushContact, sessions: tuple[float, ...]
) -> list[tuple[int, int]]:
    """Indices of poses between which the pusher travels far enough."""
    along = np.linalg.norm(np.diff(contact.point[:, :2], axis=0), axis=1)
    travel = np.interp(link.time, contact.pose_time, np.append(0.0, np.cumsum(along)))
    session = np.searchsorted(np.array(sessions), link.time, side="right")
    spans, first = [], 0
    for k in range(1, len(link.time)):
        if session[k] != session[first]:
            first = k
        elif travel[k] - travel[first] >= _TRAVEL:
            spans.append((first, k))
            first = k
    return spans


def _piece(
    link: LinkStream, contact: PushContact, first: int, last: int
) -> tuple[Array, Array, Array, Array, Array, float, float] | None:
    start, end = link.pose[first], link.pose[last]
    span = _touching(link, contact, first, last)
    if span is None:
        return None
    time = _at_equal_travel(contact, *span)
    path = np.stack([np.interp(time, contact.pose_time, p) for p in contact.point.T], axis=1)
    depth, normal = _depth(link.footprint, end, path[-1:])
    if abs(depth[0]) > _REACH:
        return None
    onto = path[:, :2] - depth[0] * turned(normal, end[2:])
    speed = float(np.linalg.norm(np.diff(path[:, :2], axis=0), axis=1).sum() / (time[-1] - time[0]))
    force = np.full(2, np.nan)
    if len(contact.time):
        sampled = [np.interp(time, contact.time, part) for part in contact.force.T[:2]]
        force = np.array(sampled)[:, int(STEADY * STEPS) :].mean(axis=1)
    return start, end, onto, normal[0], force, float(path[:, 2].mean()), speed


def _touching(
    link: LinkStream, contact: PushContact, first: int, last: int
) -> tuple[float, float] | None:
    """Times between which the pusher may touch: from near the first pose to deepest in the last."""
    inside = (contact.pose_time > link.time[first]) & (contact.pose_time < link.time[last])
    if inside.sum() < _FEWEST:
        return None
    time, path = contact.pose_time[inside], contact.point[inside]
    until = int(np.argmax(_depth(link.footprint, link.pose[last], path)[0]))
    before, _ = _depth(link.footprint, link.pose[first], path[: until + 1])
    away = np.flatnonzero(before < -_REACH)
    since = int(away[-1]) if len(away) else 0
    return None if since >= until else (float(time[since]), float(time[until]))


def _at_equal_travel(contact: PushContact, since: float, until: float) -> Array:
    """Times (STEPS + 1,) between which the pusher travels alike: while it rests nothing slides."""
    inside = (contact.pose_time > since) & (contact.pose_time < until)
    time = np.concatenate([[since], contact.pose_time[inside], [until]])
    path = np.stack([np.interp(time, contact.pose_time, p) for p in contact.point.T[:2]], axis=1)
    way = path - path[0]
    along = np.maximum.accumulate(way @ way[-1]) / max(float(way[-1] @ way[-1]), 1e-12)
    share = np.clip(along, 0.0, 1.0) + 1e-6 * np.linspace(0.0, 1.0, len(time))
    return np.asarray(np.interp(np.linspace(share[0], share[-1], STEPS + 1), share, time))


def _depth(outline: Array, pose: Array, place: Array) -> tuple[Array, Array]:
    """Depth (N,) of places (N, 2 or 3) in an object at a pose, and normals (N, 2) of its edges."""
    own = turned(place[:, :2] - pose[:2], np.full(len(place), -pose[2]))
    return nearest_edge(outline, edge_normals(outline), own)
