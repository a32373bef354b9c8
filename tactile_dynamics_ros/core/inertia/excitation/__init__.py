"""Motions that reveal most about a held object within the limits of arm and grip."""

from tactile_dynamics_ros.core.inertia.excitation.design import (
    Criterion,
    DesignConfig,
    DesignedMotion,
    InertiaCriterion,
    design_motion,
    wrench_information,
)
from tactile_dynamics_ros.core.inertia.excitation.limits import ArmLimits, Grip, MotionLimits
from tactile_dynamics_ros.core.inertia.excitation.trajectory import FourierOffsets, HeldPose

__all__ = [
    "ArmLimits",
    "Criterion",
    "DesignConfig",
    "DesignedMotion",
    "FourierOffsets",
    "Grip",
    "HeldPose",
    "InertiaCriterion",
    "MotionLimits",
    "design_motion",
    "wrench_information",
]
