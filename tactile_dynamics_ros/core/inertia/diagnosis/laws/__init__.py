"""Forms of laws for a held object."""
