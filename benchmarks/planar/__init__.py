"""Learnt models of pushing against the physical one: steps ahead, and what filters make of them."""
