"""Poses and contacts as they arrive, turned into complete samples at the stamps of the poses."""

from __future__ import annotations

from bisect import bisect_right
from collections import Counter
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.inertia.live.config import IncrementalConfig
from tactile_dynamics_ros.core.inertia.live.contact_queue import (
    ContactQueue,
    ContactReading,
)
from tactile_dynamics_ros.core.inertia.live.residuals import ContactRows, PoseWindows
from tactile_dynamics_ros.core.inertia.residuals.contact_grid import UNMEASURED_TORQUE_STD
from tactile_dynamics_ros.core.inertia.residuals.stated_noise import PoseScatter, SensorNoise
from tactile_dynamics_ros.core.numerics.noise import (
    FROZEN,
    STUCK,
    in_runs,
    repeated_forces,
    repeated_poses,
)
from tactile_dynamics_ros.core.numerics.stream_whitening import RollingTable, sliding_rows
from tactile_dynamics_ros.core.streams.pose_noise import ASSUMED_STD, jumps

MAXIMUM_CONTACTS = 8
"""Contacts that tables have room for: two hands of four fingers. Others are counted as a problem
and not used; each costs its columns in every kept sample. Fewer leave forces of a hand out, which
the estimate takes for load; more cost time with each sample."""
_LAYOUT_POSES = 12
"""Poses of a new stretch from which their period, and so the windows, are taken: 0.12 s at 100 Hz.
The median of fewer is moved by single late ones; more delay the first sample."""
_NOISE_POSES = 200
"""Poses from which noise is read, two seconds at 100 Hz: it is then known to 7 %. More follow a
change of noise late."""
_NOISE_EVERY = 50
"""Poses between such readings, and the least they need: twice a second at 100 Hz. More often costs
time, more seldom follows a change of noise late."""
_DRAWS = 4099
"""Fixed standard normal draws, used in a ring: at 100 Hz they come again after 41 s. Fixed, so that
a recording gives the same estimate each time; a prime, so that no period of the motion meets the
same draws. Fewer repeat within a motion and feign excitation, more hold memory only (200 kB
now)."""


class PoseNoise(NamedTuple):
    """Square roots (2, 3, 3) of the covariance of rotation and position; stated, or assumed."""

    factors: Array
    stated: bool


@dataclass(frozen=True)
class Layout:
    """Windows of one gapless stretch: half widths in samples and the period in s."""

    start: int
    short: int
    long: int
    period: float


class SampleStream:
    """Bounded memory of raw samples; every row is a pose with the contacts at its stamp."""

    def __init__(self, config: IncrementalConfig, problems: Counter[str] | None = None) -> None:
        """Start empty; problems are counted in what is given."""
        self._config = config
        capacity = int(config.replay_duration * config.maximum_rate) + 64
        self._poses = RollingTable(
            capacity,
            {
                "time": (),
                "position": (3,),
                "rotation": (3, 3),
                "noise": (2, 3, 3),
                "stated": (),
            },
        )
        slots = MAXIMUM_CONTACTS
        self._contacts = RollingTable(
            capacity,
            {
                "point": (slots, 3),
                "rotation": (slots, 3, 3),
                "force": (slots, 3),
                "in_sensor": (slots, 3),
                "torque": (slots, 3),
                "std": (slots, 3),
                "in_contact": (slots,),
                "lost": (),
                "doubtful": (),
            },
        )
        self._queues: dict[str, ContactQueue] = {}
        self._layouts: list[Layout] = []
        self._starts = [0]
        self._draws = np.random.default_rng(0).normal(size=(_DRAWS, 6))
        self._scatter = PoseScatter()
        self._noise = SensorNoise(
            MAXIMUM_CONTACTS, config.point_std, config.force_std, config.torque_std
        )
        self._repeated_pose = 0
        self._repeated_force = np.zeros(MAXIMUM_CONTACTS, dtype=int)
        self.problems = Counter[str]() if problems is None else problems

    @property
    def names(self) -> tuple[str, ...]:
        """Contacts in the order in which they first spoke."""
        return tuple(self._queues)

    @property
    def first(self) -> int:
        """Running number of the oldest sample kept."""
        return max(self._poses.start, self._contacts.start)

    @property
    def end(self) -> int:
        """Running number after the newest sample."""
        return self._poses.end

    @property
    def newest(self) -> float:
        """Newest stamp of a pose."""
        end = self._poses.end
        has_any = end > self._poses.start
        return float(self._poses.rows("time", end - 1, end)[0]) if has_any else -np.inf

    @property
    def _stretch_start(self) -> int:
        """Running number of the first pose of the newest stretch."""
        return self._starts[-1]

    def _begin_stretch(self) -> None:
        """Let no window reach from poses to come to those so far."""
        self._layouts = [x for x in self._layouts if self._end_of(x) > self._poses.start]
        oldest = bisect_right(self._starts, self._poses.start)
        self._starts = [*self._starts[oldest:], self._poses.end]

    def add_pose(self, time: float, position: Array, rotation: Array, noise: PoseNoise) -> None:
        """Append a pose; a stamp that jumps back by more than the maximal gap starts anew.

        No window reaches across a gap or a jump of the poses.

        Args:
            time: s.
            position: (3,) m.
            rotation: (3, 3).
            noise: of the pose.
        """
        step = time - self.newest
        if step <= 0.0:
            self.problems["pose stamp not newer"] += 1
            if step > -self._config.maximum_gap:
                return
            self.begin_again()
        elif step < 0.8 / self._config.maximum_rate:
            self.problems["pose faster than maximum_rate"] += 1
            return
        elif step > self._config.maximum_gap and np.isfinite(step):
            self.problems["gap between poses"] += 1
            self._begin_stretch()
        elif self._jumps(time, position, rotation, noise):
            self.problems["pose jumps"] += 1
            self._begin_stretch()
        self._count_missing_poses(step)
        self._count_repeated_pose(position, rotation)
        self._poses.append(
            {
                "time": time,
                "position": position,
                "rotation": rotation,
                "noise": noise.factors,
                "stated": noise.stated,
            }
        )
        self._lay_out()
        if self._poses.end % _NOISE_EVERY == 0:
            self._measure_noise()

    def begin_again(self) -> None:
        """Forget the raw samples, so that none is joined with those to come."""
        self._poses.clear()
        while self._contacts.end < self._poses.end:
            self._contacts.append(_blank_row())
        self._contacts.clear()
        self._starts, self._layouts = [self._poses.end], []
        for queue in self._queues.values():
            queue.clear()

    def add_contact(self, name: str, time: float, reading: ContactReading) -> None:
        """Append a contact's reading."""
        if name not in self._queues:
            if len(self._queues) == MAXIMUM_CONTACTS:
                self.problems[f"contact '{name}' beyond {MAXIMUM_CONTACTS}"] += 1
                return
            self._queues[name] = ContactQueue(self._config.contact_timeout)
        queue = self._queues[name]
        if np.any(reading.torque != 0.0):
            queue.has_torque = True
        if not queue.append(time, reading):
            self.problems[f"contact '{name}' stamp not newer"] += 1
            if time < queue.newest - 1.0:
                queue.clear()
                queue.append(time, reading)

    def align(self, now: float) -> None:
        """Read the contacts at every pose stamp that is decided by `now`."""
        while self._contacts.end < self._poses.end:
            row = self._contacts.end
            layout = self._layout(row)
            time = float(self._poses.rows("time", row, row + 1)[0])
            if layout is None and row >= self._stretch_start:
                return
            period = layout.period if layout else 0.01
            if not all(queue.is_settled(time, period, now) for queue in self._queues.values()):
                return
            self._contacts.append(self._read(time, period))
            self._count_doubtful_forces()

    def next_range(self, first: int, limit: int) -> tuple[int, int, Layout] | None:
        """Next rows from `first` on, at most `limit`, whose windows are complete and gapless."""
        for layout in self._layouts:
            begin = max(first, layout.start + layout.long, self._poses.start + layout.long)
            begin = max(begin, self._contacts.start)
            end = min(self._end_of(layout) - layout.long, self._contacts.end, begin + limit)
            if begin < end:
                return begin, end, layout
        return None

    def windows(self, first: int, last: int, layout: Layout) -> PoseWindows:
        """Pose windows around rows first <= k < last."""
        span, width = (first - layout.long, last + layout.long), 2 * layout.long + 1

        def view(name: str) -> Array:
            return sliding_rows(self._poses.rows(name, *span), width)

        raw = (self._poses.rows(name, *span) for name in ("noise", "stated"))
        return PoseWindows(
            view("time"),
            view("position"),
            view("rotation"),
            sliding_rows(self._scatter.scaled(*raw), width),
            self._drawn(*span, width),
            layout.short,
        )

    def _drawn(self, first: int, last: int, width: int) -> Array:
        """Fixed standard normal draws (B, W, 6) of the poses first <= k < last."""
        rows = self._draws[np.arange(first, last) % len(self._draws)]
        return sliding_rows(rows, width)

    def contacts(self, first: int, last: int) -> ContactRows:
        """Contacts of rows first <= k < last."""
        count = len(self._queues)

        def rows(name: str) -> Array:
            return self._contacts.rows(name, first, last)[:, :count]

        has_torque = np.array([queue.has_torque for queue in self._queues.values()])
        torque_std = self._noise.torque[:count] * has_torque
        if count == 1 and not has_torque[0]:  # it holds the body alone
            torque_std = np.array([UNMEASURED_TORQUE_STD])
        seen = self._noise.force[:count, None]
        believed = rows("std") >= self._noise.least_force[:count, None]
        return ContactRows(
            self.names,
            rows("point"),
            rows("rotation"),
            rows("force"),
            rows("torque"),
            np.where(believed, rows("std"), seen),
            rows("in_contact") > 0.0,
            torque_std,
            self._noise.point[:count],
        )

    def flags(self, first: int, last: int) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        """Whether rows are usable, and whether they are doubtful.

        Doubtful are rows with a finger that fell silent or to zero while it pressed, with a force
        that repeats itself to the last bit, and rows near to poses that do. What is at rest and
        quantised repeats itself too, but then it also fits.
        """
        lost = self._contacts.rows("lost", first, last) > 0.0
        held = np.any(self._contacts.rows("in_contact", first, last) > 0.0, axis=1)
        absent = self._contacts.rows("doubtful", first, last) > 0.0
        doubtful = absent | self._stuck(first, last) | self._frozen(first, last)
        return held & ~lost, doubtful

    def _stuck(self, first: int, last: int) -> NDArray[np.bool_]:
        """Whether a contact repeats one force for longer than chance lets it, rows first <= k."""
        begin = max(first - STUCK, self._contacts.start)
        end = min(last + STUCK, self._contacts.end)
        count = len(self._queues)
        runs = in_runs(self._repeats(begin, end)[:, :count], STUCK)[first - begin : last - begin]
        return np.asarray(runs.any(axis=1))

    def _repeats(self, first: int, last: int) -> NDArray[np.bool_]:
        """Whether forces (N - 1, 8) of rows first <= k < last are those of the row before."""
        world, sensor, lost = (
            self._contacts.rows(name, first, last) for name in ("force", "in_sensor", "lost")
        )
        return repeated_forces(world, sensor, lost > 0.0)

    def _frozen(self, first: int, last: int) -> NDArray[np.bool_]:
        """Whether the window of a row has poses that repeat for too long, rows first <= k."""
        layout = self._layout(first)
        reach = layout.long if layout else 0
        begin = max(first - reach - FROZEN, self._poses.start)
        end = min(last + reach + FROZEN, self._poses.end)
        position, rotation = (self._poses.rows(n, begin, end) for n in ("position", "rotation"))
        runs = in_runs(repeated_poses(position, rotation)[:, None], FROZEN)[:, 0]
        reached = np.convolve(runs, np.ones(2 * reach + 1), "same") > 0.5
        return np.asarray(reached[first - begin : last - begin])

    def _jumps(self, time: float, position: Array, rotation: Array, noise: PoseNoise) -> bool:
        """Whether a pose does not follow the last two of its stretch."""
        end = self._poses.end
        if end - max(self._stretch_start, self._poses.start) < 2:
            return False
        new = {"time": time, "position": position, "rotation": rotation}
        times, places, turns = (
            np.append(self._poses.rows(name, end - 2, end), [value], axis=0)
            for name, value in new.items()
        )
        std = np.sqrt(np.sum(noise.factors**2, axis=(1, 2)))
        return jumps(times, places, turns, std if noise.stated else ASSUMED_STD)

    def _count_missing_poses(self, step: float) -> None:
        """Count the poses that a stretch's period leads to expect before one that comes late."""
        layout = self._layouts[-1] if self._layouts else None
        if layout is not None and layout.start == self._stretch_start:
            missing = round(step / layout.period) - 1
            if missing > 0:
                self.problems["pose missing"] += missing

    def _count_repeated_pose(self, position: Array, rotation: Array) -> None:
        end = self._poses.end
        same = end > self._poses.start and (
            np.array_equal(self._poses.rows("position", end - 1, end)[0], position)
            and np.array_equal(self._poses.rows("rotation", end - 1, end)[0], rotation)
        )
        self._repeated_pose = self._repeated_pose + 1 if same else 1
        if self._repeated_pose >= FROZEN:
            self.problems["pose frozen"] += 1

    def _count_doubtful_forces(self) -> None:
        """Count forces of the newest row that repeat themselves or understate their noise."""
        end = self._contacts.end
        same = self._repeats(max(end - 2, self._contacts.start), end)
        repeated = same.any(axis=0)
        self._repeated_force = np.where(repeated, self._repeated_force + 1, 1)
        understated = self._understated(end - 1)
        for slot, name in enumerate(self.names):
            if self._repeated_force[slot] >= STUCK:
                self.problems[f"contact '{name}' stuck at one value"] += 1
            if understated[slot]:
                self.problems[f"contact '{name}' understates its noise"] += 1

    def _understated(self, row: int) -> NDArray[np.bool_]:
        """Contacts (8,) that state far less noise than their readings have, in one row."""
        std = self._contacts.rows("std", row, row + 1)[0]
        held = self._contacts.rows("in_contact", row, row + 1)[0] > 0.0
        return np.asarray(np.any(std < self._noise.least_force[:, None], axis=1) & held)

    @property
    def obstacles(self) -> tuple[str, ...]:
        """What is wrong with the newest readings, so that nothing should be concluded now."""
        end = self._contacts.end
        if end == self._contacts.start:
            return ()
        std, understated = self._contacts.rows("std", end - 1, end)[0], self._understated(end - 1)
        return tuple(
            f"contact '{name}' does not fit: it states a noise of {std[slot].min():.2g} N, its "
            f"readings scatter by {self._noise.force[slot]:.2g} N"
            for slot, name in enumerate(self.names)
            if understated[slot]
        )

    def _lay_out(self) -> None:
        start = self._stretch_start
        if self._poses.end - start != _LAYOUT_POSES:
            return
        period = float(np.median(np.diff(self._poses.rows("time", start, self._poses.end))))
        least = (self._config.window_degree + 3) // 2
        short = max(round(self._config.residual_half_width / period), least)
        long = max(round(self._config.regressor_half_width / period), short + 2)
        self._layouts.append(Layout(start, short, long, period))

    def _layout(self, row: int) -> Layout | None:
        for layout in reversed(self._layouts):
            if layout.start <= row < self._end_of(layout):
                return layout
        return None

    def _end_of(self, layout: Layout) -> int:
        following = bisect_right(self._starts, layout.start)
        return self._starts[following] if following < len(self._starts) else self._poses.end

    def _read(self, time: float, period: float) -> dict[str, Any]:
        row = _blank_row()
        for slot, queue in enumerate(self._queues.values()):
            reading = queue.read(time, period)
            if reading is None:
                if queue.was_loaded(time):
                    row["doubtful"] = 1.0
                    self.problems[f"contact '{self.names[slot]}' absent after it pressed"] += 1
                continue
            row["lost"] = max(row["lost"], float(reading.lost))
            row["point"][slot], row["rotation"][slot] = reading.point, reading.rotation
            row["force"][slot], row["torque"][slot] = reading.force, reading.torque
            row["in_sensor"][slot] = reading.rotation.T @ reading.force
            row["std"][slot], row["in_contact"][slot] = reading.std, 1.0
        return row

    def _measure_noise(self) -> None:
        """Compare what is stated, or assumed, of the last poses with how they scatter."""
        end = self._poses.end
        first = max(self._stretch_start, self._poses.start, end - _NOISE_POSES)
        names = ("time", "rotation", "position", "noise", "stated")
        rows = [self._poses.rows(name, first, end) for name in names]
        if len(rows[0]) < _NOISE_EVERY:
            return
        self._scatter.measure(*rows)
        self._measure_contact_noise()

    def _measure_contact_noise(self) -> None:
        """Take the scatter of the readings of contacts that touched long enough."""
        end = self._contacts.end
        first = max(self._stretch_start, self._contacts.start, end - _NOISE_POSES)
        time = self._poses.rows("time", first, end)
        for slot in range(len(self._queues)):
            held = self._contacts.rows("in_contact", first, end)[:, slot] > 0.0
            if held.sum() < _NOISE_EVERY:
                continue
            point, force, torque = (
                self._contacts.rows(name, first, end)[held, slot]
                for name in ("point", "force", "torque")
            )
            self._noise.measure(slot, time[held], point, force, torque)


def _blank_row() -> dict[str, Any]:
    slots = MAXIMUM_CONTACTS
    return {
        "point": np.zeros((slots, 3)),
        "rotation": np.broadcast_to(np.eye(3), (slots, 3, 3)).copy(),
        "force": np.zeros((slots, 3)),
        "in_sensor": np.zeros((slots, 3)),
        "torque": np.zeros((slots, 3)),
        "std": np.zeros((slots, 3)),
        "in_contact": np.zeros(slots),
        "lost": 0.0,
        "doubtful": 0.0,
    }
