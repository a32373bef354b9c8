"""The latest pushes of live measurements, as streams for a fit."""

from __future__ import annotations

from collections import deque
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.planar.filter.record import PushRecord
from tactile_dynamics_ros.core.planar.filter.tracker import Felt
from tactile_dynamics_ros.core.planar.streams import USUAL_POSE_STD, PushedStreams

Array = NDArray[np.float64]

_MOST = 30_000
"""Poses of the pusher that are kept: five minutes at 100 Hz, as long as pushes are; fewer would let
the axes of the first pushes be those of later ones."""


class PushWindow:
    """Keeps poses and forces around the latest touches.

    Args:
        longest: s of touch that are kept.

    Attributes:
        gravity: (3,) m/s^2, axes of the support.
        newest: s, stamp of the newest force or pose; minus infinity where there is none.
    """

    def __init__(self, longest: float) -> None:
        self._longest = longest
        self.gravity = np.array([0.0, 0.0, -9.81])
        self._outline: Array | None = None
        self.clear()

    def clear(self) -> None:
        """Forget all measurements; the outline stays."""
        self._record = PushRecord(self._longest)
        self._turns: deque[tuple[float, float]] = deque(maxlen=_MOST)
        self.newest = -np.inf

    def set_outline(self, outline: Array) -> bool:
        """Take the footprint (V, 2), m; another one is another object and begins anew."""
        before, self._outline = self._outline, outline
        changed = before is not None and not np.array_equal(before, outline)
        if changed:
            self.clear()
        return changed

    def add_pose(self, time: float, pose: Array, std: Array | None) -> None:
        """Take where the link is: x, y, yaw, with their std where stated."""
        spread = USUAL_POSE_STD if std is None or not np.all(std > 0.0) else std
        self._record.add_pose(time, pose, spread)
        self.newest = max(self.newest, time)

    def add_pusher(self, time: float, pose: Array) -> None:
        """Take where the pusher is: x, y, z, yaw; its axes matter."""
        self._turns.append((time, float(pose[3])))

    def add_contact(self, felt: Felt) -> None:
        """Take a force on the object."""
        self._record.add_contact(felt)
        self.newest = max(self.newest, felt.time)

    def streams(self, window: float = np.inf) -> PushedStreams:
        """All pushes that are kept: a few seconds of one push would tell nothing.

        Args:
            window: not used.

        Raises:
            BadInputError: no outline was seen, or nothing was touched.
        """
        if self._outline is None:
            raise BadInputError("/object/footprint has not come: start shape_estimator, or send it")
        streams = self._record.streams(self._outline, self.gravity)
        if not streams.contacts:
            raise BadInputError("nothing was pushed yet; push the object first")
        link = streams.links[0]
        pose = np.column_stack([link.pose[:, :2], np.unwrap(link.pose[:, 2])])
        time, yaw = np.array(self._turns).T if self._turns else (None, None)
        links = (replace(link, pose=pose),)
        return replace(streams, links=links, pusher_time=time, pusher_yaw=yaw)
