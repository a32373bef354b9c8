"""A planned action carried out under a guard that stops it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.configuration import check_ranges, parameter
from tactile_dynamics_ros.core.planar.actions.candidate import Candidate
from tactile_dynamics_ros.core.planar.actions.straight import (
    StraightAction,
    StraightConfig,
    straight_action,
)
from tactile_dynamics_ros.core.planar.mechanics.linkage import turned

_MISSED, _MISSED_FOR = 0.03, 1.0
"""m by which a tip may be from its target, and s for how long: a tip that travels at 0.3 m/s lags
by 15 mm. Beyond, the arm is blocked, out of reach or commanded by somebody else."""


@dataclass(frozen=True)
class GuardConfig:
    """What no motion may go on with."""

    most_force: float = parameter(25.0, "of the contact, at which it stops", "N", 0.1, 200.0)
    stale: float = parameter(0.5, "age of the object's pose at which it stops", "s", 0.05, 10.0)

    def __post_init__(self) -> None:
        check_ranges(self)


@dataclass(frozen=True)
class Seen:
    """What is known at an instant.

    Attributes:
        time: s. tip: (4,) x, y, z (m) and turn (rad). pose: (3,) of the object. pose_time: s.
        force: N of the contact; 0 where nothing is measured or nobody tells.
    """

    time: float
    tip: Array
    pose: Array
    pose_time: float
    force: float = 0.0


class Guard:
    """Watches a motion.

    Args:
        config: limits.
        unloads: whether the motion only draws back; then no force stops it.

    Attributes:
        pressed: whether it was too much force that stopped the motion.
        off_target: whether it was that the arm does not follow its targets.
    """

    def __init__(self, config: GuardConfig, unloads: bool = False) -> None:
        self._most_force, self._stale = config.most_force, config.stale
        self._unloads, self.pressed, self.off_target = unloads, False, False
        self._missed = np.inf

    def reason(self, seen: Seen, target: Array | None) -> str:
        """Why the motion has to stop, in words; empty if it may go on.

        Args:
            seen: now.
            target: (4,) where the tip was sent last; None at first.
        """
        if seen.force > self._most_force and not self._unloads:
            self.pressed = True
            return f"the contact bears {seen.force:.1f} N, more than {self._most_force:g} N"
        if seen.time - seen.pose_time > self._stale:
            return f"the object's pose is {seen.time - seen.pose_time:.2g} s old"
        far = miss(seen, target) >= _MISSED
        self._missed = min(self._missed, seen.time) if far else np.inf
        if seen.time - self._missed > _MISSED_FOR:
            self.off_target = True
            return "the arm does not follow its targets"
        return ""


def miss(seen: Seen, target: Array | None) -> float:
    """Distance of the tip from where it was last sent, m."""
    return 0.0 if target is None else float(np.linalg.norm(target[:3] - seen.tip[:3]))


_SETTLING = 0.3
"""s after the last target before an action counts as done: twice the delay of an arm."""

_MOST_STEP = 0.04
"""s by which a motion goes on from one pose of the tip to the next: four periods of 100 Hz, 12 mm
of travel. Longer gaps between poses make the motion wait instead of leap."""

_MOVED = 2e-3
"""m by which an object has to come elsewhere to have been touched, where no force is measured:
poses of cameras are right to 1 mm."""


@dataclass(frozen=True)
class WayConfig(StraightConfig):
    """How the tip goes from push to push: low, as what is pushed high falls over, and swiftly."""

    height: float = parameter(0.012, "of the push above the support", "m", 1e-3, 0.5)
    clearance: float = parameter(0.2, "height above the support on the way there", "m", 0.01, 1.0)
    travel_speed: float = parameter(0.3, "on the way there and back", "m/s", 1e-3, 1.0)
    hold: float = parameter(0.1, "rest before and after the push", "s", 0.0, 10.0)


class Clock:
    """Time of a motion, which never leaps: where poses come late the motion waits.

    An arm goes straight to its newest target; leaps would cut the corners of the way.

    Attributes:
        time: of the motion, s. holes: gaps between poses in which it waited.
    """

    def __init__(self) -> None:
        self._last: float | None = None
        self.time, self.holes = 0.0, 0

    def advance(self, now: float) -> float:
        """Return the time since the first call, s, less what leaps took."""
        if self._last is not None:
            self.time += min(max(now - self._last, 0.0), _MOST_STEP)
            self.holes += now - self._last > _MOST_STEP
        self._last = now
        return self.time


class Performance:
    """Answers each observation with where the tip should be.

    Args:
        action: that is carried out.
        guard: that may stop it.

    Attributes:
        finished: whether it has ended. why: it was stopped; empty if it was not.
        touched: whether a force was measured or the object moved.
        width: m, of the jaws now; None before the first answer.
    """

    @property
    def holes(self) -> int:
        """Gaps between poses of the tip in which the motion had to wait: it jerked."""
        return self._clock.holes

    @property
    def pressed(self) -> bool:
        """Whether it was stopped by too much force."""
        return self._guard.pressed

    @property
    def off_target(self) -> bool:
        """Whether it was stopped because the arm did not follow its targets."""
        return self._guard.off_target

    def __init__(self, action: StraightAction, guard: Guard) -> None:
        self.finished, self.why, self.touched = False, "", False
        self.width: float | None = None
        self._lay: Array | None = None
        self._action, self._guard = action, guard
        self._clock = Clock()
        self._target: Array | None = None

    def advance(self, seen: Seen) -> Array:
        """Return where the tip should be now, (4,)."""
        self.why = self.why or self._guard.reason(seen, self._target)
        self._lay = seen.pose if self._lay is None else self._lay
        moved = np.hypot(*(seen.pose - self._lay)[:2]) > _MOVED
        self.touched = self.touched or seen.force > 0.0 or bool(moved)
        time = self._clock.advance(seen.time)
        self.finished = bool(self.why) or time > self._action.duration + _SETTLING
        if self.why:
            return seen.tip.copy()
        self._target, self.width = self._action.frame(time), self._action.width(time)
        return self._target


def action_of(
    candidate: Candidate,
    seen: Seen,
    way: StraightConfig,
    support: float,
    standoff: float,
    gap: float,
) -> StraightAction:
    """Return the action that makes a push or a pull of an object where it is seen.

    Args:
        candidate: in the object's frame.
        seen: now.
        way: how the tip goes there and back.
        support: height of the table, m.
        standoff: m, radius of the tip.
        gap: m, between tip and object at the start of a push.
    """
    vectors = np.stack([candidate.point, candidate.normal, candidate.direction])
    point, normal, direction = turned(vectors, np.full(3, seen.pose[2]))
    start = seen.pose[:2] + point
    if candidate.grips:
        end = start + candidate.length * direction
        turn = float(np.arctan2(-normal[0], normal[1]))
        return straight_action(
            seen.tip, start, end, candidate.travel, way, support, pull=True, turn=turn
        )
    start = start - standoff * normal - gap * direction
    end = start + (candidate.length + gap) * direction
    return straight_action(seen.tip, start, end, candidate.travel, way, support)
