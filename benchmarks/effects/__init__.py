"""Hidden-effect benchmark of the diagnosis."""
