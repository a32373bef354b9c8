"""Fits of a rigid body with effects to a whole recording."""
