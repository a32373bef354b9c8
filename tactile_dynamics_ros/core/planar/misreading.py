"""Recordings of pushes whose signs, units or axes are other than the contracts say.

A tip touches the outline and presses into it. Where it does neither as the numbers are read, but
does in another reading, that reading is named; nothing has to be fitted for it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.errors import BadInputError, nearest
from tactile_dynamics_ros.core.planar.streams import LinkStream, PushContact, PushedStreams

Array = NDArray[np.float64]

_PRESSES = 3.0
"""Force that counts as a touch, in standard deviations of its noise, or of 0.03 N."""
_FEWEST = 20
"""Touching samples below which nothing is said: a fifth of a second at 100 Hz."""
_OUTWARD = 0.9
"""Share of touching samples whose force points out of the object from which its sign is wrong: of
right ones hardly any does, at corners a few per cent."""
_AWAY, _BETTER, _BESIDE = 0.03, 4.0, 0.08
"""Median distance of the contacts from the outline over the size of the object: above the first,
another reading is looked for, which must bring it down by the second and below the third.
Synthetic recordings have 0.003 as they are and 0.03 to 900 in other readings; of round objects a
wrong yaw does not show. A calibration that is off by a few per cent is no other reading."""


@dataclass(frozen=True)
class Reading:
    """One way to read a recording.

    Attributes:
        name: of the convention, as `--assume` takes it.
        change: what is done to read it so.
        applied: the recording read so.
    """

    name: str
    change: str
    applied: Callable[[PushedStreams], PushedStreams]


def _with_poses(streams: PushedStreams, change: Callable[[Array], Array]) -> PushedStreams:
    links = tuple(replace(link, pose=change(link.pose)) for link in streams.links)
    return replace(streams, links=links)


def _with_contacts(
    streams: PushedStreams, change: Callable[[PushContact], PushContact]
) -> PushedStreams:
    contacts = {name: change(contact) for name, contact in streams.contacts.items()}
    return replace(streams, contacts=contacts)


def _scaled_links(streams: PushedStreams, scale: float, poses: bool) -> PushedStreams:
    def scaled(link: LinkStream) -> LinkStream:
        if not poses:
            return replace(link, footprint=scale * link.footprint)
        std = None if link.pose_std is None else link.pose_std * [scale, scale, 1.0]
        return replace(link, pose=link.pose * [scale, scale, 1.0], pose_std=std)

    return replace(streams, links=tuple(scaled(link) for link in streams.links))


def _scaled_points(contact: PushContact, scale: float) -> PushContact:
    return replace(contact, point=scale * contact.point)


def _mirrored(contact: PushContact) -> PushContact:
    flip = np.array([1.0, -1.0, 1.0])
    return replace(
        contact,
        force=contact.force * flip,
        point=contact.point * flip,
        normal=contact.normal * flip,
    )


_DEGREE = np.pi / 180.0
"""Radians of a degree: a change of units, which nobody can choose otherwise."""
READINGS = (
    Reading(
        "force_sign",
        "forces are those of the object on the pusher: turn their sign",
        lambda s: _with_contacts(s, lambda c: replace(c, force=-c.force)),
    ),
    Reading(
        "angle_unit",
        "yaw is in degrees",
        lambda s: _with_poses(s, lambda pose: pose * [1.0, 1.0, _DEGREE]),
    ),
    Reading(
        "inverse_rotation",
        "yaw turns the other way round",
        lambda s: _with_poses(s, lambda pose: pose * [1.0, 1.0, -1.0]),
    ),
    Reading("position_unit", "poses are in mm", lambda s: _scaled_links(s, 1e-3, True)),
    Reading(
        "position_unit",
        "poses and contact points are in mm",
        lambda s: _with_contacts(_scaled_links(s, 1e-3, True), lambda c: _scaled_points(c, 1e-3)),
    ),
    Reading(
        "position_unit",
        "contact points are in mm",
        lambda s: _with_contacts(s, lambda c: _scaled_points(c, 1e-3)),
    ),
    Reading("position_unit", "the footprint is in mm", lambda s: _scaled_links(s, 1e-3, False)),
    Reading(
        "mirrored_axes",
        "y of forces and contact points has the other sign",
        lambda s: _with_contacts(s, _mirrored),
    ),
)
"""Readings that are tried, in this order; more would find what no recording was seen to have."""


def check_reading(streams: PushedStreams) -> None:
    """Check that the tip presses into the outline.

    Raises:
        BadInputError: it does in another reading only, which is named.
    """
    found = misread(streams)
    if found is not None:
        raise BadInputError(
            f"signs, units or axes: {found.change}; read it so with --assume {found.name}"
        )


def misread(streams: PushedStreams) -> Reading | None:
    """Another reading in which the tip touches the outline and presses into it, or None."""
    outward, away = _judged(streams)
    if not outward and away < _AWAY:
        return None
    judged = [(_judged(reading.applied(streams)), reading) for reading in READINGS]
    pressing = [(distance, reading) for (turned, distance), reading in judged if not turned]
    distance, best = min(pressing, key=lambda pair: pair[0], default=(np.inf, READINGS[0]))
    better = outward or distance < away / _BETTER
    return best if better and distance < _BESIDE else None


def assumed(streams: PushedStreams, name: str) -> tuple[PushedStreams, Reading]:
    """The recording as a convention says, in the form in which the tip touches the outline.

    Raises:
        BadInputError: there is no such convention for pushes.
    """
    forms = [reading for reading in READINGS if reading.name == name]
    if not forms:
        known = sorted({reading.name for reading in READINGS})
        raise BadInputError(
            f"--assume {name}: expected one of {', '.join(known)} for pushes" + nearest(name, known)
        )
    best = min(forms, key=lambda form: _judged(form.applied(streams)))
    return best.applied(streams), best


def _judged(streams: PushedStreams) -> tuple[bool, float]:
    """Whether forces point outwards, and the median distance of contacts over the size."""
    outward, away = [], []
    for contact in streams.contacts.values():
        if len(contact.time) == 0 or len(contact.pose_time) == 0:
            continue
        std = 0.03 if contact.force_std is None else float(np.max(contact.force_std))
        touching = np.linalg.norm(contact.force[:, :2], axis=1) > _PRESSES * std
        time = contact.time[touching]
        normal = _at(time, contact.pose_time, contact.normal)
        outward.append(np.sum(contact.force[touching] * normal, axis=1) < 0.0)
        away.append(_distance(streams, time, _at(time, contact.pose_time, contact.point)))
    every = np.concatenate([*outward, np.zeros(0, dtype=bool)])
    if len(every) < _FEWEST:
        return False, 0.0
    return bool(np.mean(every) > _OUTWARD), float(np.median(np.concatenate(away)))


def _at(time: Array, known: Array, values: Array) -> Array:
    return np.stack([np.interp(time, known, column) for column in values.T], axis=1)


def _distance(streams: PushedStreams, time: Array, point: Array) -> Array:
    """Distance (N,) of points from the nearest outline, over its size."""
    found = []
    for link in streams.links:
        pose = _at(time, link.time, link.pose)
        x, y = (point[:, :2] - pose[:, :2]).T
        cos, sin = np.cos(pose[:, 2]), np.sin(pose[:, 2])
        local = np.stack([cos * x + sin * y, cos * y - sin * x], axis=1)
        size = float(np.linalg.norm(np.ptp(link.footprint, axis=0)))
        found.append(_from_outline(local, np.asarray(link.footprint)) / max(size, 1e-9))
    return np.asarray(np.min(found, axis=0))


def _from_outline(points: Array, outline: Array) -> Array:
    """Distance (N,) m of points (N, 2) from the edges of a polygon (V, 2)."""
    edge = np.roll(outline, -1, axis=0) - outline
    rel = points[:, None] - outline
    along = np.sum(rel * edge, axis=2) / np.maximum(np.sum(edge**2, axis=1), 1e-18)
    foot = np.clip(along, 0.0, 1.0)[..., None] * edge
    return np.asarray(np.linalg.norm(rel - foot, axis=2).min(axis=1))
