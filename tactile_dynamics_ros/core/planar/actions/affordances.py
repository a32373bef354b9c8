"""What might be done to an object where it lies: pushes, hard stops, pulls and shakes."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.configuration import check_ranges, parameter
from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.planar.actions.candidate import MANNERS, Candidate
from tactile_dynamics_ros.core.planar.actions.grips import Grasp, grasps
from tactile_dynamics_ros.core.planar.linked.outlines import distance_outside
from tactile_dynamics_ros.core.planar.mechanics.linkage import placed, turned
from tactile_dynamics_ros.core.planar.mechanics.outline import convex_hull

CHOOSERS = ("gain", "uniform", "random")
"""Ways to choose: by expected gain, round the object in equal steps, by chance."""
INSIDE = ("gain", "place")
"""Well inside the border: all manners compete by their gain, or only pushes do, as in paper B."""
_CORNER = 0.012
"""m from a corner within which no push begins: a tip of 6 mm radius would slip off."""
_GRASPS = 4
"""Places of pulls that are compared: each of them goes two ways, and two are simulated for every
ten pushes, so that choosing takes half as long again."""
_BESIDE = 0.006
"""m between the tip and other parts where it comes down and draws back: outlines and poses from
cameras are right to 3 mm together."""
_RETREAT = 0.03
"""m by which the tip draws back from the object, along its way, before it rises."""
_INWARD = 0.3
"""Share of its way by which a pull near the border has to come nearer to the inside: less, and
pulls along the border would stay there."""


@dataclass(frozen=True)
class ExploreConfig:
    """What may be chosen, how, and when enough is known."""

    chooser: str = parameter("gain", "gain, uniform or random")
    manners: tuple[str, ...] = parameter(
        ("push",), "that the robot can do: push, stop (hard), pull, shake"
    )
    inside: str = parameter("gain", "inside the border: gain (all compete) or place (only pushes)")
    inside_low: tuple[float, ...] = parameter(
        (0.3, -0.3), "corner of the border beyond which objects are pulled, world", "m"
    )
    inside_high: tuple[float, ...] = parameter((0.75, 0.3), "opposite corner, world", "m")
    speeds: tuple[float, ...] = parameter((0.08, 0.2), "of pushes that are tried", "m/s")
    length: float = parameter(0.06, "of the way after contact", "m", 0.01, 0.3)
    acceleration: float = parameter(1.0, "at start and stop", "m/s^2", 0.1, 20.0)
    stop_speed: float = parameter(0.3, "of a push with a hard stop", "m/s", 0.01, 1.0)
    braking: float = parameter(10.0, "of a hard stop", "m/s^2", 0.1, 50.0)
    pull_speed: float = parameter(0.03, "of a pull", "m/s", 0.005, 0.5)
    sway: float = parameter(0.03, "of a shake from end to end", "m", 0.001, 0.1)
    sway_hz: float = parameter(2.0, "of a shake", "Hz", 0.2, 10.0)
    grip_force: float = parameter(12.0, "with which each pad grips", "N", 0.1, 70.0)
    places: int = parameter(10, "round the outline that are tried", "", 3, 60)
    turn_deg: float = parameter(12.0, "of directions to the normal, both ways", "deg", 0.0, 40.0)
    budget: int = parameter(8, "pushes and pulls at most", "", 1, 100)
    least: int = parameter(2, "pushes at least: one alone does not tell variation", "", 1, 100)
    gain: float = parameter(0.2, "expected, below which no push is worth it", "nats", 0.0, 100.0)
    product: float = parameter(
        0.08, "wanted relative std of mass times friction; tables differ by 0.07", "", 1e-3, 10.0
    )
    mass: float = parameter(0.1, "wanted relative std of the mass", "", 1e-3, 10.0)
    com: float = parameter(0.002, "wanted std of the centre of mass", "m", 1e-4, 0.1)
    patience: float = parameter(
        60.0, "real time for the estimate of a push; then the next is chosen", "s", 1.0, 3600.0
    )
    goal: tuple[float, ...] = parameter(
        (0.5, 0.0, 0.0), "x, y (m), yaw (deg) for which it is explored, with goal_error; live"
    )
    goal_error: float = parameter(
        0.0,
        "at the goal that is small enough, angles at 8 cm; 0: no goal counts; live",
        "m",
        0,
        0.5,
    )
    seed: int = parameter(0, "of chance", "", 0)

    def __post_init__(self) -> None:
        check_ranges(self)
        if self.chooser not in CHOOSERS:
            raise BadInputError(f"chooser '{self.chooser}': expected {', '.join(CHOOSERS)}")
        if self.inside not in INSIDE:
            raise BadInputError(f"inside '{self.inside}': expected {' or '.join(INSIDE)}")
        unknown = [name for name in self.manners if name not in MANNERS]
        if unknown or not self.manners:
            raise BadInputError(f"manners {list(self.manners)}: expected {', '.join(MANNERS)}")
        if len(self.goal) != 3 or not np.all(np.isfinite(self.goal)):
            raise BadInputError(f"goal {list(self.goal)}: expected x, y (m) and yaw (deg)")
        if len(self.inside_low) != 2 or len(self.inside_high) != 2:
            raise BadInputError(
                f"inside_low {self.inside_low}, inside_high {self.inside_high}: expected x, y each"
            )

    @property
    def wanted(self) -> Array:
        """Stds (4,) as the parameters of a belief."""
        return np.array([self.product, self.mass, self.com, self.com])

    def beyond_border(self, place: Array) -> float:
        """How far a place (2,) lies outside the border, m, world; 0 inside."""
        low, high = np.array(self.inside_low), np.array(self.inside_high)
        return float(np.linalg.norm(np.maximum(low - place, 0.0) + np.maximum(place - high, 0.0)))


@dataclass(frozen=True, eq=False)
class Surroundings:
    """Where an object lies, and what must not be run into.

    Attributes:
        pose: (3,) of the object, world.
        others: (V, 2) m each, outlines of other parts in the object's frame.
        room: ((2,), (2,)) m, corners of where tip, pads and object may come to, world; None: all.
        tip_radius: m. opening: m, of the jaws.
    """

    pose: Array
    others: tuple[Array, ...] = ()
    room: tuple[Array, Array] | None = None
    tip_radius: float = 0.006
    opening: float = 0.078

    def placed(self, points: Array) -> Array:
        """Points (N, 2) of the object's frame in the world."""
        return placed(points, self.pose)

    def holds(self, points: Array) -> bool:
        """Whether all points (N, 2), world, lie in the room."""
        if self.room is None:
            return True
        low, high = self.room
        return bool(np.all(points >= low) and np.all(points <= high))

    def moved(self, candidate: Candidate) -> Array:
        """Where (2,) the object's frame comes to, about, world."""
        return np.asarray(self.placed(candidate.length * candidate.direction[None])[0])


def pushes(outline: Array, config: ExploreConfig) -> list[Candidate]:
    """Pushes round an outline in each direction at each speed; hard stops along normals."""
    found = []
    for point, normal in _places(outline, config.places):
        for turn in np.deg2rad([-config.turn_deg, 0.0, config.turn_deg]):
            way = turned(normal[None], np.array([turn]))[0]
            slow = Candidate(
                point, normal, way, config.speeds[0], config.length, config.acceleration
            )
            if "push" in config.manners:
                found += [replace(slow, speed=speed) for speed in config.speeds]
            if "stop" in config.manners and turn == 0.0:
                hard = replace(slow, manner="stop", braking=config.braking)
                found.append(replace(hard, speed=config.stop_speed))
    return found


def pulls(outline: Array, config: ExploreConfig, around: Surroundings) -> list[Candidate]:
    """Pulls, steady and shaken, along and across each grasp, towards the inside of the border."""
    manners = [name for name in config.manners if name in ("pull", "shake")]
    if not manners:
        return []
    found = []
    for grasp in grasps(outline, around.opening, _GRASPS, around.others):
        along = np.array([grasp.closing[1], -grasp.closing[0]])
        for axis in (along, grasp.closing):
            pulled = _inward(grasp, axis, config, around)
            shaken = replace(pulled, manner="shake", sway=config.sway, sway_hz=config.sway_hz)
            found += [pulled if manner == "pull" else shaken for manner in manners]
    return found


def fits(candidate: Candidate, around: Surroundings) -> bool:
    """Whether tip or pads and the object stay in the room, and the tip clear of other parts."""
    if candidate.grips:
        side = 0.5 * around.opening * candidate.normal
        ends = [candidate.point + s * candidate.direction for s in (0.0, candidate.length)]
        path = np.array([end + k * side for end in ends for k in (-1.0, 1.0)])
        return around.holds(np.vstack([around.placed(path), around.moved(candidate)]))
    along = np.array([-0.02, 0.0, candidate.length])
    path = candidate.point + along[:, None] * candidate.direction
    standoff = around.tip_radius * candidate.normal
    back = np.array([0.5 * _BESIDE, _RETREAT])
    tip = candidate.point - standoff - back[:, None] * candidate.direction
    far = around.tip_radius + _BESIDE
    clear = all(distance_outside(other, tip).min() > far for other in around.others)
    return clear and around.holds(np.vstack([around.placed(path), around.moved(candidate)]))


def leads_inside(candidate: Candidate, config: ExploreConfig, around: Surroundings) -> bool:
    """Whether an object beyond the border comes nearer to the inside by a good part of the way."""
    nearer = config.beyond_border(around.pose[:2]) - config.beyond_border(around.moved(candidate))
    return nearer > min(_INWARD * candidate.length, 0.999 * config.beyond_border(around.pose[:2]))


def _inward(grasp: Grasp, axis: Array, config: ExploreConfig, around: Surroundings) -> Candidate:
    """A pull along an axis, (2,), the way that ends nearest to the middle of the inside."""
    middle = 0.5 * (np.array(config.inside_low) + np.array(config.inside_high))
    ahead = turned(axis[None], around.pose[2:])[0] @ (middle - around.pose[:2])
    return Candidate(
        grasp.middle,
        grasp.closing,
        axis if ahead >= 0.0 else -axis,
        config.pull_speed,
        config.length,
        config.acceleration,
        manner="pull",
        width=grasp.width,
    )


def _places(outline: Array, count: int) -> list[tuple[Array, Array]]:
    """Points (2,) of an anticlockwise outline and normals (2,) into it, away from sharp corners."""
    hull = convex_hull(outline)
    way = np.roll(hull, -1, axis=0) - hull
    length = np.linalg.norm(way, axis=1)
    along = (np.arange(count) + 0.5) / count * length.sum()
    ends = np.cumsum(length)
    found = []
    for place in along:
        k = int(np.searchsorted(ends, place, side="right"))
        inset = min(_CORNER, 0.5 * float(length[k]))
        left = float(np.clip(place - (ends[k] - length[k]), inset, length[k] - inset))
        unit = way[k] / length[k]
        found.append((hull[k] + left * unit, np.array([-unit[1], unit[0]])))
    return found
