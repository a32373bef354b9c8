"""Pushing an object to a pose: plan, go there, push in closed loop, look, plan anew."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.configuration import check_ranges, parameter
from tactile_dynamics_ros.core.planar.actions.straight import (
    Leg,
    StraightAction,
    StraightConfig,
    way_back,
    way_there,
)
from tactile_dynamics_ros.core.planar.control.performance import (
    Clock,
    Guard,
    GuardConfig,
    Seen,
    WayConfig,
    miss,
)
from tactile_dynamics_ros.core.planar.control.plan import Push
from tactile_dynamics_ros.core.planar.control.prediction import Pushable

_SETTLE = 0.25
"""s of slowing down: the speed is at most the length that is left over this, so that two
corrections fall into the last 2 mm at 10 Hz. Longer makes pushes slower, shorter overshoots."""
_CRAWL = 0.008
"""m/s, lowest speed of a push: 1 mm takes a tenth of a second; slower only costs time."""
_LOOKS = 5
"""Poses that are averaged before a plan: noise of 0.5 mm becomes 0.2. More only wait longer."""
_NEVER = 1e-3
"""m that a push must save to count as progress: twice what averaged poses are uncertain by."""
_BLOCKED, _BLOCKED_FOR = 0.01, 0.3
"""m by which a tip that pushes may be from its target, and s for how long, before it lifts off and
plans anew: pushes lag by 3 mm; where messages come late the target leaps ahead by 1 cm at times."""
_WORSE = 0.03
"""m by which the error may exceed the least of a push before it ends: plans miss by 2 cm;
where the object moves otherwise than predicted, as on a joint, corrections push it on and on."""
_RESTS = ("look", "go")
"""Phases in which the object lies where it was seen last: poses of a pushed one are 20 ms old, and
a push that is stopped for its force has thrown objects by 5 degrees meanwhile."""
_MOST_STEP = 0.1
"""s of motion that one target may be ahead of the last; longer gaps between poses slow the push
down instead of making the tip leap."""


@dataclass(frozen=True)
class ControlConfig(GuardConfig):
    """When to push on, when to stop."""

    speed: float = parameter(0.05, "of the tip while it pushes", "m/s", 1e-3, 0.5)
    rate_hz: float = parameter(10.0, "at which a push is corrected", "Hz", 0.5, 100.0)
    near: float = parameter(0.002, "distance from the goal that is near enough", "m", 1e-4, 0.1)
    near_deg: float = parameter(1.2, "angle to the goal that is near enough", "deg", 0.01, 90.0)
    reached: float = parameter(0.01, "largest distance that counts as reached", "m", 1e-3, 0.5)
    reached_deg: float = parameter(8.0, "largest angle that counts as reached", "deg", 0.1, 180.0)
    most_time: float = parameter(120.0, "after which it is given up", "s", 1.0, 3600.0)
    lost: float = parameter(0.006, "gap at which contact counts as lost", "m", 1e-3, 0.1)
    tries: int = parameter(4, "pushes without progress before it is given up", "", 1, 100)

    def __post_init__(self) -> None:
        check_ranges(self)


@dataclass(frozen=True)
class Outcome:
    """How it ended.

    Attributes:
        reached: whether the object is within what counts as reached; never where a push was
            stopped midway, as nobody looked where the object came to rest.
        error_m, error_rad: of the object's last pose. pushes: made. duration_s: in all.
        why: it ended, in words.
    """

    reached: bool
    error_m: float
    error_rad: float
    pushes: int
    duration_s: float
    why: str

    def to_json(self) -> dict[str, object]:
        """Plain numbers and words."""
        return {
            "reached": self.reached,
            "error_m": self.error_m,
            "error_rad": self.error_rad,
            "pushes": self.pushes,
            "duration_s": self.duration_s,
            "stopped_because": self.why,
        }


class Planner(Protocol):
    """What decides where to push."""

    goal: Array
    body: Pushable

    def left(self, pose: Array) -> float:
        """What is left to do for an object at a pose (3,), m."""

    def plan(self, pose: Array) -> Push:
        """Return the next push of an object at a pose (3,)."""

    def go_on(self, plan: Array, pose: Array, tip: Array, normal: Array) -> Push:
        """Return the best way on from a tip (2,) that touches."""

    def contact(self, pose: Array, tip: Array) -> tuple[float, Array]:
        """Gap between tip (2,) and object at a pose (3,), m, and the normal (2,) into it."""

    def retreat(self, pose: Array, tip: Array) -> Array:
        """Direction (2,) in which a tip (2,) comes free of an object at a pose (3,)."""

    def strikes(self, pose: Array, tip: Array) -> bool:
        """Whether a tip (2,) runs into a part that it does not push."""


class PushController:
    """Answers each observation with where the tip should be; ends by itself.

    Args:
        planner: decides where to push.
        straight: how the tip goes there and back.
        config: when to stop.
        support: height of the table, m.

    Attributes:
        outcome: how it ended; None while it goes on.
        phase: what is being done. push: the last one decided. pushes: begun so far.
    """

    def __init__(
        self,
        planner: Planner,
        straight: StraightConfig | None = None,
        config: ControlConfig | None = None,
        support: float = 0.0,
    ) -> None:
        self.planner, self.support = planner, support
        self.straight, self.config = straight or WayConfig(), config or ControlConfig()
        self.outcome: Outcome | None = None
        self.phase, self.push, self.pushes = "look", None, 0
        self._began: float | None = None
        self._looks: deque[Array] = deque(maxlen=_LOOKS)
        self._look_time = -np.inf
        self._way, self._clock = StraightAction(()), Clock()
        self._best, self._idle = np.inf, 0
        self._touched = False
        self._target: Array | None = None
        self._late = np.inf
        self._guard = Guard(self.config)

    push: Push | None

    def advance(self, seen: Seen) -> Array:
        """Return where the tip should be now, (4,); where it is once it has ended."""
        if self._began is None:
            self._began = seen.time
        reason = self._reason_to_stop(seen)
        if reason and self.outcome is None:
            self._end(seen, reason)
        if self.outcome is not None:
            return seen.tip.copy()
        step = {"look": self._look, "go": self._go, "push": self._advance_push}.get(self.phase)
        self._target = self._leave(seen) if step is None else step(seen)
        return self._target

    def skip_way(self) -> tuple[Array, float] | None:
        """Skip the way through the air that begins: return its end (4,) and how many s it takes.

        None while the tip is not on such a way. For simulations in which nothing happens there.
        """
        if self.phase != "go" or self._clock.time >= self._way.duration:
            return None
        self._clock.time = self._way.duration
        return self._way.frame(np.inf), self._way.duration

    def stop(self, seen: Seen, why: str) -> None:
        """End now."""
        if self.outcome is None:
            self._end(seen, why)

    def progress(self, seen: Seen) -> dict[str, object]:
        """Numbers of what is being done."""
        away, turn = self._away(seen.pose)
        return {"pushes": self.pushes, "error_m": away, "error_rad": turn}

    def _reason_to_stop(self, seen: Seen) -> str:
        reason = self._guard.reason(seen, self._target)
        if not reason and self._is_late(seen) and self.phase == "look":
            return f"not there after {self.config.most_time:g} s"
        return reason

    def _is_late(self, seen: Seen) -> bool:
        assert self._began is not None
        return seen.time - self._began > self.config.most_time

    def _end(self, seen: Seen, why: str) -> None:
        away, turn = self._away(seen.pose)
        near = away <= self.config.reached
        inside = near and turn <= np.deg2rad(self.config.reached_deg) and self.phase in _RESTS
        duration = 0.0 if self._began is None else seen.time - self._began
        self.outcome = Outcome(bool(inside), away, turn, self.pushes, duration, why)

    def _away(self, pose: Array) -> tuple[float, float]:
        """Distance (m) and angle (rad) of a pose from the goal."""
        off = pose - self.planner.goal
        turn = abs((off[2] + np.pi) % (2.0 * np.pi) - np.pi)
        return float(np.hypot(*off[:2])), float(turn)

    def _look(self, seen: Seen) -> Array:
        """Gather poses at rest; then decide."""
        if seen.pose_time > self._look_time:
            self._look_time = seen.pose_time
            self._looks.append(seen.pose)
        if len(self._looks) == _LOOKS:
            poses = np.array(self._looks)
            poses[:, 2] = poses[0, 2] + np.angle(np.exp(1j * (poses[:, 2] - poses[0, 2])))
            self._decide(seen, poses.mean(axis=0))
        return seen.tip.copy()

    def _decide(self, seen: Seen, pose: Array) -> None:
        """Stop, or begin the way to the next push."""
        config = self.config
        away, turn = self._away(pose)
        left = self.planner.left(pose)
        if away <= config.near and turn <= np.deg2rad(config.near_deg):
            self._end(seen, "near enough")
            return
        self._idle = 0 if left < self._best - _NEVER else self._idle + 1
        self._best = min(self._best, left)
        if self._idle > config.tries:
            self._end(seen, f"{config.tries} tries brought it no nearer")
            return
        push = self.planner.plan(pose)
        if push.length <= 0.0:  # none helps where it seems to lie: look again
            self._looks.clear()
            return
        self.push, self.phase, self._touched = push, "go", False
        self._walk(seen, way_there(seen.tip, push.start, self.straight, self.support, seen.tip[3]))

    def _walk(self, seen: Seen, legs: Sequence[Leg]) -> None:
        self._way, self._clock = StraightAction(tuple(legs)), Clock()
        self._clock.advance(seen.time)

    def _follow(self, seen: Seen, then: str) -> Array:
        """Go along the way; the next phase begins at its end."""
        time = self._clock.advance(seen.time)
        if time >= self._way.duration:
            self.phase = then
        return self._way.frame(time)

    def _go(self, seen: Seen) -> Array:
        target = self._follow(seen, "push")
        if self.phase == "push":
            assert self.push is not None
            self.pushes += 1
            self._left, self._last = self.push.length, seen.time
            self._place, self._turned = self.push.start.copy(), seen.time
            self._z, self._least = target[2], np.inf
        return target

    def _advance_push(self, seen: Seen) -> Array:
        """Move on along the direction, corrected at the configured rate."""
        assert self.push is not None
        gap = self.planner.contact(seen.pose, self._place)[0]
        self._touched = self._touched or gap < 1e-3
        if self._touched and seen.time - self._turned >= 1.0 / self.config.rate_hz:
            self._turned = seen.time
            start_normal = self.push.normal
            self.push = self.planner.go_on(self.push.plan, seen.pose, self._place, start_normal)
            self._left = self.push.length
        step = min(seen.time - self._last, _MOST_STEP)
        self._last = seen.time
        speed = float(np.clip(self._left / _SETTLE, _CRAWL, self.config.speed))
        way = min(speed * step, max(self._left, 0.0))
        self._place = self._place + way * self.push.direction
        self._left -= way
        late = miss(seen, self._target) > _BLOCKED
        self._late = min(self._late, seen.time) if late else np.inf
        blocked = seen.time - self._late > _BLOCKED_FOR
        blocked = blocked or self.planner.strikes(seen.pose, self._place)
        still = self.planner.left(seen.pose)
        self._least = min(self._least, still)
        useless = self._left <= 1e-4 or still > self._least + _WORSE or self._is_late(seen)
        if useless or gap > self._most_gap() or blocked:
            self._begin_leaving(seen)
        return np.array([*self._place, self._z, seen.tip[3]])

    def _most_gap(self) -> float:
        assert self.push is not None
        return self.config.lost if self._touched else self.config.lost + 0.02

    def _begin_leaving(self, seen: Seen) -> None:
        away = self.planner.retreat(seen.pose, self._place)
        now = seen.tip.copy()
        self.phase = "leave"
        self._walk(seen, way_back(now, away, self.straight, self.support))

    def _leave(self, seen: Seen) -> Array:
        target = self._follow(seen, "look")
        if self.phase == "look":
            self._looks.clear()
            self._look_time = seen.pose_time
        return target
