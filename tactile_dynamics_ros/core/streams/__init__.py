"""Time-stamped measurements: what was measured, in which order, and the last of it."""
