"""A page in the browser: what is handled, how sure that is, and whether the model fits."""
