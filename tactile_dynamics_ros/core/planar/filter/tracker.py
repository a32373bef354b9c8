"""Measurements of a pushed object as they come, in steps of the filter."""

from __future__ import annotations

from bisect import bisect_left
from collections import deque
from dataclasses import dataclass, replace

import numpy as np

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.configuration import check_ranges, parameter
from tactile_dynamics_ros.core.planar.filter.change import ChangeMonitor
from tactile_dynamics_ros.core.planar.filter.dual import DualConfig, DualFilter
from tactile_dynamics_ros.core.planar.filter.observation import (
    ForceNoise,
    MeasuredWrench,
    Observation,
    SeenPose,
)
from tactile_dynamics_ros.core.planar.filter.process import Process, PusherMotion
from tactile_dynamics_ros.core.planar.filter.revised import filter_of

_TOUCH = 4.0
"""Force from which something is touched, in standard deviations of the force, as in the fits to
recordings. At 3 one sample in three hundred of a silent sensor would begin a push."""
_SILENT = 3.5
"""Periods of a contact's stream without a force after which nothing is touched; fewer are dropped
messages. Longer ones let a released object be held."""
_SMOOTHED = 10
"""Samples over which the place of the contact on the tip and its normal are averaged: 0.3 mm of
noise become 0.1 mm. A tip that rolls along an edge turns by little in a tenth of a second."""
_STANDS = 1.5e-3
"""Speed, m/s, below which an object that nothing touches has stopped: that of the noise of poses.
The mechanics stop it within a step from there."""
_STANDS_AFTER = 0.5
"""Time without a touch, s, after which it stands in any case: at 0.3 m/s with a coefficient of 0.1
it slides for 0.3 s."""
_RESTS_EVERY = 0.1
"""Time, s, of which one step of an object that stands is taken: a filter that does nothing else
took a fifth of a core at 100 Hz. Poses of a tenth of a second say little more together."""
_KEPT = 2.0
"""Measurements that are held back for the filter at most, s; older ones are of no use to it."""
_STIFFNESS_SPREAD = 1.0
"""Standard deviation of the velocity at which tip and arm give way over what their stiffness says:
stiffnesses of arms are known to a factor of two."""
_PADS = ("pad_left", "pad_right")
"""Contacts that touch only while an object is gripped, by their names on the topics. Others push:
were one of them missing here, a pull would count as a push by a tip."""


@dataclass(frozen=True)
class TrackerConfig:
    """Steps of the filter."""

    step: float = parameter(0.01, "of the filter", "s", 0.002, 0.1)
    stiffness: float = parameter(2e4, "of tip or pads with the arm", "N/m", 1e2, 1e7)
    filter: DualConfig = DualConfig()

    def __post_init__(self) -> None:
        check_ranges(self)


@dataclass(frozen=True, eq=False)
class ContactForce:
    """One force of a contact.

    Attributes:
        name: of the contact. time: s. force: (3,) N on the object, axes of S. std: (3,) N.
        point: (3,) m in S. normal: (3,) into the object, axes of S.
    """

    name: str
    time: float
    force: Array
    std: Array
    point: Array
    normal: Array


def touches(measured: ContactForce) -> bool:
    """Whether a force is more than its noise."""
    return bool(np.linalg.norm(measured.force) > _TOUCH * float(measured.std.max()))


class _Series:
    """Rows in the order of time, of which old ones are dropped."""

    def __init__(self) -> None:
        self.times: list[float] = []
        self.rows: list[Array] = []

    def add(self, time: float, row: Array) -> None:
        if self.times and time <= self.times[-1]:
            return
        self.times.append(time)
        self.rows.append(row)
        if len(self.times) > 400 and time - self.times[len(self.times) // 2] > _KEPT:
            half = len(self.times) // 2
            del self.times[:half], self.rows[:half]

    def within(self, start: float, end: float) -> list[tuple[float, Array]]:
        """Rows from a time to another, the second left out."""
        first, last = bisect_left(self.times, start), bisect_left(self.times, end)
        return list(zip(self.times[first:last], self.rows[first:last], strict=True))

    def at(self, time: float) -> Array | None:
        """Row at a time, on the line between its neighbours; None outside."""
        k = bisect_left(self.times, time)
        if k == len(self.times) or (k == 0 and self.times[0] > time):
            return None
        if self.times[k] == time:
            return self.rows[k]
        before, after = self.times[k - 1], self.times[k]
        share = (time - before) / (after - before)
        return np.asarray((1.0 - share) * self.rows[k - 1] + share * self.rows[k])


class _Contact:
    """Stream of one contact: force, std, point and normal in a row of 12."""

    def __init__(self) -> None:
        self.series = _Series()
        self._gaps: deque[float] = deque([0.01], maxlen=15)

    def add(self, measured: ContactForce) -> None:
        if self.series.times:
            gap = measured.time - self.series.times[-1]
            if 0.0 < gap < 0.5:
                self._gaps.append(gap)
        self.series.add(
            measured.time,
            np.concatenate([measured.force, measured.std, measured.point, measured.normal]),
        )

    def touched(self, start: float, end: float) -> tuple[bool, Array | None]:
        """Whether it touches during a step, and the mean row of the samples within."""
        inside = [row for _, row in self.series.within(start, end)]
        if inside:
            row = np.mean(inside, axis=0)
            row[3:6] /= np.sqrt(len(inside))
            size = [np.linalg.norm(r[:3]) > _TOUCH * r[3:6].max() for r in inside]
            return bool(np.all(size)), row
        reach = _SILENT * float(np.median(self._gaps))
        before = self.series.within(start - reach, start)
        if not before:
            return False, None
        last = before[-1][1]
        return bool(np.linalg.norm(last[:3]) > _TOUCH * last[3:6].max()), None


@dataclass(frozen=True, eq=False)
class _Touch:
    """What is touched during one step; the row is None where its force is not known."""

    tip: tuple[str, Array | None] | None
    pads: list[tuple[str, Array | None]]

    @property
    def any(self) -> bool:
        return self.tip is not None or bool(self.pads)

    @property
    def rows(self) -> list[Array]:
        """Of what is touched, where the force is known."""
        both = self.pads or ([] if self.tip is None else [self.tip])
        return [row for _, row in both if row is not None]


class PushTracker:
    """Feeds a filter from streams with stamps of their own.

    Args:
        process: the model.
        config: of steps and filter.
        prior: mean and covariance of the parameters; the process's own by default.
        noise: knows better how good forces are; None leaves what is stated of them.

    Attributes:
        filter: None before the first pose of every link.
        time: s, up to where the belief goes.
        steps: taken so far, and touched: those of them in which something was touched.
        problems: counts of what could not be used.
        watch: is shown each touch before the filter learns from it; None for nobody.
    """

    def __init__(
        self,
        process: Process,
        config: TrackerConfig | None = None,
        prior: tuple[Array, Array] | None = None,
        noise: ForceNoise | None = None,
    ) -> None:
        self.process, self.config = process, config or TrackerConfig()
        self._noise = noise
        self.filter: DualFilter | None = None
        self.time = -np.inf
        self.steps = self.touched = 0
        self.problems: dict[str, int] = {}
        self.watch: ChangeMonitor | None = None
        self._prior = prior
        self._poses = [_Series() for _ in range(process.links)]
        self._pusher, self._contacts = _Series(), dict[str, _Contact]()
        self._was, self._free_since = False, -np.inf
        self._force = np.zeros(2)
        self._arm: list[Array] = []

    def add_pose(self, time: float, pose: Array, std: Array, link: int = 0) -> None:
        """Take a pose (3,) of a link, yaw unwrapped, with its std (3,)."""
        self._poses[link].add(time, np.concatenate([pose, std]))

    def add_pusher(self, time: float, pose: Array) -> None:
        """Take where the pusher is: x, y, z (m), yaw (rad, unwrapped), in S."""
        self._pusher.add(time, np.asarray(pose, dtype=float))

    def add_contact(self, measured: ContactForce) -> None:
        """Take a force."""
        self._contacts.setdefault(measured.name, _Contact()).add(measured)

    def advance(self, until: float) -> int:
        """Take the steps that end before a time by which all measurements have come.

        Whether a touch begins or ends in the next step has to be known, so that the belief stays
        two steps behind.

        Returns:
            How many steps were taken.
        """
        if self.filter is None and not self._begin():
            return 0
        taken = 0
        step = self.config.step
        while self.time + 2.0 * step <= until:
            ends = [self._pusher.at(self.time), self._pusher.at(self.time + step)]
            if ends[1] is None and self._pusher.times and self.time < self._pusher.times[0]:
                self.time += step
                continue
            try:
                self._take(ends, step)
            except np.linalg.LinAlgError:
                self._count("filter_restarted")
                self._start([series.rows[-1] for series in self._poses])
            self.time += step
            taken += 1
        return taken

    def _begin(self) -> bool:
        """Make the filter where every link was seen, with steps around the stamps of forces."""
        if not all(series.times for series in self._poses):
            return False
        rows = [series.rows[0] for series in self._poses]
        start = max(series.times[0] for series in self._poses)
        phase = start
        for contact in self._contacts.values():
            phase = contact.series.times[0] - 0.5 * self.config.step
        step = self.config.step
        self.time = start + (phase - start) % step
        self._start(rows)
        return True

    def _start(self, rows: list[Array]) -> None:
        """Make the filter anew, at poses of all links with the std of the first."""
        self.filter = filter_of(
            self.process,
            np.concatenate([row[:3] for row in rows]),
            rows[0][3:],
            self.config.filter,
            self._prior,
        )

    def _count(self, problem: str) -> None:
        self.problems[problem] = self.problems.get(problem, 0) + 1

    def _take(self, ends: list[Array | None], step: float) -> None:
        """Take one step."""
        assert self.filter is not None
        start, end = self.time, self.time + step
        touch, after = self._touch(start, end), self._touch(end, end + step)
        poses = self._seen_poses(start, end)
        self.steps += 1
        if touch.any and (ends[0] is None or ends[1] is None):
            self._count("pusher_missing")
            touch = _Touch(None, [])
        if touch.any:
            assert ends[0] is not None and ends[1] is not None
            steady = self._was and after.any
            motion, rows = self._pushed(touch, ends[0], ends[1], step)
            lag = self._lag(rows, after.rows, step)
            motion = replace(motion, after=motion.after - np.append(step * lag, 0.0))
            wrench = self._wrench(touch, rows, motion) if rows else None
            if self._noise is not None:
                wrench = self._noise.measured(motion, wrench, 1.0, self.filter.state[0])
            wrench = wrench if steady else None
            if self.watch is not None:
                self.watch.see(start, self.filter.state, motion, wrench, poses)
            self.filter.step(motion, Observation(poses, wrench, _STIFFNESS_SPREAD * lag))
            self.touched += 1
            self._was, self._free_since = True, end
            return
        if self._was and self.watch is not None:
            self.watch.release(start)
        self._was, self._arm, self._force = False, [], np.zeros(2)
        if self._noise is not None:
            self._noise.end()
        resting = self._stands() or start - self._free_since > _STANDS_AFTER
        if not resting:
            self.filter.step(_unpushed(step), Observation(poses))
        elif self.steps % max(1, round(_RESTS_EVERY / step)) == 0:
            self.filter.step(None, Observation(poses))

    def _touch(self, start: float, end: float) -> _Touch:
        tip: tuple[str, Array | None] | None = None
        pads = []
        for name, contact in self._contacts.items():
            touches, row = contact.touched(start, end)
            if touches and name in _PADS:
                pads.append((name, row))
            elif touches:
                tip = (name, row)
        return _Touch(tip, pads)

    def _seen_poses(self, start: float, end: float) -> tuple[SeenPose, ...]:
        seen = []
        for link, series in enumerate(self._poses):
            inside = series.within(start, end)
            if inside:
                mean = np.mean([row for _, row in inside], axis=0)
                age = end - float(np.mean([time for time, _ in inside]))
                seen.append(SeenPose(mean[:3], mean[3:] / np.sqrt(len(inside)), age, link))
        return tuple(seen)

    def _pushed(
        self, touch: _Touch, before: Array, after: Array, step: float
    ) -> tuple[PusherMotion, list[Array]]:
        """How the touching point moves, and the rows of what it feels."""
        rows = touch.rows
        if rows:
            at = np.mean([row[6:9] for row in rows], axis=0)
            arm = at[:2] - 0.5 * (before + after)[:2]
            self._arm = [*self._arm, np.concatenate([arm, at[2:], rows[0][9:11]])][-_SMOOTHED:]
        if not self._arm:
            self._arm = [np.array([0.0, 0.0, before[2], 0.0, 0.0])]
        smooth = np.mean(self._arm, axis=0)
        offset = np.zeros(3)
        normal = None
        if not touch.pads:
            offset[:2] = smooth[:2]
            size = float(np.linalg.norm(smooth[3:5]))
            normal = smooth[3:5] / size if size > 0.5 else None
        motion = PusherMotion(
            before=before[[0, 1, 3]] + offset,
            after=after[[0, 1, 3]] + offset,
            step=step,
            height=float(smooth[2]),
            grip=bool(touch.pads),
            touching=True,
            normal=normal,
            lift=float(sum(row[2] for row in rows)),
        )
        return motion, rows

    def _lag(self, rows: list[Array], after: list[Array], step: float) -> Array:
        """Velocity (2,), m/s, at which tip and arm give way while the force grows."""
        before, self._force = self._force, np.sum([row[:2] for row in rows], axis=0) + np.zeros(2)
        if not rows or not after:
            return np.zeros(2)
        change = 0.5 * (np.sum([row[:2] for row in after], axis=0) - before)
        return np.asarray(change / (self.config.stiffness * step))

    def _wrench(
        self, touch: _Touch, rows: list[Array], motion: PusherMotion
    ) -> MeasuredWrench | None:
        """Force of a tip, or wrench of both pads; one pad alone also feels the squeeze."""
        force = np.sum([row[:2] for row in rows], axis=0)
        std = np.linalg.norm([row[3:5] for row in rows], axis=0)
        if not touch.pads:
            return MeasuredWrench(force, std)
        if len(rows) < len(_PADS):
            return None
        arms = [row[6:8] - motion.before[:2] for row in rows]
        torque = sum(a[0] * row[1] - a[1] * row[0] for a, row in zip(arms, rows, strict=True))
        spread = np.hypot(
            max(float(np.linalg.norm(a)) for a in arms) * std[0],
            3e-4 * max(float(np.linalg.norm(row[:2])) for row in rows),
        )
        return MeasuredWrench(np.append(force, torque), np.append(std, spread))

    def _stands(self) -> bool:
        assert self.filter is not None
        rates = self.filter.state[0].reshape(-1, 6)[:, 3:]
        return bool(np.abs(rates * [1.0, 1.0, 0.03]).max() < _STANDS)


def _unpushed(step: float) -> PusherMotion:
    """A step in which nothing touches the object."""
    away = np.array([0.0, 0.0, 0.0])
    return PusherMotion(away, away, step, touching=False)
