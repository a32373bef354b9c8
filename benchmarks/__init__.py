"""Benchmarks of the package; each writes the numbers that the documentation shows."""
