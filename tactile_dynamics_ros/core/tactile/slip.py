"""Slip from vibration: the power of PAC in the band of micro-vibrations."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.signal import butter, sosfilt

from tactile_dynamics_ros.core.configuration import check_ranges, parameter
from tactile_dynamics_ros.core.tactile.electrodes import PAC
from tactile_dynamics_ros.core.tactile.signal_change import check_frame

Array = NDArray[np.float64]

PAC_RATE = 2200.0


@dataclass(frozen=True)
class SlipConfig:
    """Band and thresholds.

    Source: slip vibration lies in 50 to 400 Hz; thresholds about twice the unloaded level.
    """

    low_hz: float = parameter(60.0, "lower edge of the band", "Hz", 10.0, 500.0)
    high_hz: float = parameter(400.0, "upper edge of the band", "Hz", 100.0, 1000.0)
    onset: float = parameter(3.0, "level over rest that begins a slip", "", 1.0, 100.0)
    end: float = parameter(2.0, "level over rest below which it ends", "", 1.0, 100.0)
    frames: int = parameter(2, "frames in a row that begin or end a slip", "", 1, 100)

    def __post_init__(self) -> None:
        check_ranges(self)


@dataclass(frozen=True)
class SlipEstimate:
    """What one frame of one fingertip says about slip.

    Attributes:
        score: vibration over the threshold of slip, above 1 = slip; 0 without contact.
        level: vibration over that of rest, 1 = silence.
        slipping: the same with hysteresis and debouncing.
    """

    score: float
    level: float
    slipping: bool


class SlipDetector:
    """Vibration level and slip of one fingertip, frame by frame.

    Args:
        config: band and thresholds.
    """

    def __init__(self, config: SlipConfig | None = None) -> None:
        self.config = config or SlipConfig()
        band = [self.config.low_hz, self.config.high_hz]
        self._filter: Array = butter(2, band, btype="bandpass", fs=PAC_RATE, output="sos")
        self._state: Array = np.zeros((len(self._filter), 2))
        self._rest_level, self._offset = 20.0, 2000.0
        self._slipping = False
        self._streak = 0

    def tare(self, raw: ArrayLike) -> None:
        """Take the level of frames (K, 44) without contact as that of rest."""
        counts = np.atleast_2d(check_frame(raw))
        samples = counts[:, PAC].ravel()
        self._state = np.zeros_like(self._state)
        band, _ = sosfilt(self._filter, samples - samples.mean(), zi=self._state)
        self._rest_level = max(float(np.sqrt(np.mean(band[22:] ** 2))), 1.0)
        self._slipping, self._streak = False, 0
        self._offset = float(samples.mean())

    def update(self, raw: ArrayLike, touching: bool = True) -> SlipEstimate:
        """Return what the next frame says about slip.

        Args:
            raw: (44,) counts.
            touching: whether the fingertip touches anything; what is not touched does not slip.
        """
        samples = check_frame(raw)[PAC] - self._offset
        band, self._state = sosfilt(self._filter, samples, zi=self._state)
        level = float(np.sqrt(np.mean(band**2))) / self._rest_level
        limit = self.config.end if self._slipping else self.config.onset
        changes = (touching and level > limit) != self._slipping
        self._streak = self._streak + 1 if changes else 0
        if self._streak >= self.config.frames:
            self._slipping, self._streak = not self._slipping, 0
        return SlipEstimate(level / self.config.onset * touching, level, self._slipping)
