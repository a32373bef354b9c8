"""Pieces of pushes: the mean force along each beside the one that what is known of it expects."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field

import numpy as np

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.planar.filter.observation import MeasuredWrench, SeenPose
from tactile_dynamics_ros.core.planar.filter.patch import PatchProcess
from tactile_dynamics_ros.core.planar.filter.process import PusherMotion
from tactile_dynamics_ros.core.planar.mechanics.linkage import applied, shifted_twist, turned
from tactile_dynamics_ros.core.planar.mechanics.simulation import GRAVITY, support_resistance

_DRAWS, _SEED = 24, 46
"""Hypotheses of what is not known of reference and motion, and the seed of their draw; twice as
many change a statistic of 20 by less than one, as few as ten by several."""
_KNOWN, _UNKNOWN = 4, 7
"""Numbers of the reference, and with the three of the believed twist, which is not known either."""
_LEAST = 8
"""Steps with a force that make a piece of a way: 80 ms. Shorter ones are starts and stops alone."""
_SEEN = 5
"""Poses within a piece from which its motion is known: at fewer their noise of 0.5 mm turns the
friction of a slow push by half a radian; more would make short touches say nothing."""
_BEFORE = 0.05
"""Time, s, from which poses before a piece are looked at too, that short ones are known better; the
longer, the more of what the filter believed before counts."""
_PARTS = 6
"""Parts of a piece in each of which friction is looked at: a pivoting object changes its way by
half a radian within one. With the middle alone clean pivots had statistics of ten."""
_HELD = 100
"""Poses and steps that are held: a second at 100 Hz; a piece is shorter."""
_SLOWEST = 0.02
"""Speed of the pusher, m/s, below which forces count nothing: an object that hardly slides takes
any force up to its friction. At none the ends of controlled pushes raised alarms."""
_VAGUE = 0.25
"""Standard deviation, over the friction, of what the motion of a piece leaves open beyond which it
is left out: an object that pivots below the tip may be rubbed any way, and errors are no longer
normal. Without it one of 27 clean pieces of a simulated run raised an alarm alone."""


@dataclass(frozen=True, eq=False)
class Piece:
    """Mean of the forces along a piece of a push.

    Attributes:
        start: s, when its push began. end: s, its own end.
        lack: (2,) N, measured less expected, axes of S. expected: (2,) N.
        slopes: (2, 4) N by each standard deviation of what is not known of the reference.
        rest: (2, 2) N^2, what is not known of its motion.
    """

    start: float
    end: float
    lack: Array
    expected: Array
    slopes: Array
    rest: Array


@dataclass(eq=False)
class _Sum:
    """A piece that grows.

    Attributes:
        start: s, of its first step. motion: of its last. count: steps. duration: s.
        way: m, of the pusher. spread: m/s, std of the velocity. measured: (2,) N, summed.
        gain: (D, 2) m/s that centres of mass gained in these steps.
        rows: yaw and twist (4,) of the frame in each, as the filter believes.
    """

    start: float
    motion: PusherMotion
    count: int = 0
    duration: float = 0.0
    way: float = 0.0
    spread: float = 0.0
    measured: Array = field(default_factory=lambda: np.zeros(2))
    gain: Array = field(default_factory=lambda: np.zeros((_DRAWS, 2)))
    rows: list[Array] = field(default_factory=list)


@dataclass(frozen=True, eq=False)
class _Step:
    """A step of the filter whose end is not believed yet; `state` (6,) is that at its start."""

    time: float
    state: Array
    motion: PusherMotion
    measured: Array

    @property
    def end(self) -> float:
        """Time, s."""
        return self.time + self.motion.step


class PieceMeter:
    """Cuts pushes into pieces, and holds the mean force of each against that of a reference.

    Args:
        process: the model.
        length: m, of a piece.
        mean: (4,) numbers of the link that are held for true. covariance: (4, 4) of them.

    Attributes:
        friction: N, of the whole object.
    """

    def __init__(
        self, process: PatchProcess, length: float, mean: Array, covariance: Array
    ) -> None:
        self._process, self._length = process, length
        self._draws, self._twist = np.split(_unit_draws(), [_KNOWN], axis=1)
        self._own = mean + self._draws @ np.linalg.cholesky(covariance).T
        self.friction = GRAVITY * float(np.exp(mean[0]))
        self._poses: deque[Array] = deque(maxlen=_HELD)
        self._path: deque[Array] = deque(maxlen=_HELD)
        self._start: float | None = None
        self._sum: _Sum | None = None
        self._open: _Step | None = None

    def see(
        self,
        time: float,
        state: tuple[Array, Array],
        motion: PusherMotion,
        measured: MeasuredWrench | None,
        poses: tuple[SeenPose, ...],
    ) -> Piece | None:
        """Take a step in which something is touched; return the piece that ended before it.

        Args:
            time: s, when it begins.
            state: mean (6,) and covariance (6, 6) believed then.
            motion: of the pusher.
            measured: None where the force is not known or just begins or ends.
            poses: of the link that were seen meanwhile.
        """
        self._start = time if self._start is None else self._start
        self._path.append(np.append(time, state[0][3:]))
        for pose in poses:
            at = time + motion.step - pose.age
            self._poses.append(np.array([at, *pose.value, *pose.std]))
        ended = None
        if self._open is not None and abs(self._open.end - time) < 0.5 * motion.step:
            ended = self._add(self._open, state)
        moves = _way(motion) >= _SLOWEST * motion.step
        self._open = (
            _Step(time, state[0], motion, measured.value[:2]) if measured and moves else None
        )
        return ended

    def release(self, time: float) -> Piece | None:
        """Note that nothing is touched any more; return the piece that ends with it."""
        ended = self._closed(time)
        self._sum = self._start = self._open = None
        self._poses.clear()
        self._path.clear()
        return ended

    def _add(self, step: _Step, state: tuple[Array, Array]) -> Piece | None:
        """Add a step to the piece, now that it is known what is believed at its end."""
        done = self._sum = self._sum or _Sum(step.time, step.motion)
        done.motion = step.motion
        done.gain += self._centre_velocity(state[0]) - self._centre_velocity(step.state)
        done.rows.append(0.5 * (step.state[2:] + state[0][2:]))
        done.measured += step.measured
        done.count += 1
        done.duration += step.motion.step
        done.way += _way(step.motion)
        done.spread = float(np.sqrt(0.5 * np.trace(state[1][3:5, 3:5])))
        return self._closed(step.end) if done.way >= self._length and self._is_whole() else None

    def _centre_velocity(self, state: Array) -> Array:
        """Velocity (D, 2) of the centres of mass at a state (6,), m/s."""
        yaw = np.full(_DRAWS, state[2])
        twist = np.tile(state[3:], (_DRAWS, 1))
        return shifted_twist(twist, turned(self._own[:, 2:4], yaw))[:, :2]

    def _is_whole(self) -> bool:
        """Whether the piece is long enough to say how the object moves."""
        done = self._sum
        return done is not None and done.count >= _LEAST and len(self._seen(done)) >= _SEEN

    def _seen(self, done: _Sum) -> Array:
        """Rows (n, 7) of time, pose and its std along a piece and just before."""
        return np.array([row for row in self._poses if row[0] > done.start - _BEFORE])

    def _closed(self, time: float) -> Piece | None:
        whole, start = self._is_whole(), self._start
        done, self._sum = self._sum, None
        if done is None or start is None or not whole:
            return None
        expected = self._expected(done)
        middle = expected.mean(axis=0)
        slopes = self._draws.T @ (expected - middle) / _DRAWS
        rest = np.cov((expected - middle - self._draws @ slopes).T, bias=True)
        momentum = float(np.exp(self._own[:, 1].mean())) * done.spread / done.duration
        rest = np.asarray(rest + 2.0 * momentum**2 * np.eye(2))
        if np.sqrt(np.trace(rest)) > _VAGUE * self.friction:
            return None
        return Piece(start, time, done.measured / done.count - middle, middle, slopes.T, rest)

    def _expected(self, done: _Sum) -> Array:
        """Force (D, 2) that the motion of a piece takes: friction is overcome, mass accelerated.

        F = m dv / dt - F_support(twist)

        The twist is that of poses along the whole piece: the filter's follows the forces, and would
        explain with a slight turn what a lean does. How it varies within is the filter's. Simulated
        steps would not do: with them a lag of the belief of 0.1 mm behind the tip is an impact.
        """
        parts = [np.mean(rows, axis=0) for rows in np.array_split(done.rows, _PARTS)]
        rows = np.repeat(parts, _DRAWS, axis=0)
        missed, std = self._missed(done)
        yaw, rates = rows[:, 0], rows[:, 1:] + missed + np.tile(self._twist * std, (_PARTS, 1))
        link = self._process.link_of(np.tile(self._own, (_PARTS, 1)), done.motion)
        measured = np.tile(done.measured / done.count, (len(yaw), 1))
        friction = np.column_stack([-measured, np.zeros(len(yaw))])
        height = np.full(len(yaw), done.motion.height)
        twist = shifted_twist(rates, turned(link.com, yaw))
        resistance = support_resistance(link, yaw, twist, friction, measured, height)
        resisted = applied(resistance, twist)[:, :2].reshape(_PARTS, _DRAWS, 2).mean(axis=0)
        return np.asarray(resisted + link.mass[:_DRAWS, None] * done.gain / done.duration)

    def _missed(self, done: _Sum) -> tuple[Array, Array]:
        """Twist (3,) by which poses move on faster than the filter believes, and its std (3,)."""
        path, seen = np.array(self._path), self._seen(done)
        ways = 0.5 * np.diff(path[:, 0])[:, None] * (path[1:, 1:] + path[:-1, 1:])
        gone = np.vstack([np.zeros(3), np.cumsum(ways, axis=0)])
        believed = np.column_stack([np.interp(seen[:, 0], path[:, 0], way) for way in gone.T])
        time = seen[:, 0] - seen[:, 0].mean()
        weights = time / (time @ time)
        std = float(np.linalg.norm(weights)) * seen[:, 4:].mean(axis=0)
        return np.asarray(weights @ (seen[:, 1:4] - believed)), std


def _way(motion: PusherMotion) -> float:
    """Way of the pusher in a step, m."""
    return float(np.linalg.norm((motion.after - motion.before)[:2]))


def _unit_draws() -> Array:
    """Draws (D, 7) of standard normal numbers whose sample covariance is exactly the identity."""
    draws = np.random.default_rng(_SEED).standard_normal((_DRAWS, _UNKNOWN))
    whole = np.linalg.qr(draws - draws.mean(axis=0))[0]
    return np.asarray(np.sqrt(_DRAWS) * whole)
