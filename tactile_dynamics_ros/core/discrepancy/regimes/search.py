"""Which effect, behind which gate, explains a residual best; and whether the rest of it agrees."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import ndtr

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.discrepancy.model.residual_model import Family, ResidualModel
from tactile_dynamics_ros.core.discrepancy.regimes.sums import CellSums, Gates, gates_to_try
from tactile_dynamics_ros.core.discrepancy.structure import window_index
from tactile_dynamics_ros.core.numerics.regime import Gate

_MOST_COLUMNS = 6
"""Columns of families with a choice of sensors that are tried: errors of two fingers. More would be
a hundred families that differ in little."""
_MOST_OF_ALL = 20
"""Columns of any other family: a spring has 19. More would fit a regime whatever happens there."""
_BLOCK = 0.5
"""Length of the blocks that are fitted and predicted in turn, s: far longer than the windows of the
motion (±70 ms), and so short that a regime of three seconds has six of them."""
_LEAST_LOSS = 1e-2
"""Squared residual of a block, in those of one white number, below which ratios do not count: only
exact data have less."""


@dataclass(frozen=True)
class Candidate:
    """A family behind a gate.

    Attributes:
        family: what acts.
        gate: where.
        criterion: -2 log evidence it gains, with the price of its parameters and of the search.
        searched: number of gates and families that it was the best of.
    """

    family: Family
    gate: Gate
    criterion: float
    searched: int


@dataclass(frozen=True)
class RegimeSearch:
    """Families and gates of one fitted model.

    Attributes:
        sums: over cells.
        families: that may act in a regime.
        everywhere: all families.
        gates: to be tried.
        floor: white RMS of the noise alone.
    """

    sums: CellSums
    families: tuple[Family, ...]
    everywhere: tuple[Family, ...]
    gates: Gates
    floor: float

    @classmethod
    def of(
        cls, model: ResidualModel, floor: float, names: Sequence[str] | None = None
    ) -> RegimeSearch | None:
        """Prepare the search; None where the model offers no condition or no effect.

        Args:
            model: fitted.
            floor: white RMS of the noise alone.
            names: of the effects to be tried; all that the model lacks by default.
        """
        found = tuple(model.families(names))
        families = tuple(family for family in found if _is_tried(family))
        everywhere = tuple(family for family in found if not family.event)
        conditions = model.conditions() if families else ()
        if not conditions:
            return None
        sums = CellSums.of(model)
        gates = gates_to_try(model, conditions, sums)
        return cls(sums, families, everywhere, gates, floor) if gates.gates else None

    def candidates(
        self, used: Array | None = None, families: Sequence[Family] | None = None
    ) -> list[Candidate]:
        """The best gate of every family and condition, best first.

        Args:
            used: (W,) cells to be fitted; all by default.
            families: to be tried; all that may act in a regime by default.
        """
        cells = np.ones(len(self.sums.rows)) if used is None else used
        rows = len(self.sums.residual) * cells.mean()
        found = []
        for family in self.families if families is None else families:
            columns = self.sums.columns(family)
            gain = self.sums.fit(columns, self.gates.inside, cells).gain
            tried = self.gates.tried(family)
            searched = family.choices * self.gates.count(family)
            price = len(family.kept) * float(np.log(rows)) + 2.0 * float(np.log(max(searched, 1)))
            for condition in np.unique(self.gates.of_condition[tried]):
                of_it = np.flatnonzero(tried & (self.gates.of_condition == condition))
                best = int(of_it[np.argmax(gain[of_it])])
                criterion = price - float(gain[best]) / self.floor**2
                found.append(Candidate(family, self.gates.gates[best], criterion, searched))
        return sorted(found, key=lambda candidate: candidate.criterion)

    def best_everywhere(self, used: Array) -> Family:
        """The family that explains most of some cells by acting everywhere."""
        return min(self.everywhere, key=lambda family: self._criterion(family, used))

    def criterion_everywhere(self) -> float:
        """`Candidate.criterion` of the best family that acts everywhere, or of none at all."""
        used = np.ones(len(self.sums.rows))
        return min(0.0, *(self._criterion(family, used) for family in self.everywhere))

    def _criterion(self, family: Family, used: Array) -> float:
        always = np.ones((1, len(self.sums.rows)))
        gain = float(self.sums.fit(self.sums.columns(family), always, used).gain[0])
        rows = len(self.sums.residual) * used.mean()
        price = len(family.kept) * float(np.log(rows)) + 2.0 * float(np.log(family.choices))
        return price - gain / self.floor**2

    def split_p_value(self, families: Sequence[Family]) -> float:
        """P-value that a regime, found in every second block, does not predict the other blocks.

        In each half the best gate of the best of the families is found and fitted, as is the best
        effect that acts everywhere. The log ratio of what they leave of each block of the other
        half is averaged over blocks: few blocks of large errors do not decide.

        Args:
            families: that may act in a regime.
        """
        block = window_index(self.sums.time, _BLOCK)
        numbers = np.unique(block)
        ratios = np.zeros(len(numbers))
        noise = _LEAST_LOSS * self.floor**2
        for parity in (0, 1):
            used = (block % 2 == parity).astype(float)
            best = self.candidates(used, families)[0]
            rival = self.best_everywhere(used)
            inside = self.gates.inside[self.gates.gates.index(best.gate)]
            gated, always = (
                np.bincount(block, losses)[numbers]
                for losses in (
                    self._losses(best.family, inside, used),
                    self._losses(rival, np.ones_like(inside), used),
                )
            )
            logs = np.log(np.maximum(always, noise)) - np.log(np.maximum(gated, noise))
            ratios += np.where(numbers % 2 == parity, 0.0, logs)
        spread = float(ratios.std(ddof=1) / np.sqrt(len(ratios)))
        return float(ndtr(-ratios.mean() / max(spread, 1e-300)))

    def _losses(self, family: Family, inside: Array, used: Array) -> Array:
        columns = self.sums.columns(family)
        return self.sums.losses(columns, inside, self.sums.fit(columns, inside[None], used))


def _is_tried(family: Family) -> bool:
    """Whether a family is tried behind gates."""
    whole = family.label == family.reading
    most = _MOST_OF_ALL if whole else _MOST_COLUMNS
    return family.regional and not family.rings and len(family.kept) <= most
