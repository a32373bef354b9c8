"""All readings of a recording, in the order in which they obey Newton and Euler."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from tactile_dynamics_ros.core.errors import TactileDynamicsError
from tactile_dynamics_ros.core.inertia.conventions.balance import (
    Balance,
    Evidence,
    thinned,
)
from tactile_dynamics_ros.core.inertia.conventions.imus import imu_readings
from tactile_dynamics_ros.core.inertia.conventions.motions import Motions, followed_width
from tactile_dynamics_ros.core.inertia.conventions.poses import pose_readings
from tactile_dynamics_ros.core.inertia.conventions.reading import Reading
from tactile_dynamics_ros.core.inertia.conventions.wrenches import wrench_readings
from tactile_dynamics_ros.core.streams.streams import Streams


def readings_of(streams: Streams) -> list[Reading]:
    """Every other way in which a recording may have been meant; the commonest of equals first."""
    return [*wrench_readings(streams), *pose_readings(streams), *imu_readings(streams)]


BESIDE = 1.0
"""Logarithm of what is left, behind the best, up to which readings are ranked: a factor of 2.7 that
no thorough fit makes up for. Wider only costs time."""

ALIKE = 0.08
"""Difference of scores up to which readings are fitted thoroughly to be told apart: 4 % of what is
left of forces and of torques. At 0.02 units that a slow motion hardly tells are taken for told; at
0.3 time is spent on readings that no fit makes up for."""


@dataclass(frozen=True)
class Ranked:
    """A reading with its balance.

    Attributes:
        reading: what is tried.
        balance: what it leaves.
        rarity: place in the order in which readings are common.
    """

    reading: Reading
    balance: Balance
    rarity: int

    @property
    def score(self) -> float:
        """That of the balance; lower is better."""
        return self.balance.score


@dataclass(frozen=True)
class Ranking:
    """Readings of a recording, best first.

    Attributes:
        recorded: balance of the recording as it is, or None where it shows none.
        ranked: readings near to the best.
    """

    recorded: Balance | None
    ranked: tuple[Ranked, ...]

    @property
    def gain(self) -> float:
        """By how much less the best reading leaves than the recording as it is, in logarithms."""
        if not self.ranked:
            return 0.0
        return self.gain_of(self.ranked[0].reading.name)

    def score_of(self, reading: Reading) -> float:
        """Score of a reading; infinite where it is not near to the best."""
        return next((one.score for one in self.ranked if one.reading is reading), np.inf)

    def gain_of(self, name: str) -> float:
        """By how much less a convention leaves than the recording as it is, if it is near."""
        scores = [one.score for one in self.ranked if one.reading.name == name]
        if not scores:
            return -np.inf
        return np.inf if self.recorded is None else self.recorded.score - min(scores)

    @property
    def loss(self) -> float:
        """By how much more the best reading leaves in its worst channel, in logarithms."""
        if not self.ranked or self.recorded is None:
            return 0.0
        before, after = self.recorded.left, self.ranked[0].balance.left
        return max(after[name] - before[name] for name in after if name in before)


@dataclass(frozen=True)
class Readings:
    """Readings of a recording, made once and ranked twice.

    Attributes:
        recorded: evidence of the recording as it is, or None where it shows nothing.
        others: with their places in the order in which readings are common, and their evidence.
    """

    recorded: Evidence | None
    others: tuple[tuple[int, Reading, Evidence], ...]

    @classmethod
    def of(cls, streams: Streams, names: Sequence[str] = ()) -> Readings:
        """Readings of streams.

        Args:
            streams: as recorded.
            names: of the conventions that are tried; all by default.
        """
        few, motions = thinned(streams), Motions(followed_width(streams))
        if len(next(iter(few.contacts.values())).time) < 2:
            return cls(None, ())
        tried = [
            (rarity, reading, _read(reading, few, motions))
            for rarity, reading in enumerate(readings_of(few))
            if not names or reading.name in names
        ]
        others = tuple((r, reading, seen) for r, reading, seen in tried if seen is not None)
        return cls(Evidence.of(few, motions), others)

    @cached_property
    def alone(self) -> Ranking:
        """Readings held against Newton and Euler of the load alone."""
        return self._rank(disturbed=False)

    @cached_property
    def disturbed(self) -> Ranking:
        """The same where other forces and torques than the load's are admitted."""
        return self._rank(disturbed=True)

    def ranks_equal(self, one: Reading, other: Reading) -> bool:
        """Whether two readings leave as little, the load alone and beside other forces together."""
        scores = [
            sum(ranking.score_of(reading) for ranking in (self.alone, self.disturbed))
            for reading in (one, other)
        ]
        return bool(np.all(np.isfinite(scores))) and abs(scores[0] - scores[1]) <= ALIKE

    def _rank(self, disturbed: bool) -> Ranking:
        found: list[Ranked] = []
        best = np.inf
        for rarity, reading, evidence in self.others:
            balance = _weigh(evidence, disturbed, best + BESIDE)
            if balance is not None:
                best = min(best, balance.score)
                found.append(Ranked(reading, balance, rarity))
        near = [one for one in found if one.score <= best + BESIDE]
        recorded = None if self.recorded is None else self.recorded.weigh(disturbed)
        return Ranking(recorded, tuple(sorted(near, key=lambda one: one.score)))


def _read(reading: Reading, streams: Streams, motions: Motions) -> Evidence | None:
    """Evidence of a reading; None where streams cannot be read so."""
    try:
        return Evidence.of(reading.apply(streams), motions)
    except (TactileDynamicsError, np.linalg.LinAlgError, ValueError):
        return None


def _weigh(evidence: Evidence, disturbed: bool, enough: float) -> Balance | None:
    """Balance of a reading; None where its numbers cannot be solved for."""
    try:
        return evidence.weigh(disturbed, enough)
    except (TactileDynamicsError, np.linalg.LinAlgError, ValueError):
        return None
