"""Whether two parts turn against each other, where, and with how much friction."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, replace

import numpy as np

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.numerics.search import SearchConfig, cross_entropy
from tactile_dynamics_ros.core.planar.control.jointed import Hinge, JointedBody, Rubbing
from tactile_dynamics_ros.core.planar.control.prediction import Pushable, PushedBody
from tactile_dynamics_ros.core.planar.linked.outlines import distance_outside
from tactile_dynamics_ros.core.planar.mechanics.linkage import in_frame, placed, turned

_TURNS = np.deg2rad(3.0)
"""Turn of two parts against each other from which a joint is presumed, rad: markers tell each to
0.2 deg, and rigid pairs stay within 1 deg; pushes turn joints by 5 deg and more."""
_AVERAGED, _TOGETHER = 15, 1e-3
"""Relative poses that are averaged, half a second of 30 Hz, and s within which two poses are of
one image: of different ones a turning object would seem to have a joint."""
_ALIKE = np.deg2rad(1.0)
"""Turn within which averages count as one place seen again, rad: more of them tell no more of the
joint's place, and a day at rest must not outweigh a turn of a second."""
_MOST_SEEN = 20
"""Averages that count at one turn: trackers have lasting errors that no average removes."""
_NOISE = 4e-4
"""m by which an average of relative places is off, along x and y: of 0.7 mm each, and moving."""
_KNOWN = 0.01
"""m to which the place of a joint has to be known before it counts: a tenth of what parts measure,
and beyond it turns are predicted about the wrong place by as much as their lever arms."""
_LOOSE = 0.003
"""m by which seen places may miss those of a joint: joints have play, separate parts slide by more
within one push."""
_BESIDE = 0.015
"""m by which a joint may lie outside both outlines: joints lie where parts meet; two parts that
slide a little have a pole anywhere."""
LOW = 0.03
"""m above the support up to which a tip may push parts: pushes are made at 12 mm, ways there go
high above, and parts of less than 3 cm are seldom."""


@dataclass
class _Seen:
    """Mean relative pose (3,) at one turn, and of how many averages."""

    mean: Array
    count: int = 1

    def add(self, pose: Array) -> None:
        self.count = min(self.count + 1, _MOST_SEEN)
        self.mean = self.mean + (pose - self.mean) / self.count


class JointWatch:
    """Takes poses of both parts; tells whether they turned, and the joint once it is known.

    Attributes:
        turned: whether they turned against each other. pushes: what moved them so far.
    """

    def __init__(self) -> None:
        self.turned, self.pushes = False, PushRecord()
        self._numbers, self._fitted, self._pushing = PRESUMED, (0, True), False
        self._newest: list[Array] = []
        self._seen: list[_Seen] = []
        self._hinge: Hinge | None = None
        self._fresh = True

    def add(
        self, first: tuple[float, Array], second: tuple[float, Array], tip: Array | None
    ) -> None:
        """Note times, s, and poses (3,) of both parts; from two images they tell nothing.

        Args:
            first: time and pose of the first part.
            second: of the second.
            tip: (2,) m, at that time; None where it is too high to push.
        """
        if abs(first[0] - second[0]) > _TOGETHER:
            return
        self.pushes.add(tip, first[1], second[1])
        self._pushing = tip is not None
        place = in_frame(second[1][None, :2], first[1])[0]
        turn = float(second[1][2] - first[1][2])
        before = self._newest[-1][2] if self._newest else 0.0
        turn = before + (turn - before + np.pi) % (2.0 * np.pi) - np.pi
        self._newest.append(np.array([*place, turn]))
        if len(self._newest) == _AVERAGED:
            self._note(np.mean(self._newest, axis=0))
            del self._newest[:-1]

    def _note(self, pose: Array) -> None:
        away = [abs(seen.mean[2] - pose[2]) for seen in self._seen]
        near = int(np.argmin(away)) if away else -1
        if near >= 0 and away[near] < _ALIKE:
            self._seen[near].add(pose)
        else:
            self._seen.append(_Seen(pose))
        turns = [seen.mean[2] for seen in self._seen]
        self.turned = self.turned or max(turns) - min(turns) > _TURNS
        self._fresh = True

    def hinge(self, first: Array, second: Array) -> Hinge | None:
        """Return the joint of parts with outlines (V, 2), each in its frame; None while unknown.

        j_1 - R(turn) j_2 = place of the second part in the first one's frame, least squares.
        """
        if self._fresh and self.turned:
            self._hinge, self._fresh = self._found(first, second), False
        return self._hinge

    def rubbing(self, parts: tuple[PushedBody, PushedBody], hinge: Hinge) -> Rubbing:
        """Return friction under the parts, fitted anew after each push."""
        known = self.pushes.count, hinge.locked
        if known != self._fitted and not self._pushing:
            self._numbers, self._fitted = self.pushes.fitted(parts, hinge), known
        return rubbing(parts, hinge, self._numbers)

    def _found(self, first: Array, second: Array) -> Hinge | None:
        poses = np.array([seen.mean for seen in self._seen])
        weight = np.sqrt([float(seen.count) for seen in self._seen])
        cos, sin = np.cos(poses[:, 2]), np.sin(poses[:, 2])
        one, none = np.ones_like(cos), np.zeros_like(cos)
        rows = (
            np.concatenate(
                [
                    np.stack([one, none, -cos, sin], axis=1),
                    np.stack([none, one, -sin, -cos], axis=1),
                ]
            )
            * np.tile(weight, 2)[:, None]
        )
        information = rows.T @ rows / _NOISE**2
        std = np.sqrt(np.diag(np.linalg.pinv(information)))
        if np.linalg.cond(information) > 1e10 or std.max() > _KNOWN:
            return None
        wanted = np.concatenate([poses[:, 0], poses[:, 1]]) * np.tile(weight, 2)
        found = np.linalg.lstsq(rows, wanted, rcond=None)[0]
        at = found[:2] - turned(np.tile(found[2:], (len(poses), 1)), poses[:, 2])
        miss = np.linalg.norm(at - poses[:, :2], axis=1)
        outside = max(
            float(distance_outside(outline, place[None])[0])
            for outline, place in ((first, found[:2]), (second, found[2:]))
        )
        if miss.max() > _LOOSE or outside > _BESIDE:
            return None
        return Hinge(found[:2], found[2:])


def body_of_two(
    parts: tuple[PushedBody, PushedBody], poses: tuple[Array, Array], watch: JointWatch
) -> Pushable:
    """Return what is to be pushed of two parts at poses (3,), each with its outline in its frame.

    They are one body until they turn; then two parts on a joint once its place is known; else the
    second is only in the way.
    """
    first, second = parts
    hinge = watch.hinge(first.outline, second.outline)
    if not watch.turned:
        middle = 0.5 * (placed(first.com[None], poses[0]) + placed(second.com[None], poses[1]))
        one, two = (in_frame(middle, pose)[0] for pose in poses)
        hinge = Hinge(one, two, locked=True)
    if hinge is not None:
        return JointedBody(
            parts, hinge, float(poses[1][2] - poses[0][2]), watch.rubbing(parts, hinge)
        )
    return first.beside(in_frame(placed(second.outline, poses[1]), poses[0]))


_STRIDE, _STRIDES = 0.0025, 4
"""Way of the tip from sample to sample, m, and how many make a piece: along 10 mm noisy poses tell
a motion to 7 %, and what is pushed still touches at much the same place."""
_KEPT = 40
"""Newest pieces that count, four pushes of 10 cm: a fit to them takes a tenth of a second."""
_TOUCHING = 0.002
"""m by which a tip's gap may miss none for it to push: outlines and poses are right to a few mm."""
_OFF = np.array([1e-3, 1e-3, 0.012, 0.012])
"""m, m, rad, rad by which a piece's motion is off by noise of its poses and by
outlines."""
_CRUDE = 0.1
"""Share of a motion by which the ellipsoid misses it: friction that differs from place to place."""
_JOINT = 0.01
"""m, friction torque of a joint over the parts' friction force that is presumed: a third of what
turns a part of 10 cm on the spot; seen were 0.004 to 0.05."""
_PRIOR = np.array([0.8, 1.2, 0.3, 0.3, 0.3, 0.3])
"""Std of what is presumed: logit of the first part's share, logarithm of the joint's friction, and
centres of friction over friction radii (1 cm of 3.5 cm): wide, as nothing else is known."""
PRESUMED = np.zeros(6)
"""Numbers of the friction that is presumed before any push: shares as areas, centres in the middle,
the joint as above."""
_SEARCH = SearchConfig(samples=64, elites=8, rounds=6, colour=0.0)
"""Search for six numbers: 400 tries, of which half as many find costs 5 % higher."""


@dataclass(frozen=True, eq=False)
class _Piece:
    """A piece of a push: tips (P, 2), poses (P, 3) of the first part, yaws (P,) of the second."""

    tips: Array
    first: Array
    second: Array


class PushRecord:
    """Keeps pieces of pushes.

    Attributes:
        count: pieces added so far.
    """

    def __init__(self) -> None:
        self.count = 0
        self._run: list[tuple[Array, Array, float]] = []
        self._pieces: deque[_Piece] = deque(maxlen=_KEPT)

    def add(self, tip: Array | None, first: Array, second: Array) -> None:
        """Note a tip (2,) low enough to push, or None, and poses (3,) of both parts then."""
        if tip is None:
            self._run.clear()
            return
        if self._run and np.hypot(*(tip - self._run[-1][0])) < _STRIDE:
            return
        self._run.append((tip, first, float(second[2])))
        if len(self._run) <= _STRIDES:
            return
        tips, poses, yaws = zip(*self._run, strict=True)
        self._pieces.append(_Piece(np.array(tips), np.array(poses), np.array(yaws)))
        self.count += 1
        del self._run[:-1]

    def fitted(self, parts: tuple[PushedBody, PushedBody], hinge: Hinge, seed: int = 0) -> Array:
        """Return the numbers (6,) of `rubbing` that describe the pieces best, as presumed if none.

        Args:
            parts: each in its own frame.
            hinge: what holds them together.
            seed: of the search.
        """
        body = JointedBody(parts, hinge, 0.0, Rubbing.presumed(parts, hinge))
        moves = _Moves.of(body, list(self._pieces))
        if moves is None:
            return PRESUMED

        def cost(tried: Array) -> Array:
            return moves.cost(body, tried[:, 0])

        rng = np.random.default_rng([seed, 61])
        found = cross_entropy(cost, np.zeros((1, 6)), _PRIOR[None], rng, _SEARCH)
        return np.asarray(found.best[0])


@dataclass(frozen=True, eq=False)
class _Moves:
    """Pieces in which a tip pushes: states (M, 4) before and after, tips (M, 2) and ways."""

    presumed: Rubbing
    before: Array
    after: Array
    tip: Array
    ways: list[Array]

    @classmethod
    def of(cls, body: JointedBody, pieces: list[_Piece]) -> _Moves | None:
        """Take the pieces whose tips touch at both ends; the tip is put where it just touches."""
        if not pieces:
            return None
        states = np.stack([np.column_stack([p.first, p.second]) for p in pieces])
        tips = np.stack([p.tips for p in pieces])
        gap, normal = body.touch(tips[:, 0], states[:, 0])
        last = body.touch(tips[:, -1], states[:, -1])[0]
        gap, last = gap - body.tip_radius, last - body.tip_radius
        rows = (np.abs(gap) < _TOUCHING) & (np.abs(last) < _TOUCHING)
        if not rows.any():
            return None
        start = (tips[:, 0] + gap[:, None] * normal)[rows]
        ways = np.diff(tips[rows], axis=1)
        ends = states[rows, 0], states[rows, -1]
        return cls(body.rubbing, *ends, start, list(ways.swapaxes(0, 1)))

    def cost(self, body: JointedBody, tried: Array) -> Array:
        """Misfit (N,) of numbers (N, 6): robust, with what is presumed of them."""
        count, pieces = len(tried), len(self.before)
        variants = np.repeat(tried, pieces, axis=0)
        body = replace(body, rubbing=_varied(self.presumed, variants))
        before = np.tile(self.before, (count, 1))
        tip = np.tile(self.tip, (count, 1))
        after, _ = body.pushed_along(before, tip, [np.tile(way, (count, 1)) for way in self.ways])
        moved = self.after - self.before
        off = _OFF + _CRUDE * np.abs(moved)
        miss = ((after - before).reshape(count, pieces, 4) - moved) / off
        misfit = np.log1p(np.sum(miss * miss, axis=2) / 4.0).sum(axis=1)
        return np.asarray(2.0 * misfit + np.sum(np.square(tried / _PRIOR), axis=1))


def rubbing(parts: tuple[PushedBody, PushedBody], hinge: Hinge, numbers: Array) -> Rubbing:
    """Return the friction that numbers (6,) say: see `PushRecord.fitted`."""
    return _varied(Rubbing.presumed(parts, hinge), numbers[None])


def _varied(presumed: Rubbing, numbers: Array) -> Rubbing:
    """Return N variants of what is presumed, by numbers (N, 6)."""
    logit = np.log(presumed.forces[0] / presumed.forces[1]) + numbers[:, 0]
    share = 1.0 / (1.0 + np.exp(-logit))
    shift = np.stack([numbers[:, 2] + 1j * numbers[:, 3], numbers[:, 4] + 1j * numbers[:, 5]])
    return Rubbing(
        presumed.arms + presumed.radii * shift,
        presumed.radii,
        np.stack([share, 1.0 - share]),
        np.where(presumed.joint > 0.0, presumed.joint, _JOINT * np.exp(numbers[:, 1])),
    )
