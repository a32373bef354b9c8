"""Train the graph network on steps of pushes whose outcome is known."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from torch import Tensor, nn

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.configuration import check_ranges, parameter
from tactile_dynamics_ros.core.planar.network.graph import MOTION
from tactile_dynamics_ros.core.planar.network.transitions import Examples
from tactile_dynamics_ros.core.planar.network.weights import (
    LATENT,
    GraphWeights,
    net_sizes,
    node_features,
)

Report = Callable[[int, float, float], None]
Told = tuple[Tensor, Tensor]
"""What is known of an outcome, and its standard deviation, in units of the output."""

_LOG_STD = (-7.0, 1.5)
"""Bounds of ln(standard deviation), as the forward pass has them; others here would teach outputs
that are then cut."""
_LARGEST_GRADIENT = 1.0
"""Norm to which gradients are cut: a rare impact must not undo an epoch. Ten times as much lets the
first epochs diverge; a tenth slows all."""
_WARM_UP = 0.1
"""Share of the steps in which the step size rises before it falls as a cosine. Not tuned."""
_SPREAD_FLOOR = 1e-4
"""Least unit of an output, m/s, rad/s, N or N m: one that never changes would divide by nothing."""


@dataclass(frozen=True)
class GraphTrainingConfig:
    """Size of the network and of its training."""

    width: int = parameter(64, "hidden units of each of the three layers", "", 4, 512)
    epochs: int = parameter(60, "passes over the steps", "", 1, 10000)
    batch: int = parameter(512, "steps of pushes per step of the optimiser", "", 8, 65536)
    learning_rate: float = parameter(2e-3, "largest step size", "", 1e-6, 1.0)
    seed: int = parameter(0, "of initial weights and order", "", 0)

    def __post_init__(self) -> None:
        check_ranges(self)


class StepNetwork(nn.Module):
    """Perceptrons that together say what becomes of links and what the robot feels.

    Args:
        sizes: inputs, hidden units and outputs of each perceptron, by name.
    """

    def __init__(self, sizes: dict[str, tuple[int, ...]]) -> None:
        super().__init__()
        self.nets = nn.ModuleDict({name: _perceptron(each) for name, each in sizes.items()})


class GraphNetwork(StepNetwork):
    """`weights.propagate` in torch: same nets, same order.

    Args:
        about: of the network to be; its nets are not read.
        width: hidden units.
    """

    def __init__(self, about: GraphWeights, width: int) -> None:
        super().__init__(net_sizes(about.kind, width, about.forces))
        self.fixed = node_features(about.kind)

    def forward(self, nodes: Tensor, edges: Tensor) -> tuple[Tensor, Tensor]:
        """Return (N, L, 2 MOTION) of the links and (N, 2 forces) of the robot."""
        links = nodes.shape[1] - 2
        blank = nodes.new_zeros((len(nodes), LATENT))
        node = [torch.cat([nodes[:, k], blank], dim=1) for k in range(links + 2)]
        robot, support, chain = node[0], node[1], node[2:]
        for k in range(links):
            sender = robot if k == 0 else chain[k - 1]
            cause = self._edge(sender, chain[k], edges[:, k], 0.0)
            borne = self._edge(support, chain[k], edges[:, links + k], 0.0)
            chain[k] = self._updated(chain[k], cause + borne)
        for k in range(links - 1, 0, -1):
            effect = self._edge(chain[k], chain[k - 1], edges[:, k], 1.0)
            chain[k - 1] = self._updated(chain[k - 1], effect)
        forces = self._edge(chain[0], robot, edges[:, 0], 1.0)
        process = torch.stack([self.nets["process"](each) for each in chain], dim=1)
        return process, self.nets["touch"](forces)

    def _edge(self, sender: Tensor, receiver: Tensor, static: Tensor, effect: float) -> Tensor:
        flag = static.new_full((len(static), 1), effect)
        own = torch.cat([static[:, :3], flag, static[:, 4:]], dim=1)
        found: Tensor = self.nets["edge"](torch.cat([sender, receiver, own], dim=1))
        return found

    def _updated(self, node: Tensor, edge: Tensor) -> Tensor:
        latent = self.nets["node"](torch.cat([node, edge], dim=1))
        return torch.cat([node[:, : self.fixed], latent], dim=1)


def _perceptron(sizes: tuple[int, ...]) -> nn.Sequential:
    layers: list[nn.Module] = []
    for before, after in zip(sizes[:-2], sizes[1:-1], strict=True):
        layers += [nn.Linear(before, after), nn.SiLU()]
    return nn.Sequential(*layers, nn.Linear(sizes[-2], sizes[-1]))


def step_loss(process: Tensor, touch: Tensor, motion: Told, force: Told) -> Tensor:
    """Return squared error and beta-weighted likelihood (beta = 1/2) of motion and force together.

    Paper B adds the two as well. Its plain likelihood lets steps that are hard to predict count
    for little, so that they stay so; weighted by the predicted spread they do not. What was
    measured has the likelihood of an observation: its noise adds to the predicted spread.

    Args:
        process: (N, L, 2 MOTION) and
        touch: (N, 2 forces) that the network says, mean and ln std.
        motion: (N, L, MOTION) and its std.
        force: (N, forces) and its std.

    Source: paper B, IV-B2; Seitzer et al. 2022.
    """
    total = _likelihood(process[..., :MOTION], process[..., MOTION:], motion)
    mean, log_std = torch.chunk(touch, 2, dim=-1)
    forces: Tensor = total + _likelihood(mean, log_std, force)
    return forces


def _likelihood(mean: Tensor, log_std: Tensor, told: Told) -> Tensor:
    truth, noise = told
    own = log_std.clamp(*_LOG_STD)
    bounded = 0.5 * torch.log(torch.exp(2.0 * own) + noise**2)
    error = nn.functional.huber_loss(mean, truth, reduction="none", delta=1.0)
    surprise = 0.5 * ((truth - mean) * torch.exp(-bounded)) ** 2 + bounded
    return (error + surprise * torch.exp(bounded).detach()).mean()


def output_units(examples: Sequence[Examples]) -> tuple[Array, Array]:
    """Units (MOTION,) of velocities and (forces,) of forces: their root mean squares."""
    motion = np.concatenate([e.motion.reshape(-1, MOTION) for e in examples])
    force = np.concatenate([e.force for e in examples])
    return _root_mean_square(motion), _root_mean_square(force)


def _root_mean_square(values: Array) -> Array:
    return np.asarray(np.sqrt(np.mean(np.square(values), axis=0)) + _SPREAD_FLOOR)


@dataclass
class _Run:
    """A training that goes on: network, optimiser, where it is."""

    network: StepNetwork
    optimiser: torch.optim.Optimizer
    schedule: torch.optim.lr_scheduler.LRScheduler
    epoch: int = 0


def train_graph(
    about: GraphWeights,
    examples: Sequence[Examples],
    held_out: Sequence[Examples],
    config: GraphTrainingConfig | None = None,
    report: Report | None = None,
    checkpoint: str | None = None,
    make: Callable[[GraphWeights, int], StepNetwork] = GraphNetwork,
) -> GraphWeights:
    """Train on examples, each item of another number of links.

    Args:
        about: kind, step, speed, origin and, by the length of `force_scale`, what the robot feels
            of the network to be; its nets are not read. The result is of its class, whose `outputs`
            has to agree with what `make` makes.
        examples: to train on.
        held_out: of other objects; their loss is only reported.
        config: size and length.
        report: called with the epoch, the loss, and that of the held-out steps.
        checkpoint: file from which an interrupted training goes on, and where it is kept.
        make: untrained network, from `about` and a width.
    """
    config = config or GraphTrainingConfig()
    units = output_units(examples)
    parts = [_tensors(part, units) for part in examples]
    others = [_tensors(part, units) for part in held_out]
    steps = sum(-(-len(part[0]) // config.batch) for part in parts)
    torch.manual_seed(config.seed)
    run = _begin(make(about, config.width), config, steps, checkpoint)
    while run.epoch < config.epochs:
        loss = _epoch(run, parts, config)
        if report is not None:
            report(run.epoch, loss, _held_out_loss(run.network, others))
        if checkpoint is not None:
            _keep(run, checkpoint)
    nets = _plain(run.network)
    return replace(about, nets=nets, motion_scale=units[0], force_scale=units[1])


def _begin(
    network: StepNetwork, config: GraphTrainingConfig, steps: int, checkpoint: str | None
) -> _Run:
    optimiser = torch.optim.Adam(network.parameters(), lr=config.learning_rate)
    schedule = torch.optim.lr_scheduler.OneCycleLR(
        optimiser, config.learning_rate, config.epochs * steps, pct_start=_WARM_UP,
        cycle_momentum=False,
    )  # fmt: skip
    run = _Run(network, optimiser, schedule)
    if checkpoint is not None:
        _resume(run, checkpoint)
    return run


def _resume(run: _Run, checkpoint: str) -> None:
    try:
        kept = torch.load(checkpoint, weights_only=True)
    except FileNotFoundError:
        return
    run.network.load_state_dict(kept["network"])
    run.optimiser.load_state_dict(kept["optimiser"])
    run.schedule.load_state_dict(kept["schedule"])
    run.epoch = kept["epoch"]


def _keep(run: _Run, checkpoint: str) -> None:
    torch.save(
        {
            "network": run.network.state_dict(),
            "optimiser": run.optimiser.state_dict(),
            "schedule": run.schedule.state_dict(),
            "epoch": run.epoch,
        },
        checkpoint,
    )


def _tensors(part: Examples, units: tuple[Array, Array]) -> tuple[Tensor, ...]:
    motion, force = (
        (value / unit, std / unit)
        for value, std, unit in (
            (part.motion, part.noise.motion, units[0]),
            (part.force, part.noise.force, units[1]),
        )
    )
    values = (part.nodes, part.edges, *motion, *force)
    return tuple(torch.from_numpy(value.astype(np.float32)) for value in values)


def _epoch(run: _Run, parts: list[tuple[Tensor, ...]], config: GraphTrainingConfig) -> float:
    """Pass once over all examples in an order that the epoch decides; return the mean loss."""
    draw = torch.Generator().manual_seed(1000 * config.seed + run.epoch)
    batches = [
        (part, rows)
        for part in parts
        for rows in torch.split(torch.randperm(len(part[0]), generator=draw), config.batch)
    ]
    losses = []
    for k in torch.randperm(len(batches), generator=draw).tolist():
        part, rows = batches[k]
        nodes, edges, motion, motion_std, force, force_std = (values[rows] for values in part)
        run.optimiser.zero_grad()
        process, touch = run.network(nodes, edges)
        loss = step_loss(process, touch, (motion, motion_std), (force, force_std))
        torch.autograd.backward(loss)
        nn.utils.clip_grad_norm_(run.network.parameters(), _LARGEST_GRADIENT)
        run.optimiser.step()
        run.schedule.step()
        losses.append(float(loss.detach()))
    run.epoch += 1
    return float(np.mean(losses))


def _held_out_loss(network: StepNetwork, parts: list[tuple[Tensor, ...]]) -> float:
    losses = []
    with torch.no_grad():
        for nodes, edges, motion, motion_std, force, force_std in parts:
            process, touch = network(nodes, edges)
            told = (motion, motion_std), (force, force_std)
            losses.append(float(step_loss(process, touch, *told)))
    return float(np.mean(losses))


def _plain(network: StepNetwork) -> dict[str, tuple[tuple[Array, Array], ...]]:
    """Layers of the nets as a file of single precision gives them back."""
    return {
        name: tuple(
            (
                layer.weight.detach().numpy().T.astype(float),
                layer.bias.detach().numpy().astype(float),
            )
            for layer in net.children()
            if isinstance(layer, nn.Linear)
        )
        for name, net in network.nets.items()
    }
