"""Superquadrics of simulated objects on a table: accuracy, views, parts, honesty, time."""
