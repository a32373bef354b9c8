"""Live force of one fingertip by the network."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.tactile.calibration import LabelledPresses
from tactile_dynamics_ros.core.tactile.fingertip import (
    Felt,
    FingertipConfig,
    FingertipEstimator,
)
from tactile_dynamics_ros.core.tactile.network.inputs import (
    REST_MEAN,
    Memory,
    lagged,
    network_inputs,
)
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
        self._rest = np.full(19, REST_MEAN)

    def reset(self, rest: Array) -> None:
        """Forget past frames and take the electrodes' rest counts (19,)."""
        self._memory.reset()
        self._rest = rest

    def predict(self, change: Array) -> Felt:
        """Return force (3,), std (3,), contact point (3,) and its std for the next frame (20,)."""
        return predict_together([self], [change])[0]

    def remember(self, change: Array) -> tuple[Array, Array]:
        """Take in the next frame (20,); return its low-passed copies (6, 20) and the rest (19,)."""
        return self._memory.update(change), self._rest


def predict_together(models: Sequence[NetworkForceModel], changes: Sequence[Array]) -> list[Felt]:
    """Return the contacts of several fingertips with the same weights, in one pass.

    Args:
        models: of the fingertips.
        changes: (20,) next frame of each.
    """
    pairs = [model.remember(change) for model, change in zip(models, changes, strict=True)]
    past, rest = (np.stack(each) for each in zip(*pairs, strict=True))
    found = models[0].weights.evaluate(*network_inputs(np.stack(changes), past, rest))
    columns = (found.force, found.std, found.point, found.point_std.tolist())
    return list(zip(*columns, strict=True))


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
