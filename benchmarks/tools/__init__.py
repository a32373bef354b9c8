"""Inertia from little motion, with the shape as prior."""
