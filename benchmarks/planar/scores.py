"""Normalised errors with intervals over objects."""

from __future__ import annotations

from typing import Any

import numpy as np

from tactile_dynamics_ros.core.array import Array

_RESAMPLES = 2000
"""Of the bootstrap over objects."""


def mean_interval(values: Array) -> dict[str, float]:
    """Mean and the ends of its 95 % interval by a bootstrap over objects."""
    rng = np.random.default_rng(0)
    draws = values[rng.integers(len(values), size=(_RESAMPLES, len(values)))].mean(axis=1)
    low, high = np.quantile(draws, [0.025, 0.975])
    return {"mean": float(np.mean(values)), "low": float(low), "high": float(high)}


def nrmse(errors: Array, size: float) -> dict[str, float]:
    """Root mean square over objects over the range of the set, with its 95 % interval."""
    square = mean_interval(np.square(errors / size))
    return {name: float(np.sqrt(value)) for name, value in square.items()}


def scored(
    estimates: list[dict[str, float]], truths: list[dict[str, float]], ranges: dict[str, float]
) -> dict[str, Any]:
    """NRMSE of every quantity that an estimate has, and of all of a link together."""
    found: dict[str, Any] = {}
    for name in truths[0]:
        if name in estimates[0]:
            off = np.array([e[name] - t[name] for e, t in zip(estimates, truths, strict=True)])
            found[name] = nrmse(off, ranges[name])
    for link in sorted({name[-1] for name in truths[0]}):
        own = [f"{part}{link}" for part in ("m", "f", "com")]
        if all(name in found for name in own):
            found[f"overall{link}"] = float(np.mean([found[name]["mean"] for name in own]))
    return found
