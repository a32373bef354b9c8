"""Inertia of the held object: wrench residuals, batch and live estimation, excitation."""
