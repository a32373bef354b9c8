"""From raw counts of a fingertip to force and contact point with their uncertainty."""
