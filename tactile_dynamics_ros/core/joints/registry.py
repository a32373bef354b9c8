"""Effects of joints by their names."""

from __future__ import annotations

from tactile_dynamics_ros.core.effects.catalogue import CatalogueEntry, entry_of
from tactile_dynamics_ros.core.effects.registry import EffectRegistry
from tactile_dynamics_ros.core.joints.effects import JointEffect

JOINT_EFFECT_NAMES = (
    "stribeck_friction",
    "load_dependent_friction",
    "friction_warming",
    "directional_friction",
    "rotor_inertia",
    "joint_elasticity",
    "backlash",
    "joint_coupling",
    "link_cable",
    "base_tilt",
    "torque_drift",
    "torque_gain",
    "torque_ripple",
    "torque_delay",
)
"""Names of the effects of joints in the order in which people see them; they are API. Coulomb and
viscous friction and a torque's offset are no effects: every model of a joint has them."""

JOINTS: EffectRegistry[JointEffect] = EffectRegistry(
    "joints",
    JOINT_EFFECT_NAMES,
    (
        "tactile_dynamics_ros.core.joints.drive_effects",
        "tactile_dynamics_ros.core.joints.arm_effects",
    ),
)
"""Effects of an arm's joints, drives and torque sensors."""


def describe_joint_effect(name: str) -> CatalogueEntry:
    """Entry of an effect in the catalogue."""
    effect = JOINTS.create(name)
    return entry_of(effect, JOINTS.model, effect.parameters(), (name,))
