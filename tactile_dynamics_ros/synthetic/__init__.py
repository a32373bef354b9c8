"""Recordings with hidden physical effects: prescribed motion and exact rigid-body dynamics."""

from tactile_dynamics_ros.synthetic.calibration import magnitude_for_whitened_rms
from tactile_dynamics_ros.synthetic.effects import CATALOGUE, EVENTS, OUTSIDE, create_hidden_effect
from tactile_dynamics_ros.synthetic.recordings import (
    HiddenRecording,
    generate,
    generate_at_whitened_rms,
)
from tactile_dynamics_ros.synthetic.scenario import Scenario, ScenarioOptions
from tactile_dynamics_ros.synthetic.sensors import SensorOptions

__all__ = [
    "CATALOGUE",
    "EVENTS",
    "OUTSIDE",
    "HiddenRecording",
    "Scenario",
    "ScenarioOptions",
    "SensorOptions",
    "create_hidden_effect",
    "generate",
    "generate_at_whitened_rms",
    "magnitude_for_whitened_rms",
]
