"""Signature of a residual that no known effect explains: channels, frame, lines, laws, bursts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.discrepancy.change import Change, clear_change
from tactile_dynamics_ros.core.discrepancy.model.residual_model import (
    Family,
    ResidualModel,
    Residuals,
)
from tactile_dynamics_ros.core.discrepancy.screening import Score, best_by_effect, screen
from tactile_dynamics_ros.core.discrepancy.structure import Structure, find_line, in_frame
from tactile_dynamics_ros.core.discrepancy.trials import square
from tactile_dynamics_ros.core.discrepancy.verdict.adequacy import Assessment
from tactile_dynamics_ros.core.discrepancy.verdict.wording import write_interval

_CHANNEL_SHARE = 0.15
"""Excess error of a channel, over that of the worst, from which the error is said to act on it.
0.075 and 0.3 changed nothing in 16 examples (7 synthetic probes, 9 slides), which have two
channels."""
_CORRELATED = 0.1
"""Share of the excess error from which a quantity is said to go with it, and a further term to be
worth writing. 0.05 and 0.2 changed nothing in the 16."""
_FORMULA_SHARE = 0.5
"""Share of the excess error that a formula must explain to be written: more than it leaves. 0.25
changed nothing in the 16."""
_FORMULA_TERMS = 3
"""Terms of a formula at most: what people can read meaning into; more would fit anything. 2 and 6
changed nothing in the 16."""
_FORMULA_COLUMNS = 3
"""Columns of a term at most, those of a vector. 2 and 6 changed nothing in the 16."""
_BURST_SHARE = 0.6
"""Share of the excess error that bursts must hold to be reported: most of it. At 0.3 nothing
changed in the 16; more than 1 tells none (one of them has bursts)."""
_BURST_TIME = 0.2
"""Share of the time in which bursts are bursts: what lasts longer is identified by its condition.
At 0.4 nothing changed in the 16, at 0.1 those of the one example were not told."""


@dataclass(frozen=True)
class Signature:
    """Properties of an unexplained residual.

    Attributes:
        channels: those that carry the excess error.
        frame: in which it is simplest, or None.
        frequency_hz: of a line in its spectrum, or None.
        correlates_with: the named quantity that explains most, or None.
        share: of the excess error that this quantity explains.
        formula: a sparse law in named quantities that explains at least half of it, or None.
        intervals: times (start, end) in s of bursts, if the error comes in bursts.
        change: the time at which it begins or ends, if there is one.
    """

    channels: tuple[str, ...]
    frame: str | None
    frequency_hz: float | None
    correlates_with: str | None
    share: float
    formula: str | None
    intervals: tuple[tuple[float, float], ...]
    change: Change | None = None

    def to_json(self) -> dict[str, Any]:
        """The part `unexplained` of the document of `diagnose`."""
        return {
            "channels": list(self.channels),
            "frequency_hz": self.frequency_hz,
            "correlates_with": self.correlates_with,
            "formula": self.formula,
            "frame": self.frame,
            "share_of_excess": self.share,
            "intervals": [list(interval) for interval in self.intervals],
            "change": self.change.to_json() if self.change else None,
        }


def describe_residual(assessment: Assessment) -> Signature:
    """Describe what a model leaves over by spectrum, frame, bursts and sparse regression."""
    model, floor = assessment.model, assessment.structure.floor
    residuals = model.residuals()
    line = find_line(residuals, floor)
    frequency = line.hz if line else None
    scores = screen(model, model.library(), floor)
    excess = max(square(model) - floor**2 * len(model.residual), 1e-12)
    best = best_by_effect(scores)
    share = min(1.0, best[0].gain / excess) if best else 0.0
    named = best[0] if best and share > _CORRELATED else None
    frame = line.frame if line else named.family.frame if named else ""
    formula = _find_formula(model, scores, floor, excess)
    return Signature(
        channels=failing_channels(residuals, frame, floor),
        frame=frame or None,
        frequency_hz=frequency,
        correlates_with=named.family.name if named else None,
        share=share if named else 0.0,
        formula=formula.write() if formula else None,
        intervals=_bursts(residuals, assessment.structure),
        change=clear_change(model, assessment.scores, floor),
    )


def failing_channels(residuals: Residuals, frame: str | None, floor: float) -> tuple[str, ...]:
    """Channels (in the axes of the frame) with a good part of the excess error.

    A channel contributes e_k (C^-1 e)_k to the square of the residual e with covariance C. White
    channels alone do not say where an error acts: they are those of a triangular factor of C, in
    which each holds what earlier ones do not tell of it.
    """
    plain, weighted = residuals.factors or (residuals.white, residuals.white)
    square = np.mean(
        in_frame(residuals, plain, frame) * in_frame(residuals, weighted, frame), axis=0
    )
    excess = np.maximum(square - floor**2, 0.0)
    if not np.any(excess > 0):
        excess = np.maximum(square, 0.0)
    picked = np.flatnonzero(excess > _CHANNEL_SHARE * excess.max())
    order = picked[np.argsort(-excess[picked])]
    return tuple(residuals.channels[k] for k in order)


def _bursts(residuals: Residuals, structure: Structure) -> tuple[tuple[float, float], ...]:
    """Times of the bursts if most of the excess error comes in a small part of the time."""
    bursts = structure.bursts
    if not len(bursts):
        return ()
    inside = np.any(
        (residuals.time[:, None] >= bursts[:, 0]) & (residuals.time[:, None] < bursts[:, 1]), axis=1
    )
    excess = residuals.white**2 - structure.floor**2
    share = float(excess[inside].sum() / max(float(excess.sum()), 1e-12))
    if share < _BURST_SHARE or inside.mean() > _BURST_TIME:
        return ()
    return _joined(bursts)


def _joined(bursts: Array) -> tuple[tuple[float, float], ...]:
    breaks = np.flatnonzero(bursts[1:, 0] > bursts[:-1, 1] + 1e-6) + 1
    return tuple((float(run[0, 0]), float(run[-1, 1])) for run in np.split(bursts, breaks))


@dataclass(frozen=True)
class Formula:
    """A sparse law in named quantities.

    Attributes:
        families: its terms, most important first.
        score: of all of them together.
    """

    families: tuple[Family, ...]
    score: Score

    def write(self) -> str:
        """Coefficients with their standard deviations, and symbols."""
        symbols = [symbol for family in self.families for symbol in family.symbols]
        numbers = zip(self.score.coefficients, self.score.stds, symbols, strict=True)
        terms = [f"({write_interval(c, std)}) {symbol}" for c, std, symbol in numbers]
        return " + ".join(terms)


def find_formula(model: ResidualModel, floor: float) -> Formula | None:
    """A sparse law that explains at least half of the excess error of a model, or None."""
    excess = max(square(model) - floor**2 * len(model.residual), 1e-12)
    return _find_formula(model, screen(model, model.library(), floor), floor, excess)


def _find_formula(
    model: ResidualModel, scores: Sequence[Score], floor: float, excess: float
) -> Formula | None:
    """Forward selection of short terms until half of the excess error is explained."""
    short = [s for s in scores if s.family.symbols and len(s.family.kept) <= _FORMULA_COLUMNS]
    chosen: list[Family] = []
    found: Score | None = None
    explained = 0.0
    for _ in range(_FORMULA_TERMS):
        others = [s.family for s in short if all(s.family is not f for f in chosen)]
        options = [_joint(model, [*chosen, family], floor) for family in others]
        if not options:
            break
        score, families = max(options, key=lambda option: option[0].gain)
        if score.gain - explained < _CORRELATED * excess:
            break
        chosen, explained, found = families, score.gain, score
    if found is None or explained < _FORMULA_SHARE * excess:
        return None
    return Formula(tuple(chosen), found)


def _joint(
    model: ResidualModel, families: list[Family], floor: float
) -> tuple[Score, list[Family]]:
    columns = np.concatenate([f.columns[:, list(f.kept)] for f in families], axis=1)
    joint = Family("formula", "formula", "formula", columns, tuple(range(columns.shape[1])))
    return screen(model, [joint], floor)[0], families
