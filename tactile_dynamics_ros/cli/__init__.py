"""The command `tactile-dynamics`."""
