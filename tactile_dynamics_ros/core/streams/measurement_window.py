"""The last seconds of live measurements, as streams for a batch fit."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.streams.streams import (
    ContactSample,
    ContactStream,
    PoseStream,
    Streams,
)

_RESTARTED = 1.0
"""Age, s, of a stamp against the newest from which its stream begins anew: clocks restart, samples
come late by far less. As `stamps._TOLERANCE`; less would forget a window for a late sample, more
would keep samples of a clock that was set back by less, out of order."""


_STEP_GAP = 0.25
"""Pause, s, that is put between what came before a step of the clock and what comes after: longer
than any window of the motion, so that no sample is joined across it. Shorter joins them, longer
drops more of the oldest samples."""

_AROUND = 5.0
"""Time, s, that is kept after the object was let go, and of what comes while nothing is held: a
batch of one stream may come before that of the other, and queues of streams are five seconds deep.
Less would lose readings whose counterpart comes in the next batch, more keeps what belongs to no
grasp."""


@dataclass
class _Entries:
    """Readings in the order of their stamps, each a tuple that begins with its time.

    Attributes:
        kept: until shortly after the object was let go. coming: the latest after that.
    """

    kept: deque[tuple[Any, ...]] = field(default_factory=deque)
    coming: deque[tuple[Any, ...]] = field(default_factory=deque)

    @property
    def newest(self) -> float:
        """Stamp of the newest entry, s; minus infinity where there is none."""
        entries = self.coming or self.kept
        return float(entries[-1][0]) if entries else -np.inf

    def append(self, entry: tuple[Any, ...]) -> bool:
        """Add an entry that is newer than all; return False (and do not) if it is not."""
        time = entry[0]
        if time < self.newest - _RESTARTED:
            self.kept.clear()
            self.coming.clear()
        if time <= self.newest:
            return False
        self.coming.append(entry)
        return True

    def settle(self, held: float, duration: float) -> None:
        """Keep what is of the last `duration` s in which the object was held, until `held`, s."""
        while self.coming and self.coming[0][0] <= held + _AROUND:
            self.kept.append(self.coming.popleft())
        _drop_before(self.coming, self.newest - _AROUND)
        _drop_before(self.kept, held - duration)

    def move(self, change: float) -> None:
        """Move all entries in time, s."""
        for entries in (self.kept, self.coming):
            moved = [(entry[0] + change, *entry[1:]) for entry in entries]
            entries.clear()
            entries.extend(moved)

    def since(self, first: float) -> list[tuple[Any, ...]]:
        """Entries kept from a time (s) on."""
        return [entry for entry in self.kept if entry[0] >= first]


def _drop_before(entries: deque[tuple[Any, ...]], first: float) -> None:
    while entries and entries[0][0] < first:
        entries.popleft()


class MeasurementWindow:
    """Poses and contacts of the last `duration` seconds in which the object was held.

    Held means that its pose comes and something touches it. What comes while nothing is held, poses
    or forces of zero, does not push the last grasp out of the window.

    Args:
        duration: s.
    """

    def __init__(self, duration: float) -> None:
        self._duration = duration
        self.clear()

    @property
    def contacts(self) -> tuple[str, ...]:
        """Names of the contacts that were heard."""
        return tuple(self._contacts)

    @property
    def newest(self) -> float:
        """Stamp until which the object was held, s; minus infinity where it was not."""
        return min(self._poses.newest, self._touched)

    @property
    def span(self) -> float:
        """Time from the oldest pose until the object was let go, s."""
        kept = self._poses.kept
        return max(self.newest - float(kept[0][0]), 0.0) if kept else 0.0

    def clear(self) -> None:
        """Forget everything."""
        self._poses = _Entries()
        self._contacts: dict[str, _Entries] = {}
        self._touched = -np.inf

    def add_pose(self, t: float, X_WO: Array, covariance: Array | None) -> None:
        """Add a pose (4, 4) with covariance (6, 6) [rotation, position], None if not stated."""
        if self._poses.append((t, X_WO, covariance)):
            self._poses.settle(self.newest, self._duration)

    def add_contact(self, contact: ContactSample) -> None:
        """Add what one contact applies on the object."""
        entries = self._contacts.setdefault(contact.name, _Entries())
        if not entries.append((contact.time, contact)):
            return
        if contact.touches:
            self._touched = contact.time
        entries.settle(self.newest, self._duration)

    def step_back(self, step: float) -> None:
        """Take what is kept for older, with a gap, since the clock stepped back by `step` s."""
        change = -(step + _STEP_GAP)
        for entries in (self._poses, *self._contacts.values()):
            entries.move(change)
        self._touched += change

    def streams(self, window: float = np.inf) -> Streams:
        """The last `window` seconds of measurements.

        Raises:
            BadInputError: there are none.
        """
        for entries in (self._poses, *self._contacts.values()):
            entries.settle(self.newest, self._duration)
        if len(self._poses.kept) < 2 or not self._contacts:
            raise BadInputError("nothing held yet: no object pose or no contact has arrived")
        first = self.newest - window
        contacts = {
            name: _contact_stream(name, found)
            for name, entries in self._contacts.items()
            if len(found := entries.since(first)) >= 2
        }
        return Streams(_pose_stream(self._poses.since(first)), contacts)


def _pose_stream(entries: list[tuple[Any, ...]]) -> PoseStream:
    time, matrices, covariances = zip(*entries, strict=True)
    poses = np.array(matrices)
    stated = all(covariance is not None for covariance in covariances)
    return PoseStream(
        time=np.array(time),
        position=poses[:, :3, 3],
        rotation=poses[:, :3, :3],
        covariance=np.array(covariances) if stated else None,
    )


def _contact_stream(name: str, entries: list[tuple[Any, ...]]) -> ContactStream:
    time, contacts = np.array([entry[0] for entry in entries]), [entry[1] for entry in entries]
    torque = np.array([contact.torque for contact in contacts])
    stds = [contact.std for contact in contacts]
    return ContactStream(
        name=name,
        time=time,
        force=np.array([contact.force for contact in contacts]),
        torque=torque,
        force_std=None if any(std is None for std in stds) else np.array(stds),
        pose_time=time,
        position=np.array([contact.point for contact in contacts]),
        rotation=np.array([contact.rotation for contact in contacts]),
        carries_torque=bool(np.any(torque != 0.0)),
    )
