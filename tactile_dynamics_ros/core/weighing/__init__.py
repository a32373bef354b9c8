"""An arm that turns what it carries about, to weigh it."""
