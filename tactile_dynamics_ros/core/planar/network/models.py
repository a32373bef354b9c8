"""The models of pushing that `property_estimator` can be told to filter with, by their names."""

from __future__ import annotations

from pathlib import Path

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.planar.filter.live import MODELS, PATCH, WEIGHTS, PushingModel
from tactile_dynamics_ros.core.planar.mechanics.support import SupportPatch
from tactile_dynamics_ros.core.planar.network.graph import Thing
from tactile_dynamics_ros.core.planar.network.process import GraphProcess
from tactile_dynamics_ros.core.planar.network.weights import GraphWeights, shipped_networks

_POINTS = 25
"""Points of a footprint of which a network sees the second moments, as in its training; they move
by 2 % with 64."""
_FASTER = 1.5
"""Speed over the fastest in a network's training up to which its numbers are not doubted: steps at
the shipped networks' 30 mm/s vary by a third with the noise of poses."""
_FASTEST = 1.2
"""Fastest pushes of a training over the unit of its velocities: 30 mm/s over 25. Follows from the
settings of `tactile-dynamics train pushing`."""


def pushing_model(name: str) -> PushingModel:
    """Return the model of a name, with the shipped weights where it is learnt.

    Args:
        name: one of MODELS, or a file of weights of pushes (.npz).

    Raises:
        BadInputError: there is no such model, or its weights cannot be read.
    """
    own = name.endswith(WEIGHTS)
    if name not in MODELS and not own:
        raise BadInputError(f"model '{name}': expected {', '.join(MODELS)}")
    if name == PATCH.name:
        return PATCH
    weights, *pull = (GraphWeights.load(Path(name)),) if own else shipped_networks(name)

    def create(outline: Array) -> GraphProcess:
        return GraphProcess.of(Thing((SupportPatch(outline, _POINTS),)), weights, *pull)

    return PushingModel(name, create, weights.step, _FASTER * _FASTEST * weights.speed)
