"""The published networks to compare with: voxel convolutions, and multi-sample dropout heads.

Source: Sundaralingam et al., 2019 (electrodes in a 16 x 16 x 8 voxel grid with a contact voxel,
3-D convolutions, dense layers of 64, 32 and 3) and paper A, Sec. III (ten dropout heads that share
their weights, keep rate 0.7, loss weighted by alignment with the surface normal).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.configuration import check_ranges, parameter
from tactile_dynamics_ros.core.shape.skin_surface import skin_normal
from tactile_dynamics_ros.core.tactile.analytic_force import electrode_centroid
from tactile_dynamics_ros.core.tactile.calibration import LabelledPresses
from tactile_dynamics_ros.core.tactile.electrodes import ELECTRODE_POSITION

GRID = (16, 16, 8)
LOWER = np.array([-15e-3, -7.2e-3, -7.2e-3])
UPPER = np.array([7.2e-3, 7.2e-3, 0.0])
HEADS = 10
KEEP = 0.7


@dataclass(frozen=True)
class VoxelConfig:
    """Training of the voxel network."""

    heads: int = parameter(HEADS, "dropout heads; 1 is the network of 2019", "", 1, 100)
    epochs: int = parameter(8, "passes over the frames", "", 1, 1000)
    batch: int = parameter(512, "frames per step", "", 8, 65536)
    every: int = parameter(8, "use every such frame of a sequence", "", 1, 100)
    learning_rate: float = parameter(2e-3, "largest step size", "", 1e-6, 1.0)
    seed: int = parameter(0, "of initial weights and order of frames", "", 0)

    def __post_init__(self) -> None:
        check_ranges(self)


class VoxelNetwork(nn.Module):
    """Convolutions over a voxel grid, dense layers, and one or many dropout heads.

    Args:
        heads: 1 for the network of 2019, more for multi-sample dropout.
    """

    def __init__(self, heads: int = HEADS) -> None:
        super().__init__()
        self.heads = heads
        self.convolutions = nn.Sequential(
            nn.Conv3d(2, 16, 3, stride=2, padding=1),
            nn.ReLU(),
            nn.Conv3d(16, 32, 3, stride=2, padding=1),
            nn.ReLU(),
            nn.Flatten(),
        )
        self.dense = nn.ModuleList([nn.Linear(1024, 64), nn.Linear(64, 32), nn.Linear(32, 3)])
        self.dropout = nn.Dropout(1.0 - KEEP)

    def forward(self, voxels: Tensor) -> Tensor:
        """Return forces (heads, N, 3) for voxels (N, 2, 16, 16, 8)."""
        hidden: Tensor = self.convolutions(voxels)
        if self.heads == 1:
            return self._head(hidden, drop=False)[None]
        return torch.stack([self._head(hidden, drop=True) for _ in range(self.heads)])

    def _head(self, hidden: Tensor, drop: bool) -> Tensor:
        for layer in list(self.dense)[:-1]:
            hidden = torch.relu(layer(self.dropout(hidden) if drop else hidden))
        output: Tensor = self.dense[-1](hidden)
        return output


def fill_voxels(change: Array) -> Tensor:
    """Return the voxel grid (N, 2, 16, 16, 8): electrode changes, and PDC at the contact.

    Args:
        change: (N, 20) tared signals, hundreds of counts.
    """
    grid = np.zeros((len(change), 2, *GRID), dtype=np.float32)
    x, y, z = _voxel_of(ELECTRODE_POSITION).T
    grid[:, 0, x, y, z] = change[:, :19]
    rows = np.arange(len(change))
    x, y, z = _voxel_of(electrode_centroid(change)).T
    grid[rows, 1, x, y, z] = change[:, 19]
    return torch.from_numpy(grid)


def _voxel_of(point: Array) -> NDArray[np.intp]:
    share = (point - LOWER) / (UPPER - LOWER)
    index = np.floor(share * np.array(GRID)).astype(np.intp)
    return np.asarray(np.clip(index, 0, np.array(GRID) - 1))


def alignment_weight(force: Array, normal: Array) -> Array:
    """Return 2^(10 (1 - acos(n . f / |f|) / pi)) / |f|, the weight (N,) of a sample in the loss.

    Args:
        force: (N, 3) N.
        normal: (N, 3) unit vectors into the object.

    Source: paper A, Sec. III.
    """
    strength = np.maximum(np.linalg.norm(force, axis=1), 0.05)
    cosine = np.clip(np.sum(force * normal, axis=1) / strength, -1.0, 1.0)
    return np.asarray(2.0 ** (10.0 * (1.0 - np.arccos(cosine) / np.pi)) / strength)


def train_voxel_network(
    presses: LabelledPresses,
    config: VoxelConfig | None = None,
    report: Callable[[int, float], None] | None = None,
) -> VoxelNetwork:
    """Train on the touching frames of labelled presses."""
    config = config or VoxelConfig()
    torch.manual_seed(config.seed)
    change, force, point = presses.frames(config.every)
    touching = np.linalg.norm(force, axis=1) > 0.02
    change, force, point = change[touching], force[touching], point[touching]
    weight = alignment_weight(force, skin_normal(point))
    target = torch.tensor(force, dtype=torch.float32)
    share = torch.tensor(weight / weight.mean(), dtype=torch.float32)[:, None]
    network = VoxelNetwork(config.heads)
    optimiser = torch.optim.Adam(network.parameters(), lr=config.learning_rate)
    steps = config.epochs * (len(change) // config.batch + 1)
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimiser, config.learning_rate, steps)
    for epoch in range(config.epochs):
        losses = []
        order = torch.randperm(len(change))
        for start in range(0, len(order), config.batch):
            rows = order[start : start + config.batch]
            optimiser.zero_grad()
            error = network(fill_voxels(change[rows.numpy()])) - target[rows]
            loss = (share[rows] * error**2).mean()
            torch.autograd.backward(loss)
            optimiser.step()
            schedule.step()
            losses.append(float(loss.detach()))
        if report is not None:
            report(epoch, float(np.mean(losses)))
    return network


def predict_voxel(network: VoxelNetwork, change: Array, chunk: int = 4096) -> tuple[Array, Array]:
    """Return force and the spread of the heads (N, 3), N, for tared signals (N, 20)."""
    found = []
    with torch.no_grad():
        for start in range(0, len(change), chunk):
            found.append(network(fill_voxels(change[start : start + chunk])))
    heads = torch.cat(found, dim=1).double().numpy()
    spread = heads.std(axis=0) if len(heads) > 1 else np.zeros(heads.shape[1:])
    return heads.mean(axis=0), spread
