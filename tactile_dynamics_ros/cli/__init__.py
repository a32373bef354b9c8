"""The command `tactile-dynamics`: one module per family of verbs."""
