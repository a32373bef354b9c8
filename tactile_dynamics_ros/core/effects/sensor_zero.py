"""The zero of a single force/torque sensor, which belongs to every model of what it carries."""

from __future__ import annotations

from collections.abc import Collection, Sequence

from tactile_dynamics_ros.core.effects.effect import Effect
from tactile_dynamics_ros.core.effects.registry import create_effects

ZERO = "force_bias"
"""Name of the effect that is a constant zero of a sensor. It is API."""


def zero_beside(contacts: Collection[str], effects: Sequence[str]) -> tuple[str, ...]:
    """Name of the effect that a model of a single sensor has beside those that are named.

    A wrist sensor reads newtons with nothing on it, and what it was zeroed with is not recorded.
    Fingertips are several, and are zeroed without contact.

    Args:
        contacts: names of all contacts.
        effects: names or labels of the effects that were asked for.
    """
    named = {label.partition(":")[0] for label in effects}
    return (ZERO,) if len(contacts) == 1 and ZERO not in named else ()


def with_zero(contacts: Collection[str], effects: Sequence[Effect]) -> tuple[Effect, ...]:
    """Effects of a model, before them the zero of a single sensor.

    Args:
        contacts: names of all contacts.
        effects: that were asked for.
    """
    names = [effect.name for effect in effects]
    return (*create_effects(zero_beside(contacts, names)), *effects)
