"""Which push to make next, and when no more: candidates, choice, stop."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.configuration import check_ranges, parameter
from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.planar.actions.information import (
    NAMES,
    Belief,
    Candidate,
    PredictedObject,
    SensingConfig,
    expected_gain,
    informations,
    updated,
)
from tactile_dynamics_ros.core.planar.mechanics.linkage import turned
from tactile_dynamics_ros.core.planar.mechanics.outline import convex_hull

Array = NDArray[np.float64]

CHOOSERS = ("gain", "uniform", "random")
"""Ways to choose: by expected gain, round the object in equal steps, by chance."""
_STANDS, _LOOKED_BACK = 0.9, 2
"""Ratio to which the last so many pushes have to narrow something that is wanted narrower; else
pushing on is no use, whatever is expected. Nearer to 1 a budget is spent on hopeless masses."""
_RIVALS = 4
"""Pushes from other places that are told beside the chosen one, for people: more hide the object
on a page."""
_CORNER = 0.012
"""m from a corner within which no push begins: a tip of 6 mm radius would slip off."""


@dataclass(frozen=True)
class ExploreConfig:
    """What pushes may be chosen, how, and when enough is known."""

    chooser: str = parameter("gain", "gain, uniform or random")
    speeds: tuple[float, ...] = parameter((0.08, 0.2), "that are tried", "m/s")
    length: float = parameter(0.06, "of a push after contact", "m", 0.01, 0.3)
    acceleration: float = parameter(4.0, "at start and stop of a push", "m/s^2", 0.1, 20.0)
    places: int = parameter(10, "round the outline that are tried", "", 3, 60)
    turn_deg: float = parameter(12.0, "of directions to the normal, both ways", "deg", 0.0, 40.0)
    budget: int = parameter(8, "pushes at most", "", 1, 100)
    least: int = parameter(2, "pushes at least: one alone does not tell variation", "", 1, 100)
    gain: float = parameter(0.2, "expected, below which no push is worth it", "nats", 0.0, 100.0)
    product: float = parameter(0.05, "wanted relative std of mass times friction", "", 1e-3, 10.0)
    mass: float = parameter(0.1, "wanted relative std of the mass", "", 1e-3, 10.0)
    com: float = parameter(0.002, "wanted std of the centre of mass", "m", 1e-4, 0.1)
    seed: int = parameter(0, "of chance", "", 0)

    def __post_init__(self) -> None:
        check_ranges(self)
        if self.chooser not in CHOOSERS:
            raise BadInputError(f"chooser '{self.chooser}': expected {', '.join(CHOOSERS)}")

    @property
    def wanted(self) -> Array:
        """Stds (4,) as the parameters of a belief."""
        return np.array([self.product, self.mass, self.com, self.com])


@dataclass(frozen=True, eq=False)
class Choice:
    """A push that was chosen.

    Attributes:
        candidate: in the object's frame. gain: expected, nats. because: in words.
        expected: belief after it.
        rivals: the best pushes from other places, with their gains, nats.
    """

    candidate: Candidate
    gain: float
    because: str
    expected: Belief
    rivals: tuple[tuple[Candidate, float], ...] = ()

    def to_json(self, pose: Array) -> dict[str, object]:
        """Plain numbers, with point and direction in the world.

        Args:
            pose: (3,) of the object before the push.
        """
        told = _plain(self.candidate, self.gain, pose)
        return {"kind": "push", **told, "chosen_because": self.because}

    def rivals_json(self, pose: Array) -> list[dict[str, object]]:
        """Plain numbers of the rivals, with point and direction in the world.

        Args:
            pose: (3,) of the object before the push.
        """
        return [_plain(candidate, gain, pose) for candidate, gain in self.rivals]


def _plain(candidate: Candidate, gain: float, pose: Array) -> dict[str, object]:
    point, direction = (
        turned(v[None], pose[2:])[0] for v in (candidate.point, candidate.direction)
    )
    return {
        "point": (pose[:2] + point).tolist(),
        "direction": direction.tolist(),
        "speed": candidate.speed,
        "length": candidate.length,
        "expected_gain": gain,
    }


def _rivals(
    candidates: list[Candidate], gains: Array, chosen: int
) -> tuple[tuple[Candidate, float], ...]:
    """The best push from each other place, the best places first."""
    best: dict[tuple[float, ...], int] = {}
    for k in np.argsort(gains):
        best[tuple(candidates[k].point)] = int(k)
    best.pop(tuple(candidates[chosen].point), None)
    order = sorted(best.values(), key=lambda k: -gains[k])[:_RIVALS]
    return tuple((candidates[k], float(gains[k])) for k in order)


class Explorer:
    """Chooses pushes of one object until its parameters are known.

    Args:
        thing: the object as it was seen.
        config: what may be chosen.
        sensing: what is measured.
        room: ((2,), (2,)) m, corners of where tip and object's middle may come to, world.
        tip_radius: m.

    Attributes:
        count: pushes chosen so far.
    """

    def __init__(
        self,
        thing: PredictedObject,
        config: ExploreConfig | None = None,
        sensing: SensingConfig | None = None,
        room: tuple[Array, Array] | None = None,
        tip_radius: float = 0.006,
    ) -> None:
        self.thing, self.config = thing, config or ExploreConfig()
        self.sensing, self.room, self.tip_radius = sensing, room, tip_radius
        self.count = 0
        self._stds: list[Array] = []
        self._rng = np.random.default_rng([self.config.seed, 47])
        self._angle = self._rng.uniform(0.0, 2.0 * np.pi)

    def reason_to_stop(self, belief: Belief) -> str:
        """Why nothing more is to be done, in words; empty if something is."""
        lacking = self.lacking(belief)
        if not lacking and self.count >= self.config.least:
            return "all parameters are known to the wanted width"
        if self.count >= self.config.budget:
            return f"{self.count} pushes were made; still wider than wanted: {', '.join(lacking)}"
        return ""

    def _stands(self, belief: Belief) -> bool:
        """Whether pushes have ceased to narrow what is wider than wanted."""
        if self.count < self.config.least + _LOOKED_BACK or len(self._stds) <= _LOOKED_BACK:
            return False
        wide = belief.std > self.config.wanted
        return bool(np.all(belief.std[wide] > _STANDS * self._stds[-1 - _LOOKED_BACK][wide]))

    def lacking(self, belief: Belief) -> list[str]:
        """Names of parameters that are wider than wanted."""
        wide = belief.std > self.config.wanted
        return [name for name, is_wide in zip(NAMES, wide, strict=True) if is_wide]

    def choose(self, belief: Belief, pose: Array) -> Choice | str:
        """Return the next push, or why there is none.

        Args:
            belief: what is known.
            pose: (3,) of the object.
        """
        reason = self.reason_to_stop(belief)
        if reason:
            return reason
        self._stds.append(belief.std)
        if self._stands(belief):
            names = ", ".join(self.lacking(belief))
            return (
                f"the last {_LOOKED_BACK} pushes hardly narrowed what is wanted narrower: {names}"
            )
        candidates = [c for c in self._candidates() if self._fits(c, pose)]
        if not candidates:
            return "no push keeps tip and object where the arm may be"
        found = self._informations(belief, candidates)
        gains = expected_gain(belief, found)
        k = self._chosen(candidates, gains, pose)
        if self.config.chooser == "gain" and gains[k] < self.config.gain and self.count:
            return f"no push would tell more than {gains[k]:.2g} nats"
        self.count += 1
        after = updated(belief, found[k])
        words, rivals = self._words(belief, after), _rivals(candidates, gains, k)
        return Choice(candidates[k], float(gains[k]), words, after, rivals)

    def _words(self, belief: Belief, after: Belief) -> str:
        """Say what a push narrows most."""
        if self.config.chooser != "gain":
            return f"chosen {self.config.chooser}ly"
        ratio = belief.std / after.std
        k = int(ratio.argmax())
        return f"it narrows {NAMES[k]} most, {ratio[k]:.1f} times, of all that fit"

    def _candidates(self) -> list[Candidate]:
        """Pushes round the outline, in each direction and at each speed."""
        config, found = self.config, []
        for point, normal in _places(self.thing.outline, config.places):
            for turn in np.deg2rad([-config.turn_deg, 0.0, config.turn_deg]):
                way = turned(normal[None], np.array([turn]))[0]
                for speed in config.speeds:
                    found.append(
                        Candidate(point, normal, way, speed, config.length, config.acceleration)
                    )
        return found

    def _fits(self, candidate: Candidate, pose: Array) -> bool:
        """Whether tip and object stay in the room."""
        if self.room is None:
            return True
        low, high = self.room
        ends = np.array([-0.02, 0.0, candidate.length])
        path = candidate.point + ends[:, None] * candidate.direction
        path = pose[:2] + turned(path, np.full(3, pose[2]))
        pushed = pose[:2] + turned(candidate.direction[None], pose[2:])[0] * candidate.length
        points = np.vstack([path, pushed])
        return bool(np.all(points >= low) and np.all(points <= high))

    def _informations(self, belief: Belief, candidates: list[Candidate]) -> Array:
        """Information (N, 4, 4); those of one speed are simulated together."""
        found = np.zeros((len(candidates), 4, 4))
        for speed in self.config.speeds:
            chosen = [k for k, c in enumerate(candidates) if c.speed == speed]
            if chosen:
                alike = [candidates[k] for k in chosen]
                found[chosen] = informations(self.thing, belief, alike, self.sensing)
        return found

    def _chosen(self, candidates: list[Candidate], gains: Array, pose: Array) -> int:
        if self.config.chooser == "gain":
            return int(gains.argmax())
        if self.config.chooser == "random":
            return int(self._rng.integers(len(candidates)))
        self._angle += 2.0 * np.pi * 0.382  # the golden section spreads any number evenly
        bearing = np.array([np.arctan2(*c.point[::-1]) for c in candidates])
        off = np.abs((bearing - self._angle + np.pi) % (2.0 * np.pi) - np.pi)
        near = np.flatnonzero(off < off.min() + 1e-6)
        return int(near[self._rng.integers(len(near))])


def next_choice(explorer: Explorer, belief: Belief, pose: Array) -> tuple[Explorer, Choice | str]:
    """Choose in another process: return the explorer as it is afterwards, and its choice."""
    return explorer, explorer.choose(belief, pose)


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
