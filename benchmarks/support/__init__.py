"""Generators, layouts and helpers that only studies and tests need."""
