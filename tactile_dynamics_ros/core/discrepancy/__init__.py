"""Which effect a model lacks; knows whitened residuals and nothing of hands or wrenches."""
