"""Newton-Euler residuals of a recording with the covariance of their noise."""
