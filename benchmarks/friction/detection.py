"""Detectors of slip on the same probes: delay and false alarms against the true sliding speed."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.friction.slip_detection import SlipFusion, SlipObservation

Flags = NDArray[np.bool_]

RAMPS = ("load", "unload", "drag", "slide")
STILL, GROSS = 3e-4, 1e-3
"""Sliding speed below which nothing slips, and above which it surely does, m/s. Between the two an
alarm is neither right nor wrong."""
LATELY = 25
"""Instants back to which an alarm may owe itself to a slip."""
SOON = 0.5
PERIOD = 0.01


@dataclass(frozen=True)
class Attempt:
    """One ramp until slip: what was true and what was sensed, (T,) each.

    Attributes:
        speed: true, m/s. loading: whether the tangential force was still built up.
        vibration: PAC level over rest. electrodes: their change. path: along the pull, m.
        ratio: of the sensed tangential to the normal force.
        expected: median ratio of the slips that the probe found before, or None at the first.
    """

    speed: Array
    loading: Flags
    vibration: Array
    electrodes: Array
    path: Array
    ratio: Array
    expected: float | None = None

    @property
    def onset(self) -> int | None:
        """Index at which the slip began: the last still instant before it was gross."""
        gross = np.flatnonzero(self.speed > GROSS)
        if not len(gross):
            return None
        still = np.flatnonzero(self.speed[: gross[0]] < STILL)
        return int(still[-1]) + 1 if len(still) else None


def split_attempts(row: dict[str, Any]) -> list[Attempt]:
    """Cut the time series of one probe into its ramps."""
    slip = row.get("slip") or {}
    if not slip:
        return []
    phase = np.array(slip["phase"])
    measured = np.array(slip["measured"])
    ratio = np.linalg.norm(measured[:, 1:], axis=1) / np.maximum(measured[:, 0], 0.05)
    inside = np.isin(phase, RAMPS)
    starts = np.flatnonzero(inside & ~np.concatenate([[False], inside[:-1]])) + 1
    ends = np.flatnonzero(inside & ~np.concatenate([inside[1:], [False]])) + 1
    series = {name: np.array(slip[name]) for name in ("speed", "vibration", "electrodes", "path")}
    return [
        Attempt(
            loading=phase[a:b] == "load",
            ratio=ratio[a:b],
            expected=_expected(row["events"], slip["time"][a]),
            **{name: values[a:b] for name, values in series.items()},
        )
        for a, b in zip(starts, ends, strict=True)
        if b - a > 30
    ]


def _expected(events: Iterable[dict[str, Any]], time: float) -> float | None:
    before = [event["tangential"] / event["normal"] for event in events if event["time"] < time]
    return float(np.median(before)) if before else None


def fused(attempt: Attempt, forces: bool = True) -> Flags:
    """What the probe's detector tells, with or without how near the forces are to earlier slips."""
    detector = SlipFusion()
    detector.reset(attempt.expected if forces else None)
    told = []
    for k, loading in enumerate(attempt.loading):
        rest = (None, None) if loading else (attempt.electrodes[k], attempt.path[k])
        seen = SlipObservation(attempt.vibration[k], *rest, attempt.ratio[k])
        told.append(detector.update(PERIOD * k, seen).slipping)
    return np.array(told)


def vibration_only(attempt: Attempt, limit: float = 3.0) -> Flags:
    """PAC alone: above three times the rest level in two frames running."""
    high = attempt.vibration > limit
    return high & np.concatenate([[False], high[:-1]])


def force_only(attempt: Attempt, fall: float = 0.12) -> Flags:
    """Force alone: the ratio of forces fell by 12 % from its highest of the last 0.3 s, twice."""
    highest = np.array(
        [attempt.ratio[max(0, k - 30) : k + 1].max() for k in range(len(attempt.ratio))]
    )
    low = (attempt.ratio < (1.0 - fall) * highest) & (highest > 0.1)
    return low & np.concatenate([[False], low[:-1]])


LIMITS = np.arange(1.5, 6.05, 0.1)
"""Of the vibration, tried from below for as many false alarms as the fused detector has."""

DETECTORS: dict[str, Callable[[Attempt], Flags]] = {
    "fused": fused,
    "fused, without forces": partial(fused, forces=False),
    "vibration_only": vibration_only,
    "force_only": force_only,
}


def score_detectors(rows: Iterable[dict[str, Any]]) -> dict[str, dict[str, float | None]]:
    """Delay (s), share missed within 0.5 s and false alarms per minute of every detector.

    Vibration alone is also scored at the limit at which it gives no more alarms than the fused one.
    """
    attempts = [attempt for row in rows for attempt in split_attempts(row)]
    scores = {name: _score(attempts, detector) for name, detector in DETECTORS.items()}
    allowed = scores["fused"]["false_alarms_per_minute"]
    for limit in LIMITS if allowed is not None else ():
        score = _score(attempts, partial(vibration_only, limit=limit))
        if score["false_alarms_per_minute"] <= allowed:
            scores["vibration_only, as many alarms"] = score | {"limit": float(limit)}
            break
    return scores


def _score(
    attempts: list[Attempt], detector: Callable[[Attempt], Flags]
) -> dict[str, float | None]:
    delays: list[float] = []
    missed = alarms = slips = 0
    quiet = 0.0
    for attempt in attempts:
        told, onset = detector(attempt), attempt.onset
        end = len(told) if onset is None else max(onset - 3, 0)
        rising = np.flatnonzero(told[:end] & ~np.concatenate([[False], told[:end][:-1]]))
        alarms += sum(attempt.speed[max(0, k - LATELY) : k + 1].max() < STILL for k in rising)
        quiet += PERIOD * int((attempt.speed[:end] < STILL).sum())
        if onset is None:
            continue
        slips += 1
        later = np.flatnonzero(told[max(onset - 3, 0) :])
        delay = PERIOD * (int(later[0]) + max(onset - 3, 0) - onset) if len(later) else np.inf
        if delay > SOON:
            missed += 1
        else:
            delays.append(delay)
    return {
        "slips": slips,
        "missed_share": missed / slips if slips else None,
        "median_delay_s": float(np.median(delays)) if delays else None,
        "p90_delay_s": float(np.quantile(delays, 0.9)) if delays else None,
        "false_alarms_per_minute": 60.0 * alarms / quiet if quiet else None,
        "minutes_at_rest": quiet / 60.0,
    }
