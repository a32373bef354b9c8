"""The held object as a model that the search for missing effects can question."""
