"""Borders of a regime at which the model itself fits best."""

from __future__ import annotations

import math
from dataclasses import replace

from scipy.optimize import minimize_scalar

from tactile_dynamics_ros.core.discrepancy.model.residual_model import ResidualModel
from tactile_dynamics_ros.core.discrepancy.regimes.border import Border, round_to
from tactile_dynamics_ros.core.discrepancy.screening import screen
from tactile_dynamics_ros.core.numerics.regime import Gate

_REACH = 2.0
"""Standard deviations about a border within which it is looked for: white residuals that remember
move it by about one. Farther costs steps, nearer cuts the best."""
_STEPS = 7
"""Fits for each border: golden sections then leave a seventh of a standard deviation. More are
finer than a border is known."""


def refine_border(model: ResidualModel, name: str, label: str, border: Border) -> Border:
    """Move the ends of a gate to where the effect behind it explains most.

    White residuals near a border depend on what acted before: only columns that are made white
    behind the gate are exact there.

    Args:
        model: fitted, without the effect.
        name: of the effect, without regime.
        label: of the reading that acts, without regime.
        border: found sample by sample.
    """
    gate = border.gate
    for upper in (False, True):
        at = gate.high if upper else gate.low
        if math.isinf(at):
            continue

        def loss(value: float, upper: bool = upper, gate: Gate = gate) -> float:
            return -_gain(model, name, label, _moved(gate, value, upper))

        reach = _REACH * border.std
        found = minimize_scalar(
            loss,
            bounds=(at - reach, at + reach),
            method="bounded",
            options={"maxiter": _STEPS, "xatol": 1e-3 * reach},
        )
        if found.fun < loss(at):
            gate = _moved(gate, round_to(float(found.x), border.std), upper)
    return replace(border, gate=gate)


def _moved(gate: Gate, value: float, upper: bool) -> Gate:
    return replace(gate, high=value) if upper else replace(gate, low=value)


def _gain(model: ResidualModel, name: str, label: str, gate: Gate) -> float:
    """Fall of the squared residual with a reading of an effect behind a gate."""
    wanted = label.replace(name, f"{name}[{gate}]", 1)
    families = [f for f in model.families([f"{name}[{gate}]"]) if f.label == wanted]
    return max((score.gain for score in screen(model, families)), default=0.0)
