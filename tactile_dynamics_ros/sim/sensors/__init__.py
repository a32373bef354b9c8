"""Measurement models: true simulated state in, noisy readings of real sensors out."""
