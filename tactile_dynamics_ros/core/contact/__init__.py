"""Contacts between fingers and object: points, frames, forces, hand kinematics."""
