"""Train noise nets by the likelihood of errors whose truth is known."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor, nn

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.configuration import check_ranges, parameter
from tactile_dynamics_ros.core.planar.network.noise import (
    LOG_FACTOR,
    STRIDES,
    NoiseNet,
    convolved_size,
)

_KERNELS, _CHANNELS = (5, 3), (6, 12)
"""Sides and outputs of the two convolutions of a crop: some 10 000 weights, of which 600 are in the
convolutions. The paper says three layers and no sizes."""
_SPREAD = 1e-3
"""Least standard deviation of a feature: one that never changes would divide by nothing."""
_MOST = 5.0
"""Error over its predicted std, beyond which it counts linearly: jumps to another of the turns that
look alike must not widen all looks."""


@dataclass(frozen=True)
class NoiseTrainingConfig:
    """Size of a net and of its training."""

    width: int = parameter(24, "hidden units of each of the two layers", "", 2, 256)
    epochs: int = parameter(60, "passes over the examples", "", 1, 10000)
    batch: int = parameter(256, "examples per step of the optimiser", "", 8, 65536)
    learning_rate: float = parameter(3e-3, "largest step size", "", 1e-6, 1.0)
    decay: float = parameter(1e-2, "of weights, against learning single recordings", "", 0.0, 1.0)
    seed: int = parameter(0, "of initial weights and order", "", 0)

    def __post_init__(self) -> None:
        check_ranges(self)


@dataclass(frozen=True, eq=False)
class NoiseExamples:
    """What a net learns from.

    Attributes:
        features: (N, n). crops: (N, CROP, CROP) or None.
        errors: (N, k, d) over their stated standard deviations, d of each of k factors, NaN where
            one is not to be learnt from.
        granted: (N, k, d) variance that they have anyway, in the same units: what a filter expects
            to be off by its own belief, along axes in which it is independent.
    """

    features: Array
    crops: Array | None
    errors: Array
    granted: Array

    def __len__(self) -> int:
        return len(self.features)


class NoiseNetwork(nn.Module):
    """`NoiseNet` in torch.

    Args:
        features: beside a crop. factors: outputs. width: hidden units.
        crop: whether there is a crop.
    """

    def __init__(self, features: int, factors: int, width: int, crop: bool) -> None:
        super().__init__()
        sizes = zip((1, _CHANNELS[0]), _CHANNELS, _KERNELS, STRIDES, strict=True)
        self.convolutions = nn.ModuleList(
            nn.Conv2d(a, b, size, stride) for a, b, size, stride in sizes if crop
        )
        inputs = features + (_CHANNELS[-1] * convolved_size(_KERNELS) ** 2 if crop else 0)
        self.layers = nn.Sequential(
            nn.Linear(inputs, width), nn.SiLU(),
            nn.Linear(width, width), nn.SiLU(),
            nn.Linear(width, factors),
        )  # fmt: skip

    def forward(self, features: Tensor, crops: Tensor | None = None) -> Tensor:
        """Return ln of factors (N, k) from standardised features (N, n)."""
        if crops is not None:
            value = crops[:, None]
            for convolution in self.convolutions:
                value = nn.functional.silu(convolution(value))
            features = torch.cat([value.flatten(1), features], dim=1)
        found: Tensor = self.layers(features)
        return found.clamp(*LOG_FACTOR)

    def plain(self, middle: Array, scale: Array) -> NoiseNet:
        """Return the net as numpy runs it."""
        linear = [layer for layer in self.layers if isinstance(layer, nn.Linear)]
        kernels = [each for each in self.convolutions if isinstance(each, nn.Conv2d)]
        return NoiseNet(
            middle,
            scale,
            tuple(_plain(each) for each in kernels),
            tuple((matrix.T, bias) for matrix, bias in map(_plain, linear)),
        )


def _plain(layer: nn.Linear | nn.Conv2d) -> tuple[Array, Array]:
    """Matrix or kernel, and bias."""
    assert layer.bias is not None
    matrix, bias = (part.detach().numpy().astype(float) for part in (layer.weight, layer.bias))
    return matrix, bias


def noise_loss(log_factor: Tensor, errors: Tensor, granted: Tensor) -> Tensor:
    """Mean of -ln N(error | 0, factor^2 + granted), far errors as of a Laplace tail.

    Without the constant. Source: paper B, IV-B2 (likelihood of observations).
    """
    known = torch.isfinite(errors)
    variance = torch.exp(2.0 * log_factor)[..., None] + granted
    white = torch.where(known, errors, 0.0) / torch.sqrt(variance)
    surprise = nn.functional.huber_loss(
        white, torch.zeros_like(white), reduction="none", delta=_MOST
    )
    each = (surprise + 0.5 * torch.log(variance)) * known
    return each.sum() / known.sum()


def train_noise(examples: NoiseExamples, config: NoiseTrainingConfig | None = None) -> NoiseNet:
    """Train one net."""
    config = config or NoiseTrainingConfig()
    torch.manual_seed(config.seed)
    middle, scale = examples.features.mean(axis=0), examples.features.std(axis=0) + _SPREAD
    features = _tensor((examples.features - middle) / scale)
    crops = None if examples.crops is None else _tensor(examples.crops)
    errors, granted = _tensor(examples.errors), _tensor(examples.granted)
    network = NoiseNetwork(
        features.shape[1], errors.shape[1], config.width, examples.crops is not None
    )
    optimiser = torch.optim.AdamW(
        network.parameters(), lr=config.learning_rate, weight_decay=config.decay
    )
    steps = config.epochs * -(-len(examples) // config.batch)
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimiser, config.learning_rate, steps)
    draw = torch.Generator().manual_seed(config.seed)
    for _ in range(config.epochs):
        for rows in torch.split(torch.randperm(len(examples), generator=draw), config.batch):
            optimiser.zero_grad()
            found = network(features[rows], None if crops is None else crops[rows])
            loss = noise_loss(found, errors[rows], granted[rows])
            torch.autograd.backward(loss)
            optimiser.step()
            schedule.step()
    return network.plain(middle, scale)


def _tensor(values: Array) -> Tensor:
    return torch.from_numpy(values.astype(np.float32))
