"""What the joints of an arm measured: positions and torques on one clock."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.errors import BadInputError

_PAUSE = 10.0
"""Pause between recordings that are joined, s: nothing is derived across it."""


@dataclass(frozen=True, eq=False)
class JointStreams:
    """Positions and torques of the joints of an arm, as they were recorded.

    Attributes:
        names: of the n joints.
        time: (N,) s, increasing.
        position: (N, n) rad, or m of joints that slide.
        effort: (N, n) torque of the drive, N m, or N: positive along the joint's axis.
        urdf: text of the arm's URDF.
        gains: (n,) factors by which efforts in the drives' own units were taken as N m; None where
            efforts are in N m.
        gain_std: (n,) std of the logarithm of these factors.
    """

    names: tuple[str, ...]
    time: Array
    position: Array
    effort: Array
    urdf: str = ""
    gains: Array | None = None
    gain_std: Array | None = None

    def __post_init__(self) -> None:
        """Check the shapes.

        Raises:
            BadInputError: arrays do not fit each other.
        """
        shape = (len(self.time), len(self.names))
        for what, array in (("position", self.position), ("effort", self.effort)):
            if array.shape != shape:
                raise BadInputError(
                    f"{what}: shape {array.shape}; expected {shape}, as time and names"
                )

    @classmethod
    def join(cls, parts: Sequence[JointStreams]) -> JointStreams:
        """Several recordings of one arm, one after the other with a pause between them.

        Raises:
            BadInputError: they are of different joints.
        """
        names = parts[0].names
        if any(set(part.names) != set(names) for part in parts):
            raise BadInputError(f"joints: recordings of other joints than {', '.join(names)}")
        own = [part.of(names) for part in parts]
        gains, std = own[0].gains, own[0].gain_std
        if gains is not None:
            own = [part.raw.scaled(gains, std) for part in own]
        starts = np.cumsum([0.0, *(part.duration + _PAUSE for part in own[:-1])])
        return replace(
            own[0],
            time=np.concatenate([p.time - p.time[0] + s for p, s in zip(own, starts, strict=True)]),
            position=np.concatenate([p.position for p in own]),
            effort=np.concatenate([p.effort for p in own]),
        )

    @property
    def raw(self) -> JointStreams:
        """Efforts as the drives reported them, without gains."""
        if self.gains is None:
            return self
        return replace(self, effort=self.effort / self.gains, gains=None, gain_std=None)

    @property
    def duration(self) -> float:
        """Seconds from the first to the last sample."""
        return float(self.time[-1] - self.time[0]) if len(self.time) else 0.0

    def between(self, start: float, stop: float) -> JointStreams:
        """What was measured from start to stop, s on the clock of `time`."""
        inside = (self.time >= start) & (self.time <= stop)
        return replace(
            self,
            time=self.time[inside],
            position=self.position[inside],
            effort=self.effort[inside],
        )

    def scaled(self, factors: Array, std: Array | None = None) -> JointStreams:
        """Efforts times a factor for each joint (n,).

        Args:
            factors: by which efforts are multiplied.
            std: (n,) of the factors' logarithms where they are uncertain gains of drives.
        """
        gains = self.gains if std is None else factors * (1.0 if self.gains is None else self.gains)
        kept = self.gain_std if std is None else std
        return replace(self, effort=self.effort * factors, gains=gains, gain_std=kept)

    def of(self, names: Sequence[str]) -> JointStreams:
        """Only these joints, in this order."""
        columns = [self.names.index(name) for name in names]
        return replace(
            self,
            names=tuple(names),
            position=self.position[:, columns],
            effort=self.effort[:, columns],
            gains=None if self.gains is None else self.gains[columns],
            gain_std=None if self.gain_std is None else self.gain_std[columns],
        )
