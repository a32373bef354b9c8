"""Live estimation of what a dexterous hand is holding."""
