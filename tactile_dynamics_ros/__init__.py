"""Live estimation of what a dexterous hand is holding."""

__version__ = "0.1.0"
