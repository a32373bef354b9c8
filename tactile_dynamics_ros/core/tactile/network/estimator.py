"""Live force of one fingertip by the network."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.tactile.fingertip import FingertipConfig, FingertipEstimator
from tactile_dynamics_ros.core.tactile.network.inputs import Memory, lagged, network_inputs
from tactile_dynamics_ros.core.tactile.network.weights import (
    NetworkWeights,
    Prediction,
    shipped_network,
)

Array = NDArray[np.float64]


class NetworkForceModel:
    """Force and contact point by the network, with a memory of past frames.

    Args:
        weights: of the network; those shipped with the package if None.
        period: s between frames.
    """

    def __init__(self, weights: NetworkWeights | None = None, period: float = 0.01) -> None:
        self.weights = weights or shipped_network()
        self._memory = Memory(period)

    def reset(self) -> None:
        """Forget past frames."""
        self._memory.reset()

    def predict(self, change: Array) -> tuple[Array, Array, Array, float]:
        """Return force (3,), std (3,), contact point (3,) and its std for the next frame (20,)."""
        inputs, size = network_inputs(change, self._memory.update(change))
        found = self.weights.evaluate(inputs[None], size[None])
        return found.force[0], found.std[0], found.point[0], float(found.point_std[0])


class NetworkForceEstimator(FingertipEstimator):
    """Live force of one fingertip by the network; used like `AnalyticForceEstimator`.

    Args:
        config: thresholds.
        weights: of the network; those shipped with the package if None.
    """

    def __init__(
        self, config: FingertipConfig | None = None, weights: NetworkWeights | None = None
    ) -> None:
        config = config or FingertipConfig()
        super().__init__(NetworkForceModel(weights, config.period), config)


def predict_sequence(change: Array, weights: NetworkWeights, period: float = 0.01) -> Prediction:
    """Return contacts for a sequence of tared signals (T, 20)."""
    return weights.evaluate(*network_inputs(change, lagged(change, period)))
