"""Friction under two parts and in their joint, from how pushes moved them so far."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.numerics.search import SearchConfig, cross_entropy
from tactile_dynamics_ros.core.planar.control.jointed import Hinge, JointedBody, Rubbing
from tactile_dynamics_ros.core.planar.control.prediction import PushedBody

Array = NDArray[np.float64]

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
