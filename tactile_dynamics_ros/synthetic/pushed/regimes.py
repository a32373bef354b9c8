"""What acts only on a part of the table, or for a while."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from tactile_dynamics_ros.synthetic.pushed.effects import Hidden, hide
from tactile_dynamics_ros.synthetic.pushed.friction_field import FrictionField
from tactile_dynamics_ros.synthetic.pushed.scene import BodyState, Film, Influence, Scene
from tactile_dynamics_ros.synthetic.pushed.simulator import Motion, simulate

Maker = Callable[[Scene, float, np.random.Generator], "tuple[Hidden, Bounds]"]


@dataclass(frozen=True)
class Bounds:
    """Bounds of a place of link_1's middle along an axis of the table (m), or of the time (s).

    Attributes:
        symbol: x, y or t. low, high: bounds. middle: (2,) m of link_1, frame of the link.
    """

    symbol: str
    low: float
    high: float
    middle: np.ndarray

    def hold(self, state: BodyState) -> bool:
        """Whether they hold at an instant."""
        if self.symbol == "t":
            return self.low < state.time < self.high
        return bool(self.low < state.place(self.middle)["xy".index(self.symbol)] < self.high)

    def values(self, motion: Motion) -> np.ndarray:
        """(K,) of the quantity."""
        if self.symbol == "t":
            return motion.time
        c, s = np.cos(motion.angle[:, 0]), np.sin(motion.angle[:, 0])
        x, y = self.middle
        arm = (c * x - s * y, s * x + c * y)
        axis = "xy".index(self.symbol)
        return np.asarray(motion.origin[:, 0, axis] + arm[axis])


@dataclass(frozen=True)
class Within:
    """Something that acts while bounds hold."""

    influence: Influence
    bounds: Bounds

    def act(self, state: BodyState) -> tuple[np.ndarray, np.ndarray, float]:
        """Return what acts inside, and nothing outside."""
        force, place, load = self.influence.act(state)
        return (force, place, load) if self.bounds.hold(state) else (0.0 * force, place, 0.0)


def _place(scene: Scene, rng: np.random.Generator) -> Bounds:
    """Draw a border that a quarter to a half of the time of the sliding lies beyond."""
    middle = scene.thing.links[0].corners.mean(axis=0)
    motion = simulate([scene])[0]
    options = [Bounds(symbol, 0.0, np.inf, middle) for symbol in "xy"]
    values = [bounds.values(motion) for bounds in options]
    widest = int(np.argmax([np.ptp(v) for v in values]))
    moving = np.abs(np.gradient(values[widest])) > 1e-5
    border = np.quantile(values[widest][moving], 1.0 - rng.uniform(0.3, 0.5))
    return replace(options[widest], low=float(border))


def _while(scene: Scene, rng: np.random.Generator) -> Bounds:
    """Draw a while of a quarter to two fifths of the recording."""
    length = simulate([scene])[0].time[-1]
    start, share = rng.uniform(0.2, 0.5), rng.uniform(0.25, 0.4)
    middle = scene.thing.links[0].corners.mean(axis=0)
    return Bounds("t", float(start * length), float((start + share) * length), middle)


def _film(scene: Scene, size: float, rng: np.random.Generator) -> tuple[Hidden, Bounds]:
    bounds = _place(scene, rng)
    film = Film("xy".index(bounds.symbol), bounds.low)
    wet = replace(scene, viscosity=4.0 * size, film=film)
    return Hidden(wet, parameters={"coefficient": 4.0 * size}), bounds


def _rough(scene: Scene, size: float, rng: np.random.Generator) -> tuple[Hidden, Bounds]:
    bounds = _place(scene, rng)
    factor = float(np.exp(0.25 * size * rng.choice([-1.0, 1.0])))
    table = scene.field or FrictionField.even()
    half = table.with_step("xy".index(bounds.symbol), bounds.low, factor - 1.0)
    return Hidden(replace(scene, field=half), parameters={"factor": factor}), bounds


def _within(name: str, draw: Callable[[Scene, np.random.Generator], Bounds]) -> Maker:
    """Make the influence that an effect adds act within bounds only."""

    def make(scene: Scene, size: float, rng: np.random.Generator) -> tuple[Hidden, Bounds]:
        bounds = draw(scene, rng)
        made = hide(name, size, scene, rng)
        *others, added = made.scene.influences
        acting = (*others, Within(added, bounds))
        return replace(made, scene=replace(made.scene, influences=acting)), bounds

    return make


REGIONAL: dict[str, tuple[str, Maker]] = {
    "film on one side of the table": ("viscous_support", _film),
    "one side of the table rubs otherwise": ("friction_change", _rough),
    "spring taut beyond a place": ("tether_spring", _within("tether_spring", _place)),
    "hung on for a while": ("constant_pull", _within("constant_pull", _while)),
}
"""Effect that acts, and what makes it act there, by what it is in the world."""


def hide_in_regime(case: str, size: float, scene: Scene, rng: np.random.Generator) -> Hidden:
    """Return a scene in which something acts in a regime; parameters say which.

    Args:
        case: of `REGIONAL`.
        size: multiple of the typical size.
        scene: without it.
        rng: of places and times.
    """
    name, make = REGIONAL[case]
    made, bounds = make(scene, size, rng)
    ends = {"symbol": bounds.symbol, "low": bounds.low, "high": bounds.high}
    return replace(made, parameters={**made.parameters, "effect": name, "regime": ends})


def bounds_in(scene: Scene, regime: dict[str, Any]) -> Bounds:
    """Return the bounds that `hide_in_regime` told, for the object of a scene."""
    return Bounds(**regime, middle=scene.thing.links[0].corners.mean(axis=0))
