"""The catalogue of a held object: one module for each kind of effect."""
