"""Motion at this moment from poses so far: velocities and accelerations without looking ahead.

A bank of Kalman filters for a pose whose jerk is white noise, one filter for each ratio of the
jerk's density to the variance of the poses. The innovations of the last seconds say which ratio
fits, so that nothing is tuned to a robot or a tracker.

Source: Bar-Shalom, Li, Kirubarajan 2001, section 6.2.3 (white noise jerk) and 11.6.2 (static
multiple models).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.contact.wrench_samples import GRAVITY_W
from tactile_dynamics_ros.core.rigid_body.rotation import exp_so3, log_so3

_RATIOS = 10.0 ** np.arange(3.0, 16.0)
"""Densities of the jerk over the variance of a pose, 1/s^5: from 1 (m/s^3)^2 s seen with 30 mm to
10^5 seen with 10 um. A decade changes the bandwidth by 1.5, so that the best of them is within a
few per cent of the best there is; beyond the ends no arm moves and no tracker measures."""
_BEGINNING = np.diag([1.0, 1e8, 1e12])
"""Variances of position, velocity and acceleration at the first pose, over that of a pose: 10 m/s
and 1000 m/s^2 at 1 mm. Larger ones change nothing after three poses, smaller ones hold it back."""
_MEMORY = 2.0
"""Time over which innovations are forgotten, s: some hundred poses. Shorter flickers between two
ratios, longer keeps that of a motion that is over."""
_EVERY = 10
"""Poses between two looks at which ratio is best, which changes in seconds: a tenth of the cost."""
_LEAST_STEP = 0.0035
"""Time, s, within which further poses are left out: 250 a second follow any arm. More make
accelerations a tenth less noisy, and cost a third of the processor at 1 kHz."""
_LONGEST_STEP = 0.1
"""Time between poses, s, beyond which the motion begins anew: an arm at 1 Hz makes a third of its
sweep in it. Longer ones would be bridged by a guess, shorter ones break at a lost message."""
_SETTLING = 0.4
"""Time from the first pose until accelerations are known, s: five times the delay of the slowest
filter that was chosen in the benchmark. Shorter shows guesses, longer says nothing for longer."""


class Motion(NamedTuple):
    """A motion at N instants.

    Attributes:
        position: (N, 3) m, world.
        rotation: (N, 3, 3) R_WO.
        velocity: (N, 3) m/s, world.
        acceleration: (N, 3) m/s^2, world.
        angular_velocity: (N, 3) rad/s, body.
        angular_acceleration: (N, 3) rad/s^2, body.
    """

    position: Array
    rotation: Array
    velocity: Array
    acceleration: Array
    angular_velocity: Array
    angular_acceleration: Array


class _Bank:
    """What positions and rotations have in common: innovations, and which ratio explains them.

    Attributes:
        best: ratio of the largest likelihood, the variance of a pose at its best for each.
    """

    def __init__(self) -> None:
        self.count, self.square = 0.0, np.full(len(_RATIOS), 1e-30)
        self.logs = np.zeros(len(_RATIOS))
        self.best, self._look = len(_RATIOS) // 2, 0

    def score(self, innovation: Array, variance: Array, keep: float) -> None:
        """Add innovations (B, 3) of variances (B,) over that of a pose."""
        self.count = keep * self.count + 3.0
        self.square = keep * self.square + (innovation**2).sum(axis=1) / variance
        self.logs = keep * self.logs + 3.0 * np.log(variance)
        self._look += 1
        if self._look % _EVERY == 0:
            likely = self.count * np.log(self.square / max(self.count, 1.0)) + self.logs
            self.best = int(np.argmin(likely))

    def pose_variance(self, which: int) -> float:
        """Variance of a pose, m^2 or rad^2, as the innovations have it."""
        return float(self.square[which] / max(self.count, 1.0))


class CausalMotion:
    """Filters poses as they come and predicts the motion at any later instant."""

    def __init__(self) -> None:
        """Begin without a pose."""
        count = len(_RATIOS)
        self.time = self._since = -np.inf
        self.poses, self._step = 0, 0.0
        self._spread = np.tile(_BEGINNING, (count, 1, 1))
        self._gain = np.zeros((count, 3))
        self._places = np.zeros((count, 3, 3))
        self._rotation = np.tile(np.eye(3), (count, 1, 1))
        self._turns = np.zeros((count, 2, 3))
        self._moving, self._turning = _Bank(), _Bank()

    def add(self, time: float, pose: Array) -> None:
        """Take a pose (4, 4) at a time, s; one that hardly is later is left out."""
        step = time - self.time
        if step < _LEAST_STEP:
            return
        if not step <= _LONGEST_STEP:
            self._begin(time, pose)
            return
        self.time, self._step = time, step
        self.poses += 1
        move = _transition(step)
        spread = move @ self._spread @ move.T + _RATIOS[:, None, None] * _noise(step)
        variance = spread[:, 0, 0] + 1.0
        gain = spread[:, :, 0] / variance[:, None]
        self._spread = spread - gain[:, :, None] * spread[:, :1, :]
        self._gain = gain
        keep = float(np.exp(-step / _MEMORY))
        places = move @ self._places
        off = pose[:3, 3] - places[:, 0]
        self._places = places + gain[:, :, None] * off[:, None, :]
        turned = self._rotation @ exp_so3(
            step * self._turns[:, 0] + 0.5 * step**2 * self._turns[:, 1]
        )
        twisted = log_so3(np.swapaxes(turned, 1, 2) @ pose[:3, :3])
        self._rotation = turned @ exp_so3(gain[:, :1] * twisted)
        turns = move[:2, :2] @ self._turns
        self._turns = turns + gain[:, 1:, None] * twisted[:, None, :]
        if self.poses > 3:
            self._moving.score(off, variance, keep)
            self._turning.score(twisted, variance, keep)

    def _begin(self, time: float, pose: Array) -> None:
        CausalMotion.__init__(self)
        self.time = self._since = time
        self.poses = 1
        self._places[:, 0], self._rotation[:] = pose[:3, 3], pose[:3, :3]

    def at(self, time: Array) -> Motion:
        """Predict the motion at times (N,), s, near the newest pose."""
        ahead = np.asarray(time, dtype=float)[:, None] - self.time
        place, velocity, acceleration = self._places[self._moving.best]
        turning = self._turning.best
        rate, change = self._turns[turning]
        turned = exp_so3(ahead * rate + 0.5 * ahead**2 * change)
        held = np.ones_like(ahead)
        return Motion(
            place + ahead * velocity + 0.5 * ahead**2 * acceleration,
            self._rotation[turning] @ turned,
            velocity + ahead * acceleration,
            held * acceleration,
            rate + ahead * change,
            held * change,
        )

    @property
    def settled(self) -> bool:
        """Whether velocities and accelerations are known by now."""
        return self.poses > 1 and self.time - self._since >= _SETTLING

    @property
    def acceleration_std(self) -> tuple[float, float]:
        """Standard deviations of both accelerations at the newest pose, m/s^2 and rad/s^2."""
        return self._std(self._moving), self._std(self._turning)

    def _std(self, bank: _Bank) -> float:
        which = bank.best
        return float(np.sqrt(bank.pose_variance(which) * self._spread[which, 2, 2]))

    @property
    def acceleration_delay(self) -> float:
        """Time by which the acceleration lags where it changes steadily, s.

        In the steady state an acceleration that grows by j per second is shown too small by j times
        this: e = (I - K H) (F e + g), g = -(h^3 / 6, h^2 / 2, h).
        """
        if self.poses < 2:
            return 0.0
        step = self._step
        left = np.eye(3) - np.outer(self._gain[self._moving.best], [1.0, 0.0, 0.0])
        grown = -np.array([step**3 / 6.0, step**2 / 2.0, step])
        error = np.linalg.solve(np.eye(3) - left @ _transition(step), left @ grown)
        return float(-error[2])


class ImuMotion(CausalMotion):
    """Motion whose acceleration an IMU on the load feels: f = R^T (a - g), body frame."""

    def __init__(self) -> None:
        super().__init__()
        self._measured, self._period, self._measured_at = np.zeros(3), 0.0, -np.inf

    def feel(self, time: float, specific_force: Array) -> None:
        """Take what an IMU at the origin of the body feels, m/s^2, at a time, s."""
        step = time - self._measured_at
        if step > 0.0:
            self._period = min(step, _LONGEST_STEP)
            self._measured, self._measured_at = np.asarray(specific_force, dtype=float), time

    @property
    def settled(self) -> bool:
        """Whether rotation and specific force are known by now."""
        return super().settled and self.time - self._measured_at < _LONGEST_STEP

    def at(self, time: Array) -> Motion:
        """Predict the motion at times (N,), s, near the newest pose."""
        found = super().at(time)
        return found._replace(acceleration=found.rotation @ self._measured + GRAVITY_W)

    @property
    def acceleration_std(self) -> tuple[float, float]:
        """Standard deviations: what an IMU feels has little noise beside other errors."""
        return 0.0, super().acceleration_std[1]

    @property
    def acceleration_delay(self) -> float:
        """Half the time between two samples of the IMU, s."""
        return 0.5 * self._period


def _transition(step: float) -> Array:
    return np.array([[1.0, step, 0.5 * step**2], [0.0, 1.0, step], [0.0, 0.0, 1.0]])


def _noise(step: float) -> Array:
    """Covariance (3, 3) that white jerk of density one adds in a step."""
    return np.array(
        [
            [step**5 / 20.0, step**4 / 8.0, step**3 / 6.0],
            [step**4 / 8.0, step**3 / 3.0, step**2 / 2.0],
            [step**3 / 6.0, step**2 / 2.0, step],
        ]
    )
