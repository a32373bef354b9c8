"""The last seconds of live measurements, as streams for a batch fit."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.streams.streams import (
    ContactSample,
    ContactStream,
    PoseStream,
    Streams,
)

Array = NDArray[np.float64]

_RESTARTED = 1.0
"""Age, s, of a stamp against the newest from which its stream begins anew: clocks restart, samples
come late by far less. As `stamps._TOLERANCE`; less would forget a window for a late sample, more
would keep samples of a clock that was set back by less, out of order."""


@dataclass
class _Entries:
    """Readings in the order of their stamps, each a tuple that begins with its time."""

    kept: deque[tuple[Any, ...]] = field(default_factory=deque)

    def append(self, entry: tuple[Any, ...], duration: float) -> None:
        """Add an entry that is newer than all, and drop those older by more than `duration`, s."""
        time = entry[0]
        if self.kept and time < self.kept[-1][0] - _RESTARTED:
            self.kept.clear()
        if self.kept and time <= self.kept[-1][0]:
            return
        self.kept.append(entry)
        while self.kept[0][0] < time - duration:
            self.kept.popleft()

    def since(self, first: float) -> list[tuple[Any, ...]]:
        """Entries from a time (s) on."""
        return [entry for entry in self.kept if entry[0] >= first]


class MeasurementWindow:
    """Poses and contacts of the last `duration` seconds.

    Args:
        duration: s.
    """

    def __init__(self, duration: float) -> None:
        self._duration = duration
        self.clear()

    @property
    def newest(self) -> float:
        """Stamp of the newest pose, s; minus infinity where there is none."""
        return float(self._poses.kept[-1][0]) if self._poses.kept else -np.inf

    @property
    def span(self) -> float:
        """Time from the oldest to the newest pose, s."""
        kept = self._poses.kept
        return float(kept[-1][0] - kept[0][0]) if kept else 0.0

    def clear(self) -> None:
        """Forget everything."""
        self._poses = _Entries()
        self._contacts: dict[str, _Entries] = {}

    def add_pose(self, t: float, X_WO: Array, covariance: Array | None) -> None:
        """Add a pose (4, 4) with covariance (6, 6) [rotation, position], None if not stated."""
        self._poses.append((t, X_WO, covariance), self._duration)

    def add_contact(self, contact: ContactSample) -> None:
        """Add what one contact applies on the object."""
        self._contacts.setdefault(contact.name, _Entries()).append(
            (contact.time, contact), self._duration
        )

    def streams(self, window: float = np.inf) -> Streams:
        """The last `window` seconds of measurements.

        Raises:
            BadInputError: there are none.
        """
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
