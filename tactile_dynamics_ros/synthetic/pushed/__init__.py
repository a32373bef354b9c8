"""Recordings of pushed and pulled objects, with hidden physical effects."""

from tactile_dynamics_ros.synthetic.pushed.actions import ActionOptions, PlannedPush
from tactile_dynamics_ros.synthetic.pushed.effects import CATALOGUE, JOINTED, OUTSIDE
from tactile_dynamics_ros.synthetic.pushed.recordings import (
    HiddenPush,
    PushOptions,
    generate,
    record_pushes,
)
from tactile_dynamics_ros.synthetic.pushed.regimes import REGIONAL
from tactile_dynamics_ros.synthetic.pushed.sensors import SensorOptions

__all__ = [
    "CATALOGUE",
    "JOINTED",
    "OUTSIDE",
    "REGIONAL",
    "ActionOptions",
    "PushOptions",
    "HiddenPush",
    "PlannedPush",
    "SensorOptions",
    "generate",
    "record_pushes",
]
