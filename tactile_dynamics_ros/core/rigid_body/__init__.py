"""Rotations, inertial parameters and the Newton-Euler equations."""
