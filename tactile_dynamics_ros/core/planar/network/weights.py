"""Weights of the graph network and its forward pass in numpy."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.files import write_arrays
from tactile_dynamics_ros.core.planar.network.graph import EDGE, HELP, MOTION, NODE, Graph
from tactile_dynamics_ros.core.reading import open_arrays

Layers = tuple[tuple[Array, Array], ...]

NETS = ("edge", "node", "process", "touch")
"""Perceptrons of the graph network: f_e, f_n, what becomes of a link, what the robot feels. Fixed
by `propagate`; files have their layers under these names."""
ACTIONS = {"push": 2, "pull": 3}
"""What a robot does, a network each, as in the paper, and how many numbers it feels then: a gripper
feels a torque too."""
KINDS = ("graph", "graph_residual")
"""The paper's network, and the one that learns what mechanics leave. Fixed names of the product."""
LATENT = 32
"""Numbers that nodes and edges carry beside their features. Half of it costs accuracy of forces,
twice as many cost time and file size; the shipped networks have 32."""
_FOLDER = Path(__file__).parent
"""Where the shipped files are."""
_LOG_STD = (-7.0, 1.5)
"""Bounds of ln(standard deviation in units of the outputs): the lower keeps single steps that are
met by chance from ruling the training, the upper keeps strange steps from being weightless."""


@dataclass(frozen=True, eq=False)
class Expected:
    """Output of the network for C pushes, links with the touched one first.

    Attributes:
        motion: (C, L, MOTION) in axes of the contact, m/s and rad/s; a residual network's is beside
            the mechanics. motion_std: the same.
        force: (C, 2) N of a tip on the object, axes of the contact, or (C, 3) of a gripper, with
            the torque about where it began (N m). force_std: the same.
    """

    motion: Array
    motion_std: Array
    force: Array
    force_std: Array


@dataclass(frozen=True, eq=False)
class GraphWeights:
    """A trained network.

    Attributes:
        kind: one of KINDS.
        step: s, of the steps that it was trained on. speed: m/s, unit of velocities.
        motion_scale: (MOTION,) and force_scale: (2,) of a tip, (3,) of a gripper, units of the
            outputs.
        nets: layers, matrix (n_in, n_out) and bias (n_out,), of each of NETS; SiLU between them.
        origin: what it was trained on.
    """

    kind: str
    step: float
    speed: float
    motion_scale: Array
    force_scale: Array
    nets: dict[str, Layers]
    origin: str

    @property
    def forces(self) -> int:
        """How many numbers the robot feels: 2 where a tip pushes, 3 where a gripper pulls."""
        return len(self.force_scale)

    @property
    def residual(self) -> bool:
        """Whether it states what mechanics leave."""
        return self.kind == "graph_residual"

    def evaluate(self, graph: Graph) -> Expected:
        """What becomes of links and what the robot feels."""
        process, touch = self.outputs(graph)
        low, high = _LOG_STD
        spread = np.exp(np.clip(process[..., MOTION:], low, high))
        forces = np.exp(np.clip(touch[..., self.forces :], low, high))
        return Expected(
            process[..., :MOTION] * self.motion_scale,
            spread * self.motion_scale,
            touch[..., : self.forces] * self.force_scale,
            forces * self.force_scale,
        )

    def outputs(self, graph: Graph) -> tuple[Array, Array]:
        """Means and ln std of links (C, L, 12) and robot (C, 2 forces), in units of the outputs."""
        return propagate(self.nets, graph)

    def save(self, path: Path) -> None:
        """Write as a compressed npz file."""
        arrays: dict[str, Any] = {
            f"{name}_{part}_{k}": values.astype(np.float32)
            for name, layers in self.nets.items()
            for k, layer in enumerate(layers)
            for part, values in zip(("matrix", "bias"), layer, strict=True)
        }
        for name in ("kind", "step", "speed", "motion_scale", "force_scale", "origin"):
            arrays[name] = np.array(getattr(self, name))
        write_arrays(path, arrays)

    @classmethod
    def load(cls, path: Path) -> GraphWeights:
        """Read what `save` wrote.

        Raises:
            BadInputError: the file is missing, or holds no such network or one of another version.
        """
        with open_arrays(path, "a network of pushes") as content:
            nets = {name: _layers(content, name) for name in NETS}
            kind = str(content["kind"])
            rows = len(nets["node"][0][0])
            wanted = node_features(kind) + 2 * LATENT
            if kind not in KINDS or rows != wanted:
                raise ValueError(
                    f"{kind} made for {rows} inputs, this version has {wanted}; train again "
                    "(tactile-dynamics train pushing)"
                )
            return cls(
                kind,
                float(content["step"]),
                float(content["speed"]),
                content["motion_scale"],
                content["force_scale"],
                nets,
                str(content["origin"]),
            )


def _layers(content: Any, name: str) -> Layers:
    count = sum(key.startswith(f"{name}_matrix_") for key in content.files)
    if not count:
        raise KeyError(f"no layers of {name}")
    return tuple(
        (content[f"{name}_matrix_{k}"].astype(float), content[f"{name}_bias_{k}"].astype(float))
        for k in range(count)
    )


def node_features(kind: str) -> int:
    """Features of each node."""
    return NODE + (HELP if kind == "graph_residual" else 0)


def net_sizes(kind: str, width: int, forces: int = 2) -> dict[str, tuple[int, ...]]:
    """Inputs, hidden units and outputs of each of NETS: three layers each.

    Args:
        kind: one of `KINDS`.
        width: hidden units.
        forces: numbers that the robot feels.
    """
    node = node_features(kind) + LATENT
    return {
        "edge": (2 * node + EDGE, width, width, LATENT),
        "node": (node + LATENT, width, width, LATENT),
        "process": (node, width, width, 2 * MOTION),
        "touch": (LATENT, width, width, 2 * forces),
    }


def propagate(nets: dict[str, Layers], graph: Graph) -> tuple[Array, Array]:
    """Propagate cause from the robot outwards and effect back; return (C, L, 12) and (C, 2 forces).

    Cause: each link is updated by the edge from where the cause comes, and by its support's.
    Effect: from the last link back, each sender's edge updates the receiver; the edge to the robot
    is what it feels.

    Source: paper B, Algorithm 1, with the receiver updated in the cause pass.
    """
    links = graph.nodes.shape[1] - 2
    blank = np.zeros((len(graph.nodes), LATENT))
    node = [np.concatenate([graph.nodes[:, k], blank], axis=1) for k in range(links + 2)]
    fixed = graph.nodes.shape[2]
    robot, support, chain = node[0], node[1], node[2:]
    for k in range(links):
        sender = robot if k == 0 else chain[k - 1]
        cause = _edge(nets, sender, chain[k], graph.edges[:, k], 0.0)
        borne = _edge(nets, support, chain[k], graph.edges[:, links + k], 0.0)
        chain[k] = _updated(nets, chain[k], cause + borne, fixed)
    for k in range(links - 1, 0, -1):
        effect = _edge(nets, chain[k], chain[k - 1], graph.edges[:, k], 1.0)
        chain[k - 1] = _updated(nets, chain[k - 1], effect, fixed)
    forces = _edge(nets, chain[0], robot, graph.edges[:, 0], 1.0)
    process = np.stack([perceptron(nets["process"], each) for each in chain], axis=1)
    return process, perceptron(nets["touch"], forces)


def _edge(
    nets: dict[str, Layers], sender: Array, receiver: Array, static: Array, effect: float
) -> Array:
    own = static.copy()
    own[:, 3] = effect
    return perceptron(nets["edge"], np.concatenate([sender, receiver, own], axis=1))


def _updated(nets: dict[str, Layers], node: Array, edge: Array, fixed: int) -> Array:
    latent = perceptron(nets["node"], np.concatenate([node, edge], axis=1))
    return np.concatenate([node[:, :fixed], latent], axis=1)


def perceptron(layers: Layers, value: Array) -> Array:
    """Layers with x / (1 + exp(-x)) between them."""
    with np.errstate(over="ignore"):
        for matrix, bias in layers[:-1]:
            value = value @ matrix + bias
            value = value / (1.0 + np.exp(-value))
    matrix, bias = layers[-1]
    return np.asarray(value @ matrix + bias)


def shipped_file(kind: str, setting: str = "slow", action: str = "push") -> Path:
    """File of the weights that come with the package, of one of `ACTIONS`."""
    name = kind if action == "push" else f"{kind}_{action}"
    return _FOLDER / f"{name}_{setting}.npz"


@lru_cache(maxsize=4)
def shipped_graph(kind: str, setting: str = "slow", action: str = "push") -> GraphWeights:
    """Return a network that comes with the package."""
    return GraphWeights.load(shipped_file(kind, setting, action))


def shipped_networks(kind: str, setting: str = "slow") -> tuple[GraphWeights, ...]:
    """The network of pushes and, where there is one, that of pulls."""
    there = [action for action in ACTIONS if shipped_file(kind, setting, action).exists()]
    return tuple(shipped_graph(kind, setting, action) for action in there)
