"""A table with objects that can be pushed, and a depth camera that moves around it."""
