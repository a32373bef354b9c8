"""Superquadrics: the surface, its recovery from points, parts of an object, the next view."""
