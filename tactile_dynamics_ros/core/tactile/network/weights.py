"""The network that estimates forces: weights, inputs and the estimator."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.files import write_arrays
from tactile_dynamics_ros.core.reading import open_arrays
from tactile_dynamics_ros.core.shape.skin_surface import project_to_skin
from tactile_dynamics_ros.core.tactile.calibration import MIRROR_AXES, LabelledPresses
from tactile_dynamics_ros.core.tactile.electrodes import ELECTRODE_POSITION
from tactile_dynamics_ros.core.tactile.fingertip import (
    FingertipConfigs,
    FingertipEstimator,
    TactileReading,
    frame_period,
)
from tactile_dynamics_ros.core.tactile.signal_change import MIRROR, PATTERN_FLOOR, signal_size

MEMORY = np.array([0.02, 0.05, 0.12, 0.3, 1.0, 4.0])
"""Time constants of the low-passes that give the network a past, s: the short ones let it average
the noise of a frame without lagging behind, the long ones show creep. From two frames to the slow
creep, a factor of 2.4 to 4 apart; fewer or other ones need another training, more make the network
slower."""

INPUTS = 20 * (1 + len(MEMORY)) + 2 + 19
"""Numbers that the network is given: pattern and its differences from the past (20 each), two of
the size, 19 rest counts. It follows from `MEMORY` and the 19 electrodes; the weights of the network
have as many rows."""

_FRAMES = 20 * np.arange(1 + len(MEMORY))[:, None] + MIRROR
"""Inputs of the mirrored sensor among pattern and differences. Fixed by the order of the inputs."""
MIRROR_INPUTS = np.concatenate(
    [_FRAMES.ravel(), _FRAMES.size + np.array([0, 1]), _FRAMES.size + 2 + MIRROR[:19]]
)
"""Where each input of the same contact on a mirrored sensor is taken from. Fixed by the order of
the inputs; a wrong one gives contacts on the right other forces than those on the left."""

_STEADY = slice(20 * 2, 20 * 2 + 19)
"""Inputs that tell the electrodes' changes within 0.05 s. The 0.05 s are the second of `MEMORY`;
with 0.02 s noise would choose the side of light touches, with 0.3 s the side would lag."""

REST_MEAN, REST_SPREAD = 3100.0, 300.0
"""Usual electrode counts without contact, and how far units differ: published rest counts lie
between 2600 and 3250. They standardise inputs; the network has been trained with them."""


def lagged(change: Array, period: float) -> Array:
    """Return (T, 6, 20) low-passed copies of a sequence (T, 20), zero before it starts."""
    follow = 1.0 - np.exp(-period / MEMORY)
    copies = [lfilter([f], [1.0, f - 1.0], change, axis=0) for f in follow]
    return np.stack(copies, axis=1)


class Memory:
    """Low-passes of the signals that are followed frame by frame.

    Args:
        period: s between frames.
    """

    def __init__(self, period: float) -> None:
        self._follow = (1.0 - np.exp(-period / MEMORY))[:, None]
        self.reset()

    def reset(self, shape: tuple[int, ...] = ()) -> None:
        """Forget the past; frames to come are of ``shape`` fingertips."""
        self._state = np.zeros((*shape, len(MEMORY), 20))

    def update(self, change: Array) -> Array:
        """Return (..., 6, 20) low-passed signals after the next frame (..., 20)."""
        self._state = self._state + self._follow * (change[..., None, :] - self._state)
        return self._state


def network_inputs(change: Array, past: Array, rest: Array) -> tuple[Array, Array]:
    """Return inputs (..., INPUTS) and signal size (..., 1).

    The pattern change / size and the differences (change - past) / size tell where, how and since
    when; the size tells how hard, and scales the output. The rest state tells how sensitive each
    electrode of this unit is.

    Args:
        change: (..., 20) tared signals, hundreds of counts.
        past: (..., 6, 20) low-passed copies.
        rest: (19,) or (..., 19) electrode counts without contact.
    """
    size = signal_size(change) + PATTERN_FLOOR
    recent = (change[..., None, :] - past) / size[..., None]
    flat = recent.reshape(*change.shape[:-1], -1)
    level = np.zeros_like(size) + (rest - REST_MEAN) / REST_SPREAD
    parts = [change / size, flat, np.log(size), size / 4.0, level]
    return np.concatenate(parts, axis=-1), size


def face_left(inputs: Array) -> tuple[Array, NDArray[np.bool_]]:
    """Return inputs (..., INPUTS) with contacts on the right mirrored to the left, and which were.

    A sensor is its own mirror image, so that a network need only know its left half, y > 0. Skin
    that is pressed makes electrodes fall: a contact is on the right if sum_k min(c_k, 0)^2 y_k < 0
    for changes c, averaged over 0.05 s, of electrodes at y.
    """
    fall = np.minimum(inputs[..., :19] - inputs[..., _STEADY], 0.0)
    on_right = fall**2 @ ELECTRODE_POSITION[:, 1] < 0.0
    return np.where(on_right[..., None], inputs.take(MIRROR_INPUTS, axis=-1), inputs), on_right


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
        """Forget past frames and take the electrodes' rest counts (..., 19)."""
        self._memory.reset(rest.shape[:-1])
        self._rest = rest

    def predict(self, change: Array) -> TactileReading:
        """Return the contacts in the next frame, given its tared signals (..., 20)."""
        found = self.weights.evaluate(
            *network_inputs(change, self._memory.update(change), self._rest)
        )
        return found.force, found.std, found.point, found.point_std


class NetworkForceEstimator(FingertipEstimator):
    """Live force of one fingertip, or of several, by the network.

    Args:
        config: thresholds and constants of the fingertip, or of each of several.
        weights: of the network; those shipped with the package if None.
    """

    def __init__(
        self, config: FingertipConfigs | None = None, weights: NetworkWeights | None = None
    ) -> None:
        super().__init__(NetworkForceModel(weights, frame_period(config)), config)


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
