"""Objects that are pushed and pulled on a support: their mechanics and what recordings tell."""
