"""Fuse the kinematic pose with vision: joints tell fast motion, vision tells slip in the hand.

The object's pose is X_WO = X_kinematic T(s), where the slip s = [rotation, translation] in the
object frame wanders. A Kalman filter estimates s from vision at vision's own time stamps, so that
latency does little harm: s changes slowly while an image travels. How fast s wanders is learnt
from the innovations: they are large where the object slips.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.configuration import check_ranges, parameter
from tactile_dynamics_ros.core.errors import NotIdentifiableError
from tactile_dynamics_ros.core.rigid_body.rotation import exp_so3, log_so3

Array = NDArray[np.float64]

CHI2_6_9999 = 27.86
"""0.9999 quantile of chi squared with six degrees of freedom."""


@dataclass(frozen=True)
class PoseFusionConfig:
    """How fast the object may slip in the hand, and what vision is worth."""

    slip_position: float = parameter(4e-4, "usual slip in the hand", "m/sqrt(s)", 1e-7, 0.1)
    slip_rotation_deg: float = parameter(0.3, "usual turn in the hand", "deg/sqrt(s)", 1e-4, 90.0)
    adaptation: float = parameter(0.1, "how fast slip is learnt from innovations", "", 0.0, 1.0)
    strongest_slip: float = parameter(1e4, "largest factor on the usual slip's variance", "", 1.0)
    bias_position: float = parameter(2e-4, "constant error of vision", "m", 0.0, 0.1)
    bias_rotation_deg: float = parameter(0.05, "constant error of vision", "deg", 0.0, 45.0)
    history: float = parameter(1.0, "longest latency of vision", "s", 0.01, 60.0)
    outliers_to_restart: int = parameter(10, "rejected poses in a row that mean a slip", "", 1)

    def __post_init__(self) -> None:
        check_ranges(self)


class PoseFusion:
    """Pose of a held object from kinematic predictions and delayed vision.

    Args:
        config: process noise and gates.

    Attributes:
        rejected: poses from vision in a row that did not fit.
        slip_factor: how much faster than usual the slip's variance grows now.
    """

    def __init__(self, config: PoseFusionConfig | None = None) -> None:
        self.config = config or PoseFusionConfig()
        turn, shift = np.deg2rad(self.config.slip_rotation_deg), self.config.slip_position
        self._growth = np.diag([turn**2] * 3 + [shift**2] * 3)
        self.reset()

    def reset(self) -> None:
        """Forget the slip and all poses: the object was grasped anew."""
        self.rejected = 0
        self.slip_factor = 1.0
        self._history: deque[tuple[float, Array]] = deque()
        self._grown: deque[tuple[float, float]] = deque()
        self._slip = np.eye(4)
        self._corrected = -np.inf
        self._covariance: Array | None = None

    def predict(self, kinematic: Array, covariance: Array, time: float) -> tuple[Array, Array]:
        """Take a kinematic pose and return the fused one.

        Args:
            kinematic: (4, 4) X_WO of the kinematic tracker.
            covariance: (6, 6) of it [rotation, position], world axes; where the slip starts.
            time: s, not decreasing.

        Returns:
            X_WO (4, 4) and its covariance (6, 6) [rotation, position], world axes.
        """
        kinematic = np.asarray(kinematic, dtype=float)
        if self._covariance is None:
            self._covariance = _to_body(np.asarray(covariance, dtype=float), kinematic)
        elif self._history:
            grown = self.slip_factor * max(0.0, time - self._history[-1][0])
            self._covariance = self._covariance + grown * self._growth
            self._grown.append((time, grown))
        self._history.append((time, kinematic))
        for past in (self._history, self._grown):
            while past and past[0][0] < time - self.config.history:
                past.popleft()
        return self._fuse(kinematic, self._covariance)

    def correct(self, vision: Array, covariance: Array, time: float) -> bool:
        """Correct the slip by a pose from vision; return whether it was used.

        Images older than the history or than the last one that came are not used.

        Args:
            vision: (4, 4) X_WO.
            covariance: (6, 6) of it [rotation, position], world axes.
            time: s, when the image was taken.

        Raises:
            NotIdentifiableError: no kinematic pose is known yet.
        """
        if self._covariance is None:
            raise NotIdentifiableError("pose fusion: vision came before any kinematic pose")
        kinematic = self._kinematic_at(time)
        if kinematic is None or time < self._corrected:
            return False
        self._corrected = time
        predicted = kinematic @ self._slip
        noise = _to_body(np.asarray(covariance, dtype=float), predicted)
        innovation = _body_difference(predicted, np.asarray(vision, dtype=float))
        since = self._grown_since(time) * self._growth
        past = self._covariance - since
        spread = past + noise
        misfit = float(innovation @ np.linalg.solve(spread, innovation))
        self._adapt(misfit)
        if misfit > CHI2_6_9999:
            self.rejected += 1
            if self.rejected < self.config.outliers_to_restart:
                return False
            past = past + np.outer(innovation, innovation)
            spread = past + noise
        self.rejected = 0
        gain = np.linalg.solve(spread, past).T
        self._slip = self._slip @ _small_transform(gain @ innovation)
        remaining = np.eye(6) - gain
        self._covariance = remaining @ past @ remaining.T + gain @ noise @ gain.T + since
        return True

    def _grown_since(self, time: float) -> float:
        """Return by how many times the growth per second the covariance has grown since a time."""
        return sum(grown for when, grown in self._grown if when > time)

    def _adapt(self, misfit: float) -> None:
        """Let the slip grow faster where innovations exceed their covariance, slower otherwise."""
        change = self.config.adaptation * np.clip(misfit / 6.0 - 1.0, -1.0, 10.0)
        factor = self.slip_factor * float(np.exp(change))
        self.slip_factor = min(max(factor, 0.1), self.config.strongest_slip)

    def _fuse(self, kinematic: Array, covariance: Array) -> tuple[Array, Array]:
        pose = kinematic @ self._slip
        bias = [np.deg2rad(self.config.bias_rotation_deg)] * 3 + [self.config.bias_position] * 3
        turn = np.kron(np.eye(2), pose[:3, :3])
        return pose, turn @ (covariance + np.diag(bias) ** 2) @ turn.T

    def _kinematic_at(self, time: float) -> Array | None:
        """Interpolate the kinematic pose at a past time; None if it lies outside the history."""
        if not self._history or time < self._history[0][0]:
            return None
        after = self._history[-1]
        for before in reversed(self._history):
            if before[0] <= time:
                return _interpolate(before, after, time)
            after = before
        return None


def _interpolate(before: tuple[float, Array], after: tuple[float, Array], time: float) -> Array:
    span = after[0] - before[0]
    share = min((time - before[0]) / span, 1.0) if span > 0.0 else 0.0
    step = _body_difference(before[1], after[1])
    return np.asarray(before[1] @ _small_transform(share * step))


def _body_difference(start: Array, end: Array) -> Array:
    """Return (6,) [rotation vector, translation] from start to end in the axes of start."""
    relative = start[:3, :3].T @ end[:3, :3]
    return np.concatenate([log_so3(relative), start[:3, :3].T @ (end[:3, 3] - start[:3, 3])])


def _small_transform(step: Array) -> Array:
    transform = np.eye(4)
    transform[:3, :3], transform[:3, 3] = exp_so3(step[:3]), step[3:]
    return transform


def _to_body(covariance: Array, pose: Array) -> Array:
    turn = np.kron(np.eye(2), pose[:3, :3].T)
    return np.asarray(turn @ covariance @ turn.T)
