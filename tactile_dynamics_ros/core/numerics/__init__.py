"""Numerics that several rooms share: least squares, whitening, local polynomials, noise."""
