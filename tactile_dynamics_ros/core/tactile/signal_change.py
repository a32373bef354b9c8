"""Change of a BioTac's signals since its rest state, compensated for temperature."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.tactile.electrodes import CHANNELS, ELECTRODES, FULL_SCALE, PDC, TDC

Array = NDArray[np.float64]

COUNTS_PER_KELVIN = 31.7
"""Mean drift of an electrode with temperature. Source: fits of one sensor, 25.7 to 35.3 degC, whose
electrodes drift by 27 to 38 counts per kelvin each."""


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
    if not np.all((counts >= 0) & (counts <= FULL_SCALE)):
        raise BadInputError(
            f"BioTac counts between {np.min(counts)} and {np.max(counts)}: "
            f"expected 12-bit values between 0 and {FULL_SCALE}"
        )
    return counts


@dataclass(frozen=True)
class RestState:
    """Signals of one sensor without contact.

    Attributes:
        electrodes: (19,) counts. pressure: PDC counts. temperature: degC.
        drift: counts per kelvin, of all electrodes or (19,) of each.
        frames: how many frames it is the average of.
    """

    electrodes: Array
    pressure: float
    temperature: float
    drift: float | Array = COUNTS_PER_KELVIN
    frames: int = 1

    @classmethod
    def from_frames(cls, raw: ArrayLike, drift: float | Array = COUNTS_PER_KELVIN) -> RestState:
        """Average frames (K, 44) that were read without contact.

        Raises:
            BadInputError: no frames, or the pressure moves as it does under contact.
        """
        counts = np.atleast_2d(check_frame(raw))
        if len(counts) == 0:
            raise BadInputError("tare: no BioTac frames; expected at least one without contact")
        spread = float(np.ptp(counts[:, PDC]))
        if spread > 40.0:
            raise BadInputError(
                f"tare: PDC moved by {spread:.0f} counts, expected less than 40; "
                "lift the finger off before taring"
            )
        mean = counts.mean(axis=0)
        warmth = float(temperature(mean[TDC]))
        return cls(mean[ELECTRODES], float(mean[PDC]), warmth, drift, len(counts))

    def change(self, counts: Array) -> Array:
        """Return (..., 20): electrode changes and PDC change, in hundreds of counts.

        The electrodes' drift with the core's temperature is taken out.
        """
        warming = temperature(counts[..., TDC]) - self.temperature
        drift = self.drift * warming[..., None]
        electrodes = counts[..., ELECTRODES] - self.electrodes - drift
        pressure = counts[..., PDC : PDC + 1] - self.pressure
        return np.concatenate([electrodes, pressure], axis=-1) / 100.0

    def follow(self, counts: Array, gain: float) -> RestState:
        """Return the rest state with a frame (44,) without contact averaged in.

        Electrodes wander by a count or so within seconds, so a long average is better: every
        frame counts the same until 1 / gain of them, older ones then fade. Zero keeps the state.
        """
        share = max(gain, 1.0 / (self.frames + 1)) if gain > 0.0 else 0.0
        now = float(temperature(counts[TDC]))
        return RestState(
            self.electrodes + share * (counts[ELECTRODES] - self.electrodes),
            self.pressure + share * float(counts[PDC] - self.pressure),
            self.temperature + share * (now - self.temperature),
            self.drift,
            self.frames + 1,
        )
