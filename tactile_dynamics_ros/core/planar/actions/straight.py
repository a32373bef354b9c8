"""A straight push or pull: up, over, down, along, hold, back and up."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.configuration import check_ranges, parameter
from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.rigid_body.rotation import exp_so3

Array = NDArray[np.float64]


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
    """A straight motion from rest to rest with trapezoidal speed, or a rest.

    Attributes:
        name: what it is for.
        start, end: (4,) x, y, z (m) and turn (rad).
        width: of the jaws, m.
        speed: m/s at most. acceleration: m/s^2. rest: s after the motion.
    """

    name: str
    start: Array
    end: Array
    width: float
    speed: float
    acceleration: float
    rest: float = 0.0

    @property
    def duration(self) -> float:
        """Seconds with the rest."""
        length, speed = self._length, self._peak
        return (length / speed + speed / self.acceleration if length > 0.0 else 0.0) + self.rest

    def at(self, time: float) -> Array:
        """Return x, y, z and turn (4,) at a time since the start, s."""
        if self._length == 0.0:
            return self.end.copy()
        ramp, moving = self._peak / self.acceleration, self.duration - self.rest
        t = float(np.clip(time, 0.0, moving))
        left = moving - t
        way = self._peak * (t - 0.5 * ramp)
        if t < ramp:
            way = 0.5 * self.acceleration * t**2
        elif left < ramp:
            way = self._length - 0.5 * self.acceleration * left**2
        return np.asarray(self.start + way / self._length * (self.end - self.start))

    @property
    def _length(self) -> float:
        """Way, m; a turn counts as the way of a point at 0.1 m."""
        return float(np.linalg.norm((self.end - self.start) * [1.0, 1.0, 1.0, 0.1]))

    @property
    def _peak(self) -> float:
        """Speed that is reached."""
        return min(self.speed, float(np.sqrt(self._length * self.acceleration)))


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
    speed: float,
    config: StraightConfig,
    support: float = 0.0,
    pull: bool = False,
) -> StraightAction:
    """Plan a push or a pull.

    Args:
        now: (4,) x, y, z (m) and turn (rad) of the tip.
        start: (2,) m, of the tip (push) or of the middle between the pads (pull).
        end: (2,) m.
        speed: m/s, along.
        config: of everything else.
        support: height of the table, m.
        pull: grip first and open afterwards; the pads then stand to both sides of the way.

    Raises:
        BadInputError: there is no way between start and end, or the speed is not positive.
    """
    way = np.asarray(end, dtype=float) - start
    length = float(np.linalg.norm(way))
    if length < 1e-3 or not np.isfinite(length):
        raise BadInputError(f"push: from {list(start)} to {list(end)} is no way; expected 1 mm")
    if not 0.0 < speed <= 2.0:
        raise BadInputError(f"push: speed {speed} m/s: expected more than 0 and at most 2")
    turn = _turn_across(now[3], way) if pull else now[3]
    low, closed, opened = support + config.height, 0.0, config.opening
    begin, finish = np.array([*start, low, turn]), np.array([*end, low, turn])
    legs = way_there(now, begin[:2], config, support, turn, opened if pull else closed)
    if pull:
        legs.append(Leg("grip", begin, begin, closed, 1.0, 1.0, config.grip_time))
    name = "pull" if pull else "push"
    legs.append(Leg(name, begin, finish, closed, speed, config.acceleration, config.hold))
    if pull:
        legs.append(Leg("release", finish, finish, opened, 1.0, 1.0, config.grip_time))
    back = np.zeros(2) if pull else -way / length
    legs += way_back(finish, back, config, support, opened if pull else closed)
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
    return _chain(now, stops, width, config.travel_speed, config.acceleration)


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
    return _chain(now, stops, width, config.travel_speed, config.acceleration)


def _chain(
    start: Array,
    stops: list[tuple[str, Array, float]],
    width: float,
    speed: float,
    acceleration: float,
) -> list[Leg]:
    """Return legs from stop to stop."""
    legs = []
    for name, end, rest in stops:
        legs.append(Leg(name, start, end, width, speed, acceleration, rest))
        start = end
    return legs


def _turn_across(turn: float, way: Array) -> float:
    """Return the turn nearest to the present one with pads to both sides of a way."""
    wanted = np.arctan2(way[1], way[0]) - turn
    return float(turn + wanted - np.pi * np.round(wanted / np.pi))
