"""How large the error of a model is, whether the model is adequate, and where it fails."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.discrepancy.diagnosis import Diagnosis, diagnose
from tactile_dynamics_ros.core.discrepancy.model.residual_model import (
    Condition,
    ResidualModel,
    Residuals,
)
from tactile_dynamics_ros.core.discrepancy.regimes.step import ErrorRegime, find_error_regime
from tactile_dynamics_ros.core.discrepancy.structure import window_index
from tactile_dynamics_ros.core.discrepancy.verdict.adequacy import Assessment
from tactile_dynamics_ros.core.discrepancy.verdict.judgement import Judgement, judge
from tactile_dynamics_ros.core.discrepancy.verdict.materiality import Trace

_THIRD = 1.0 / 3.0
"""Share of the samples in which a condition is called low or high: thirds leave a middle between
the two. Less compares groups of few samples, more mixes what is low with what is high."""
_NOTABLE_SHARE = 0.45
"""Share of the excess error that must come with a third of the samples to be reported: by chance a
third does. Lower tells more conditions (0.225: in 3 of 16 examples), higher fewer (0.9: in 7)."""
_MOST_PLACES = 8
"""Places that are reported at most: what fits a screen and the figure of the report. 4 and 16
changed nothing in 16 examples, which have two channels."""
_WINDOW = 1.0
"""Length of the stretches that are reported to fail, s: the RMS of a hundred samples of a wrench
scatters by 3 % in noise. With 0.5 s they are more and shorter (5 of 16 examples), with 2 s fewer
(6)."""
_FAILING = 1.5
"""RMS of a stretch over the median of all from which it is reported: noise of 100 samples never
reaches it. Lower tells parts of what fails everywhere (0.75 does in 13 of 16 examples)."""
_SIGNIFICANT = 5.0
"""Excess of the squares of a channel, in standard deviations of those of noise, from which it is
told to fail: one in three million by chance. Lower looks for places in channels of noise, higher
passes over a channel that fails a little."""


@dataclass(frozen=True)
class Place:
    """Where a model fails.

    Attributes:
        channel: of the residual.
        condition: in words that follow "its error occurs".
        share_of_error: of the channel's excess error that occurs then.
    """

    channel: str
    condition: str
    share_of_error: float


@dataclass(frozen=True)
class Comparison:
    """A model held against its data.

    Attributes:
        assessment: tests of the residual.
        adequate: whether nothing is seen to be missing that matters; as `diagnose` says it.
        residuals: of the model.
        channel_rms: white RMS by channel.
        places: where it fails, worst first; empty if it is adequate, or if the error of no channel
            depends on what was going on.
        intervals: stretches (start, end) in s in which the error is far above its median.
        trace: what is significant and does not matter, or None.
        regime: in which the error is larger than elsewhere, whatever causes it; or None.
    """

    assessment: Assessment
    adequate: bool
    residuals: Residuals
    channel_rms: dict[str, float]
    places: tuple[Place, ...]
    intervals: tuple[tuple[float, float], ...]
    trace: Trace | None = None
    regime: ErrorRegime | None = None

    def _regimes(self) -> list[dict[str, Any]]:
        """Entry of `fails_where` for the regime of the error."""
        if self.regime is None:
            return []
        gate, unit = self.regime.gate, f" {self.regime.unit}".rstrip()
        words = f"where {gate}{unit} ({100.0 * self.regime.share_of_time:.0f} % of the time)"
        return [
            {
                "channel": "all channels",
                "condition": words,
                "share_of_error": self.regime.share_of_error,
                "regime": str(gate),
                "p_value": self.regime.p_value,
            }
        ]

    @property
    def compared(self) -> tuple[str, ...]:
        """Names of the conditions on which the error may depend."""
        return tuple(dict.fromkeys(c.cosine_of or c.name for c in self.residuals.conditions))

    def to_json(self) -> dict[str, Any]:
        """Fields of the document of `compare` that do not depend on the kind of model."""
        return {
            "channels": self.channel_rms,
            "adequate": self.adequate,
            "white": self.assessment.white,
            "p_value": self.assessment.p_value,
            "noise_floor": self.assessment.structure.floor,
            "fails_where": [*self._regimes(), *(vars(place) for place in self.places)],
            "intervals": [list(interval) for interval in self.intervals],
            "trace": self.trace.to_json() if self.trace else None,
        }


def compare(
    model: ResidualModel,
    judgement: Judgement | None = None,
    diagnosis: Diagnosis | None = None,
) -> Comparison:
    """Hold a fitted model against its data.

    Where tests of the residual do not decide whether it is adequate, a diagnosis does.

    Args:
        model: fitted.
        judgement: of it, if there is one already.
        diagnosis: of it, if there is one already.

    Raises:
        NotIdentifiableError: nothing is seen to be missing, in too short a recording.
    """
    if diagnosis is not None:
        judgement = Judgement(diagnosis.assessment)
    judgement = judgement or judge(model)
    if diagnosis is None and judgement.adequate is None:
        diagnosis = diagnose(model, judgement=judgement)
    adequate, trace = bool(judgement.adequate), judgement.trace
    if diagnosis is not None:
        adequate, trace = diagnosis.verdict == "adequate", diagnosis.trace
    if adequate:
        judgement.require_length()
    assessment = judgement.assessment
    residuals = model.residuals()
    rms = np.sqrt(np.mean(residuals.white**2, axis=0))
    intervals = () if adequate else failing_intervals(residuals)
    return Comparison(
        assessment=assessment,
        adequate=adequate,
        residuals=residuals,
        channel_rms=dict(zip(residuals.channels, map(float, rms), strict=True)),
        places=() if adequate else _places(residuals, assessment.structure.floor),
        intervals=intervals,
        trace=trace,
        regime=None if adequate else find_error_regime(model, assessment.structure.floor),
    )


def _places(residuals: Residuals, floor: float) -> tuple[Place, ...]:
    """The conditions under which most of the error of a failing channel occurs, if any are."""
    excess = residuals.white**2 - floor**2
    found = []
    for index, channel in enumerate(residuals.channels):
        total = float(excess[:, index].sum())
        if total < _SIGNIFICANT * np.sqrt(2.0 * len(excess)):
            continue
        found += _places_of_channel(channel, excess[:, index] / total, residuals)
    found.sort(key=lambda place: place.share_of_error, reverse=True)
    return tuple(found[:_MOST_PLACES])


def _places_of_channel(channel: str, share: Array, residuals: Residuals) -> list[Place]:
    options = [
        Place(channel, words, float(np.clip(share[inside].sum(), 0.0, 1.0)))
        for condition in residuals.conditions
        for words, inside in _subsets(condition)
    ]
    notable = sorted((p for p in options if p.share_of_error > _NOTABLE_SHARE), key=_by_share)
    return notable[-2:]


def _by_share(place: Place) -> float:
    return place.share_of_error


def _subsets(condition: Condition) -> list[tuple[str, NDArray[np.bool_]]]:
    """Highest and lowest third of a condition, or where it is below its most."""
    values, unit = condition.values, f" {condition.unit}".rstrip()
    low, high = np.quantile(values, [_THIRD, 1.0 - _THIRD])
    if condition.below_most:
        return [(condition.below_most, values < values.max())] if np.ptp(values) > 0 else []
    if not low < high:
        return []
    if condition.name == "time":
        middle = (values >= low) & (values <= high)
        return [
            (f"before {low:.1f} s", values < low),
            (f"from {low:.1f} s to {high:.1f} s", middle),
            (f"after {high:.1f} s", values > high),
        ]
    below, above = f"below {low:.3g}{unit}", f"above {high:.3g}{unit}"
    if condition.cosine_of:
        far, near = np.degrees(np.arccos(np.clip([low, high], -1.0, 1.0)))
        below, above = f"more than {far:.0f} deg", f"less than {near:.0f} deg"
    name = condition.cosine_of or condition.name
    return [
        (f"while {name} is {below}", values < low),
        (f"while {name} is {above}", values > high),
    ]


def failing_intervals(residuals: Residuals) -> tuple[tuple[float, float], ...]:
    """Stretches of seconds whose RMS exceeds 1.5 times the median, neighbours joined."""
    index = window_index(residuals.time, _WINDOW)
    square = np.bincount(index, (residuals.white**2).mean(axis=1))
    count = np.maximum(np.bincount(index), 1)
    rms = np.sqrt(square / count)
    failing = np.flatnonzero(rms > _FAILING * np.median(rms[np.bincount(index) > 0]))
    runs = np.split(failing, np.flatnonzero(np.diff(failing) > 1) + 1)
    start = float(residuals.time[0])
    return tuple(
        (start + float(run[0]) * _WINDOW, start + float(run[-1] + 1) * _WINDOW)
        for run in runs
        if len(run)
    )
