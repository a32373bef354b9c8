"""The catalogue of effects that a rigid-body model of a held object can lack."""

from tactile_dynamics_ros.core.effects.effect import Effect, LinearEffect
from tactile_dynamics_ros.core.effects.parameter import EffectParameter
from tactile_dynamics_ros.core.effects.registry import (
    EFFECT_NAMES,
    create_effect,
    create_effects,
    register_effect,
    registered_names,
)

__all__ = [
    "EFFECT_NAMES",
    "Effect",
    "EffectParameter",
    "LinearEffect",
    "create_effect",
    "create_effects",
    "register_effect",
    "registered_names",
]
