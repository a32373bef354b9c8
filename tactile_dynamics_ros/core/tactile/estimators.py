"""The force models that come with the package, by name."""

from __future__ import annotations

from pathlib import Path

from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.tactile.analytic_force import AnalyticForceEstimator
from tactile_dynamics_ros.core.tactile.fingertip import FingertipConfigs, FingertipEstimator
from tactile_dynamics_ros.core.tactile.network.estimator import NetworkForceEstimator
from tactile_dynamics_ros.core.tactile.network.weights import NetworkWeights

FORCE_MODELS = ("network", "analytic")
"""Names of the force models, the default first; they are API (`biotac_force` parameter `model`).
Another order makes another model the default."""


def create_force_estimator(
    model: str = "network", config: FingertipConfigs | None = None
) -> FingertipEstimator:
    """Return the live estimator of one fingertip, or of several that are read together.

    Args:
        model: one of FORCE_MODELS, or a file of weights that `train biotac` has written (.npz).
        config: thresholds and constants of the fingertip, or of each of several.

    Raises:
        BadInputError: there is no such model, or the file holds none.
    """
    if model.endswith(".npz"):
        return NetworkForceEstimator(config, NetworkWeights.load(Path(model)))
    if model == "network":
        return NetworkForceEstimator(config)
    if model == "analytic":
        return AnalyticForceEstimator(config)
    raise BadInputError(
        f"force model '{model}': expected one of {', '.join(FORCE_MODELS)}, or a .npz file of "
        "`train biotac`"
    )
