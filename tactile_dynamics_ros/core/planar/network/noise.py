"""Noise nets: by which factor the stated standard deviation of a pose or a force is off."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.files import write_arrays
from tactile_dynamics_ros.core.planar.filter.observation import MeasuredWrench, relative_std
from tactile_dynamics_ros.core.planar.filter.process import PusherMotion
from tactile_dynamics_ros.core.planar.network.noise_features import (
    LOOK,
    TOUCH,
    Looked,
    Touched,
    TouchHistory,
)
from tactile_dynamics_ros.core.planar.network.weights import Layers, perceptron
from tactile_dynamics_ros.core.reading import open_arrays

Kernels = tuple[tuple[Array, Array], ...]

CROP = 64
"""Pixels of each side of the depth crop, as in the paper; the matrices of the net have its size."""
STRIDES = (4, 2)
"""Steps of the two convolutions: crops become 16 x 16, then 7 x 7. Smaller ones cost time."""
LOG_FACTOR = (float(np.log(1.0 / 3.0)), float(np.log(30.0)))
"""Bounds of ln(factor): a look may be three times better than stated, and a force that a start or
a lost touch spoils thirty times worse. Wider ones let rare steps rule the training."""
_LEAST = 1e-3
"""Least standard deviation of a force, N, that is left to its sensor beside the mechanics' share of
it: no covariance may become singular."""
_SHIPPED = Path(__file__).parent / "noise.npz"
"""File of the weights that come with the package; `train pushing --noise` makes it."""
_NAMES = {"touch": (TOUCH, 1), "look": (LOOK, 2), "crop": (2, 2)}
"""Nets by name: features beside a crop, and factors. Fixed by what calls them."""


@dataclass(frozen=True, eq=False)
class NoiseNet:
    """One net.

    Attributes:
        middle, scale: (n,) that standardise the features.
        kernels: of convolutions, (out, in, k, k) and (out,) each, SiLU after each; of a crop.
        layers: of the perceptron after them, matrix (n_in, n_out) and bias (n_out,).
    """

    middle: Array
    scale: Array
    kernels: Kernels
    layers: Layers

    def log_factor(self, features: Array, crops: Array | None = None) -> Array:
        """(N, n_out) ln of factors, from features (N, n) and crops (N, CROP, CROP)."""
        inputs = (features - self.middle) / self.scale
        if crops is not None:
            inputs = np.concatenate([_convolved(self.kernels, crops), inputs], axis=1)
        return np.asarray(np.clip(perceptron(self.layers, inputs), *LOG_FACTOR))


@dataclass(frozen=True, eq=False)
class NoiseWeights:
    """Trained noise nets.

    Attributes:
        nets: touch, look (from visible share, point count and residual) and, where it was trained,
            crop (from a depth crop instead of those).
        origin: the command that made them.
    """

    nets: dict[str, NoiseNet]
    origin: str

    def touch_factor(self, touched: Touched) -> Array:
        """(N,) by which stated standard deviations of forces are off."""
        return np.asarray(np.exp(self.nets["touch"].log_factor(touched.features)[:, 0]))

    def look_factor(self, looked: Looked) -> Array:
        """(N, 2) by which those of place and yaw are off."""
        found = np.exp(self.nets["look"].log_factor(looked.features))
        return np.asarray(np.where(looked.known, found, 1.0))

    def crop_factor(self, looked: Looked, crops: Array) -> Array:
        """(N, 2) the same from crops (N, CROP, CROP) and the stated std alone."""
        found = np.exp(self.nets["crop"].log_factor(looked.features[:, -2:], crops))
        return np.asarray(np.where(looked.known, found, 1.0))

    def look_std(self, looked: Looked) -> Array:
        """(N, 3) standard deviations of x, y and yaw, corrected."""
        return np.asarray(looked.std * self.look_factor(looked)[:, [0, 0, 1]])

    def save(self, path: Path) -> None:
        """Write as a compressed npz file."""
        arrays: dict[str, Any] = {"origin": np.array(self.origin)}
        for name, net in self.nets.items():
            arrays |= {f"{name}_middle": net.middle, f"{name}_scale": net.scale}
            for part, rows in (("kernel", net.kernels), ("layer", net.layers)):
                for k, (matrix, bias) in enumerate(rows):
                    arrays[f"{name}_{part}_{k}"] = matrix.astype(np.float32)
                    arrays[f"{name}_{part}_bias_{k}"] = bias.astype(np.float32)
        write_arrays(path, arrays)

    @classmethod
    def load(cls, path: Path) -> NoiseWeights:
        """Read what `save` wrote.

        Raises:
            BadInputError: the file is missing, or holds no such nets or those of another version.
        """
        with open_arrays(path, "noise nets") as content:
            names = [name for name in _NAMES if f"{name}_middle" in content.files]
            nets = {name: _net(content, name) for name in names}
            if not {"touch", "look"} <= set(names):
                raise ValueError("no noise nets")
            return cls(nets, str(content["origin"]))


class TouchNoise:
    """Gives forces the standard deviations of a noise net; a `filter.observation.ForceNoise`.

    Args:
        model: the nets.
    """

    def __init__(self, model: NoiseWeights) -> None:
        self._model, self._history = model, TouchHistory()

    def end(self) -> None:
        """Nothing was touched in this step."""
        self._history.end()

    def measured(
        self, motion: PusherMotion, measured: MeasuredWrench | None, share: float, state: Array
    ) -> MeasuredWrench | None:
        """The force of a step with its corrected std, less what mechanics miss."""
        touched = self._history.next(motion, measured, share, state)
        if measured is None or touched is None:
            return measured
        whole = float(self._model.touch_factor(touched)[0] * touched.stated[0])
        own = np.sqrt(max(whole**2 - float(relative_std(touched.force)[0]) ** 2, _LEAST**2))
        return MeasuredWrench(measured.value, np.full(len(measured.value), own))


def _net(content: Any, name: str) -> NoiseNet:
    middle = content[f"{name}_middle"].astype(float)
    if len(middle) != _NAMES[name][0]:
        raise ValueError(f"{name} has {len(middle)} features, wanted {_NAMES[name][0]}")
    kernels, layers = (
        tuple(
            (content[f"{name}_{part}_{k}"].astype(float),
             content[f"{name}_{part}_bias_{k}"].astype(float))
            for k in range(sum(f.startswith(f"{name}_{part}_bias_") for f in content.files))
        )
        for part in ("kernel", "layer")
    )  # fmt: skip
    return NoiseNet(middle, content[f"{name}_scale"].astype(float), kernels, layers)


def _convolved(kernels: Kernels, crops: Array) -> Array:
    """(N, F) of crops (N, H, W): cross-correlations with steps, x / (1 + exp(-x)) after each."""
    value = crops[:, None]
    for (kernel, bias), stride in zip(kernels, STRIDES, strict=True):
        size = kernel.shape[-1]
        parts = sliding_window_view(value, (size, size), axis=(2, 3))[:, :, ::stride, ::stride]
        value = np.einsum("ncyxij,ocij->noyx", parts, kernel, optimize=True)
        value = value + bias[:, None, None]
        value = value / (1.0 + np.exp(-value))
    return value.reshape(len(value), -1)


def convolved_size(sizes: Sequence[int]) -> int:
    """Pixels of each side after convolutions with kernels of the given sizes."""
    side = CROP
    for size, stride in zip(sizes, STRIDES, strict=True):
        side = (side - size) // stride + 1
    return side


def depth_crop(depth: Array, intrinsics: Array, centre: Array, radius: float) -> Array:
    """Square crop (CROP, CROP) of a depth image around a sphere, in units of its radius.

    Depths count from the centre, cut at two radii; pixels without a depth or outside are 2: as far
    as the table behind.

    Args:
        depth: (H, W) m, NaN where invalid.
        intrinsics: (3, 3) of the camera.
        centre: (3,) m, camera frame, of the sphere.
        radius: m.
    """
    height, width = depth.shape
    middle = (intrinsics @ centre)[:2] / centre[2]
    half = intrinsics[0, 0] * radius / centre[2]
    grid = half * (2.0 * (np.arange(CROP) + 0.5) / CROP - 1.0)
    column, row = (np.rint(m + grid).astype(int) for m in middle)
    inside = ((row >= 0) & (row < height))[:, None] & ((column >= 0) & (column < width))[None]
    found = depth[np.clip(row, 0, height - 1)[:, None], np.clip(column, 0, width - 1)[None]]
    unit = np.clip((found - centre[2]) / radius, -2.0, 2.0)
    return np.where(inside & np.isfinite(unit), unit, 2.0)


@lru_cache(maxsize=1)
def shipped_noise() -> NoiseWeights:
    """Return the noise nets that come with the package."""
    return NoiseWeights.load(_SHIPPED)


def shipped_noise_file() -> Path:
    """Where they are."""
    return _SHIPPED
