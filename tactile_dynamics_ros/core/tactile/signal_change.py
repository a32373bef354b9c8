"""Change of a BioTac's signals since its rest state, and features of it.

The pattern u of electrode changes, divided by the size q of the whole signal, tells where and how
a contact presses; q tells how hard. Force features are products of powers of q with polynomials
of u, so that they grow no faster than q^2 and vanish without a signal.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.tactile.electrodes import CHANNELS, ELECTRODES, FULL_SCALE, PDC, TDC

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


COUNTS_PER_KELVIN = 31.7
"""Mean drift of an electrode with temperature. Source: fits of one sensor, 25.7 to 35.3 degC, whose
electrodes drift by 27 to 38 counts per kelvin each. It is where an unmeasured unit begins: 5
counts/K off are 50 counts after 10 K of warming, which the tare at rest takes out only once; the
command that learns drift replaces it."""

_SIGNALS = slice(0, PDC + 1)
"""Place of electrodes and PDC in a frame, which the rest state is kept of. Fixed by the frame's
order; other signals are no forces."""


def temperature(tdc: ArrayLike) -> Array:
    """Return the core's temperature in degC, T = 4025 / ln((155183 - 46555 r) / r) - 273.15.

    Args:
        tdc: counts; r = tdc / 4095.
    """
    ratio = np.minimum(np.maximum(tdc, 1.0), FULL_SCALE) / FULL_SCALE
    return np.asarray(4025.0 / np.log((155183.0 - 46555.0 * ratio) / ratio) - 273.15)


def check_frame(raw: ArrayLike) -> Array:
    """Return raw counts as floats (..., 44).

    Raises:
        BadInputError: not 44 channels, not finite, or outside the 12-bit range.
    """
    counts = np.asarray(raw, dtype=float)
    if counts.ndim == 0 or counts.shape[-1] != CHANNELS:
        raise BadInputError(
            f"BioTac frame of shape {counts.shape}: expected (..., {CHANNELS}) counts, "
            "E1..E19, PDC, TDC, TAC, PAC0..PAC21"
        )
    if not ((counts >= 0) & (counts <= FULL_SCALE)).all():
        raise BadInputError(
            f"BioTac counts between {np.min(counts)} and {np.max(counts)}: "
            f"expected 12-bit values between 0 and {FULL_SCALE}"
        )
    return counts


@dataclass(frozen=True)
class RestState:
    """Signals of a sensor, or of several, without contact.

    Attributes:
        signals: (..., 20) counts of E1 to E19 and PDC.
        temperature: (...) degC.
        drift: (..., 20) counts per kelvin, zero of PDC.
        frames: (...) how many frames it is the average of.
    """

    signals: Array
    temperature: Array
    drift: Array
    frames: NDArray[np.int_]

    @classmethod
    def from_frames(cls, raw: ArrayLike, drift: ArrayLike = COUNTS_PER_KELVIN) -> RestState:
        """Average frames (K, ..., 44) that were read without contact.

        Args:
            raw: counts.
            drift: counts per kelvin, of all electrodes or (..., 19) of each.

        Raises:
            BadInputError: no frames, or the pressure moves as it does under contact.
        """
        counts = np.atleast_2d(check_frame(raw))
        if len(counts) == 0:
            raise BadInputError("tare: no BioTac frames; expected at least one without contact")
        spread = np.ravel(np.ptp(counts[..., PDC], axis=0))
        if spread.max() > 40.0:
            raise BadInputError(
                f"tare: PDC of fingertip {spread.argmax() + 1} of {spread.size} moved by "
                f"{spread.max():.0f} counts, expected less than 40; "
                "lift the finger off before taring"
            )
        mean = counts.mean(axis=0)
        drifts = np.zeros((*mean.shape[:-1], PDC + 1))
        drifts[..., ELECTRODES] = drift
        frames = np.full(mean.shape[:-1], len(counts))
        return cls(mean[..., _SIGNALS], temperature(mean[..., TDC]), drifts, frames)

    @property
    def electrodes(self) -> Array:
        """Electrode counts (..., 19)."""
        return self.signals[..., ELECTRODES]

    def warming(self, counts: Array) -> Array:
        """Return how much warmer (...) the core is in frames (..., 44), K."""
        return np.asarray(temperature(counts[..., TDC]) - self.temperature)

    def change(self, counts: Array, warming: Array) -> Array:
        """Return (..., 20): changes of the signals in frames (..., 44), in hundreds of counts.

        The electrodes' drift with the core's ``warming`` (...) is taken out.
        """
        moved = counts[..., _SIGNALS] - self.signals - self.drift * warming[..., None]
        return np.asarray(moved / 100.0)

    def follow(self, counts: Array, gain: ArrayLike, free: ArrayLike = True) -> RestState:
        """Return the rest state with a frame (..., 44) averaged in, of those that are ``free``.

        Electrodes wander by a count or so within seconds, so a long average is better: every
        frame counts the same until 1 / gain of them, older ones then fade. Zero keeps the state.
        """
        taken = np.logical_and(free, np.greater(gain, 0.0))
        share = np.where(taken, np.maximum(gain, 1.0 / (self.frames + 1)), 0.0)
        moved = share[..., None] * (counts[..., _SIGNALS] - self.signals)
        return RestState(
            self.signals + moved,
            self.temperature + share * self.warming(counts),
            self.drift,
            self.frames + taken,
        )
