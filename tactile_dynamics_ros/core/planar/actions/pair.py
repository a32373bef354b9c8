"""What a push would tell of two parts: whether a joint holds them, and the numbers of each."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Any

import numpy as np
from scipy.special import ndtri

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.planar.actions.candidate import WORDS, Candidate
from tactile_dynamics_ros.core.planar.actions.exploration import (
    Choice,
    Explorer,
    by_kind,
    in_words,
    rivals,
    to_tell,
)
from tactile_dynamics_ros.core.planar.actions.information import (
    NAMES,
    STEPS,
    STIFFNESS,
    Belief,
    PredictedObject,
    believed_link,
    expected_gain,
    informations,
    paths_of,
    updated,
)
from tactile_dynamics_ros.core.planar.linked.chances import JOINT_SPREAD, JOINT_TORQUE, SEEN_TURN
from tactile_dynamics_ros.core.planar.linked.outlines import in_second, meeting_points
from tactile_dynamics_ros.core.planar.linked.pushes import ENOUGH_TURN
from tactile_dynamics_ros.core.planar.linked.rows import PairPatch
from tactile_dynamics_ros.core.planar.mechanics.linkage import (
    Joint,
    Linkage,
    in_frame,
    placed,
    turned,
)
from tactile_dynamics_ros.core.planar.mechanics.pusher import Tip
from tactile_dynamics_ros.core.planar.mechanics.simulation import GRAVITY, simulate
from tactile_dynamics_ros.core.planar.mechanics.support import SupportPatch

RIGID = (*NAMES, "ln_ratio")
"""Numbers of two parts that are one body: those of the body, in the frame of link_1, with the
geometric mean of both frictions, and ln of the friction of link_2 over that of link_1."""
JOINTED = tuple(f"{name}_{k}" for k in (1, 2) for name in NAMES) + ("ln_joint_torque",)
"""Numbers of two parts on a joint: those of each in its own frame, and ln of the joint's friction
in N m."""
_TORQUES = JOINT_TORQUE * np.exp(JOINT_SPREAD * ndtri((np.arange(5) + 0.5) / 5))
"""Friction of joints that are tried, N m: five, each as likely before any push, from bearings to
hinges of laptops. Not tuned."""


@dataclass(frozen=True, eq=False, kw_only=True)
class PredictedPair(PredictedObject):
    """Two parts of which the first one is touched, in its frame; `outline` is its.

    Attributes:
        second: (V, 2) m, outline of the other part in its own frame.
        offset: (3,) m, m, rad, its pose.
        joint: (2,) m, where a joint holds them; None: they are one body.
    """

    second: Array
    offset: Array
    joint: Array | None = None

    @property
    def names(self) -> tuple[str, ...]:
        """Numbers of the part that is touched come first."""
        return RIGID if self.joint is None else JOINTED

    @property
    def start(self) -> Array:
        """Both parts, or the one body."""
        first = np.zeros((1, 3))
        return first if self.joint is None else np.vstack([first, self.offset])

    @cached_property
    def patch(self) -> PairPatch:
        """Both footprints, in the frame of the part that is touched."""
        return PairPatch(self.outline, self.points, other=placed(self.second, self.offset))

    def linkage(self, parameters: Array, com_height: Array) -> Linkage:
        """One body whose faces rub differently, or two on a joint."""
        if self.joint is None:
            rough = self.patch.contrast(parameters[:, 4:])
            return Linkage((believed_link(self.patch, parameters, com_height, rough),))
        links = tuple(
            believed_link(SupportPatch(outline, self.points), own, com_height)
            for outline, own in zip(
                (self.outline, self.second), np.split(parameters[:, :8], 2, axis=1), strict=True
            )
        )
        there = np.tile(in_second(self.joint, self.offset), (len(parameters), 1))
        here = np.tile(self.joint, (len(parameters), 1))
        return Linkage(links, Joint(here, there, np.exp(parameters[:, 8])))


def joint_shows(
    pair: PredictedPair, mean: Array, enough: float, candidates: Sequence[Candidate]
) -> Array:
    """Share (N,) of usual joints that would turn far enough in each candidate.

    Each is simulated on joints of five frictions; a turn by less than what is enough counts by its
    share, so that of pushes in which no joint turns the harder one is preferred.

    Args:
        pair: with a joint.
        mean: (9,) its numbers; the joint's friction is not used.
        enough: rad.
        candidates: of one manner, with the same speed, length and acceleration.
    """
    count, tried = len(candidates), len(_TORQUES)
    parameters = np.tile(mean, (count * tried, 1))
    parameters[:, 8] = np.tile(np.log(_TORQUES), count)
    same = np.ones(count * tried)
    tip = Tip(pair.outline, pair.push_height * same, pair.tip_friction * same, STIFFNESS)
    start = np.repeat(pair.start[None], len(same), axis=0)
    body = pair.linkage(parameters, pair.com_height * same)
    motion = simulate(body, tip, start, paths_of(candidates, tried), STEPS)
    turn = np.abs(motion.pose[:, -1, 1, 2] - motion.pose[:, -1, 0, 2] - pair.offset[2])
    shown = np.clip(turn / enough, 0.0, 1.0)
    return np.asarray(shown.reshape(count, tried).mean(axis=1))


class PairExplorer:
    """Chooses pushes of two parts until it is known what they are to each other, and their numbers.

    First each part is pushed where a joint would turn, unless the estimate has decided by then;
    then what narrows the numbers of the likeliest structure; separate parts in turn, each alone.

    Args:
        explorers: of both parts, which propose the pushes.

    Attributes:
        count: pushes chosen so far.
    """

    def __init__(self, explorers: Sequence[Explorer]) -> None:
        self.explorers, self.config = tuple(explorers), explorers[0].config
        self.count = 0
        self._asked: set[int] = set()
        self._part = 0
        self._promise: tuple[tuple[str, ...], str, Array, Array] | None = None
        self._kept: dict[tuple[tuple[str, ...], str], Array] = {}

    def soften(self) -> None:
        """Push at half the speed, and elsewhere, from now on."""
        for explorer in self.explorers:
            explorer.soften()

    def avoid(self) -> None:
        """Begin elsewhere from now on than where the last push began."""
        self.explorers[self._part].avoid()

    def choose(
        self, found: dict[str, Any] | None, beliefs: Sequence[Belief], poses: Array
    ) -> Choice | str:
        """Return the next push, or why there is none.

        Args:
            found: the estimate, as `estimate --json` has it; None before the first.
            beliefs: of each part alone, which count before an estimate of both.
            poses: (2, 3) of the parts.
        """
        if self.count >= self.config.budget:
            return f"{self.count} pushes were made"
        structure = "undecided" if found is None else found["structure"]
        if structure == "separate":
            return self._alone(beliefs, poses)
        offered = [self._offered(k, poses) for k in (0, 1)]
        asking = [k for k in (0, 1) if k not in self._asked and offered[k]]
        if structure == "undecided" and asking:
            return self._to_turn(asking, offered, beliefs, poses)
        if not any(offered):
            return "no push keeps tip and object where the arm may be"
        if structure == "jointed" and found and found["joint"]["friction_torque_nm"] is None:
            both = [k for k in (0, 1) if offered[k]]
            return self._to_turn(both, offered, beliefs, poses, found)
        return self._to_narrow(offered, found, beliefs, poses)

    def _beside(self, part: int, poses: Array) -> Array:
        """(3,) pose of the other part in the frame of a part."""
        place = in_frame(poses[1 - part][None, :2], poses[part])[0]
        return np.append(place, poses[1 - part][2] - poses[part][2])

    def _offered(self, part: int, poses: Array) -> list[Candidate]:
        explorer, other = self.explorers[part], self.explorers[1 - part].thing.outline
        beside = placed(other, self._beside(part, poses))
        return explorer.pushes(explorer.around(poses[part], (beside,)))

    def _pair(
        self, part: int, poses: Array, jointed: bool, found: dict[str, Any] | None = None
    ) -> PredictedPair:
        """The pair as seen from a part; a joint is where it was found, or where outlines meet."""
        thing, other = self.explorers[part].thing, self.explorers[1 - part].thing.outline
        offset = self._beside(part, poses)
        joint = meeting_points(thing.outline, other, offset).mean(axis=0) if jointed else None
        place = None if found is None else found["joint"].get("position")
        if jointed and place is not None:
            joint = np.array(place)
            if part == 1:
                joint = in_second(joint, self._beside(0, poses))
        named = {n: getattr(thing, n) for n in ("tip_friction", "push_height", "com_height")}
        return PredictedPair(thing.outline, **named, second=other, offset=offset, joint=joint)

    def _made(self, part: int, candidate: Candidate) -> None:
        self.count += 1
        self._part = part
        self.explorers[part].note(candidate)

    def _to_turn(
        self,
        asking: Sequence[int],
        offered: Sequence[list[Candidate]],
        beliefs: Sequence[Belief],
        poses: Array,
        found: dict[str, Any] | None = None,
    ) -> Choice:
        """The push that turns most joints visibly; one that is found, far enough for numbers."""
        shown, enough = [], SEEN_TURN if found is None else ENOUGH_TURN
        for part in asking:
            pair = self._pair(part, poses, True, found)
            mean = _to_touched(pair, part) @ _of_parts(beliefs, pair).mean
            simulated = partial(joint_shows, pair, mean, enough)
            shown.append(by_kind(offered[part], simulated))
        part = asking[int(np.argmax([share.max() for share in shown]))]
        share = shown[asking.index(part)]
        k = int(share.argmax())
        self._asked.add(part)
        self._made(part, offered[part][k])
        told = "turns the joint, which tells its friction and what is whose"
        if found is None:
            turned_by = f"{100.0 * share[k]:.0f} % of usual joints would turn"
            told = f"tells whether the parts are one body ({turned_by})"
        words = f"{WORDS[offered[part][k].manner]} on part {part + 1}: {told}"
        return Choice(offered[part][k], 0.0, words, None, part=part)

    def _to_narrow(
        self,
        offered: Sequence[list[Candidate]],
        found: dict[str, Any] | None,
        beliefs: Sequence[Belief],
        poses: Array,
    ) -> Choice | str:
        """The push that narrows most of what is wanted narrower."""
        chances = {"rigid": 1.0} if found is None else found["structure_probability"]
        names = RIGID if chances["rigid"] >= chances.get("jointed", 0.0) else JOINTED
        belief = pair_belief(found, beliefs, self._pair(0, poses, names is JOINTED, found))
        self._judge(names, belief)
        wide = belief.std > self._wanted(names)
        if not wide.any() and self.count >= self.config.least:
            return "what pushes of both parts tell is known to the wanted width"
        pairs = [self._pair(k, poses, names is JOINTED, found) for k in (0, 1)]
        found_by = [self._told(k, offered[k], belief, pairs[k]) for k in (0, 1)]
        gains = [expected_gain(belief, each, wide if wide.any() else None) for each in found_by]
        part = int(np.argmax([gain.max(initial=-1.0) for gain in gains]))
        k = int(gains[part].argmax())
        if gains[part][k] < self.config.gain and self.count >= self.config.least:
            left = in_words(names, wide)
            return f"no push that was simulated would narrow {left} any further"
        self._made(part, offered[part][k])
        after = updated(belief, found_by[part][k])
        self._promise = names, offered[part][k].manner, belief.std, after.std
        words = f"{WORDS[offered[part][k].manner]} on part {part + 1}: "
        words += to_tell(names, belief, after, wide)
        others = rivals(offered[part], gains[part], k)
        return Choice(offered[part][k], float(gains[part][k]), words, after, others, part)

    def _told(
        self, part: int, offered: list[Candidate], belief: Belief, pair: PredictedPair
    ) -> Array:
        """Information (N, n, n) of pushes of a part."""
        names = pair.names
        if not offered:
            return np.zeros((0, len(names), len(names)))
        turn = _to_touched(pair, part)
        mean = turn @ belief.mean
        if part == 1 and names is RIGID:
            mean[2:4] += pair.offset[:2]
        seen = Belief(mean, turn @ belief.covariance @ turn.T)
        sensing = self.explorers[part].sensing
        own = by_kind(offered, lambda alike: informations(pair, seen, alike, sensing))
        kept = [self._kept.get((names, c.manner), np.ones(len(names))) for c in offered]
        root = np.sqrt(np.array(kept))
        return np.asarray(root[:, :, None] * (turn.T @ own @ turn) * root[:, None])

    def _judge(self, names: tuple[str, ...], belief: Belief) -> None:
        """Note which share of what the last push promised it brought, for pushes of its manner.

        Simulations know the tip's motion; estimators have poses, and resolve hard stops less.
        """
        promise, self._promise = self._promise, None
        if promise is None or promise[0] != names or np.allclose(belief.std, promise[2]):
            return  # no estimate of it came
        before, promised, brought = (std**-2.0 for std in (promise[2], promise[3], belief.std))
        share = (brought - before) / np.maximum(promised - before, 1e-9)
        self._kept[names, promise[1]] = np.clip(share, 0.0, 1.0)

    def _wanted(self, names: tuple[str, ...]) -> Array:
        """Stds (n,) that are wide enough; the ratio of two frictions is as two products are."""
        config = self.config
        wanted = {"ln_product": config.product, "ln_mass": config.mass, "com": config.com}
        wanted |= {"ln_ratio": np.sqrt(2.0) * config.product, "ln_joint": config.mass}
        stems = [next(stem for stem in wanted if name.startswith(stem)) for name in names]
        return np.array([wanted[stem] for stem in stems])

    def _alone(self, beliefs: Sequence[Belief], poses: Array) -> Choice | str:
        """The push of the part that was pushed least, as of one part alone."""
        reasons = []
        for part in sorted((0, 1), key=lambda k: self.explorers[k].count):
            beside = placed(self.explorers[1 - part].thing.outline, self._beside(part, poses))
            choice = self.explorers[part].choose(beliefs[part], poses[part], [beside])
            if isinstance(choice, Choice):
                self.count, self._part = self.count + 1, part
                return replace(choice, part=part)
            reasons.append(f"part {part + 1}: {choice}")
        return "; ".join(reasons)


def pair_belief(
    found: dict[str, Any] | None, beliefs: Sequence[Belief], pair: PredictedPair
) -> Belief:
    """What an estimate tells of numbers that pushes narrow; before one, what each part alone does.

    Args:
        found: as `estimate --json` has it.
        beliefs: of each part alone.
        pair: the parts, the first one touched.
    """
    names = pair.names
    told = {"names": []} if found is None else found["covariance"]
    if found is None or not set(names) <= set(told["names"]):
        return _of_parts(beliefs, pair)
    at = [told["names"].index(name) for name in names]
    covariance = np.array(told["matrix"])[np.ix_(at, at)]
    links = found["links"]
    if names is RIGID:
        whole, rub = found["whole"], [link["friction"]["value"] for link in links]
        mass = whole["mass"]["value"]
        product = np.log(np.sqrt(rub[0] * rub[1]) * mass)
        ratio = np.log(rub[1] / rub[0])
        return Belief(np.array([product, np.log(mass), *whole["com"]["value"], ratio]), covariance)
    numbers: list[float] = []
    for link in links:
        force, mass = link["friction_force_n"]["value"], link["mass"]["value"]
        numbers += [np.log(force / GRAVITY), np.log(mass), *link["carried_at"]["value"]]
    torque = found["joint"]["friction_torque_nm"]["value"]
    return Belief(np.array([*numbers, np.log(torque)]), covariance)


def _of_parts(beliefs: Sequence[Belief], pair: PredictedPair) -> Belief:
    """What is known of both before an estimate: of each alone, or of both as one body."""
    one, two = beliefs
    if pair.joint is not None:
        mean = np.concatenate([one.mean, two.mean, [np.log(JOINT_TORQUE)]])
        std = np.concatenate([one.std, two.std, [JOINT_SPREAD]])
        return Belief(mean, np.diag(std**2))
    whole = np.logaddexp(one.mean[:2], two.mean[:2])
    friction = [belief.mean[0] - belief.mean[1] for belief in beliefs]
    mean = np.array([*whole, *pair.patch.centroid, friction[1] - friction[0]])
    wide = [*np.maximum(one.std, two.std)[:2], *(one.std + two.std)[2:]]
    return Belief(mean, np.diag(np.square([*wide, np.hypot(one.std[0], two.std[0])])))


def _to_touched(pair: PredictedPair, part: int) -> Array:
    """Matrix (n, n) from numbers in the order and frame of link_1 to those of the touched part.

    A centre of mass is turned only; what it is shifted by is that of the pair's offset.
    """
    count = len(pair.names)
    matrix = np.eye(count)
    if part == 0:
        return matrix
    if pair.joint is not None:
        return np.asarray(matrix[[4, 5, 6, 7, 0, 1, 2, 3, 8]])
    matrix[2:4, 2:4] = turned(np.eye(2), np.full(2, pair.offset[2])).T
    matrix[4, 4] = -1.0
    return matrix
