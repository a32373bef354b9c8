"""Recordings with hidden physical effects: prescribed motion and exact rigid-body dynamics."""

from benchmarks.hidden.calibration import magnitude_for_whitened_rms
from benchmarks.hidden.effects import CATALOGUE, OUTSIDE, create_hidden_effect
from benchmarks.hidden.recordings import HiddenRecording, generate, generate_at_whitened_rms
from benchmarks.hidden.scenario import Scenario, ScenarioOptions
from benchmarks.hidden.sensors import SensorOptions

__all__ = [
    "CATALOGUE",
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
