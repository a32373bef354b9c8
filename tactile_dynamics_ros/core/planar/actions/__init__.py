"""What a robot does to an object on a table."""
