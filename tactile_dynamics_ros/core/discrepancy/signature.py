"""Signature of a residual that no known effect explains: channels, frame, lines, laws, bursts.

A change is something that begins or ends at one time: known effects act before or after it only.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.discrepancy.model.residual_model import (
    Family,
    ResidualModel,
    Residuals,
)
from tactile_dynamics_ros.core.discrepancy.screening import (
    FEIGNED,
    Score,
    best_by_effect,
    orthonormal,
    screen,
)
from tactile_dynamics_ros.core.discrepancy.structure import (
    Index,
    Structure,
    find_line,
    in_frame,
    window_rows,
    window_starts,
)
from tactile_dynamics_ros.core.discrepancy.trials import square
from tactile_dynamics_ros.core.discrepancy.verdict.adequacy import Assessment
from tactile_dynamics_ros.core.discrepancy.verdict.wording import write_interval

_WINDOW = 0.5
"""Distance of the times that are tried, s, and what is left out to either side of each. Of 16
examples one has a change: half as long finds the same, with 1 s it is missed."""
_MARGIN = 0.1
"""Share of the recording at either end where no change is sought: few windows there fit anything.
Also the least length of a recording: forty windows, 20 s. With 0.05 and 0.2 the change of the
example was not reported."""
_MOST_COLUMNS = 6
"""Columns of families that are tried: a bias of two sensors, a force at a point. More would fit
half of a recording whatever happens there. 3 and 12 changed nothing in 16 examples."""
_MOST = 0.5
"""Share of the excess error that a change must explain to be reported: more than all else together.
At 0.25 nothing changed in 16 examples, at 1 nothing is ever reported."""
_CLEARLY = 20.0
"""Difference of -2 log evidence to the best effect that always acts: odds of e^10. The search over
times, sides and readings is paid for besides. 10 and 40 changed nothing in 16 examples."""


@dataclass(frozen=True)
class Change:
    """An effect that acts before or after one time only.

    Attributes:
        label: the effect that it looks like, with its reading.
        time: s, known to about half a second.
        ends: whether it acts before that time rather than after it.
        share: of the excess error that it explains.
        criterion: -2 log evidence beyond that of the rival that it was held against.
    """

    label: str
    time: float
    ends: bool
    share: float
    criterion: float

    def to_json(self) -> dict[str, Any]:
        """Part of `unexplained` in the document of `diagnose`."""
        return {"effect": self.label, "time": self.time, "ends": self.ends}


def find_change(
    bare: ResidualModel, rival: Array, price: float, floor: float = 1.0
) -> Change | None:
    """The change at one time with the best evidence.

    A family U that acts from one time on is [Q, 1(t > t_c) U], with Q what the model can explain.
    Windows of 0.5 s beside the time count for nobody, so that it need not be known better.

    Args:
        bare: fitted, without the effects of the rival.
        rival: (M,) residual at the same whitening that the change is held against.
        price: of the parameters of the rival, in units of -2 log evidence.
        floor: white RMS of the noise alone.
    """
    families = [f for f in bare.families() if len(f.kept) <= _MOST_COLUMNS]
    starts = window_starts(bare.time, _WINDOW)
    if len(starts) < 4.0 / _MARGIN or not families:
        return None
    sums = _Sums.of(bare, rival, starts)
    found = [change for family in families for change in sums.changes(family, floor, price)]
    return min(found, key=lambda change: change.criterion)


@dataclass
class _Sums:
    """Sums over windows, and over all but the two beside each time between windows.

    Attributes:
        basis: (M, p) Q, orthonormal. residual: (M,) r. windows: rows of each.
        time: (K,) between windows. inverse: (K, p, p) of Q^T Q. shares: (K, p) Q^T r.
        left: (K,) square of r beside Q. rival: (K,) square of the rival's residual.
        known: projections of columns by their array.
    """

    basis: Array
    residual: Array
    windows: list[slice]
    time: Array
    inverse: Array
    shares: Array
    left: Array
    rival: Array
    known: dict[int, tuple[Array, Array, Array]]

    @classmethod
    def of(cls, bare: ResidualModel, rival: Array, starts: Index) -> _Sums:
        basis, residual = orthonormal(bare.jacobian), bare.residual
        windows = window_rows(starts, len(residual))
        grams = _beside(np.stack([basis[rows].T @ basis[rows] for rows in windows]))
        shares = _beside(np.add.reduceat(basis * residual[:, None], starts, axis=0))
        square = _beside(np.add.reduceat(residual**2, starts))
        inverse = np.asarray(np.linalg.inv(grams), dtype=np.float64)
        explained = np.einsum("ki,kij,kj->k", shares, inverse, shares)
        others = _beside(np.add.reduceat(rival**2, starts))
        time, left = bare.time[starts][1:], square - explained
        return cls(basis, residual, windows, time, inverse, shares, left, others, {})

    def changes(self, family: Family, floor: float, price: float) -> list[Change]:
        """The best time at which a family begins, and at which it ends."""
        if id(family.columns) not in self.known:
            self.known[id(family.columns)] = self._project(family.columns)
        grams, crosses, shares = self.known[id(family.columns)]
        kept = list(family.kept)
        grams, crosses, shares = grams[:, kept][..., kept], crosses[:, kept], shares[:, kept]
        rows = len(self.residual)
        found = []
        for ends in (False, True):
            gain, freedom = self._gain(*(_side(part, ends) for part in (grams, crosses, shares)))
            left = self.left - gain
            searched = 2.0 * np.log(2.0 * len(self.time) * family.choices)
            beyond = (left - self.rival) / floor**2 + freedom * np.log(rows) + searched - price
            margin = int(_MARGIN * len(beyond))
            best = margin + int(np.argmin(beyond[margin : len(beyond) - margin]))
            noise = floor**2 * rows * (1.0 - 2.0 / len(self.windows))
            share = float(gain[best] / max(self.left[best] - noise, 1e-12))
            when, criterion = float(self.time[best]), float(beyond[best])
            found.append(Change(family.label, when, ends, min(share, 1.0), criterion))
        return found

    def _project(self, columns: Array) -> tuple[Array, Array, Array]:
        """U^T U (W, m, m), U^T Q (W, m, p) and U^T r (W, m), columns of unit length."""
        length = np.linalg.norm(columns, axis=0)
        unit = columns / np.where(length > 0.0, length, 1.0)
        parts = [(unit[w], self.basis[w], self.residual[w]) for w in self.windows]
        grams = np.stack([u.T @ u for u, _, _ in parts])
        crosses = np.stack([u.T @ q for u, q, _ in parts])
        return grams, crosses, np.stack([u.T @ r for u, _, r in parts])

    def _gain(self, grams: Array, crosses: Array, shares: Array) -> tuple[Array, Array]:
        """Fall of the squared residual at each time, and rank of the columns beside the model."""
        weighted = crosses @ self.inverse
        values, vectors = np.linalg.eigh(grams - weighted @ np.swapaxes(crosses, 1, 2))
        beside = shares - (weighted @ self.shares[..., None])[..., 0]
        sound = values > FEIGNED * np.trace(grams, axis1=1, axis2=2)[:, None]
        along = (np.swapaxes(vectors, 1, 2) @ beside[..., None])[..., 0]
        gain = np.where(sound, along**2 / np.where(sound, values, 1.0), 0.0)
        return gain.sum(axis=1), sound.sum(axis=1)


def _beside(windows: Array) -> Array:
    """Sums over all windows but the two beside each time between them."""
    return np.asarray(windows.sum(axis=0) - windows[:-1] - windows[1:])


def _side(windows: Array, ends: bool) -> Array:
    """Sums over the windows after each time, or before it, but the two beside it."""
    if ends:
        before = np.cumsum(windows, axis=0)
        return np.concatenate([np.zeros_like(before[:1]), before[:-2]])
    after = np.cumsum(windows[::-1], axis=0)[::-1]
    return np.concatenate([after[2:], np.zeros_like(after[:1])])


def clear_change(model: ResidualModel, scores: Sequence[Score], floor: float) -> Change | None:
    """A change that explains at least half of the excess error, and more than any effect could.

    Args:
        model: fitted.
        scores: of every effect.
        floor: white RMS of the noise alone.
    """
    if not scores:
        return None
    best = min(scores, key=lambda score: score.criterion)
    columns = best.family.columns[:, list(best.family.kept)]
    basis = orthonormal(np.concatenate([model.jacobian, columns], axis=1))
    rival = model.residual - basis @ (basis.T @ model.residual)
    price = best.freedom * np.log(len(rival)) + 2.0 * np.log(best.family.choices)
    change = find_change(model, rival, float(price), floor)
    if change is None or change.criterion > -_CLEARLY or change.share < _MOST:
        return None
    return change


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
