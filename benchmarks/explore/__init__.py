"""Benchmark of exploring and of pushing to goals."""
