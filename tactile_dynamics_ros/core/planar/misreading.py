"""Recordings of pushes whose signs, units or axes are other than the contracts say.

A tip touches the outline and presses into it, the table is below the object, and what is pushed
weighs what things weigh. Where that is not so as the numbers are read, but is in another reading,
that reading is named; nothing has to be fitted for it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.errors import BadInputError, nearest
from tactile_dynamics_ros.core.planar.mechanics.linkage import in_frame
from tactile_dynamics_ros.core.planar.mechanics.outline import area_and_centroid
from tactile_dynamics_ros.core.planar.streams import LinkStream, PushContact, PushedStreams

_PRESSES = 3.0
"""Force that counts as a touch, in standard deviations of its noise, or of 0.03 N."""
_FEWEST = 20
"""Touching samples below which nothing is said: a fifth of a second at 100 Hz."""
_OUTWARD = 0.9
"""Share of touching samples whose force points out of the object from which its sign is wrong: of
right ones hardly any does, at corners a few per cent."""
_AWAY, _BETTER, _BESIDE = 0.01, 4.0, 0.08
"""Median distance of the contacts from the outline over the size of the object: above the first,
another reading is looked for, which must bring it down by the second and below the third.
Synthetic recordings have 0.003 as they are and 0.03 to 900 in other readings; of round objects a
yaw that turns the other way does not show. A calibration that is off by a few per cent is no other
reading: none brings it down."""
_SPIN = 5.0
"""Way of the outline by turning over that of the contact, from which no push turned it: pushed
beside its middle an object turns by as much as the tip goes. Yaw in degrees has 5 to 60."""
_WINDOW = 0.3
"""s over which turns and ways are reported: the noise of poses is then a fraction of either."""
_DENSITIES = (0.5, 3e4)
"""Friction times density, kg/m^3, of what is pushed: an empty box of paper on ice has 1, tungsten
on rubber 20000. Other units of force are a thousand times off, usual things at 100 to 3000."""


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


def _flipped(contact: PushContact, flip: Array) -> PushContact:
    return replace(
        contact,
        force=contact.force * flip,
        point=contact.point * flip,
        normal=contact.normal * flip,
    )


def _mirrored(contact: PushContact) -> PushContact:
    return _flipped(contact, np.array([1.0, -1.0, 1.0]))


def _turned_over(streams: PushedStreams) -> PushedStreams:
    """In axes that are turned by half a turn about x."""
    flip = np.array([1.0, -1.0, -1.0])

    def turned(contact: PushContact) -> PushContact:
        torque = None if contact.torque is None else contact.torque * flip
        return replace(_flipped(contact, flip), torque=torque)

    streams = _with_contacts(_with_poses(streams, lambda pose: pose * flip), turned)
    yaw = None if streams.pusher_yaw is None else -streams.pusher_yaw
    return replace(streams, gravity=streams.gravity * flip, pusher_yaw=yaw)


def _scaled_forces(streams: PushedStreams, scale: float) -> PushedStreams:
    def scaled(contact: PushContact) -> PushContact:
        std = None if contact.force_std is None else scale * contact.force_std
        torque = None if contact.torque is None else scale * contact.torque
        return replace(contact, force=scale * contact.force, force_std=std, torque=torque)

    return _with_contacts(streams, scaled)


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
    Reading(
        "gravity_direction",
        "the support's z, its normal, points down: turn its pose by 180 degrees about its x",
        _turned_over,
    ),
    Reading(
        "force_unit",
        "forces are in mN, not N (in grams they would look alike: convert those yourself)",
        lambda s: _scaled_forces(s, 1e-3),
    ),
    Reading("force_unit", "forces are in kN, not N", lambda s: _scaled_forces(s, 1e3)),
)
"""Readings that are tried, in this order; more would find what no recording was seen to have."""


def check_reading(streams: PushedStreams) -> None:
    """Check that the numbers are those of a tip that presses against a thing on a table.

    Without forces nothing presses, and nothing is checked.

    Raises:
        BadInputError: they are in another reading only, which is named.
    """
    found = misread(streams) if streams.feels else None
    if found is not None:
        raise BadInputError(
            f"signs, units or axes: {found.change}; read it so with --assume {found.name}"
        )


def misread(streams: PushedStreams) -> Reading | None:
    """Another reading in which a tip presses against a thing on a table, or None."""
    now = _judged(streams)
    if now.is_right:
        return None
    judged = [(_judged(reading.applied(streams)), reading) for reading in READINGS]
    found, best = min(judged, key=lambda pair: pair[0].faults)
    better = now.faults[0] > found.faults[0] or found.away < now.away / _BETTER
    return best if better and found.faults[0] == 0 and found.away < _BESIDE else None


def assumed(streams: PushedStreams, name: str) -> tuple[PushedStreams, Reading]:
    """The recording as a convention says, in the form that suits a thing on a table best.

    Raises:
        BadInputError: there is no such convention for pushes.
    """
    forms = [reading for reading in READINGS if reading.name == name]
    if not forms:
        known = sorted({reading.name for reading in READINGS})
        raise BadInputError(
            f"--assume {name}: expected one of {', '.join(known)} for pushes" + nearest(name, known)
        )
    best = min(forms, key=lambda form: _judged(form.applied(streams)).faults)
    return best.applied(streams), best


@dataclass(frozen=True)
class _Judged:
    """What is odd about a reading.

    Attributes:
        hangs: the support is above the object.
        outward: forces point out of it.
        odd: it is denser or lighter than any thing.
        spins: it turns further than the contacts go.
        away: median distance of contacts from the outline over its size.
    """

    hangs: bool
    outward: bool
    odd: bool
    spins: bool
    away: float

    @property
    def faults(self) -> tuple[int, float]:
        """How many faults there are, and the distance."""
        return self.hangs + self.outward + self.odd + self.spins, self.away

    @property
    def is_right(self) -> bool:
        """Whether nothing is odd."""
        return self.faults[0] == 0 and self.away < _AWAY


def _judged(streams: PushedStreams) -> _Judged:
    hangs, outward, away, spin = bool(streams.gravity[2] > 0.0), [], [], []
    force, height = [], []
    for contact in streams.contacts.values():
        if len(contact.time) == 0 or len(contact.pose_time) == 0:
            continue
        std = 0.03 if contact.force_std is None else float(np.max(contact.force_std))
        touching = np.linalg.norm(contact.force[:, :2], axis=1) > _PRESSES * std
        time = contact.time[touching]
        normal = _at(time, contact.pose_time, contact.normal)
        point = _at(time, contact.pose_time, contact.point)
        outward.append(np.sum(contact.force[touching] * normal, axis=1) < 0.0)
        away.append(_distance(streams, time, point))
        spin.append(_spin(streams, contact, time))
        force.append(np.linalg.norm(contact.force[touching, :2], axis=1))
        height.append(point[:, 2])
    every = np.concatenate([*outward, np.zeros(0, dtype=bool)])
    if len(every) < _FEWEST:
        return _Judged(hangs, False, False, False, 0.0)
    density = _density(streams, np.concatenate(force), np.concatenate(height))
    return _Judged(
        hangs,
        bool(np.mean(every) > _OUTWARD),
        not _DENSITIES[0] < density < _DENSITIES[1],
        min(spin) > _SPIN,
        float(np.median(np.concatenate(away))),
    )


def _spin(streams: PushedStreams, contact: PushContact, time: Array) -> float:
    """Median way (m) by which the nearest outline turns while it is touched, over the contact's."""
    ends = time[time < time[-1] - _WINDOW] if len(time) else time
    if len(ends) < _FEWEST:
        return 0.0
    gone = np.linalg.norm(
        _at(ends + _WINDOW, contact.pose_time, contact.point)
        - _at(ends, contact.pose_time, contact.point),
        axis=1,
    )
    least = []
    for link in streams.links:
        yaw = np.interp(ends + _WINDOW, link.time, link.pose[:, 2])
        turn = np.abs(yaw - np.interp(ends, link.time, link.pose[:, 2]))
        reach = 0.5 * float(np.linalg.norm(np.ptp(link.footprint, axis=0)))
        moving = gone > 0.02 * reach
        least.append(reach * float(np.sum(turn[moving])) / max(float(np.sum(gone[moving])), 1e-9))
    return min(least)


def _density(streams: PushedStreams, force: Array, height: Array) -> float:
    """Friction times density, kg/m^3, by the median force (M,), N, on what stands on the outlines.

    It is twice as high as its centre of mass, or as the contact (M,), m, where that is not known.
    """
    tall = 2.0 * (np.array(streams.com_height) if streams.com_height else np.median(height))
    area = [abs(area_and_centroid(np.asarray(link.footprint))[0]) for link in streams.links]
    volume = float(np.sum(np.array(area) * np.maximum(tall, 1e-3)))
    return float(np.median(force)) / (9.81 * max(volume, 1e-12))


def _at(time: Array, known: Array, values: Array) -> Array:
    return np.stack([np.interp(time, known, column) for column in values.T], axis=1)


def _distance(streams: PushedStreams, time: Array, point: Array) -> Array:
    """Distance (N,) of points from the nearest outline, over its size."""
    found = []
    for link in streams.links:
        pose = _at(time, link.time, link.pose)
        local = in_frame(point[:, :2], pose)
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
