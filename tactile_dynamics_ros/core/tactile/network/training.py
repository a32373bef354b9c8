"""Train the force network on labelled presses and calibrate its uncertainty."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
import torch
from torch import Tensor, nn

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.configuration import check_ranges, parameter
from tactile_dynamics_ros.core.tactile.calibration import (
    MIRROR_AXES,
    NORMAL_90,
    LabelledPresses,
)
from tactile_dynamics_ros.core.tactile.network.weights import (
    INPUTS,
    PLACE_SCALE,
    SMALLEST_STD,
    STRENGTH_KNOTS,
    NetworkWeights,
    as_stored,
    face_left,
    lagged,
    network_inputs,
    predict_presses,
)

_QUINTIC = (3.4445, -4.7750, 2.0315)
"""Coefficients of an odd polynomial that, applied five times, takes (0.02, 1] near one. Source:
Jordan et al., 2024. Other coefficients leave singular values farther from one or need more rounds,
which makes the steps of training unequal."""


class Muon(torch.optim.Optimizer):
    """Steps of equal size along all singular directions of the momentum of each matrix.

    M <- mu M + (1 - mu) G, W <- (1 - lr decay) W - lr sqrt(max(1, rows / columns)) orth(N), where
    N = mu M + (1 - mu) G and orth(U S V^T) is about U V^T. In single precision: the optimiser of
    this name in torch works in bfloat16, some thirty times slower on processors without it.

    Args:
        matrices: parameters of two dimensions.
        lr: size of a step, in the spectral norm.
        momentum: mu. weight_decay: decay.

    Source: Jordan et al., 2024 (Muon); Newton-Schulz iteration after Bernstein and Newhouse, 2024.
    """

    def __init__(
        self,
        matrices: Iterable[nn.Parameter],
        lr: float = 0.02,
        momentum: float = 0.95,
        weight_decay: float = 0.0,
    ) -> None:
        super().__init__(matrices, {"lr": lr, "momentum": momentum, "weight_decay": weight_decay})

    @torch.no_grad()
    def step(self, closure: Callable[[], float] | None = None) -> None:  # type: ignore[override]
        """Move every matrix by one step; ``closure`` is not used."""
        for group in self.param_groups:
            for matrix in group["params"]:
                state = self.state[matrix]
                if not state:
                    state["mean"] = torch.zeros_like(matrix)
                state["mean"].lerp_(matrix.grad, 1.0 - group["momentum"])
                ahead = matrix.grad.lerp(state["mean"], group["momentum"])
                stretch = max(1.0, matrix.shape[0] / matrix.shape[1]) ** 0.5
                matrix.mul_(1.0 - group["lr"] * group["weight_decay"])
                matrix.sub_(orthogonalise(ahead), alpha=group["lr"] * stretch)


def orthogonalise(matrix: Tensor, iterations: int = 5) -> Tensor:
    """Return about U V^T (n, m) of a matrix U S V^T (n, m), singular values between 0.7 and 1.2.

    X <- a X + (b X X^T + c (X X^T)^2) X from X = matrix / |matrix|_F.

    Args:
        matrix: (n, m), not zero.
        iterations: enough for singular values above 1 / 50 of the norm.
    """
    a, b, c = _QUINTIC
    tall = matrix.shape[0] > matrix.shape[1]
    found: Tensor = matrix.T if tall else matrix
    found = found / (found.norm() + 1e-7)
    for _ in range(iterations):
        square = found @ found.T
        found = a * found + (b * square + c * square @ square) @ found
    return found.T if tall else found


OUTPUTS = 10
"""Numbers that the network gives: force (3) and its spread (3), contact point (3) and its spread.
Fixed by these four; fewer leave a quantity untaught."""
_PHASE_STEP = 7
"""Frames by which one sequence is read later than the one before. It has no factor in common with
`TrainingConfig.every` (15), so that all times since the first touch are seen; with one in common
some never are."""
_UNTOUCHED_EVERY = 5
"""One in how many frames without contact is kept: they are many and alike. All of them would make
the network spend itself on zero. Far fewer would let it see forces where there are none."""
_WARM_UP = 0.1
"""Share of the steps in which step sizes rise before they fall as a cosine (OneCycle schedule,
whose own default is 0.3). It was not tuned: what another share does to the trained network has not
been measured."""
_LARGEST_GRADIENT = 3.0
"""Norm to which gradients are cut: a batch with a rare large error must not undo an epoch. Lower
cuts usual batches too, which slows learning; higher lets rare ones through."""


@dataclass(frozen=True)
class TrainingConfig:
    """Size of the network and of its training."""

    width: int = parameter(384, "units of the first three hidden layers", "", 4, 2048)
    epochs: int = parameter(11, "passes over the frames", "", 1, 10000)
    batch: int = parameter(2048, "frames per step", "", 8, 65536)
    every: int = parameter(15, "use every such frame of a sequence", "", 1, 100)
    matrix_rate: float = parameter(0.02, "largest step size of hidden matrices", "", 1e-6, 1.0)
    learning_rate: float = parameter(3e-3, "largest step size of the rest", "", 1e-6, 1.0)
    weight_decay: float = parameter(1e-4, "decay of weights", "", 0.0, 1.0)
    place_share: float = parameter(0.1, "weight of the contact point in the loss", "", 0.0, 10.0)
    seed: int = parameter(0, "seed of initial weights and order of frames", "", 0)

    def __post_init__(self) -> None:
        check_ranges(self)


@dataclass(frozen=True)
class Frames:
    """Frames ready for training: inputs (N, INPUTS), size (N, 1), force (N, 3), point (N, 3)."""

    inputs: Tensor
    size: Tensor
    force: Tensor
    point: Tensor


def prepare_frames(presses: Iterable[LabelledPresses], every: int) -> Frames:
    """Return every ``every``-th frame of all sequences, contacts on the right mirrored to the left.

    Sequences begin at different frames, so that all times since the first touch are seen. Frames
    without contact tell little: of those, every fifth remains.
    """
    rows: list[tuple[Array, ...]] = []
    for part in presses:
        columns = (part.change, part.force, part.point, part.rest)
        for change, force, point, rest in zip(*columns, strict=True):
            taken = np.arange(_PHASE_STEP * len(rows) % every, len(change), every)
            kept_untouched = np.arange(len(taken)) % _UNTOUCHED_EVERY == 0
            taken = taken[force[taken].any(axis=1) | kept_untouched]
            past = lagged(change, part.period)[taken]
            inputs, size = network_inputs(change[taken], past, rest)
            inputs, mirrored = face_left(inputs)
            axes = np.where(mirrored[:, None], MIRROR_AXES, 1.0)
            each = (inputs, size, force[taken] * axes, point[taken] * axes)
            rows.append(tuple(values.astype(np.float32) for values in each))
    return Frames(*(torch.from_numpy(np.concatenate(column)) for column in zip(*rows, strict=True)))


def build_network(width: int) -> nn.Sequential:
    """Return the perceptron INPUTS - width - width - width - width / 2 - 10 with SiLU."""
    sizes = [INPUTS, width, width, width, width // 2]
    layers: list[nn.Module] = []
    for before, after in pairwise(sizes):
        layers += [nn.Linear(before, after), nn.SiLU()]
    return nn.Sequential(*layers, nn.Linear(sizes[-1], OUTPUTS))


def train_network(
    presses: Iterable[LabelledPresses],
    held_out: LabelledPresses,
    origin: str,
    config: TrainingConfig | None = None,
    report: Callable[[int, float], None] | None = None,
) -> NetworkWeights:
    """Train on ``presses`` and calibrate standard deviations on units of ``held_out``.

    Args:
        presses: to train on, in parts that are not kept.
        held_out: presses of other units.
        origin: description that is stored with the weights.
        config: size and length of the training.
        report: called with the epoch and its mean loss.
    """
    config = config or TrainingConfig()
    torch.manual_seed(config.seed)
    frames = prepare_frames(presses, config.every)
    mean, scale = frames.inputs.mean(dim=0), frames.inputs.std(dim=0) + 1e-3
    network = build_network(config.width)
    steps = config.epochs * -(-len(frames.size) // config.batch)
    advance = _optimise(network, steps, config)
    standard = Frames(frames.inputs.sub_(mean).div_(scale), frames.size, frames.force, frames.point)
    for epoch in range(config.epochs):
        losses = []
        order = torch.randperm(len(frames.size))
        for start in range(0, len(order), config.batch):
            rows = order[start : start + config.batch]
            batch = Frames(*(getattr(standard, name)[rows] for name in _FIELDS))
            network.zero_grad()
            loss = contact_loss(network(batch.inputs), batch, config.place_share)
            torch.autograd.backward(loss)
            advance()
            losses.append(float(loss.detach()))
        if report is not None:
            report(epoch, float(np.mean(losses)))
    return calibrate_intervals(_plain_weights(network, mean, scale, origin), held_out)


def _optimise(network: nn.Sequential, steps: int, config: TrainingConfig) -> Callable[[], None]:
    """Return what moves the network by a step: hidden matrices by Muon, the rest by Adam.

    Step sizes rise over the first tenth of ``steps`` and fall to zero as a cosine.
    """
    *hidden, output = [weight for weight in network.parameters() if weight.ndim == 2]
    biases = [bias for bias in network.parameters() if bias.ndim == 1]
    optimisers: list[torch.optim.Optimizer] = [
        Muon(hidden, lr=config.matrix_rate, weight_decay=config.weight_decay),
        torch.optim.Adam([*biases, output], lr=config.learning_rate),
    ]
    schedules = [
        torch.optim.lr_scheduler.OneCycleLR(
            each, each.defaults["lr"], steps, pct_start=_WARM_UP, cycle_momentum=False
        )
        for each in optimisers
    ]

    def advance() -> None:
        nn.utils.clip_grad_norm_(network.parameters(), _LARGEST_GRADIENT)
        for optimiser, schedule in zip(optimisers, schedules, strict=True):
            optimiser.step()
            schedule.step()

    return advance


_FIELDS = ("inputs", "size", "force", "point")
"""Arrays of a batch. Fixed by `Frames`; one that is missing here cannot be trained on."""


def contact_loss(output: Tensor, frames: Frames, place_share: float) -> Tensor:
    """Return the beta-weighted Gaussian likelihood of force and contact point, beta = 1/2.

    The force counts by 1 / (|f| + 0.3 N), so that directions of light and firm contacts count
    alike. Weak contacts say little about their place, so the point counts by |f| / (|f| + 0.2 N).

    Source: Seitzer et al., 2022 (beta negative log-likelihood).
    """
    std = frames.size * (nn.functional.softplus(output[:, 3:6]) + 0.01 * SMALLEST_STD)
    force_loss = _likelihood(frames.size * output[:, :3] - frames.force, std)
    place_std = nn.functional.softplus(output[:, 9:10]) + 0.02
    place_loss = _likelihood(output[:, 6:9] - frames.point / PLACE_SCALE, place_std)
    strength = frames.force.norm(dim=1, keepdim=True)
    force_loss = force_loss / (strength + 0.3)
    touched = strength / (strength + 0.2)
    total: Tensor = force_loss.mean() + place_share * (touched * place_loss).mean()
    return total


def _likelihood(error: Tensor, std: Tensor) -> Tensor:
    return std.detach() * (0.5 * (error / std) ** 2 + std.log())


def _plain_weights(
    network: nn.Sequential, mean: Tensor, scale: Tensor, origin: str
) -> NetworkWeights:
    """Return weights, as a file gives them back, with standard deviations as learnt."""
    linear = [layer for layer in network if isinstance(layer, nn.Linear)]
    layers = tuple(
        (as_stored(layer.weight.detach().numpy().T), as_stored(layer.bias.detach().numpy()))
        for layer in linear
    )
    knots = len(STRENGTH_KNOTS)
    learnt = np.ones((knots, 3)), np.ones(knots)
    return NetworkWeights(mean.numpy(), scale.numpy(), layers, *learnt, origin)


def calibrate_intervals(plain: NetworkWeights, held_out: LabelledPresses) -> NetworkWeights:
    """Return weights whose 90 % intervals hold on held-out units, in every band of force."""
    found = predict_presses(held_out, plain)
    force = np.concatenate([each.force for each in found])
    strength = np.linalg.norm(force, axis=1)
    _, truth, place = held_out.frames()
    error = np.abs(force - truth) / np.concatenate([each.std for each in found])
    gap = np.linalg.norm(np.concatenate([each.point for each in found]) - place, axis=1)
    place_error = gap / np.sqrt(3.0) / np.concatenate([each.point_std for each in found])
    return replace(
        plain,
        force_temperature=np.stack([_knot_factors(strength, axis) for axis in error.T], axis=1),
        place_temperature=_knot_factors(strength, place_error),
    )


def _knot_factors(strength: Array, error: Array) -> Array:
    """Return (7,) factors: 90 % quantile of normalised errors around each knot over 1.645."""
    factors = np.ones(len(STRENGTH_KNOTS))
    edges = np.concatenate([[-1.0], 0.5 * (STRENGTH_KNOTS[1:] + STRENGTH_KNOTS[:-1]), [np.inf]])
    for k, (low, high) in enumerate(zip(edges[:-1], edges[1:], strict=True)):
        inside = (strength >= low) & (strength < high)
        if inside.sum() > 50:
            factors[k] = float(np.quantile(error[inside], 0.9)) / NORMAL_90
        elif k > 0:
            factors[k] = factors[k - 1]
    return factors
