"""Recordings of arms by the torques of their joints."""

from tactile_dynamics_ros.recording.joints.recording import TABLES, JointRecording, is_of_joints

__all__ = ["TABLES", "JointRecording", "is_of_joints"]
