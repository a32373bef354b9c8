"""Inputs of the force network: signal pattern, its recent change, and its size."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from tactile_dynamics_ros.core.tactile.electrodes import ELECTRODE_POSITION
from tactile_dynamics_ros.core.tactile.features import MIRROR, PATTERN_FLOOR, signal_size

Array = NDArray[np.float64]

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
