"""Effects at a point of one part of two on a joint: pulls, springs, hands and loads."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.effects.parameter import EffectParameter
from tactile_dynamics_ros.core.planar.effects.acting import Acting
from tactile_dynamics_ros.core.planar.effects.effect import PushEffect, WrappedEffect
from tactile_dynamics_ros.core.planar.effects.situation import PlanarMotion, Situation

OF_ONE_PART = ("tether_spring", "constant_pull", "unsensed_contact", "load_change")
"""Names of the effects that act on one part of two on a joint, as on an object of its own; the rest
of the catalogue acts under both parts, or in the sensor."""
_COPIED = ("name", "family", "formula", "looks_like", "remedy", "sudden")
"""What an effect on one part says of itself as the effect does on an object; the rest has the value
of `PushEffect`."""


class PartEffect(WrappedEffect):
    """Another effect on one part of two, nothing on the other; see `on_part`.

    The two equations of a joint feel it through the balance of that part.

    Attributes:
        inner: the effect.
        part: 0 or 1.
    """

    part: int

    def __init__(self, inner: PushEffect, part: int) -> None:
        self.inner, self.part, self.start = inner, part, inner.start

    def __reduce__(self) -> tuple[Any, ...]:
        return on_part, (self.inner, self.part)

    @property
    def label(self) -> str:
        """With the part."""
        return f"{self.inner.label} on link_{self.part + 1}"

    @property
    def choices(self) -> dict[str, float]:
        """With the part."""
        return {**self.inner.choices, "link": self.part + 1.0}

    def from_time(self, start: float) -> PartEffect:
        """The same on the same part, from a time, s, on."""
        return on_part(self.inner.from_time(start), self.part)

    def changed(self, situation: Situation, theta: Array) -> Situation:
        """Nothing of both parts together: `of_part` has what changes of one."""
        return situation

    def wrench(self, motion: PlanarMotion, theta: Array) -> Array | None:
        """That of the inner effect; asked of its own part only."""
        return self.inner.wrench(motion, theta)


def on_part(effect: PushEffect, part: int) -> PartEffect:
    """An effect that acts on one part only.

    Args:
        effect: one of `OF_ONE_PART`.
        part: 0 or 1.
    """
    body: dict[str, Any] = {one: getattr(type(effect), one) for one in _COPIED}
    parameters: tuple[EffectParameter, ...] = effect.parameters
    body |= {"parameters": parameters, "sentence": f"at link_{part + 1} {effect.sentence}"}
    kind = type("PartEffect", (PartEffect,), body)
    made = kind(effect, part)
    assert isinstance(made, PartEffect)
    return made


def instances(effect: PushEffect, structure: str, push_starts: Array) -> Sequence[PushEffect]:
    """An effect of a pair, or one for each part and push between which the data must choose.

    Args:
        effect: that has a law there.
        structure: rigid or jointed.
        push_starts: (K,) s.
    """
    begun = effect.beginnings(push_starts)
    if structure != "jointed" or isinstance(effect, PartEffect) or effect.of_parts:
        return begun
    return [on_part(one, part) for one in begun for part in (0, 1)]


def has_law(effect: PushEffect, structure: str) -> bool:
    """Whether an effect means something for two parts: "rigid", "jointed", or something else."""
    parts = effect.of_parts or effect.name in OF_ONE_PART
    return not effect.of_joint and (structure == "rigid" or (structure == "jointed" and parts))


def _picked(acting: Acting, wanted: Callable[[PushEffect], bool]) -> Acting:
    kept = [(effect, theta) for effect, theta in acting if wanted(effect)]
    theta = [values for _, values in kept]
    return Acting(tuple(e for e, _ in kept), np.concatenate([np.zeros(0), *theta]))


def of_both(acting: Acting) -> Acting:
    """The effects that act on both parts alike, at their parameters."""
    return _picked(acting, lambda effect: not isinstance(effect, PartEffect))


def of_part(acting: Acting, part: int) -> Acting:
    """The inner effects of one part alone, at their parameters."""
    own = _picked(acting, lambda effect: isinstance(effect, PartEffect) and effect.part == part)
    inner = tuple(effect.inner for effect in own.effects if isinstance(effect, PartEffect))
    return replace(own, effects=inner)
