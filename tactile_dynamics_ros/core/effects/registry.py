"""Effects by name: the catalogue, other packages' effects and the users' own."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from importlib import import_module
from importlib.metadata import entry_points
from typing import TypeVar

from tactile_dynamics_ros.core.effects.effect import Effect
from tactile_dynamics_ros.core.errors import BadInputError

ENTRY_POINT_GROUP = "tactile_dynamics_ros.effects"

EFFECT_NAMES = (
    "viscous_drag",
    "quadratic_drag",
    "rotational_drag",
    "tether_spring",
    "hanging_cable",
    "unsensed_contact",
    "spinning_rotor",
    "sloshing_mass",
    "added_mass",
    "mass_change",
    "gravity_tilt",
    "contact_torsion",
    "contact_offset",
    "force_bias",
    "force_drift",
    "force_scale",
    "sensor_rotation",
    "sensor_lag",
    "time_offset",
)

_FAMILIES = ("drag", "elastic", "internal", "gravity", "contact", "sensor", "timing")

_registry: dict[str, Callable[[], Effect]] = {}
_loaded_entry_points = False

EffectClass = TypeVar("EffectClass", bound=Callable[[], Effect])


def register_effect(effect: EffectClass) -> EffectClass:
    """Class decorator: make an effect known by its name.

    Raises:
        BadInputError: the class has no name.
    """
    name = getattr(effect, "name", "")
    if not name:
        raise BadInputError(f"{effect}: an effect needs a class attribute `name`")
    _registry[name] = effect
    return effect


def registered_names() -> tuple[str, ...]:
    """Names of all effects known now, the catalogue first."""
    _load()
    own = tuple(name for name in _registry if name not in EFFECT_NAMES)
    return EFFECT_NAMES + own


def create_effect(label: str) -> Effect:
    """Effect of a name, or of a reading of it, ``name:variant``.

    Raises:
        BadInputError: no effect of that name, or the effect has no such reading.
    """
    _load()
    name, _, variant = label.partition(":")
    if name not in _registry:
        known = ", ".join(registered_names())
        raise BadInputError(f"effect '{name}' is unknown: expected one of {known}")
    effect = _registry[name]()
    return effect.with_variant(variant) if variant else effect


def create_effects(labels: Sequence[str]) -> tuple[Effect, ...]:
    """Effects of a model, in the order of their labels; each may be there once.

    Raises:
        BadInputError: an effect is unknown, has no such reading, or is named twice.
    """
    names = [label.partition(":")[0] for label in labels]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise BadInputError(
            f"effects = {list(labels)}: {', '.join(twice)} is named more than once; name it once"
        )
    return tuple(create_effect(label) for label in labels)


def _load() -> None:
    global _loaded_entry_points
    if _loaded_entry_points:
        return
    _loaded_entry_points = True
    for family in _FAMILIES:
        import_module(f"tactile_dynamics_ros.core.effects.held.{family}")
    for entry in entry_points(group=ENTRY_POINT_GROUP):
        register_effect(entry.load())
