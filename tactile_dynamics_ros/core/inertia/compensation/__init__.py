"""Contact wrench on what is carried: the measured one without zero, gravity and inertia."""

from tactile_dynamics_ros.core.inertia.compensation.compensator import (
    Compensated,
    Compensator,
    ContactWrenches,
    Load,
)

__all__ = ["Compensated", "Compensator", "ContactWrenches", "Load"]
