"""Recordings of objects that are pushed or pulled on a support."""

from tactile_dynamics_ros.recording.pushed.arrays import Support
from tactile_dynamics_ros.recording.pushed.recording import PushedRecording, recorded_model

__all__ = ["PushedRecording", "Support", "recorded_model"]
