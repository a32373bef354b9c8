"""Live force of fingertips by the network."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.tactile.calibration import LabelledPresses
from tactile_dynamics_ros.core.tactile.fingertip import (
    Felt,
    FingertipConfigs,
    FingertipEstimator,
    frame_period,
)
from tactile_dynamics_ros.core.tactile.network.weights import (
    REST_MEAN,
    Memory,
    NetworkWeights,
    Prediction,
    lagged,
    network_inputs,
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
        self._rest = np.full(19, REST_MEAN)

    def reset(self, rest: Array) -> None:
        """Forget past frames and take the electrodes' rest counts (..., 19)."""
        self._memory.reset(rest.shape[:-1])
        self._rest = rest

    def predict(self, change: Array) -> Felt:
        """Return the contacts in the next frame, given its tared signals (..., 20)."""
        found = self.weights.evaluate(
            *network_inputs(change, self._memory.update(change), self._rest)
        )
        return found.force, found.std, found.point, found.point_std


class NetworkForceEstimator(FingertipEstimator):
    """Live force of one fingertip, or of several, by the network.

    Args:
        config: thresholds and constants of the fingertip, or of each of several.
        weights: of the network; those shipped with the package if None.
    """

    def __init__(
        self, config: FingertipConfigs | None = None, weights: NetworkWeights | None = None
    ) -> None:
        super().__init__(NetworkForceModel(weights, frame_period(config)), config)


def predict_sequence(
    change: Array, rest: Array, weights: NetworkWeights, period: float = 0.01
) -> Prediction:
    """Return contacts for a sequence of tared signals (T, 20) of a unit with rest counts (19,)."""
    return weights.evaluate(*network_inputs(change, lagged(change, period), rest))


def predict_presses(presses: LabelledPresses, weights: NetworkWeights) -> list[Prediction]:
    """Return contacts for every sequence of labelled presses."""
    return [
        predict_sequence(change, rest, weights, presses.period)
        for change, rest in zip(presses.change, presses.rest, strict=True)
    ]
