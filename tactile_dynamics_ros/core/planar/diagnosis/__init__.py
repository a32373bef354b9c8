"""What the model of a pushed object lacks: its residual model for the diagnosis."""
