"""What was measured of one object since a reset, around its pushes, as streams for a fit."""

from __future__ import annotations

from collections import deque

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.planar.filter.tracker import Felt, touches
from tactile_dynamics_ros.core.planar.streams import LinkStream, PushContact, PushedStreams

Array = NDArray[np.float64]

_AROUND = 1.0
"""Time before and after a touch that is kept, s: fits look at 0.15 s before and 0.4 s after."""
_APART = 0.5
"""Silence, s, that parts two pushes; bounces are shorter, and no arm comes back within it."""
_MOST = 60_000
"""Samples of one stream that are held until the next push ends: ten minutes at 100 Hz."""


class PushRecord:
    """Keeps poses and contacts of the latest pushes.

    Args:
        longest: s of touch that are kept; older pushes go.

    Attributes:
        ended: whether a push has ended since `streams` was called last.
    """

    def __init__(self, longest: float) -> None:
        self._longest = longest
        self._poses: deque[tuple[float, Array, Array]] = deque(maxlen=_MOST)
        self._felt: dict[str, deque[Felt]] = {}
        self._touched: deque[float] = deque(maxlen=_MOST)
        self._new = False

    def add_pose(self, time: float, pose: Array, std: Array) -> None:
        """Take a pose (3,) with its std (3,)."""
        self._poses.append((time, pose, std))

    def add_contact(self, felt: Felt) -> None:
        """Take a force."""
        self._felt.setdefault(felt.name, deque(maxlen=_MOST)).append(felt)
        if touches(felt):
            self._touched.append(felt.time)
            self._new = True

    def has_ended(self, now: float) -> bool:
        """Whether there was a push that is not in a fit yet, and has ended."""
        return self._new and bool(self._touched) and now - self._touched[-1] > _AROUND

    @property
    def pushes(self) -> int:
        """How many pushes are kept, parted by silence."""
        times = np.sort(np.asarray(self._touched))
        return int(np.sum(np.diff(times) > _APART)) + bool(len(times))

    def ask_again(self) -> None:
        """Let all pushes count as not in a fit yet."""
        self._new = bool(self._touched)

    def forget_before(self, time: float) -> None:
        """Drop what was measured before a time, s."""
        self._poses = deque((row for row in self._poses if row[0] >= time), maxlen=_MOST)
        for name, felt in self._felt.items():
            kept = (each for each in felt if each.time >= time)
            self._felt[name] = deque(kept, maxlen=_MOST)
        self._touched = deque((at for at in self._touched if at >= time), maxlen=_MOST)

    def streams(self, footprint: Array, gravity: Array) -> PushedStreams:
        """Drop what is far from touches or too old, and return the rest.

        Args:
            footprint: (V, 2) m, link frame.
            gravity: (3,) m/s^2, axes of S.
        """
        self._new = False
        times = np.sort(np.asarray(self._touched))
        period = float(np.median(np.diff(times))) if len(times) > 1 else 0.01
        times = times[-max(int(self._longest / max(period, 1e-3)), 1) :]
        self._touched = deque(times.tolist(), maxlen=_MOST)
        near = _near(np.array([time for time, _, _ in self._poses]), times)
        kept = [row for row, keep in zip(self._poses, near, strict=True) if keep]
        self._poses = deque(kept, maxlen=_MOST)
        contacts = {}
        for name, felt in self._felt.items():
            near = _follows(np.array([each.time for each in felt]), times)
            rows = [each for each, keep in zip(felt, near, strict=True) if keep]
            self._felt[name] = deque(rows, maxlen=_MOST)
            if any(touches(each) for each in rows):
                contacts[name] = _contact(name, rows)
        link = LinkStream(
            np.array([time for time, _, _ in kept]),
            np.array([pose for _, pose, _ in kept]).reshape(-1, 3),
            np.median([std for _, _, std in kept], axis=0) if kept else None,
            footprint,
        )
        return PushedStreams((link,), contacts, gravity)


def _near(at: Array, touched: Array) -> NDArray[np.bool_]:
    """Which times lie around touches."""
    if len(at) == 0 or len(touched) == 0:
        return np.zeros(len(at), dtype=bool)
    after = np.clip(np.searchsorted(touched, at), 0, len(touched) - 1)
    before = np.maximum(after - 1, 0)
    gap = np.minimum(np.abs(touched[after] - at), np.abs(touched[before] - at))
    return np.asarray(gap <= _AROUND)


def _follows(at: Array, touched: Array) -> NDArray[np.bool_]:
    """Which times lie within or after touches: before, the object rests, and silence tells nothing.

    Where poses come at 30 Hz their noise would be taken for sliding without a force.
    """
    if len(at) == 0 or len(touched) == 0:
        return np.zeros(len(at), dtype=bool)
    last = np.searchsorted(touched, at, side="right") - 1
    return np.asarray((last >= 0) & (at - touched[np.maximum(last, 0)] <= _AROUND))


def _contact(name: str, rows: list[Felt]) -> PushContact:
    placed = [each for each in rows if touches(each)]
    return PushContact(
        name=name,
        time=np.array([each.time for each in rows]),
        force=np.array([each.force for each in rows]),
        force_std=np.median([each.std for each in rows], axis=0),
        pose_time=np.array([each.time for each in placed]),
        point=np.array([each.point for each in placed]),
        normal=np.array([each.normal for each in placed]),
    )
