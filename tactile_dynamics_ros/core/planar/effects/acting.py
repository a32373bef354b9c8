"""Effects of a model together, at their parameters."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.planar.effects.effect import PushEffect
from tactile_dynamics_ros.core.planar.effects.situation import PlanarMotion, Situation
from tactile_dynamics_ros.core.planar.mechanics.linkage import applied, turned


@dataclass(frozen=True, eq=False)
class Acting:
    """What effects do together.

    Attributes:
        effects: of a model.
        parameters: (k,) of all of them, one effect after the other.
    """

    effects: tuple[PushEffect, ...]
    parameters: Array

    def __iter__(self) -> Iterator[tuple[PushEffect, Array]]:
        sizes = [len(effect.parameters) for effect in self.effects]
        thetas = np.split(self.parameters, np.cumsum(sizes)[:-1]) if sizes else []
        return zip(self.effects, thetas, strict=True)

    def numbers(self, common: Array, names: Sequence[str]) -> Array:
        """Common numbers with what effects add to them.

        Args:
            common: (p,) without the parameters of effects.
            names: of them; those of two parts end in _1 and _2, and both are added to.
        """
        numbers = common
        for effect, theta in self:
            if effect.adds_to:
                places = places_of(effect, names)
                numbers = numbers.copy()
                numbers[places] += theta[0]
        return numbers

    def changed(self, situation: Situation) -> Situation:
        """What acts really, given what was measured or presumed."""
        for effect, theta in self:
            situation = effect.changed(situation, theta)
        return situation

    def resisted(
        self, motion: PlanarMotion, support: Array, spin: Array, share: float = 1.0
    ) -> tuple[Array, Array]:
        """Force of the support (R, 2), N, and torque (R,) about the centroid, N m, as changed.

        Args:
            motion: of the part.
            support: N, of dry friction alone.
            spin: N m, likewise.
            share: of a wrench on the whole object that this part of it feels.
        """
        added = np.zeros((len(spin), 3))
        for effect, theta in self:
            matrix, wrench = effect.friction(motion, theta), effect.wrench(motion, theta)
            if matrix is not None:
                support = applied(matrix, support)
                spin = spin * 0.5 * np.trace(matrix, axis1=1, axis2=2)
            if wrench is not None:
                added = added + wrench
        return support + share * added[:, :2], spin + share * added[:, 2]

    def rise(self, motion: PlanarMotion) -> Array:
        """Relative rise (R, 2) of friction under the footprint, 1/m, axes of the link.

        Load times friction 1 + g . d is, to first order, more by g . c for a centre of pressure c,
        and a pressure whose centre is off by S g, with S the second moments of the footprint.
        """
        found = np.zeros((len(motion.yaw), 2))
        for effect, theta in self:
            rise = effect.rise(motion, theta)
            if rise is not None:
                found += turned(rise, -motion.yaw)
        return found


def places_of(effect: PushEffect, names: Sequence[str]) -> list[int]:
    """Places of the common numbers to which an effect adds its parameter."""
    name = effect.adds_to
    return [k for k, own in enumerate(names) if name and own in (name, f"{name}_1", f"{name}_2")]


def described(
    effects: Sequence[PushEffect], values: Array, std: Array
) -> dict[str, dict[str, dict[str, Any]]]:
    """{effect: {parameter: {"value", "std", "unit"}}} of parameters (k,), effect after effect."""
    table: dict[str, dict[str, dict[str, Any]]] = {}
    told = iter(zip(values.tolist(), std.tolist(), strict=True))
    for effect in effects:
        own = table.setdefault(effect.name, {})
        for parameter in effect.parameters:
            value, spread = next(told)
            own[parameter.name] = {"value": value, "std": spread, "unit": parameter.unit}
        for name, chosen in effect.choices.items():
            own[name] = {"value": chosen, "std": 0.0, "unit": ""}
    return table


def ends(effects: Sequence[PushEffect]) -> NDArray[np.intp]:
    """Where the parameters of each effect begin, from the first one's."""
    counts = [len(effect.parameters) for effect in effects]
    return np.cumsum([0, *counts])[: len(counts)]
