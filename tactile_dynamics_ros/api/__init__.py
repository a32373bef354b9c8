"""The product from Python: the verbs of the command, and what they take and return."""
