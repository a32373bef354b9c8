"""The regime of an effect that a model has, for people and programs."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.discrepancy.model.residual_model import Condition, ResidualModel
from tactile_dynamics_ros.core.discrepancy.regimes.border import find_border_of
from tactile_dynamics_ros.core.discrepancy.screening import screen
from tactile_dynamics_ros.core.discrepancy.verdict.wording import write_interval
from tactile_dynamics_ros.core.numerics.regime import Gate, split_label


@dataclass(frozen=True)
class RegimeFinding:
    """Where an effect acts.

    Attributes:
        condition: whose values bound the regime.
        gate: the bounds.
        std: of the bounds, in the unit of the condition; NaN where the data do not tell.
        share: of the time.
        event: name of the effect, where it is something that changes at one time; else empty.
    """

    condition: Condition
    gate: Gate
    std: float
    share: float
    event: str = ""

    def event_json(self) -> dict[str, Any] | None:
        """Part `event` of the documents; None where nothing changes at one time."""
        if not self.event:
            return None
        std = self.std if math.isfinite(self.std) else None
        return {"name": self.event, "t": self.gate.low, "std": std}

    def to_json(self) -> dict[str, Any]:
        """Part `regime` of the documents; an open end is None."""
        ends = [end if math.isfinite(end) else None for end in (self.gate.low, self.gate.high)]
        return {
            "condition": self.gate.symbol,
            "name": self.condition.name,
            "unit": self.condition.unit,
            "from": ends[0],
            "to": ends[1],
            "std": self.std if math.isfinite(self.std) else None,
            "share_of_time": self.share,
        }

    def spans(self, time: Array) -> list[tuple[float, float]]:
        """Starts and ends, s, of the stretches in which the regime holds.

        Args:
            time: (N,) s of the values of the condition.
        """
        inside = np.concatenate([[False], self.gate.inside(self.condition.values), [False]])
        edges = np.flatnonzero(inside[1:] != inside[:-1])
        return [
            (float(time[a]), float(time[min(b, len(time) - 1)]))
            for a, b in zip(edges[::2], edges[1::2], strict=True)
        ]

    @property
    def words(self) -> str:
        """``below z = 0.420 ± 0.010 m``."""
        symbol, unit = self.gate.symbol, f" {self.condition.unit}".rstrip()
        low, high = (self._written(end) for end in (self.gate.low, self.gate.high))
        if self.event:
            return f"at {symbol} = {low}{unit}"
        if math.isinf(self.gate.low):
            return f"below {symbol} = {high}{unit}"
        if math.isinf(self.gate.high):
            return f"above {symbol} = {low}{unit}"
        return f"from {symbol} = {low} to {high}{unit}"

    @property
    def elsewhere(self) -> str:
        """Where the effect does not act, in words."""
        if math.isinf(self.gate.low):
            return "above it"
        return "below it" if math.isinf(self.gate.high) else "outside"

    def _written(self, end: float) -> str:
        return write_interval(end, self.std) if math.isfinite(self.std) else f"{end:.4g}"


def regime_of(model: ResidualModel, name: str) -> RegimeFinding | None:
    """Where an effect of a fitted model acts; None if that is everywhere.

    Args:
        model: with the effect.
        name: of the effect.
    """
    plain, regime = split_label(name)
    if regime is None:
        return None
    [gate] = regime.gates
    condition = next(c for c in model.conditions() if c.symbol == gate.symbol)
    inside = gate.inside(condition.values)
    bare = model.without_effect(name)
    floor = float(np.sqrt(np.mean(model.residual**2)))
    best = min(screen(bare, bare.families([name]), floor), key=lambda score: score.criterion)
    label = best.family.label.replace(f"[{regime}]", "")
    border = find_border_of(bare, plain, label, condition, gate, floor)
    std = border.std if border is not None else math.nan
    event = plain if best.family.event else ""
    return RegimeFinding(condition, gate, std, float(inside.mean()), event)
