"""A straight push or pull: up, over, down, along, hold, back and up."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.configuration import check_ranges, parameter
from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.rigid_body.rotation import exp_so3


@dataclass(frozen=True)
class Travel:
    """A trapezoid of speed, and a shake on top of it that begins and ends at rest.

    s(t) = trapezoid + a / 2 (1 - cos 2 pi f t) for as many whole periods as the way lasts.

    Attributes:
        speed: m/s at most. acceleration: m/s^2 at the start.
        braking: m/s^2 at the stop; 0 as at the start.
        sway: a, m, from end to end of the shake. sway_hz: f, how often.
    """

    speed: float
    acceleration: float
    braking: float = 0.0
    sway: float = 0.0
    sway_hz: float = 0.0

    @property
    def stopping(self) -> float:
        """Deceleration at the end, m/s^2."""
        return self.braking or self.acceleration

    def peak(self, length: float) -> float:
        """Speed that is reached on a way, m/s; lower than the speed where the way is short."""
        harmonic = 2.0 / (1.0 / self.acceleration + 1.0 / self.stopping)
        return min(self.speed, float(np.sqrt(length * harmonic)))

    def duration(self, length: float) -> float:
        """Seconds that a way takes, m."""
        if length == 0.0:
            return 0.0
        top = self.peak(length)
        return length / top + 0.5 * top * (1.0 / self.acceleration + 1.0 / self.stopping)

    def braking_from(self, length: float) -> float:
        """Seconds after which the speed falls, of a way of a length, m."""
        return self.duration(length) - self.peak(length) / self.stopping

    def at(self, time: Array, length: float) -> Array:
        """Way (T,) m that is gone at times (T,) s since the start of one of a length, m."""
        if length == 0.0:
            return np.zeros_like(time)
        top, whole = self.peak(length), self.duration(length)
        t = np.clip(time, 0.0, whole)
        ramp, left = top / self.acceleration, whole - t
        way = top * (t - 0.5 * ramp)
        way = np.where(t < ramp, 0.5 * self.acceleration * t**2, way)
        way = np.where(left < top / self.stopping, length - 0.5 * self.stopping * left**2, way)
        if self.sway == 0.0:
            return np.asarray(way)
        periods = np.minimum(self.sway_hz * t, np.floor(self.sway_hz * whole))
        return np.asarray(way + 0.5 * self.sway * (1.0 - np.cos(2.0 * np.pi * periods)))


@dataclass(frozen=True)
class StraightConfig:
    """How a tip is brought to an object and taken away."""

    height: float = parameter(0.02, "of the push above the support", "m", 1e-3, 0.5)
    clearance: float = parameter(0.15, "height above the support on the way there", "m", 0.01, 1.0)
    travel_speed: float = parameter(0.2, "on the way there and back", "m/s", 1e-3, 1.0)
    acceleration: float = parameter(1.0, "at start and stop", "m/s^2", 1e-2, 20.0)
    hold: float = parameter(0.2, "rest before and after the push", "s", 0.0, 10.0)
    retreat: float = parameter(0.03, "way back from the object before the tip rises", "m", 0.0, 0.5)
    opening: float = parameter(0.078, "of the jaws before they close for a pull", "m", 0.0, 0.5)
    grip_time: float = parameter(2.0, "that jaws have to close or open", "s", 0.1, 20.0)

    def __post_init__(self) -> None:
        check_ranges(self)


@dataclass(frozen=True)
class Leg:
    """A straight motion from rest to rest, or a rest.

    Attributes:
        name: what it is for.
        start, end: (4,) x, y, z (m) and turn (rad).
        width: of the jaws, m.
        travel: how the way is gone. rest: s after the motion.
    """

    name: str
    start: Array
    end: Array
    width: float
    travel: Travel
    rest: float = 0.0

    @property
    def duration(self) -> float:
        """Seconds with the rest."""
        return self.travel.duration(self._length) + self.rest

    def at(self, time: float) -> Array:
        """Return x, y, z and turn (4,) at a time since the start, s."""
        if self._length == 0.0:
            return self.end.copy()
        way = float(self.travel.at(np.array([time]), self._length)[0])
        return np.asarray(self.start + way / self._length * (self.end - self.start))

    @property
    def _length(self) -> float:
        """Way, m; a turn counts as the way of a point at 0.1 m."""
        return float(np.linalg.norm((self.end - self.start) * [1.0, 1.0, 1.0, 0.1]))


@dataclass(frozen=True)
class Moment:
    """Where the gripper should be at an instant.

    Attributes:
        leg: name of what it is doing.
        pose: (4, 4) of the tip in the world, upright. width: of the jaws, m.
    """

    leg: str
    pose: Array
    width: float


@dataclass(frozen=True)
class StraightAction:
    """Legs one after the other.

    Attributes:
        legs: in their order.
    """

    legs: tuple[Leg, ...]

    @property
    def duration(self) -> float:
        """Seconds from first to last."""
        return sum(leg.duration for leg in self.legs)

    def at(self, time: float) -> Moment:
        """Return where the gripper should be at a time since the start, s; held at the end."""
        leg, time = self._leg(time)
        frame = leg.at(time)
        pose = np.eye(4)
        pose[:3, :3] = exp_so3(np.array([0.0, 0.0, frame[3]]))
        pose[:3, 3] = frame[:3]
        return Moment(leg.name, pose, leg.width)

    def frame(self, time: float) -> Array:
        """Return x, y, z and turn (4,) at a time since the start, s; held at the end."""
        leg, time = self._leg(time)
        return leg.at(time)

    def width(self, time: float) -> float:
        """Return the width of the jaws at a time since the start, m."""
        return self._leg(time)[0].width

    def _leg(self, time: float) -> tuple[Leg, float]:
        """Return the leg at a time since the start, s, and the time since its own start."""
        for leg in self.legs:
            if time < leg.duration:
                return leg, time
            time -= leg.duration
        return leg, leg.duration


def straight_action(
    now: Array,
    start: Array,
    end: Array,
    travel: Travel,
    config: StraightConfig,
    support: float = 0.0,
    pull: bool = False,
    turn: float | None = None,
) -> StraightAction:
    """Plan a push or a pull.

    Args:
        now: (4,) x, y, z (m) and turn (rad) of the tip.
        start: (2,) m, of the tip (push) or of the middle between the pads (pull).
        end: (2,) m.
        travel: how the way between them is gone.
        config: of everything else.
        support: height of the table, m.
        pull: open above the start, grip, let go at the end, and close where the tip has risen.
        turn: rad, of the gripper of a pull, or the same turned by half a turn; without it the pads
            stand to both sides of the way.

    Raises:
        BadInputError: there is no way between start and end, or the speed is not positive.
    """
    way = np.asarray(end, dtype=float) - start
    length = float(np.linalg.norm(way))
    if length < 1e-3 or not np.isfinite(length):
        raise BadInputError(f"push: from {list(start)} to {list(end)} is no way; expected 1 mm")
    if not 0.0 < travel.speed <= 2.0:
        raise BadInputError(f"push: speed {travel.speed} m/s: expected more than 0 and at most 2")
    across = float(np.arctan2(way[1], way[0])) if turn is None else turn
    held = _nearest_turn(now[3], across) if pull else now[3]
    low, closed, opened = support + config.height, 0.0, config.opening
    begin, finish = np.array([*start, low, held]), np.array([*end, low, held])
    legs = way_there(now, begin[:2], config, support, held, opened if pull else closed)
    at_rest = Travel(1.0, 1.0)
    if pull:  # a short way leaves the jaws no time: half open they would come down on the object
        above = legs[-1].start
        legs.insert(-1, Leg("open", above, above, opened, at_rest, config.grip_time))
        legs.append(Leg("grip", begin, begin, closed, at_rest, config.grip_time))
    legs.append(Leg("pull" if pull else "push", begin, finish, closed, travel, config.hold))
    if pull:
        legs.append(Leg("release", finish, finish, opened, at_rest, config.grip_time))
    back = np.zeros(2) if pull else -way / length
    legs += way_back(finish, back, config, support, opened if pull else closed)
    if pull and config.clearance > config.height:
        above = legs[-1].end
        legs.append(Leg("close", above, above, closed, at_rest, config.grip_time))
    return StraightAction(tuple(leg for leg in legs if leg.duration > 0.0))


def freeing(now: Array, config: StraightConfig, support: float) -> StraightAction:
    """Open jaws that hold something where they are, rise, and close them in the air.

    Args:
        now: (4,) x, y, z (m) and turn (rad) of the tip.
        config: heights and speeds.
        support: height of the table, m.
    """
    at_rest = Travel(1.0, 1.0)
    legs = [Leg("release", now, now, config.opening, at_rest, config.grip_time)]
    if now[2] < support + config.clearance:
        legs += way_back(now, np.zeros(2), config, support, config.opening)
    above = legs[-1].end
    legs.append(Leg("close", above, above, 0.0, at_rest, config.grip_time))
    return StraightAction(tuple(leg for leg in legs if leg.duration > 0.0))


def drawing_back(
    now: Array, direction: Array, config: StraightConfig, support: float
) -> StraightAction:
    """Leave an object against the direction in which it was pushed, and rise.

    Args:
        now: (4,) x, y, z (m) and turn (rad) of the tip.
        direction: (2,) unit, of the push.
        config: heights and speeds.
        support: height of the table, m.
    """
    legs = way_back(now, -np.asarray(direction), config, support)
    return StraightAction(tuple(leg for leg in legs if leg.duration > 0.0))


def way_there(
    now: Array,
    start: Array,
    config: StraightConfig,
    support: float,
    turn: float,
    width: float = 0.0,
) -> list[Leg]:
    """Return the legs up, over and down to where an action starts.

    Args:
        now: (4,) x, y, z (m) and turn (rad) of the tip.
        start: (2,) m.
        config: heights and speeds.
        support: height of the table, m.
        turn: of the gripper there, rad.
        width: of the jaws, m.
    """
    high, low = support + config.clearance, support + config.height
    up = np.array([*now[:2], max(high, now[2]), now[3]])
    above, begin = np.array([*start, high, turn]), np.array([*start, low, turn])
    stops = [("rise", up, 0.0), ("travel", above, config.hold), ("descend", begin, config.hold)]
    return _chain(now, stops, width, config)


def way_back(
    now: Array, back: Array, config: StraightConfig, support: float, width: float = 0.0
) -> list[Leg]:
    """Return the legs away from an object and up.

    Args:
        now: (4,) x, y, z (m) and turn (rad) of the tip.
        back: (2,) unit, away from the object; zero to go straight up.
        config: heights and speeds.
        support: height of the table, m.
        width: of the jaws, m.
    """
    away = now + [*(config.retreat * back), 0.0, 0.0]
    raised = np.array([*away[:2], support + config.clearance, now[3]])
    stops = [("retreat", away, 0.0), ("rise", raised, 0.0)]
    return _chain(now, stops, width, config)


def _chain(
    start: Array,
    stops: list[tuple[str, Array, float]],
    width: float,
    config: StraightConfig,
) -> list[Leg]:
    """Return legs from stop to stop."""
    legs, travel = [], Travel(config.travel_speed, config.acceleration)
    for name, end, rest in stops:
        legs.append(Leg(name, start, end, width, travel, rest))
        start = end
    return legs


def _nearest_turn(now: float, wanted: float) -> float:
    """Return the turn nearest to the present one that is a wanted one or half a turn from it."""
    away = wanted - now
    return float(now + away - np.pi * np.round(away / np.pi))
