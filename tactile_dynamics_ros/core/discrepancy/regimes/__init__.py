"""Effects that act only in a regime: conditions, borders, and whether held-out data agree."""
