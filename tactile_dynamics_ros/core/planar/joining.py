"""Several recordings of one object on one support as one, with pauses between them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.planar.streams import LinkStream, PushContact, PushedStreams

_PAUSE = 10.0
"""Time between joined recordings, s: longer than any gap across which a motion is followed, so that
nothing is derived across it."""
_ALIKE = 1e-3
"""Difference of outlines, m, and of directions of gravity up to which they are those of one object
on one support: what tools of shape repeat to."""


def join_pushes(parts: Sequence[PushedStreams]) -> PushedStreams:
    """Put recordings one after the other, each after a pause.

    Noise is as the first that states it says; friction and what sensors do wrong are of all.

    Args:
        parts: of one object, poses in the same axes of the support.

    Raises:
        BadInputError: none is given, or outlines, parts or the lean of the support differ.
    """
    if not parts:
        raise BadInputError("no recording to read; expected one at least")
    first = parts[0]
    for part in parts[1:]:
        _check_alike(first, part)
    shifts, starts, begin = [], [], 0.0
    for part in parts:
        low, high = _span(part)
        shifts.append(begin - low)
        starts.append(begin)
        begin += high - low + _PAUSE
    moved = [_moved(part, shift) for part, shift in zip(parts, shifts, strict=True)]
    names = list(dict.fromkeys(name for part in moved for name in part.contacts))
    joined = replace(
        first,
        links=tuple(_links([part.links[k] for part in moved]) for k in range(len(first.links))),
        contacts={
            name: _contacts([part.contacts[name] for part in moved if name in part.contacts])
            for name in names
        },
        session_starts=tuple(starts),
        force_doubt=max(part.force_doubt for part in parts),
        mass_doubt=max(part.mass_doubt for part in parts),
        pusher_time=None,
        pusher_yaw=None,
    )
    times = [part.pusher_time for part in moved if part.pusher_time is not None]
    yaws = [part.pusher_yaw for part in moved if part.pusher_yaw is not None]
    if len(times) < len(parts) or len(yaws) < len(parts):
        return joined
    return replace(joined, pusher_time=np.concatenate(times), pusher_yaw=np.concatenate(yaws))


def _check_alike(one: PushedStreams, other: PushedStreams) -> None:
    """Check that two recordings are of one object on one support.

    Raises:
        BadInputError: they are not.
    """
    if len(one.links) != len(other.links):
        raise BadInputError(
            f"recordings of {len(one.links)} and of {len(other.links)} parts: not one object"
        )
    for k, (a, b) in enumerate(zip(one.links, other.links, strict=True), start=1):
        if a.footprint.shape != b.footprint.shape or np.any(
            np.abs(a.footprint - b.footprint) > _ALIKE
        ):
            raise BadInputError(
                f"the outlines of link_{k} differ between recordings: not one object, or another "
                "frame; ask about those that were recorded alike"
            )
    if np.linalg.norm(one.gravity - other.gravity) > _ALIKE * np.linalg.norm(one.gravity):
        raise BadInputError(
            "the support leans otherwise in one of the recordings; ask about each alone"
        )


def _span(part: PushedStreams) -> tuple[float, float]:
    """First and last stamp of all streams, s."""
    stamps = [link.time for link in part.links]
    stamps += [time for c in part.contacts.values() for time in (c.time, c.pose_time)]
    if part.pusher_time is not None:
        stamps.append(part.pusher_time)
    held = [time for time in stamps if len(time)]
    return float(min(time[0] for time in held)), float(max(time[-1] for time in held))


def _moved(part: PushedStreams, shift: float) -> PushedStreams:
    """The same, later by a shift, s."""
    links = tuple(replace(link, time=link.time + shift) for link in part.links)
    contacts = {
        name: replace(c, time=c.time + shift, pose_time=c.pose_time + shift)
        for name, c in part.contacts.items()
    }
    pusher = None if part.pusher_time is None else part.pusher_time + shift
    return replace(part, links=links, contacts=contacts, pusher_time=pusher)


def _links(links: Sequence[LinkStream]) -> LinkStream:
    std = next((link.pose_std for link in links if link.pose_std is not None), None)
    time, pose = (np.concatenate([getattr(link, n) for link in links]) for n in ("time", "pose"))
    return replace(links[0], time=time, pose=pose, pose_std=std)


def _contacts(contacts: Sequence[PushContact]) -> PushContact:
    def rows(name: str) -> Array:
        return np.concatenate([getattr(contact, name) for contact in contacts])

    links = {contact.link for contact in contacts}
    return PushContact(
        name=contacts[0].name,
        time=rows("time"),
        force=rows("force"),
        force_std=next((c.force_std for c in contacts if c.force_std is not None), None),
        pose_time=rows("pose_time"),
        point=rows("point"),
        normal=rows("normal"),
        point_std=next((c.point_std for c in contacts if c.point_std is not None), None),
        torque=rows("torque") if all(c.torque is not None for c in contacts) else None,
        link=links.pop() if len(links) == 1 else None,
    )
