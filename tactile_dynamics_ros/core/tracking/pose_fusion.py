"""Pose of a held object from the hand and from vision; average of poses at rest.

The kinematic prediction is precise over a fraction of a second but misses slip. A Kalman filter
estimates the slip, a small transform in the object's frame between prediction and object, as a
random walk whose rate follows the innovations. What vision gets wrong is partly the same from image
to image; this wander is estimated beside the slip, so that many images do not feign a precision
that they do not have. Images are late: each corrects the slip with the prediction of its own time,
which only needs the predictions of the last moments.

Where no image comes any more, the object may roll on the fingers at a speed that lasts, which no
random walk covers: the covariance then grows with the square of the time.

Corrections are spread over a moment, so that the pose can be differentiated twice. Where vision
contradicts, the covariance says so at once, and grows to the size of the disagreement
until one of the two gives in.

Source: Kalman filter with a Gauss-Markov measurement error as state (Bar-Shalom et al., 2001).
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.configuration import check_ranges, parameter
from tactile_dynamics_ros.core.errors import BadInputError, NotIdentifiableError
from tactile_dynamics_ros.core.rigid_body.rotation import exp_so3, log_so3, twice

_ITERATIONS = 10
"""Steps to the mean rotation, at most. They end earlier when a step is below 1e-12 rad: after four
where poses scatter by 0.6 deg, five by 3 deg, eight by 17 deg. Fewer leave the mean off where poses
scatter widely."""


def average_poses(poses: Array) -> tuple[Array, Array]:
    """Return the mean pose and the covariance of that mean.

    The rotation is the Karcher mean, sum log(R_mean^T R_i) = 0.

    Args:
        poses: (N, 4, 4) X_WO, N >= 2.

    Returns:
        (4, 4) mean, (6, 6) covariance [rotation, position] about world axes, rad and m.

    Raises:
        BadInputError: fewer than two poses.
    """
    poses = np.asarray(poses, dtype=float)
    if len(poses) < 2:
        raise BadInputError(f"average of poses: {len(poses)} given, expected at least 2")
    rotation = poses[0, :3, :3]
    for _ in range(_ITERATIONS):
        step = log_so3(poses[:, :3, :3] @ rotation.T).mean(axis=0)
        rotation = exp_so3(step) @ rotation
        if np.linalg.norm(step) < 1e-12:
            break
    mean = np.eye(4)
    mean[:3, :3] = rotation
    mean[:3, 3] = poses[:, :3, 3].mean(axis=0)
    spread = np.hstack([log_so3(poses[:, :3, :3] @ rotation.T), poses[:, :3, 3] - mean[:3, 3]])
    return mean, spread.T @ spread / (len(poses) - 1) / len(poses)


CHI2_6_9999 = 27.86
"""0.9999 quantile of chi squared with six degrees of freedom: of fifteen honest images a second one
is refused in eleven minutes. Lower refuses more, higher lets a wrong pose in."""
_SLIP, _WANDER = slice(0, 6), slice(6, 12)
"""Places of slip and wander in the state. Fixed by the order of the state; `_BOTH` needs both to
have six numbers."""
_BOTH = np.hstack([np.eye(6), np.eye(6)])
"""Derivative (6, 12) of vision's disagreement by [slip, wander]: it is their sum. A factor other
than one on either side would let it take more of the disagreement than there is."""


@dataclass(frozen=True)
class PoseFusionConfig:
    """Rate at which the object may slip in the hand, and how uncertain vision is."""

    slip_position: float = parameter(5e-4, "usual slip in the hand", "m/sqrt(s)", 1e-7, 0.1)
    slip_rotation_deg: float = parameter(0.3, "usual turn in the hand", "deg/sqrt(s)", 1e-4, 90.0)
    adaptation: float = parameter(0.3, "how fast slip is learnt from innovations", "", 0.0, 1.0)
    strongest_slip: float = parameter(1e4, "largest factor on the usual slip's variance", "", 1.0)
    bias_position: float = parameter(2e-4, "constant error of vision", "m", 0.0, 0.1)
    bias_rotation_deg: float = parameter(0.02, "constant error of vision", "deg", 0.0, 45.0)
    wander_position: float = parameter(8e-5, "wandering error of vision", "m", 0.0, 0.1)
    wander_rotation_deg: float = parameter(0.03, "wandering error of vision", "deg", 0.0, 45.0)
    wander_time: float = parameter(1.0, "how long that error stays alike", "s", 0.01, 1e3)
    smoothing: float = parameter(0.04, "time over which a correction is spread", "s", 0.0, 10.0)
    history: float = parameter(1.0, "longest latency of vision", "s", 0.01, 60.0)
    unseen_after: float = parameter(0.2, "pause of vision that counts as absence", "s", 0.0, 60.0)
    unseen_slip: float = parameter(
        11.0,
        "slip at a steady speed while unseen, as a multiple of the usual",
        "1/sqrt(s)",
        0.0,
        100.0,
    )
    unseen_time: float = parameter(0.7, "how long that speed may last", "s", 0.0, 60.0)
    outliers_to_restart: int = parameter(6, "rejected poses in a row that mean a slip", "", 1)
    doubt_position: float = parameter(0.03, "spread of a pose that images refute", "m", 0.0, 1.0)
    doubt_rotation_deg: float = parameter(20.0, "spread of a refuted pose", "deg", 0.0, 180.0)

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
        self.config = config = config or PoseFusionConfig()
        self._growth = _spread(config.slip_rotation_deg, config.slip_position)
        self._bias = _spread(config.bias_rotation_deg, config.bias_position)
        self._wander_spread = _spread(config.wander_rotation_deg, config.wander_position)
        self.reset()

    @property
    def doubtful(self) -> bool:
        """Whether vision contradicts the pose."""
        return bool(self._doubt.any())

    def reset(self) -> None:
        """Forget the slip and all poses: the object was grasped anew."""
        self.rejected = 0
        self.slip_factor = 1.0
        self._history: deque[tuple[float, Array]] = deque()
        self._grown: deque[tuple[float, float]] = deque()
        self._slip = np.eye(4)
        self._wander = np.zeros(6)
        self._corrected = -np.inf
        self._doubt = np.zeros((6, 6))
        self._pending, self._pending_speed = np.zeros(6), np.zeros(6)
        self._covariance: Array | None = None

    def predict(self, kinematic: Array, covariance: Array, time: float) -> tuple[Array, Array]:
        """Take a kinematic pose and return the fused one.

        Args:
            kinematic: (4, 4) X_WO of the kinematic tracker.
            covariance: (6, 6) covariance of the pose [rotation, position], world axes; where the
                slip starts.
            time: s, not decreasing.

        Returns:
            X_WO (4, 4) and its covariance (6, 6) [rotation, position], world axes.
        """
        kinematic = np.asarray(kinematic, dtype=float)
        if self._covariance is None:
            self._covariance = np.zeros((12, 12))
            self._covariance[_SLIP, _SLIP] = _to_body(np.asarray(covariance), kinematic)
            self._covariance[_WANDER, _WANDER] = self._wander_spread
        elif self._history:
            elapsed = max(0.0, time - self._history[-1][0])
            grown = self.slip_factor * elapsed + self._grown_unseen(self._history[-1][0], time)
            self._spread_correction(elapsed)
            self._covariance[_SLIP, _SLIP] += grown * self._growth
            self._grown.append((time, grown))
        self._history.append((time, kinematic))
        for past in (self._history, self._grown):
            while past and past[0][0] < time - self.config.history:
                past.popleft()
        return self._fuse(kinematic, self._covariance[_SLIP, _SLIP])

    def _grown_unseen(self, before: float, now: float) -> float:
        """Return how the slip's variance grows between two times as it does while unseen.

        What rolls on the fingers does so at a speed that lasts: (a t)^2 until it has turned back.
        """
        config = self.config
        if self._corrected == -np.inf:
            return 0.0
        first, last = (
            min(max(time - self._corrected - config.unseen_after, 0.0), config.unseen_time)
            for time in (before, now)
        )
        return config.unseen_slip**2 * (last**2 - first**2)

    def correct(self, vision: Array, covariance: Array, time: float) -> bool:
        """Correct the slip by a pose from vision; return whether it was used.

        Images older than the history or than the last one that came are not used.

        Args:
            vision: (4, 4) X_WO.
            covariance: (6, 6) covariance of the pose [rotation, position], world axes.
            time: s, when the image was taken.

        Raises:
            NotIdentifiableError: no kinematic pose is known yet.
        """
        if self._covariance is None:
            raise NotIdentifiableError("pose fusion: vision came before any kinematic pose")
        kinematic = self._kinematic_at(time)
        if kinematic is None or time < self._corrected:
            return False
        past, since = self._at_image(time)
        predicted = kinematic @ self._slip
        noise = _to_body(np.asarray(covariance, dtype=float), predicted)
        disagreement = _body_difference(predicted, np.asarray(vision, dtype=float))
        innovation = disagreement - self._wander
        misfit = float(innovation @ np.linalg.solve(_BOTH @ past @ _BOTH.T + noise, innovation))
        self._adapt(misfit)
        if misfit > CHI2_6_9999:
            self.rejected += 1
            if self.rejected < self.config.outliers_to_restart:
                self._doubt = np.outer(disagreement, disagreement)
                return False
            past = self._restart(past, disagreement)
            innovation = disagreement
        jumps = self.rejected > 0
        self.rejected, self._doubt = 0, np.zeros((6, 6))
        step = self._update(past, noise, innovation, since)
        if jumps or self.config.smoothing == 0.0:
            self._pending, self._pending_speed = np.zeros(6), np.zeros(6)
        else:
            self._pending = self._pending - step
        return True

    def _spread_correction(self, elapsed: float) -> None:
        """Let what is not yet corrected fade, critically damped: p'' = -2 p'/T - p/T^2."""
        if not self._pending.any():
            return
        rate = 1.0 / self.config.smoothing
        drift = self._pending_speed + rate * self._pending
        fade = np.exp(-rate * elapsed)
        self._pending = fade * (self._pending + drift * elapsed)
        self._pending_speed = fade * drift - rate * self._pending

    def refute(self) -> None:
        """Note that an image shows the object not to be where it is believed to be."""
        self._doubt = _spread(self.config.doubt_rotation_deg, self.config.doubt_position)

    def _at_image(self, time: float) -> tuple[Array, Array]:
        """Return the covariance (12, 12) when an image was taken, and how the slip's grew since."""
        assert self._covariance is not None
        elapsed = time - self._corrected
        self._corrected = time
        decay = float(np.exp(-elapsed / self.config.wander_time)) if elapsed < np.inf else 0.0
        since = self._grown_since(time) * self._growth
        past = self._covariance.copy()
        past[_SLIP, _SLIP] -= since
        past[_SLIP, _WANDER] *= decay
        past[_WANDER, _SLIP] *= decay
        past[_WANDER, _WANDER] *= decay**2
        past[_WANDER, _WANDER] += (1.0 - decay**2) * self._wander_spread
        self._wander = decay * self._wander
        self._covariance = past.copy()
        self._covariance[_SLIP, _SLIP] += since
        return past, since

    def _restart(self, past: Array, disagreement: Array) -> Array:
        """Let the slip be as large as the disagreement."""
        fresh = np.zeros((12, 12))
        fresh[_SLIP, _SLIP] = past[_SLIP, _SLIP] + np.outer(disagreement, disagreement)
        fresh[_WANDER, _WANDER] = self._wander_spread
        self._wander = np.zeros(6)
        return fresh

    def _update(self, past: Array, noise: Array, innovation: Array, since: Array) -> Array:
        """Correct slip and wander; return the step (6,) of the slip."""
        spread = _BOTH @ past @ _BOTH.T + noise
        gain = np.linalg.solve(spread, _BOTH @ past).T
        step = gain @ innovation
        self._slip = self._slip @ _small_transform(step[_SLIP])
        self._wander = self._wander + step[_WANDER]
        remaining = np.eye(12) - gain @ _BOTH
        self._covariance = remaining @ past @ remaining.T + gain @ noise @ gain.T
        self._covariance[_SLIP, _SLIP] += since
        return np.asarray(step[_SLIP])

    def _grown_since(self, time: float) -> float:
        """Return by how many times the growth per second the covariance has grown since a time."""
        return sum(grown for when, grown in self._grown if when > time)

    def _adapt(self, misfit: float) -> None:
        """Let the slip grow faster where innovations exceed their covariance, slower otherwise."""
        change = self.config.adaptation * np.clip(misfit / 6.0 - 1.0, -1.0, 10.0)
        factor = self.slip_factor * float(np.exp(change))
        self.slip_factor = min(max(factor, 0.1), self.config.strongest_slip)

    def _fuse(self, kinematic: Array, covariance: Array) -> tuple[Array, Array]:
        pose = kinematic @ self._slip @ _small_transform(self._pending)
        turn = twice(pose[:3, :3])
        late = np.outer(self._pending, self._pending)
        return pose, turn @ (covariance + self._bias + self._doubt + late) @ turn.T

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


def _spread(rotation_deg: float, position: float) -> Array:
    return np.diag([np.deg2rad(rotation_deg) ** 2] * 3 + [position**2] * 3)


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
    turn = twice(pose[:3, :3].T)
    return np.asarray(turn @ covariance @ turn.T)
