"""Mutated files of every kind that the package reads: what it does with them."""
