"""Gates to try: thresholds and intervals of every condition that a model offers."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.discrepancy.model.residual_model import Condition, Family
from tactile_dynamics_ros.core.numerics.regime import Gate

Array = NDArray[np.float64]

_SHARE = 0.05
"""Distance of the thresholds that are tried, as a share of the recording: what lies between is
found afterwards sample by sample. Half as far doubles the work, twice as far misses regimes of less
than a fifth of the recording."""
_LEAST = 0.1
"""Least share of the recording in a regime and outside of it: few cells fit anything. Lower finds
shorter regimes and more that are none."""
_CLOCK = "t"
"""Symbol of the condition of which intervals are tried from the start, since what is hung on is
also taken off. Intervals of the others are found from a threshold, sample by sample."""


@dataclass(frozen=True)
class Gates:
    """Gates with the cells that lie inside.

    Attributes:
        gates: G of them.
        inside: (G, W) 1 for cells inside, else 0.
        of_condition: index of the condition of each gate.
        starts: (G,) whether a gate is open from a time on, as for what changes at that time.
    """

    gates: tuple[Gate, ...]
    inside: Array
    of_condition: NDArray[np.int64]
    starts: NDArray[np.bool_]

    def tried(self, family: Family) -> NDArray[np.bool_]:
        """(G,) gates that a family is tried behind: an event begins at a time and does not end."""
        return self.starts if family.event else np.ones(len(self.gates), dtype=bool)

    def count(self, family: Family) -> int:
        """Number of gates that a family is tried behind."""
        return int(np.sum(self.tried(family)))


def gates_to_try(conditions: Sequence[Condition], cells: Sequence[slice]) -> Gates:
    """Thresholds at every twentieth of each condition that has a symbol, and intervals of time.

    Args:
        conditions: with one value for each instant.
        cells: instants of each cell.
    """
    gates: list[Gate] = []
    inside: list[NDArray[np.bool_]] = []
    owner: list[int] = []
    for index, condition in enumerate(conditions):
        if not condition.symbol:
            continue
        means = np.array([condition.values[cell].mean() for cell in cells])
        for gate in _gates_of(condition.symbol, means):
            held = gate.inside(means)
            if _LEAST <= held.mean() <= 1.0 - _LEAST:
                gates.append(gate)
                inside.append(held)
                owner.append(index)
    shape = (len(gates), len(cells))
    starts = np.array([gate.symbol == _CLOCK and math.isinf(gate.high) for gate in gates])
    within = np.reshape(inside, shape).astype(float)
    return Gates(tuple(gates), within, np.array(owner, dtype=int), starts)


def _gates_of(symbol: str, means: Array) -> list[Gate]:
    shares = np.arange(_LEAST, 1.0 - _LEAST + 1e-9, _SHARE)
    edges = np.unique(np.quantile(means, shares)).tolist()
    found = [Gate(symbol, high=edge) for edge in edges] + [Gate(symbol, low=e) for e in edges]
    if symbol == _CLOCK:
        ends = [-math.inf, *np.quantile(means, [_SHARE]).tolist(), *edges]
        found += [Gate(symbol, a, b) for k, a in enumerate(ends[1:]) for b in edges[k + 1 :]]
    return found
