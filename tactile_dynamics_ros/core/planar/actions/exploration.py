"""Which push or pull to make next, and when no more: choice, stop."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.planar.actions.affordances import (
    ExploreConfig,
    Surroundings,
    fits,
    leads_inside,
    pulls,
    pushes,
)
from tactile_dynamics_ros.core.planar.actions.candidate import WORDS, Candidate
from tactile_dynamics_ros.core.planar.actions.grips import is_held
from tactile_dynamics_ros.core.planar.actions.information import (
    Belief,
    PredictedObject,
    SensingConfig,
    expected_gain,
    informations,
    updated,
)
from tactile_dynamics_ros.core.planar.mechanics.linkage import turned

Mask = NDArray[np.bool_]
Others = Sequence[Array]

_STANDS, _LOOKED_BACK = 0.9, 2
"""Ratio to which the last so many pushes have to narrow something that is wanted narrower; else
pushing on is no use, whatever is expected. Nearer to 1 a budget is spent on hopeless masses."""
_GENTLER = 0.5
"""Share of its speed at which an object is pushed on that was pushed too hard: the force of an
impact falls as much. Nearer to 1 a stop follows a stop, nearer to 0 pushes tell no masses."""
_ELSEWHERE = 0.02
"""Distance, m, from a push that met too much force within which none begins: something may be in
the way of it. Half the least width of objects, so that other places are left."""
TELLS = {
    "ln_product": ("the friction force", "force"),
    "ln_mass": ("mass from friction", "mass"),
    "com_x": ("where the centre of mass lies", "centre"),
    "com_y": ("where the centre of mass lies", "centre"),
    "ln_ratio": ("which part rubs more", "ratio of their friction"),
    "ln_joint_torque": ("how hard the joint turns", "its friction"),
}
"""What a push tells that narrows a number, and the number in words; of parts on a joint with _1 or
_2 behind its name."""
_RIVALS = 4
"""Pushes from other places that are reported beside the chosen one, for people: more hide the
object on a page."""


@dataclass(frozen=True, eq=False)
class Choice:
    """A push or a pull that was chosen.

    Attributes:
        candidate: in the object's frame. gain: expected, nats. because: in words.
        expected: belief after it; None where it is not to narrow numbers.
        rivals: the best pushes from other places, with their gains, nats.
        part: that is pushed, 0 or 1.
    """

    candidate: Candidate
    gain: float
    because: str
    expected: Belief | None
    rivals: tuple[tuple[Candidate, float], ...] = ()
    part: int = 0

    def to_json(self, pose: Array) -> dict[str, object]:
        """Plain numbers, with point and direction in the world.

        Args:
            pose: (3,) of the object before the push.
        """
        told = _plain(self.candidate, self.gain, pose)
        return {**told, "chosen_because": self.because, "part": self.part + 1}

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
        "kind": candidate.manner,
        "point": (pose[:2] + point).tolist(),
        "direction": direction.tolist(),
        "speed": candidate.speed,
        "length": candidate.length,
        "expected_gain": gain,
    }


def rivals(
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
    """Chooses pushes and pulls of one object until its parameters are known.

    Well inside the border of the workspace all manners compete by what they would tell, or only
    pushes do, as configured; beyond it the object is pulled inwards where a grip holds it
    (Source: paper B, III-D).

    Args:
        thing: the object as it was seen.
        config: what may be chosen.
        sensing: what is measured.
        room: ((2,), (2,)) m, corners of where tip and object's middle may come to, world.
        tip_radius: m.
        opening: m, of the jaws.

    Attributes:
        count: pushes and pulls chosen so far.
    """

    def __init__(
        self,
        thing: PredictedObject,
        config: ExploreConfig | None = None,
        sensing: SensingConfig | None = None,
        room: tuple[Array, Array] | None = None,
        tip_radius: float = 0.006,
        opening: float = 0.078,
    ) -> None:
        self.thing, self.config = thing, config or ExploreConfig()
        self.sensing, self.room, self.tip_radius = sensing, room, tip_radius
        self.opening = opening
        self.count = 0
        self._stds: list[Array] = []
        self._last: Array | None = None
        self._bad: list[Array] = []
        self._rng = np.random.default_rng([self.config.seed, 47])
        self._angle = self._rng.uniform(0.0, 2.0 * np.pi)

    def soften(self) -> None:
        """Push at half the speed, and elsewhere, from now on: the last push met too much force.

        The force of an impact grows with the speed: F = v sqrt(k m) for a tip of stiffness k and
        an object of mass m.
        """
        config = self.config
        self.config = replace(
            config,
            speeds=tuple(_GENTLER * speed for speed in config.speeds),
            stop_speed=max(_GENTLER * config.stop_speed, 0.01),
            acceleration=max(_GENTLER * config.acceleration, 0.1),
            braking=max(_GENTLER * config.braking, 0.1),
        )
        self.avoid()

    def avoid(self) -> None:
        """Begin elsewhere from now on than where the last push or pull began."""
        self._bad += [] if self._last is None else [self._last]

    def note(self, candidate: Candidate) -> None:
        """Note a push that somebody else chose."""
        self.count += 1
        self._last = candidate.point

    def reason_to_stop(self, belief: Belief) -> str:
        """Why nothing more is to be done, in words; empty if something is."""
        lacking = self.lacking(belief)
        if not lacking and self.count >= self.config.least:
            return "all that is asked for is known to the wanted width"
        if self.count >= self.config.budget:
            return f"{self.count} pushes were made; still wider than wanted: {lacking}"
        return ""

    def _stands(self, belief: Belief) -> bool:
        """Whether pushes have ceased to narrow what is wider than wanted."""
        if self.count < self.config.least + _LOOKED_BACK or len(self._stds) <= _LOOKED_BACK:
            return False
        wide = belief.std > self.config.wanted
        return bool(np.all(belief.std[wide] > _STANDS * self._stds[-1 - _LOOKED_BACK][wide]))

    def lacking(self, belief: Belief) -> str:
        """What is wider than wanted, in words."""
        return in_words(self.thing.names, belief.std > self.config.wanted)

    def choose(self, belief: Belief, pose: Array, others: Others = ()) -> Choice | str:
        """Return the next push or pull, or why there is none.

        Args:
            belief: what is known.
            pose: (3,) of the object.
            others: (V, 2) m each, outlines of other parts in the object's frame.
        """
        reason = self.reason_to_stop(belief)
        if reason:
            return reason
        self._stds.append(belief.std)
        if self._stands(belief):
            return (
                f"the last {_LOOKED_BACK} pushes hardly narrowed what is wanted narrower: "
                f"{self.lacking(belief)}"
            )
        candidates, where = self._possible(belief, self.around(pose, others))
        if not candidates:
            return "no push keeps tip and object where the arm may be"
        found = by_kind(
            candidates, lambda alike: informations(self.thing, belief, alike, self.sensing)
        )
        wide = belief.std > self.config.wanted
        gains = expected_gain(belief, found, wide if wide.any() else None)
        k = self._chosen(candidates, gains, pose)
        if self.config.chooser == "gain" and gains[k] < self.config.gain and self.count:
            left = self.lacking(belief) or "anything"
            return f"no push that was simulated would narrow {left} any further"
        self.note(candidates[k])
        after = updated(belief, found[k])
        words = f"{WORDS[candidates[k].manner]}: {self._words(belief, after)}{where}"
        return Choice(candidates[k], float(gains[k]), words, after, rivals(candidates, gains, k))

    def _words(self, belief: Belief, after: Belief) -> str:
        """Say what a push is to tell."""
        if self.config.chooser != "gain":
            return f"chosen {self.config.chooser}ly"
        return to_tell(self.thing.names, belief, after, belief.std > self.config.wanted)

    def around(self, pose: Array, others: Others) -> Surroundings:
        """What must not be run into from a pose (3,), with others (V, 2) in the object's frame."""
        return Surroundings(pose, tuple(others), self.room, self.tip_radius, self.opening)

    def pushes(self, around: Surroundings) -> list[Candidate]:
        """Pushes that keep tip and object in the room and clear of other parts."""
        found = pushes(self.thing.outline, self.config)
        fitting = [candidate for candidate in found if fits(candidate, around)]
        return [c for c in fitting if self._is_elsewhere(c)] or fitting

    def _is_elsewhere(self, candidate: Candidate) -> bool:
        """Whether it begins away from those that met too much force, or that no arm reached."""
        return all(np.linalg.norm(candidate.point - bad) > _ELSEWHERE for bad in self._bad)

    def _pulls(self, belief: Belief, around: Surroundings) -> list[Candidate]:
        """Pulls that keep pads and object in the room, and that the grip should hold."""
        thing = self.thing
        footprint = thing.outline if thing.footprint is None else thing.footprint
        force = self.config.grip_force
        return [
            candidate
            for candidate in pulls(footprint, self.config, around)
            if fits(candidate, around)
            and self._is_elsewhere(candidate)
            and is_held(candidate, belief, thing.tip_friction, force)
        ]

    def _possible(self, belief: Belief, around: Surroundings) -> tuple[list[Candidate], str]:
        """What may be chosen where the object lies, and words on that where it is by place."""
        config = self.config
        if not config.beyond_border(around.pose[:2]):
            pulled = [] if config.inside == "place" else self._pulls(belief, around)
            return self.pushes(around) + pulled, ""
        if not {"pull", "shake"} & set(config.manners):
            return self.pushes(around), ""
        found = [c for c in self._pulls(belief, around) if leads_inside(c, config, around)]
        if found:
            return found, "; near the border objects are pulled"
        return self.pushes(around), "; no grip pulls it away from the border"

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


def by_kind(
    candidates: Sequence[Candidate], simulated: Callable[[list[Candidate]], Array]
) -> Array:
    """What is simulated (N, ...) of candidates, together of those of one manner and speed."""
    kinds = [(c.manner, c.speed) for c in candidates]
    found: list[Array] = [np.zeros(0)] * len(kinds)
    for kind in dict.fromkeys(kinds):
        chosen = [k for k, each in enumerate(kinds) if each == kind]
        each = simulated([candidates[k] for k in chosen])
        for k, told in zip(chosen, each, strict=True):
            found[k] = told
    return np.array(found)


def to_tell(names: Sequence[str], before: Belief, after: Belief, wide: Mask) -> str:
    """Say which number of those that are wanted narrower a push narrows most.

    By how much is not said: it ranks pushes, and fits to recordings reach a third of it.

    Args:
        names: (n,) of the numbers.
        before: belief.
        after: as is expected.
        wide: (n,) which are wanted narrower; all if none is.
    """
    ratio = before.std / after.std
    stem, part = _named(names[int(np.where(wide | ~wide.any(), ratio, 0.0).argmax())])
    return f"tells {TELLS[stem][0]}{part}"


def in_words(names: Sequence[str], chosen: Mask) -> str:
    """Some of the numbers in words, each once."""
    stems = [_named(name) for name, is_chosen in zip(names, chosen, strict=True) if is_chosen]
    return ", ".join(dict.fromkeys(f"{TELLS[stem][1]}{part}" for stem, part in stems))


def _named(name: str) -> tuple[str, str]:
    """A name of TELLS, and which part is meant."""
    stem, _, part = name.rpartition("_")
    return (stem, f" of part {part}") if part.isdigit() else (name, "")


def next_choice(explorer: Any, *known: Any) -> tuple[Any, Choice | str]:
    """Choose in another process: return the explorer as it is afterwards, and its choice.

    Args:
        explorer: of one part or of two.
        known: what its `choose` takes.
    """
    return explorer, explorer.choose(*known)
