"""Any effect of table or surroundings on a pushed object, acting only in a regime."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.stats import norm

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.numerics.regime import Gate, Regime, gated
from tactile_dynamics_ros.core.planar.effects.effect import PushEffect, WrappedEffect
from tactile_dynamics_ros.core.planar.effects.situation import PlanarMotion

AXES = {"x": 0, "y": 1}
"""Axes of the table by the symbols of places. Others would be symbols that no condition has."""
_EDGE = {"x": 1e-3, "y": 1e-3, "v": 5e-3}
"""Distance, m, and speed, m/s, over which an effect sets in that acts at one point: what a border
is known to at best. Without an edge derivatives by the motion do not exist at the border."""
_COPIED = ("family", "formula", "looks_like", "sentence", "remedy", "lasting", "of_parts")
"""What an effect in a regime says of itself as the effect does that acts everywhere. What is left
out has the value of `PushEffect`."""


class GatedPushEffect(WrappedEffect):
    """Another effect where its regime holds, nothing elsewhere; see `gate_push_effect`.

    What the table does acts under the part of the footprint that lies in the regime: for points
    whose standard deviation along an axis is s, a share Phi((x - a) / s) lies above x = a.

    Attributes:
        inner: the effect.
        regime: where it acts.
    """

    regime: Regime

    def __init__(self, inner: PushEffect, regime: Regime) -> None:
        self.inner, self.regime = inner, regime

    def __reduce__(self) -> tuple[Any, ...]:
        return gate_push_effect, (self.inner, self.regime)

    def friction(self, motion: PlanarMotion, theta: Array) -> Array | None:
        """1 + share (M - 1)."""
        matrix = self.inner.friction(motion, theta)
        if matrix is None:
            return None
        return np.asarray(np.eye(2) + self.share(motion)[:, None, None] * (matrix - np.eye(2)))

    def rise(self, motion: PlanarMotion, theta: Array) -> Array | None:
        """That of the inner effect inside, and that of the border under the footprint."""
        matrix, inner = self.inner.friction(motion, theta), self.inner.rise(motion, theta)
        found = np.zeros_like(motion.place)
        if inner is not None:
            found += self.share(motion)[:, None] * inner
        if matrix is not None:
            more = 0.5 * np.trace(matrix, axis1=1, axis2=2) - 1.0
            factor = 1.0 + self.share(motion) * more
            found += (more / factor)[:, None] * self._share_slope(motion)
        return found if inner is not None or matrix is not None else None

    def wrench(self, motion: PlanarMotion, theta: Array) -> Array | None:
        """That of the inner effect inside."""
        found = self.inner.wrench(motion, theta)
        return None if found is None else np.asarray(self.share(motion)[:, None] * found)

    def share(self, motion: PlanarMotion) -> Array:
        """(R,) share of the effect that acts, 0 to 1."""
        return np.asarray(np.prod([self._open(gate, motion) for gate in self.regime.gates], axis=0))

    def _open(self, gate: Gate, motion: PlanarMotion) -> Array:
        values = _value_of(motion, gate.symbol)
        if gate.symbol == "t":
            return gate.inside(values).astype(float)
        edge = self._edge(gate.symbol, motion)
        return np.asarray(
            norm.cdf((values - gate.low) / edge) - norm.cdf((values - gate.high) / edge)
        )

    def _share_slope(self, motion: PlanarMotion) -> Array:
        """Slope (R, 2) of the share by the place, 1/m."""
        slope = np.zeros_like(motion.place)
        for gate in self.regime.gates:
            if gate.symbol not in AXES:
                continue
            values, edge = _value_of(motion, gate.symbol), self._edge(gate.symbol, motion)
            change = norm.pdf((values - gate.low) / edge) - norm.pdf((values - gate.high) / edge)
            others = [g for g in self.regime.gates if g is not gate]
            beside = np.prod([self._open(g, motion) for g in others], axis=0) if others else 1.0
            slope[:, AXES[gate.symbol]] += change / edge * beside
        return slope

    def _edge(self, symbol: str, motion: PlanarMotion) -> float:
        if symbol in AXES and self.family == "support":
            return float(np.sqrt(0.5 * motion.gyration))
        return _EDGE[symbol]


def _value_of(motion: PlanarMotion, symbol: str) -> Array:
    """(R,) of what bounds a regime: x, y (m), v (m/s) or t (s from the first interval)."""
    if symbol in AXES:
        return motion.place[:, AXES[symbol]]
    return motion.speed if symbol == "v" else np.asarray(motion.time - motion.time[0])


def can_be_gated(effect: PushEffect) -> bool:
    """Whether an effect may act in a regime only: one that adds a force or changes the friction.

    Errors of sensors and numbers of the object are there or not, wherever it is.
    """
    return not effect.adds_to and not effect.of_joint and type(effect).changed is PushEffect.changed


def gate_push_effect(effect: PushEffect, regime: Regime) -> PushEffect:
    """An effect that acts in a regime only, with the name ``name[regime]``.

    Raises:
        BadInputError: it is an error of a sensor or a number of the object, or there is no such
            condition.
    """
    name = f"{effect.name}[{regime}]"
    if not can_be_gated(effect):
        raise BadInputError(
            f"effect '{name}': it acts everywhere or not at all; leave the regime out"
        )
    for gate in regime.gates:
        if gate.symbol not in (*AXES, "v", "t"):
            raise BadInputError(
                f"effect '{name}': '{gate.symbol}' is unknown of pushes; there are x, y, v and t"
            )
    return gated(GatedPushEffect, effect, regime, _COPIED, parameters=effect.parameters)
