"""Effects of pushed objects by their names."""

from __future__ import annotations

from tactile_dynamics_ros.core.effects.registry import CatalogueEntry, EffectRegistry, entry_of
from tactile_dynamics_ros.core.planar.effects.effect import PushEffect
from tactile_dynamics_ros.core.planar.effects.gated import gate_push_effect

PUSHED_EFFECT_NAMES = (
    "support_tilt",
    "viscous_support",
    "velocity_weakening",
    "anisotropic_support",
    "friction_gradient",
    "concentrated_pressure",
    "tether_spring",
    "constant_pull",
    "unsensed_contact",
    "force_bias",
    "force_scale",
    "sensor_rotation",
    "friction_change",
    "load_change",
    "loose_joint",
    "contact_offset",
    "sensor_lag",
    "time_offset",
)
"""Names of the effects of a pushed object in the order in which people see them; they are API."""

PUSHED: EffectRegistry[PushEffect] = EffectRegistry(
    "pushed",
    PUSHED_EFFECT_NAMES,
    (
        "tactile_dynamics_ros.core.planar.effects.support",
        "tactile_dynamics_ros.core.planar.effects.load",
        "tactile_dynamics_ros.core.planar.effects.joint",
        "tactile_dynamics_ros.core.planar.effects.sensing",
    ),
    gate=gate_push_effect,
)
"""Effects of a pushed object."""


def describe_pushed_effect(name: str) -> CatalogueEntry:
    """Entry of an effect in the catalogue."""
    effect = PUSHED.create(name)
    return entry_of(effect, PUSHED.model, effect.parameters, (name,))
