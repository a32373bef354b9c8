"""A page in the browser: what is handled, how sure that is, and whether the model fits."""

TOKEN_VARIABLE = "TACTILE_DYNAMICS_VIEW_TOKEN"
"""Environment variable by which who starts a page as a process knows its address beforehand."""
