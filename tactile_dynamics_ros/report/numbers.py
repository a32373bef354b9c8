"""Numbers as text, rounded to what their uncertainty supports."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from tactile_dynamics_ros.core.rigid_body.inertial_parameters import InertialParameters

if TYPE_CHECKING:
    from tactile_dynamics_ros.core.inertia.batch.inertial_estimate import InertialEstimate

MILLI, MICRO = 1e3, 1e6
AXES = "xyz"
UPPER = ((0, 0), (0, 1), (1, 1), (0, 2), (1, 2), (2, 2))


def with_uncertainty(value: float, std: float) -> tuple[str, str]:
    """Return a value and its standard deviation with two significant digits of the latter."""
    if not std > 0.0:
        return f"{value:.6g}", "0"
    digits = max(0, 1 - _exponent(std))
    if digits > 6 or abs(value) >= 1e6:
        return f"{value:.4e}", f"{std:.1e}"
    return f"{value:.{digits}f}", f"{std:.{digits}f}"


def _exponent(value: float) -> int:
    """Return the decimal exponent of a positive number after rounding to two digits."""
    return int(f"{value:.1e}".partition("e")[2])


def parameter_rows(
    estimate: InertialEstimate, truth: InertialParameters | None = None
) -> list[tuple[str, ...]]:
    """Return one row per parameter: name, value, std, truth where known, unit.

    A star marks what the motion leaves open.
    """
    rows = _body_rows(estimate, truth)
    if estimate.event is not None and estimate.event.body is not None and truth is None:
        event, body = estimate.event, estimate.event.body
        after = replace(estimate, inertia=body, covariance=event.covariance, event=None)
        rows += [(f"after {row[0]}", *row[1:]) for row in _body_rows(after, None)]
    for name, effect in estimate.effects.items():
        for key, value in effect.value.items():
            cells = with_uncertainty(value, effect.std[key])
            blank = () if truth is None else ("",)
            rows.append((f"{name} {key}", *cells, *blank, effect.unit[key]))
    return rows


def _body_rows(
    estimate: InertialEstimate, truth: InertialParameters | None
) -> list[tuple[str, ...]]:
    """Return the rows of the ten inertial parameters."""
    names = [
        "mass",
        *(f"com_{a}" for a in AXES),
        *(f"inertia_{AXES[i]}{AXES[j]}" for i, j in UPPER),
    ]
    units = ["kg", *["mm"] * 3, *["kg mm²"] * 6]
    scales = np.array([1.0, *[MILLI] * 3, *[MICRO] * 6])
    values, stds = scales * _ten(estimate.inertia), scales * estimate.parameter_std
    true_values = None if truth is None else scales * _ten(truth)
    rows = []
    for k, name in enumerate(names):
        value, std = with_uncertainty(float(values[k]), float(stds[k]))
        star = " *" if name in estimate.not_excited else ""
        known = () if true_values is None else (with_uncertainty(true_values[k], stds[k])[0],)
        rows.append((name + star, value, std, *known, units[k]))
    return rows


def _ten(body: InertialParameters) -> np.ndarray:
    """Return mass, centre of mass and the upper triangle of the inertia about it."""
    return np.array([body.mass, *body.com, *(body.inertia_com[i, j] for i, j in UPPER)])
