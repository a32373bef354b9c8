"""Recordings of held objects: rosbag2 files and arrays on one side, streams on the other."""

from tactile_dynamics_ros.recording.recording import Recording

__all__ = ["Recording"]
