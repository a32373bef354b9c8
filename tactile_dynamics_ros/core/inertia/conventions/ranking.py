"""Readings of a recording in the order in which they obey Newton and Euler."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tactile_dynamics_ros.core.errors import TactileDynamicsError
from tactile_dynamics_ros.core.inertia.conventions.balance import Balance, Bench, thinned
from tactile_dynamics_ros.core.inertia.conventions.catalogue import readings_of
from tactile_dynamics_ros.core.inertia.conventions.motions import Motions, followed_width
from tactile_dynamics_ros.core.inertia.conventions.reading import Reading
from tactile_dynamics_ros.core.streams.streams import Streams

BESIDE = 1.0
"""Logarithm of what is left, behind the best, up to which readings are ranked: a factor of 2.7 that
no thorough fit makes up for. Wider only costs time."""


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
        return np.inf if self.recorded is None else self.recorded.score - self.ranked[0].score

    @property
    def loss(self) -> float:
        """By how much more the best reading leaves in its worst channel, in logarithms."""
        if not self.ranked or self.recorded is None:
            return 0.0
        before, after = self.recorded.left, self.ranked[0].balance.left
        return max(after[name] - before[name] for name in after if name in before)


def rank(streams: Streams, names: Sequence[str] = (), disturbed: bool = False) -> Ranking:
    """Hold all readings of a recording against Newton and Euler.

    Args:
        streams: as recorded.
        names: of the conventions that are tried; all by default.
        disturbed: whether other forces and torques than the load's are admitted.
    """
    few, bench = thinned(streams), Bench(disturbed, Motions(followed_width(streams)))
    if len(next(iter(few.contacts.values())).time) < 2:
        return Ranking(None, ())
    found: list[Ranked] = []
    best = np.inf
    for rarity, reading in enumerate(readings_of(few)):
        if names and reading.name not in names:
            continue
        balance = _weigh(bench, reading, few, best + BESIDE)
        if balance is not None:
            best = min(best, balance.score)
            found.append(Ranked(reading, balance, rarity))
    near = [one for one in found if one.score <= best + BESIDE]
    recorded = bench.weigh(few)
    return Ranking(recorded, tuple(sorted(near, key=lambda one: one.score)))


def _weigh(bench: Bench, reading: Reading, streams: Streams, enough: float) -> Balance | None:
    """Balance of a reading; None where streams cannot be read so."""
    try:
        return bench.weigh(reading.apply(streams), enough)
    except (TactileDynamicsError, np.linalg.LinAlgError, ValueError):
        return None
