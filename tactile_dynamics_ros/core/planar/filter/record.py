"""What was measured of one object since a reset, around its pushes, as streams for a fit."""

from __future__ import annotations

from collections import deque
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.planar.filter.tracker import ContactForce, touches
from tactile_dynamics_ros.core.planar.streams import (
    USUAL_POSE_STD,
    LinkStream,
    PushContact,
    PushedStreams,
)

_AROUND = 1.0
"""Time before and after a touch that is kept, s: fits look at 0.15 s before and 0.4 s after."""
_APART = 0.5
"""Silence, s, that parts two pushes; bounces are shorter, and no arm comes back within it."""
_MOST = 60_000
"""Samples of one stream that are held until the next push ends: ten minutes at 100 Hz."""
_MOST_TURNS = 30_000
"""Poses of the pusher that are kept: five minutes at 100 Hz, as long as pushes are; fewer would let
the axes of the first pushes be those of later ones."""


class PushRecord:
    """Keeps poses and contacts of the latest pushes.

    Args:
        longest: s of touch that are kept; older pushes go.

    Attributes:
        ended: whether a push has ended since `streams` was called last.
    """

    def __init__(self, longest: float) -> None:
        self._longest = longest
        self._poses: dict[int, deque[tuple[float, Array, Array]]] = {0: deque(maxlen=_MOST)}
        self._measured: dict[str, deque[ContactForce]] = {}
        self._touched: deque[float] = deque(maxlen=_MOST)
        self._turns: deque[tuple[float, float]] = deque(maxlen=_MOST_TURNS)
        self._new = False

    def add_pose(self, time: float, pose: Array, std: Array, link: int = 0) -> None:
        """Take a pose (3,) of a link with its std (3,)."""
        poses = self._poses.setdefault(link, deque(maxlen=_MOST))
        self._drop_rest(poses, time)
        poses.append((time, pose, std))

    def add_pusher(self, time: float, yaw: float) -> None:
        """Take how the pusher is turned, rad: the axes of its sensor."""
        self._drop_rest(self._turns, time)
        self._turns.append((time, yaw))

    def add_contact(self, measured: ContactForce) -> None:
        """Take a force; long after a touch, silence tells nothing and is left out."""
        if touches(measured):
            self._touched.append(measured.time)
            self._new = True
        if self._touched and measured.time - self._touched[-1] <= _AROUND:
            self._measured.setdefault(measured.name, deque(maxlen=_MOST)).append(measured)

    def _drop_rest(self, rows: deque[Any], now: float) -> None:
        """Drop rows far from touches where a deque is full, so that a rest pushes no push out.

        Args:
            rows: that begin with their time, s.
            now: s.
        """
        resting = not self._touched or now - self._touched[-1] > _AROUND
        if len(rows) < (rows.maxlen or 0) or not resting:
            return
        times = np.array([row[0] for row in rows])
        keep = _near(times, np.sort(np.asarray(self._touched))) | (times > now - _AROUND)
        kept = [row for row, near in zip(rows, keep, strict=True) if near]
        rows.clear()
        rows.extend(kept)

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
        for link, poses in self._poses.items():
            self._poses[link] = deque((row for row in poses if row[0] >= time), maxlen=_MOST)
        for name, measured in self._measured.items():
            kept = (each for each in measured if each.time >= time)
            self._measured[name] = deque(kept, maxlen=_MOST)
        self._touched = deque((at for at in self._touched if at >= time), maxlen=_MOST)

    def streams(self, *footprints: Array, gravity: Array) -> PushedStreams:
        """Drop what is far from touches or too old, and return the rest.

        Args:
            footprints: (V, 2) m of link_1, and of link_2 where there is one, each in its frame.
            gravity: (3,) m/s^2, axes of S.
        """
        self._new = False
        times = np.sort(np.asarray(self._touched))
        period = float(np.median(np.diff(times))) if len(times) > 1 else 0.01
        times = times[-max(int(self._longest / max(period, 1e-3)), 1) :]
        self._touched = deque(times.tolist(), maxlen=_MOST)
        links = tuple(self._link(k, outline, times) for k, outline in enumerate(footprints))
        contacts = {}
        for name, measured in self._measured.items():
            near = _follows(np.array([each.time for each in measured]), times)
            rows = [each for each, keep in zip(measured, near, strict=True) if keep]
            self._measured[name] = deque(rows, maxlen=_MOST)
            if any(touches(each) for each in rows):
                contacts[name] = _contact(name, rows)
        time, yaw = np.array(self._turns).T if self._turns else (None, None)
        return PushedStreams(links, contacts, gravity, pusher_time=time, pusher_yaw=yaw)

    def _link(self, link: int, footprint: Array, touched: Array) -> LinkStream:
        """Poses of one link around touches, s; the others go."""
        poses = self._poses.get(link, deque())
        near = _near(np.array([time for time, _, _ in poses]), touched)
        kept = [row for row, keep in zip(poses, near, strict=True) if keep]
        self._poses[link] = deque(kept, maxlen=_MOST)
        return LinkStream(
            np.array([time for time, _, _ in kept]),
            np.array([pose for _, pose, _ in kept]).reshape(-1, 3),
            np.median([std for _, _, std in kept], axis=0) if kept else None,
            footprint,
        )


class PushWindow:
    """Keeps poses and forces around the latest touches, of one part or of two.

    Args:
        longest: s of touch that are kept.

    Attributes:
        gravity: (3,) m/s^2, axes of the support.
        newest: s, stamp of the newest force or pose; minus infinity where there is none.
        second: takes outline and poses of link_2.
    """

    def __init__(self, longest: float) -> None:
        self._longest = longest
        self.gravity = np.array([0.0, 0.0, -9.81])
        self._outlines: dict[int, Array] = {}
        self.second = SecondPart(self)
        self.clear()

    def clear(self) -> None:
        """Forget all measurements; the outline stays."""
        self._record = PushRecord(self._longest)
        self.newest = -np.inf
        self._parts = 1

    def set_outline(self, outline: Array, link: int = 0) -> bool:
        """Take the footprint (V, 2), m; another one is another object and begins anew."""
        before = self._outlines.get(link)
        self._outlines[link] = outline
        changed = before is not None and not np.array_equal(before, outline)
        if changed:
            self.clear()
        return changed

    def add_pose(self, time: float, pose: Array, std: Array | None, link: int = 0) -> None:
        """Take where a link is: x, y, yaw, with their std where stated."""
        spread = USUAL_POSE_STD if std is None or not np.all(std > 0.0) else std
        self._record.add_pose(time, pose, spread, link)
        self._parts = max(self._parts, link + 1)
        self.newest = max(self.newest, time)

    def add_pusher(self, time: float, pose: Array) -> None:
        """Take where the pusher is: x, y, z, yaw; its axes matter."""
        self._record.add_pusher(time, float(pose[3]))

    def add_contact(self, measured: ContactForce) -> None:
        """Take a force on the object."""
        self._record.add_contact(measured)
        self.newest = max(self.newest, measured.time)

    def streams(self, window: float = np.inf) -> PushedStreams:
        """All pushes that are kept: a few seconds of one push would tell nothing.

        Args:
            window: not used.

        Raises:
            BadInputError: no outline was seen of a part whose poses came, or nothing was touched.
        """
        for link in range(self._parts):
            if link not in self._outlines:
                part = f"link_{link + 1}/" if link else ""
                raise BadInputError(
                    f"/object/{part}footprint has not come: start shape_estimator, or send it"
                )
        outlines = [self._outlines[link] for link in range(self._parts)]
        streams = self._record.streams(*outlines, gravity=self.gravity)
        if not streams.contacts:
            raise BadInputError("nothing was pushed yet; push the object first")
        return replace(streams, links=tuple(_unwrapped(link) for link in streams.links))


class SecondPart:
    """Takes what is heard of link_2 for a window.

    Args:
        window: of both parts.
    """

    def __init__(self, window: PushWindow) -> None:
        self._window = window

    def set_outline(self, outline: Array) -> bool:
        """Take the footprint (V, 2), m, in the frame of link_2."""
        return self._window.set_outline(outline, 1)

    def add_pose(self, time: float, pose: Array, std: Array | None) -> None:
        """Take where link_2 is: x, y, yaw, with their std where stated."""
        self._window.add_pose(time, pose, std, 1)


def _unwrapped(link: LinkStream) -> LinkStream:
    """With a yaw that has no jumps."""
    pose = np.column_stack([link.pose[:, :2], np.unwrap(link.pose[:, 2])])
    return replace(link, pose=pose)


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


def _contact(name: str, rows: list[ContactForce]) -> PushContact:
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
