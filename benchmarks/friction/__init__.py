"""Friction probing: accuracy over objects, slip detection, warping surfaces, hidden effects."""
