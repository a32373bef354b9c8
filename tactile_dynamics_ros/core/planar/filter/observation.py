"""What is seen and felt during one step, as numbers that a prediction can be compared with."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.planar.filter.process import Prediction, PusherMotion

Array = NDArray[np.float64]

_RELATIVE = 0.02
"""Model error of a force over its size: of the mechanics' coarse footprint and step. At 0.5 % the
innovations of simulated pushes exceed their stated size by half."""


@dataclass(frozen=True, eq=False)
class SeenPose:
    """Pose of one link, somewhere within the step.

    Attributes:
        value: (3,) x, y, yaw. std: (3,). age: s before the step's end. link: index.
    """

    value: Array
    std: Array
    age: float = 0.0
    link: int = 0


@dataclass(frozen=True, eq=False)
class FeltWrench:
    """Wrench of the pusher on the object, mean over the step, about where the pusher began.

    Attributes:
        value: (k,) force x, y (N) and, where the torque is known too, torque (N m).
        std: (k,).
    """

    value: Array
    std: Array


@dataclass(frozen=True, eq=False)
class Observation:
    """All of one step; streams that dropped out are absent.

    Attributes:
        poses: of links. wrench: while the touch lasts.
        slack: (2,) m/s, std of the velocity by which the touched point may lag behind the pusher,
            along the force: tip and arm give way while the force changes.
    """

    poses: tuple[SeenPose, ...] = ()
    wrench: FeltWrench | None = None
    slack: Array = field(default_factory=lambda: np.zeros(2))

    @property
    def value(self) -> Array:
        """(m,) poses, then the wrench."""
        parts = [pose.value for pose in self.poses]
        parts += [self.wrench.value] if self.wrench is not None else []
        return np.concatenate(parts) if parts else np.zeros(0)

    def noise(self, force_std: float = 0.0) -> Array:
        """Standard deviations (m,), with that of the model's forces, N, beside the sensors'."""
        parts = [pose.std for pose in self.poses]
        if self.wrench is not None:
            floor = np.hypot(relative_std(self.wrench.value[:2]), force_std)
            arm = np.array([1.0, 1.0, 0.03])[: len(self.wrench.value)]
            parts.append(np.hypot(self.wrench.std, floor * arm))
        return np.concatenate(parts) if parts else np.zeros(0)

    @property
    def groups(self) -> list[slice]:
        """Which numbers belong to one measurement, that is an outlier or not as a whole."""
        sizes = [3] * len(self.poses)
        sizes += [len(self.wrench.value)] if self.wrench is not None else []
        ends = np.cumsum([0, *sizes])
        return [slice(int(a), int(b)) for a, b in zip(ends[:-1], ends[1:], strict=True)]

    def expected(self, prediction: Prediction) -> Array:
        """What hypotheses expect, (C, m)."""
        parts = [pose_at(prediction.states, pose.link, pose.age) for pose in self.poses]
        if self.wrench is not None:
            parts.append(prediction.wrench[:, : len(self.wrench.value)])
        return np.concatenate([np.zeros((len(prediction.states), 0)), *parts], axis=1)

    def by_state(self, size: int) -> Array:
        """Derivative (m, size) of the poses by the state at the step's end, 0 for the wrench."""
        out = np.zeros((len(self.value), size))
        for k, pose in enumerate(self.poses):
            for axis in range(3):
                out[3 * k + axis, 6 * pose.link + axis] = 1.0
                out[3 * k + axis, 6 * pose.link + 3 + axis] = -pose.age
        return out


class ForceNoise(Protocol):
    """What knows better than a sensor how good its forces are."""

    def felt(
        self, motion: PusherMotion, felt: FeltWrench | None, share: float, state: Array
    ) -> FeltWrench | None:
        """The force of a step with its std, that of the mechanics (`relative_std`) left out.

        Args:
            motion: of the pusher.
            felt: as stated, where it is known.
            share: of the step's samples in which something was touched.
            state: (6 L,) that is believed when the step begins.
        """

    def end(self) -> None:
        """Nothing was touched in this step."""


def relative_std(force: Array) -> Array:
    """Standard deviation (...), N, by which mechanics miss forces (..., 2)."""
    return np.asarray(_RELATIVE * np.linalg.norm(force, axis=-1))


def pose_at(states: Array, link: int, age: float) -> Array:
    """Poses (C, 3) of a link some time, s, before the states (C, 6 L)."""
    first = 6 * link
    return np.asarray(states[:, first : first + 3] - age * states[:, first + 3 : first + 6])
