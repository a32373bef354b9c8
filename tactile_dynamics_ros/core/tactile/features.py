"""Polynomial features of tared signals for linear force and contact-point regressions.

The pattern u of electrode changes, divided by the size q of the whole signal, tells where and how
a contact presses; q tells how hard. Force features are products of powers of q with polynomials
of u, so that they grow no faster than q^2 and vanish without a signal.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

PATTERN_FLOOR = 0.3
"""Signal size (hundreds of counts) below which the pattern fades into noise: 30 counts, ten times
the noise of a loud unit (3.4). Weights and network have been trained with it; another value needs
others."""

_SIZE_WEIGHT = np.array([0.25] * 19 + [1.0])[:, None]
"""Weights of the squared changes of electrodes and PDC in the signal's size: half of the
electrodes' amplitude, PDC in full. Only the scale of features changes with them; weights and
network have been trained with these."""

_ROW, _COLUMN = np.triu_indices(19)
"""Places of the products of two electrodes among the features. Each pair once, squares included
(190): as many weights are fitted, so that another order or set needs another calibration."""

MIRROR = np.array([10, 11, 12, 13, 14, 15, 6, 8, 7, 9, 0, 1, 2, 3, 4, 5, 16, 17, 18, 19])
"""Order of the 20 changes when the finger is mirrored, y -> -y. Fixed by the electrodes' places
(`electrodes._MIRROR`); a wrong pair teaches both models a sensor that is not symmetric."""


def signal_size(change: Array) -> Array:
    """Return q (..., 1), the root of half the electrodes' norm squared plus the pressure squared.

    Args:
        change: (..., 20) tared electrodes and PDC, hundreds of counts.
    """
    return np.asarray(np.sqrt((change**2) @ _SIZE_WEIGHT))


def force_features(change: Array) -> Array:
    """Return (..., 668) features that a force is linear in.

    Args:
        change: (..., 20) tared electrodes and PDC, hundreds of counts.
    """
    electrodes, pressure = change[..., :19], change[..., 19:]
    size = signal_size(change) + PATTERN_FLOOR
    pattern = electrodes / size
    pair = pattern[..., _ROW] * pattern[..., _COLUMN]
    cube = pattern**3
    parts = [
        electrodes,
        pressure,
        pressure * pattern,
        pressure**2 / size,
        size * pair,
        pressure * pair,
        size**2 * pattern,
        size * pressure,
        size**2 * pair,
        size * cube,
        size**2 * cube,
    ]
    return np.concatenate(parts, axis=-1)


def place_features(change: Array) -> Array:
    """Return (..., 230) features that the place of a contact is linear in.

    Args:
        change: (..., 20) tared electrodes and PDC, hundreds of counts.
    """
    size = signal_size(change) + PATTERN_FLOOR
    pattern = change / size
    electrodes = pattern[..., :19]
    pair = electrodes[..., _ROW] * electrodes[..., _COLUMN]
    ones = np.ones_like(size)
    return np.concatenate([ones, pattern, pair, electrodes**3], axis=-1)
