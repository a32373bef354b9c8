"""Recordings of arms by the torques of their joints."""

from tactile_dynamics_ros.recording.joints.recording import JointRecording, is_of_joints

__all__ = ["JointRecording", "is_of_joints"]
