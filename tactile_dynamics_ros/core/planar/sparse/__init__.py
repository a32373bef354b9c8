"""Friction force and centre of mass from slow pushes, by integration of the mechanics."""

from tactile_dynamics_ros.core.planar.sparse.fit import SparseFit, fit_sparse
from tactile_dynamics_ros.core.planar.sparse.prediction import product_between_rests

__all__ = ["SparseFit", "fit_sparse", "product_between_rests"]
