"""A plain feed-forward network beside the graph: same inputs, targets, likelihood and optimiser.

The paper's earlier network (A-FF) has one perceptron for all that is told of an object, so that the
number of links is fixed before it is trained.
"""

from __future__ import annotations

from functools import partial
from itertools import pairwise

import numpy as np
import torch
from torch import Tensor

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.planar.network.graph import EDGE, MOTION, NODE, Graph
from tactile_dynamics_ros.core.planar.network.training import (
    GraphTrainingConfig,
    StepNetwork,
    train_graph,
)
from tactile_dynamics_ros.core.planar.network.transitions import Examples
from tactile_dynamics_ros.core.planar.network.weights import GraphWeights, net_sizes, perceptron

_NET = "whole"
"""Name of the only perceptron, under which its layers are kept."""
_FELT = 4
"""What is said of the force: two means and two ln std."""


class FeedForwardWeights(GraphWeights):
    """A trained perceptron that is used like a graph network."""

    def outputs(self, graph: Graph) -> tuple[Array, Array]:
        """Means and ln std of links (C, L, 2 MOTION) and of the robot (C, 4)."""
        count, links = len(graph.nodes), graph.nodes.shape[1] - 2
        robot, others = graph.nodes[:, 0], graph.nodes[:, 2:].reshape(count, -1)
        inputs = np.concatenate([robot, others, graph.edges.reshape(count, -1)], axis=1)
        said = perceptron(self.nets[_NET], inputs)
        return said[:, :-_FELT].reshape(count, links, -1), said[:, -_FELT:]


class FeedForward(StepNetwork):
    """`FeedForwardWeights.outputs` in torch.

    Args:
        links: L.
        about: of the network to be; its kind is "graph", without features from mechanics.
        width: hidden units of the graph that has about as many parameters.
    """

    def __init__(self, links: int, about: GraphWeights, width: int) -> None:
        most = parameter_count(net_sizes(about.kind, width))
        super().__init__({_NET: layer_sizes(links, most)})

    def forward(self, nodes: Tensor, edges: Tensor) -> tuple[Tensor, Tensor]:
        """Return (N, L, 2 MOTION) of the links and (N, 4) of the robot."""
        links = nodes.shape[1] - 2
        told = [nodes[:, 0], nodes[:, 2:].flatten(1), edges.flatten(1)]
        said: Tensor = self.nets[_NET](torch.cat(told, dim=1))
        return said[:, :-_FELT].unflatten(1, (links, 2 * MOTION)), said[:, -_FELT:]


def parameter_count(nets: dict[str, tuple[int, ...]]) -> int:
    """Entries of all matrices and biases of perceptrons."""
    return sum((a + 1) * b for sizes in nets.values() for a, b in pairwise(sizes))


def layer_sizes(links: int, most: int) -> tuple[int, ...]:
    """Three layers for L links with as many parameters as may be, at most `most`."""
    inputs, outputs = (1 + links) * NODE + 2 * links * EDGE, links * 2 * MOTION + _FELT
    middle = 0.5 * (inputs + outputs + 2)
    width = int(np.sqrt(middle**2 + most - outputs) - middle)
    return inputs, width, width, outputs


def train(about: GraphWeights, examples: Examples, config: GraphTrainingConfig) -> GraphWeights:
    """Return a feed-forward network that was trained as the graph would have been."""
    make = partial(FeedForward, examples.motion.shape[1])
    peer = FeedForwardWeights(**vars(about))
    return train_graph(peer, [examples], [examples], config, make=make)
