"""Recordings of arms by their joint torques, with hidden effects and a hidden payload."""

from tactile_dynamics_ros.synthetic.joints.effects import CATALOGUE, OUTSIDE
from tactile_dynamics_ros.synthetic.joints.recordings import (
    HiddenArm,
    JointOptions,
    Payload,
    generate,
)

__all__ = ["CATALOGUE", "OUTSIDE", "HiddenArm", "JointOptions", "Payload", "generate"]
