"""Links of an object on a table, followed while they are pushed."""
