"""Rates and gaps of what was recorded."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.rigid_body.rotation import log_so3, nearest_rotation
from tactile_dynamics_ros.core.streams.streams import PoseStream, Streams

_GAP_PERIODS = 2.5
"""Step between samples, in median periods, from which there is a gap: a lost sample makes 2, jitter
included 2.5. Lower counts jitter, higher overlooks two lost samples."""
_STEADY = 5.0
"""Standard deviations by which halves of a hold may differ in their mean: once in a million by
chance, where a motion of 1 mm or 0.1 deg a second is twenty. At 3 one hold in a hundred moves."""


@dataclass(frozen=True)
class StreamRate:
    """Rate and gaps of one stream.

    Attributes:
        name: of the stream, as people call it.
        samples: their number.
        rate_hz: of the median period.
        gaps: steps longer than `_GAP_PERIODS`.
        longest_gap_s: the longest of them; 0 if there is none.
        lost_share: time in gaps over the stream's length.
    """

    name: str
    samples: int
    rate_hz: float
    gaps: int
    longest_gap_s: float
    lost_share: float

    @classmethod
    def of(cls, name: str, time: Array) -> StreamRate:
        """Count the gaps of stamps (N,) s."""
        steps = np.diff(time)
        if not len(steps):
            return cls(name, len(time), 0.0, 0, 0.0, 0.0)
        period = float(np.median(steps))
        gaps = steps[steps > _GAP_PERIODS * period]
        lost = float((gaps - period).sum() / (time[-1] - time[0]))
        longest = float(gaps.max()) if len(gaps) else 0.0
        return cls(name, len(time), 1.0 / period, len(gaps), longest, lost)

    @property
    def words(self) -> str:
        """The rate, and gaps if there are any, in words."""
        plain = f"{self.name}: {self.rate_hz:.0f} Hz"
        if not self.gaps:
            return plain
        return f"{plain}, {self.gaps} gaps, the longest {self.longest_gap_s:.2g} s"


def stream_rates(streams: Streams) -> list[StreamRate]:
    """Return the rates of poses, IMU, and forces and poses of every contact."""
    times = {f"force of {name}": c.time for name, c in streams.contacts.items()}
    times |= {f"pose of {name}": c.pose_time for name, c in streams.contacts.items()}
    for name, stream in (("object's pose", streams.pose), ("object's IMU", streams.imu)):
        if stream is not None:
            times[name] = stream.time
    return [StreamRate.of(name, time) for name, time in times.items()]


def rests_between_gaps(pose: PoseStream) -> bool:
    """Whether an object moves in gaps only, as in tables of static poses: nothing is lost in them.

    Args:
        pose: of the object.
    """
    steps = np.diff(pose.time)
    ends = np.flatnonzero(steps > _GAP_PERIODS * np.median(steps)) + 1
    pieces = np.split(np.arange(len(pose.time)), ends)
    return len(ends) > 0 and all(_rests(pose, piece) for piece in pieces)


def _rests(pose: PoseStream, piece: NDArray[np.int64]) -> bool:
    """Whether the halves of a piece have the same mean pose, to what its scatter explains."""
    mean = nearest_rotation(pose.rotation[piece].mean(axis=0))
    turned = log_so3(mean.T @ pose.rotation[piece])
    place = np.concatenate([turned, pose.position[piece]], axis=1)
    half = len(piece) // 2
    if half == 0:
        return True
    moved = place[half:].mean(axis=0) - place[:half].mean(axis=0)
    scatter = np.std(place, axis=0) * np.sqrt(1.0 / half + 1.0 / (len(piece) - half))
    return bool(np.all(np.abs(moved) <= _STEADY * scatter + 1e-12))
