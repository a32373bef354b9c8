"""What is seen and measured during one step, as numbers that a prediction can be compared with."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.planar.filter.process import Prediction, PusherMotion
from tactile_dynamics_ros.core.planar.mechanics.linkage import turned
from tactile_dynamics_ros.core.planar.mechanics.outline import edge_normals, nearest_edge

_RELATIVE = 0.02
"""Model error of a force over its size: of the mechanics' coarse footprint and step. At 0.5 % the
innovations of simulated pushes exceed their stated size by half."""
_ROUNDS = 3
"""Times that pixels are made linear anew where they place the link: from 3 mm beside it the third
moves it by less than 0.01 mm."""
_BLIND = 1e-9
"""Share of the largest information below which pixels say nothing, such as a disc's of its yaw."""


@dataclass(frozen=True, eq=False)
class SeenPose:
    """Pose of one link, somewhere within the step.

    Attributes:
        value: (3,) x, y, yaw, or what `along` makes of them. std: (3,).
        age: s before the step's end. link: index.
        along: (3, 3) rows, combinations of x, y and yaw with independent errors.
    """

    value: Array
    std: Array
    age: float = 0.0
    link: int = 0
    along: Array = field(default_factory=lambda: np.eye(3))


@dataclass(frozen=True, eq=False)
class MeasuredWrench:
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
    wrench: MeasuredWrench | None = None
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
        parts = [
            pose_at(prediction.states, pose.link, pose.age) @ pose.along.T for pose in self.poses
        ]
        if self.wrench is not None:
            parts.append(prediction.wrench[:, : len(self.wrench.value)])
        return np.concatenate([np.zeros((len(prediction.states), 0)), *parts], axis=1)

    def by_state(self, size: int) -> Array:
        """Derivative (m, size) of the poses by the state at the step's end, 0 for the wrench."""
        out = np.zeros((len(self.value), size))
        for k, pose in enumerate(self.poses):
            rows, first = slice(3 * k, 3 * k + 3), 6 * pose.link
            out[rows, first : first + 3] = pose.along
            out[rows, first + 3 : first + 6] = -pose.age * pose.along
        return out


@dataclass(frozen=True, eq=False)
class Pixels:
    """Part of an image in which one link may be.

    Attributes:
        value: (m,) of any unit. std: (m,) of the independent noise of each.
        render: what poses (C, 3) of the link would show, (C, m).
        lasting: (3,) m, m, rad, std of what all pixels together are off by: calibration, shape.
    """

    value: Array
    std: Array
    render: Callable[[Array], Array]
    lasting: Array


def pose_of_pixels(
    pixels: Pixels, mean: Array, covariance: Array, link: int = 0, age: float = 0.0
) -> SeenPose:
    """Three numbers that say of a pose all that the pixels say, near where it is expected.

    With pixels h(x) + e, e ~ N(0, D), and slopes J at x0, the Kalman update needs the inverse of
    the m x m matrix D + J P J^T. By Woodbury's identity it is that of the 3 x 3 information
    M = J^T D^-1 J and of y = J^T D^-1 (z - h(x0)); beside a lasting error L the information is
    I = M - M (M + L^-1)^-1 M. The rows A of `along` have A^T A = I, and unit noise.

    Args:
        pixels: seen.
        mean: (3,) expected pose.
        covariance: (3, 3); slopes are secants over its spread.
        link: index.
        age: s before the step's end.

    Source: paper B, III-E (pixels as independent observations); Woodbury 1950.
    """
    place, reach, prior = mean, np.sqrt(np.diag(covariance)), np.linalg.inv(covariance)
    for _ in range(_ROUNDS):
        ways = np.diag(reach)
        shown = pixels.render(np.concatenate([place[None], place + ways, place - ways]))
        slopes = ((shown[1:4] - shown[4:]) / (2.0 * reach[:, None])).T
        weighted = slopes / pixels.std[:, None] ** 2
        told, lack = weighted.T @ slopes, weighted.T @ (pixels.value - shown[0])
        here, place = place, place + np.linalg.solve(told + prior, lack + prior @ (mean - place))
    left = told - told @ np.linalg.solve(told + np.diag(pixels.lasting**-2.0), told)
    size, axes = np.linalg.eigh(0.5 * (left + left.T))
    along = np.sqrt(np.maximum(size, 0.0))[:, None] * axes.T
    best = here + np.linalg.pinv(told, rcond=_BLIND, hermitian=True) @ lack
    return SeenPose(along @ best, np.ones(3), age, link, along)


def coverage(outline: Array, poses: Array, places: Array, blur: float) -> Array:
    """Share (C, m) of pixels that an outline at poses covers; its edge is a ramp.

    Args:
        outline: (V, 2) m, convex, frame of the link.
        poses: (C, 3).
        places: (m, 2) m of the pixels' centres on the support.
        blur: m, width of the ramp: that of a pixel.
    """
    away = (places[None] - poses[:, None, :2]).reshape(-1, 2)
    own = turned(away, -np.repeat(poses[:, 2], len(places)))
    depth, _ = nearest_edge(outline, edge_normals(outline), own)
    return np.clip(0.5 + depth.reshape(len(poses), -1) / blur, 0.0, 1.0)


class ForceNoise(Protocol):
    """What knows better than a sensor how good its forces are."""

    def measured(
        self, motion: PusherMotion, measured: MeasuredWrench | None, share: float, state: Array
    ) -> MeasuredWrench | None:
        """The force of a step with its std, that of the mechanics (`relative_std`) left out.

        Args:
            motion: of the pusher.
            measured: as stated, where it is known.
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
