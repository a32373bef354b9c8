"""Weights of the force network and its forward pass in numpy."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.files import write_arrays
from tactile_dynamics_ros.core.reading import open_arrays
from tactile_dynamics_ros.core.shape.skin_surface import project_to_skin
from tactile_dynamics_ros.core.tactile.calibration import MIRROR_AXES
from tactile_dynamics_ros.core.tactile.network.inputs import INPUTS, face_left

Array = NDArray[np.float64]
Single = NDArray[np.float32]

SHIPPED_NETWORK = Path(__file__).parent.parent / "data" / "force_network.npz"
"""File of the weights that come with the package; `tactile-dynamics train biotac --seed 0` makes
them again. Another file is another sensor model; `train --out` writes one."""

SMALLEST_STD = 0.3
"""Lower bound of the force's standard deviation in hundredths of a newton per unit of size: without
one the likelihood rewards single frames that are met exactly. The calibration on other units scales
what comes out. Higher overstates the error of light touches, which calibration then scales down for
all; lower lets training run after single frames."""

PLACE_SCALE = 1e-3
"""Unit of the network's contact point, m: millimetres, so that all outputs are of the order of one.
Another unit needs another network; with metres its spread would be a thousandth of the other
outputs and hardly be learnt."""
_MIRROR_OUTPUTS = np.concatenate([MIRROR_AXES, np.ones(3), MIRROR_AXES, np.ones(1)])
"""Signs of force (3), std (3), contact point (3) and its std on a sensor mirrored in y. Fixed by
`MIRROR_AXES` and the order of the outputs; standard deviations have no sign."""
STRENGTH_KNOTS = np.array([0.0, 0.2, 0.5, 1.0, 2.0, 3.0, 5.0])
"""Forces (N) at which the calibration of standard deviations is stated, linear in between and
constant beyond: dense below 1 N, where touches begin and errors change most, up to 5 N, near the
strongest press of training (6 N). More knots are calibrated by fewer frames each and follow their
chance, fewer average light and firm touches; the shipped network has seven."""
_KNOT_GAPS = np.diff(STRENGTH_KNOTS)
"""Distances between neighbouring knots, N. They follow from the knots."""

_SPREADS = np.array([3, 4, 5, 9])
"""Places of the spreads among the outputs: force (3), contact point. Fixed by the order of the
outputs, as training has it."""
_SMALLEST_SPREADS = np.array([0.01 * SMALLEST_STD] * 3 + [0.02])
"""Lower bounds of the spreads of force (3), N per unit of size, and of contact point, mm:
`SMALLEST_STD`, and 0.02 mm. Training has the same; others here alone would state other errors than
were calibrated."""


@dataclass(frozen=True)
class Prediction:
    """Contacts (...) as the network sees them.

    Attributes:
        force: (..., 3) N. std: (..., 3) N. point: (..., 3) m. point_std: (...) m.
    """

    force: Array
    std: Array
    point: Array
    point_std: Array


@dataclass(frozen=True)
class NetworkWeights:
    """A multilayer perceptron with standardised inputs and calibrated uncertainty.

    Attributes:
        mean, scale: (INPUTS,) mean and scale of the inputs.
        layers: matrix (n_in, n_out) and bias (n_out,) per layer; SiLU, x / (1 + exp(-x)), between
            them. They are kept to half precision in the file.
        force_temperature: (7, 3) factors on the force std at STRENGTH_KNOTS.
        place_temperature: (7,) factors on the point std.
        origin: what it was trained on.
    """

    mean: Single
    scale: Single
    layers: tuple[tuple[Single, Single], ...]
    force_temperature: Array
    place_temperature: Array
    origin: str

    def evaluate(self, inputs: Array, size: Array) -> Prediction:
        """Return contacts for inputs (..., INPUTS) and signal sizes (..., 1).

        f = size o_1..3, std = size (softplus(o_4..6) + floor) temperature(|f|). The perceptron p
        knows the left half of the sensor; on the right, o(x) = M p(M x) with the mirror image M.
        """
        left, mirrored = face_left(inputs)
        signs: Array = np.where(mirrored[..., None], _MIRROR_OUTPUTS, 1.0)
        output = self._perceptron(left) * signs
        force = size * output[..., :3]
        factors = interpolate(self._temperature, np.sqrt((force**2).sum(axis=-1)))
        spread = np.logaddexp(0.0, output.take(_SPREADS, axis=-1)) + _SMALLEST_SPREADS
        std = spread * factors
        place = project_to_skin(PLACE_SCALE * output[..., 6:9])
        return Prediction(force, size * std[..., :3], place, PLACE_SCALE * std[..., 3])

    @cached_property
    def _temperature(self) -> Array:
        return np.column_stack([self.force_temperature, self.place_temperature])

    def _perceptron(self, inputs: Array) -> Single:
        hidden = ((inputs - self.mean) / self.scale).astype(np.float32)
        with np.errstate(over="ignore"):
            for matrix, bias in self.layers[:-1]:
                value = hidden @ matrix + bias
                hidden = value / (1.0 + np.exp(-value))
        matrix, bias = self.layers[-1]
        output: Single = hidden @ matrix + bias
        return output

    def save(self, path: Path) -> None:
        """Write as a compressed npz file."""
        arrays: dict[str, NDArray[Any]] = {
            f"matrix_{k}": layer[0].astype(np.float16) for k, layer in enumerate(self.layers)
        }
        arrays |= {f"bias_{k}": layer[1].astype(np.float16) for k, layer in enumerate(self.layers)}
        arrays |= {"mean": self.mean, "scale": self.scale, "origin": np.array(self.origin)}
        arrays["force_temperature"] = self.force_temperature
        arrays["place_temperature"] = self.place_temperature
        write_arrays(path, arrays)

    @classmethod
    def load(cls, path: Path) -> NetworkWeights:
        """Read what `save` wrote.

        Raises:
            BadInputError: the file is missing, or holds no such network or one of another version.
        """
        with open_arrays(path, "a network") as content:
            if len(content["mean"]) != INPUTS:
                raise ValueError(
                    f"made for {len(content['mean'])} inputs, this version has {INPUTS}; "
                    "train again (tactile-dynamics train biotac)"
                )
            count = sum(name.startswith("matrix_") for name in content.files)
            layers = tuple(
                (as_stored(content[f"matrix_{k}"]), as_stored(content[f"bias_{k}"]))
                for k in range(count)
            )
            return cls(
                content["mean"],
                content["scale"],
                layers,
                content["force_temperature"],
                content["place_temperature"],
                str(content["origin"]),
            )


def as_stored(values: NDArray[Any]) -> Single:
    """Return weights as a file of half precision gives them back."""
    return values.astype(np.float16).astype(np.float32)


def interpolate(factors: Array, strength: Array) -> Array:
    """Return factors (..., k) at forces (...), linear between those (7, k) at STRENGTH_KNOTS."""
    passed = (strength[..., None] - STRENGTH_KNOTS[:-1]) / _KNOT_GAPS
    share = np.minimum(np.maximum(passed, 0.0), 1.0)
    return np.asarray(factors[0] + share @ (factors[1:] - factors[:-1]))


@lru_cache(maxsize=1)
def shipped_network() -> NetworkWeights:
    """Return the network that comes with the package."""
    return NetworkWeights.load(SHIPPED_NETWORK)
