"""What may act on a part of the table or for a while: hypotheses beside friction that differs."""

from __future__ import annotations

import numpy as np

from tactile_dynamics_ros.core.numerics.regime import Gate, Regime, split_label
from tactile_dynamics_ros.core.planar.effects.effect import PushEffect
from tactile_dynamics_ros.core.planar.effects.gated import AXES, gate_push_effect
from tactile_dynamics_ros.core.planar.effects.registry import PUSHED
from tactile_dynamics_ros.core.planar.effects.situation import PlanarMotion

STEP = "friction_change"
"""The effect that, on a part of the table, a field over it imitates like a slope."""
_SHARES = np.linspace(0.1, 0.9, 9)
"""Shares of the sliding below the borders that are compared: a film on one half was 17 in log
evidence ahead of all that acts everywhere with its border off by a twentieth. Twice as many cost a
second of a core."""
_TIMES = 7
"""Stretches of a recording at whose ends something may begin or end: a push or two each. More cost
as their square."""
_BEYOND, _AROUND = (STEP, "constant_pull"), ("viscous_support",)
"""Effects that are tried beyond a border, of which the other side is the same with other numbers,
and on both sides of it. A spring that goes taut is near enough to a pull."""
_MEANWHILE = "constant_pull"
"""What is hung on and taken off again; what changes the friction at one time is tried anyway."""


def regional_hypotheses(motion: PlanarMotion) -> list[PushEffect]:
    """Effects behind a few borders of each axis of the table, and in a few stretches of time.

    Args:
        motion: of all intervals that count.
    """
    found = []
    for symbol, axis in AXES.items():
        for border in np.unique(np.quantile(motion.place[:, axis], _SHARES).round(3)).tolist():
            above, below = Gate(symbol, low=border), Gate(symbol, high=border)
            found += [_gated(name, above) for name in (*_BEYOND, *_AROUND)]
            found += [_gated(name, below) for name in _AROUND]
    time = motion.time - motion.time[0]
    inner = np.quantile(time, np.linspace(0.0, 1.0, _TIMES + 1)[1:-1]).round(2).tolist()
    ends = [-np.inf, *inner, np.inf]
    pairs = [(a, b) for k, a in enumerate(ends) for b in ends[k + 1 :]]
    found += [_gated(_MEANWHILE, Gate("t", *pair)) for pair in pairs if np.isfinite(pair).any()]
    return found


def _gated(name: str, gate: Gate) -> PushEffect:
    return gate_push_effect(PUSHED.create(name), Regime((gate,)))


def plain_name(name: str) -> str:
    """Name of an effect without its regime."""
    return split_label(name)[0]


def acts_for_a_while(name: str) -> bool:
    """Whether an effect of that name acts in a stretch of time only."""
    regime = split_label(name)[1]
    return regime is not None and any(gate.symbol == "t" for gate in regime.gates)


def is_regional(name: str) -> bool:
    """Whether an effect of that name acts in a regime only."""
    return split_label(name)[1] is not None
