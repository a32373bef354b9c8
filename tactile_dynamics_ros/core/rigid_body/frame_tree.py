"""Frames that move against each other, and where one is in another at any time."""

from __future__ import annotations

from bisect import bisect_left, insort
from dataclasses import dataclass, field

import numpy as np

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.errors import BadInputError, nearest
from tactile_dynamics_ros.core.rigid_body.rotation import inverse_pose, turned_between

_KEPT = 10.0
"""Span for which moving frames are kept, s, as tf2 keeps them: what is asked about is never older
than readings that wait. More costs memory alone."""
_LONGEST_CHAIN = 100
"""Frames between two that are asked about: an arm has ten, and a chain that is longer is a ring."""


@dataclass
class _Link:
    """A frame in its parent: at all times, or at those that were said."""

    parent: str
    static: bool
    times: list[float] = field(default_factory=list)
    poses: list[tuple[float, Array]] = field(default_factory=list)

    def at(self, time: float) -> Array | None:
        """Pose (4, 4) in the parent; None before the first and after the last that was said."""
        if self.static:
            return self.poses[-1][1]
        after = bisect_left(self.times, time)
        if after == len(self.times) or (after == 0 and self.times[0] != time):
            return None
        if self.times[after] == time:
            return self.poses[after][1]
        (start, first), (end, then) = self.poses[after - 1], self.poses[after]
        share = (time - start) / (end - start)
        pose = np.eye(4)
        pose[:3, :3] = turned_between(first[:3, :3], then[:3, :3], np.array(share))
        pose[:3, 3] = (1.0 - share) * first[:3, 3] + share * then[:3, 3]
        return pose


class FrameTree:
    """Frames by name, each in one parent, as tf has them.

    Between two times rotations turn at a constant rate and places move at a constant velocity.
    """

    def __init__(self) -> None:
        """Begin without frames."""
        self._links: dict[str, _Link] = {}

    def clear(self) -> None:
        """Forget what moves; what is static stays."""
        self._links = {name: link for name, link in self._links.items() if link.static}

    def add(self, parent: str, child: str, time: float, pose: Array, static: bool = False) -> None:
        """Say where a frame is.

        Args:
            parent: name of the frame that it is in.
            child: its name.
            time: s; for static ones without meaning.
            pose: (4, 4) of the child in the parent.
            static: whether it is there at all times.
        """
        link = self._links.get(child)
        if link is None or link.parent != parent or link.static != static:
            link = self._links[child] = _Link(parent, static)
        if static:
            link.poses = [(time, pose)]
            return
        where = bisect_left(link.times, time)
        if where < len(link.times) and link.times[where] == time:
            return
        insort(link.times, time)
        link.poses.insert(where, (time, pose))
        while link.times[-1] - link.times[0] > _KEPT:
            del link.times[0], link.poses[0]

    def at(self, base: str, frame: str, time: float) -> Array | None:
        """Return the pose (4, 4) of a frame in another at a time, s.

        Returns:
            None while a frame of the chain is not known at that time.

        Raises:
            BadInputError: a frame was never heard of, or they are not connected.
        """
        above, below = self._ancestors(frame), self._ancestors(base)
        shared = next((name for name in above if name in below), None)
        if shared is None:
            known = sorted({*self._links, *(link.parent for link in self._links.values())})
            missing = next((name for name in (base, frame) if name not in known), "")
            raise BadInputError(
                f"frame '{missing}' is not in /tf or /tf_static{nearest(missing, known)}"
                if missing
                else f"frames '{base}' and '{frame}' are not connected by /tf or /tf_static"
            )
        up = self._compose(above[: above.index(shared)], time)
        down = self._compose(below[: below.index(shared)], time)
        if up is None or down is None:
            return None
        return inverse_pose(down) @ up

    def _ancestors(self, frame: str) -> list[str]:
        """Return a frame, its parent, and so on to the root."""
        found = [frame]
        while found[-1] in self._links:
            found.append(self._links[found[-1]].parent)
            if len(found) > _LONGEST_CHAIN:
                raise BadInputError(f"frame '{frame}' is its own ancestor in /tf")
        return found

    def _compose(self, chain: list[str], time: float) -> Array | None:
        """Pose (4, 4) of the first frame in the parent of the last; None if one is not known."""
        pose = np.eye(4)
        for name in chain:
            step = self._links[name].at(time)
            if step is None:
                return None
            pose = step @ pose
        return pose
