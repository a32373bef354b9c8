"""Surfaces: of objects, of their regions and hulls, of the skin of a fingertip."""
