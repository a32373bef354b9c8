"""Slip from vibration: the power of PAC in its band; a switch without short interruptions."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.signal import butter, sosfilt

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.configuration import check_ranges, parameter
from tactile_dynamics_ros.core.tactile.electrodes import PAC
from tactile_dynamics_ros.core.tactile.signal_change import check_frame


class Debounced:
    """Switches that flip once their input has differed from them for some frames in a row.

    Args:
        frames: in a row that flip a switch; one number for all, or (...) of each.

    Attributes:
        on: (...) whether each is on.
        streak: (...) frames in a row in which the input has differed.
    """

    def __init__(self, frames: ArrayLike) -> None:
        self._frames = np.asarray(frames)
        self.reset()

    def reset(self) -> None:
        """Switch off and forget the past."""
        self.on: NDArray[np.bool_] = np.zeros(self._frames.shape, dtype=bool)
        self.streak: NDArray[np.int_] = np.zeros(self._frames.shape, dtype=int)

    def update(self, wanted: ArrayLike) -> NDArray[np.bool_]:
        """Return whether each is on after a frame whose input is ``wanted`` (...)."""
        streak = np.where(wanted != self.on, self.streak + 1, 0)
        flips = streak >= self._frames
        self.on = self.on ^ flips
        self.streak = np.where(flips, 0, streak)
        return self.on


PAC_RATE = 2200.0
"""Rate of the dynamic pressure, Hz: 22 samples per frame of 100 Hz. Source: SynTouch, BioTac. Fixed
by the sensor; another one moves the band of the filter in proportion."""


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
    """Slip that one frame of a fingertip, or of several (...), shows.

    Attributes:
        score: (...) vibration over the threshold of slip, above 1 = slip; 0 without contact.
        level: (...) vibration over that of rest, 1 = silence.
        slipping: (...) whether it slips, with hysteresis and debouncing.
    """

    score: Array
    level: Array
    slipping: NDArray[np.bool_]


class SlipDetector:
    """Vibration level and slip of one fingertip, or of several (...) at once, frame by frame.

    Args:
        config: band and thresholds.
    """

    def __init__(self, config: SlipConfig | None = None) -> None:
        self.config = config or SlipConfig()
        band = [self.config.low_hz, self.config.high_hz]
        sections = butter(2, band, btype="bandpass", fs=PAC_RATE, output="sos")
        self._filter = BlockFilter(sections, PAC.stop - PAC.start)
        self._slip = Debounced(self.config.frames)
        self._rest_level, self._offset = np.asarray(20.0), np.asarray(2000.0)

    def tare(self, raw: ArrayLike) -> None:
        """Take the level of frames (K, ..., 44) without contact as that of rest."""
        samples = np.atleast_2d(check_frame(raw))[..., PAC]
        self._offset = np.mean(samples, axis=(0, -1))
        self._filter.reset(self._offset.shape)
        band = np.stack([self._filter(frame - self._offset[..., None]) for frame in samples])
        self._filter.reset(self._offset.shape)
        self._rest_level = np.maximum(np.sqrt(np.mean(band[1:] ** 2, axis=(0, -1))), 1.0)
        self._slip.reset()

    def update(self, raw: ArrayLike, touching: ArrayLike = True) -> SlipEstimate:
        """Return what the next frame says about slip.

        Args:
            raw: (..., 44) counts.
            touching: (...) whether a fingertip touches anything; what is not touched does not slip.
        """
        band = self._filter(check_frame(raw)[..., PAC] - self._offset[..., None])
        level = np.sqrt((band**2).sum(axis=-1) / band.shape[-1]) / self._rest_level
        limit = np.where(self._slip.on, self.config.end, self.config.onset)
        slipping = self._slip.update((level > limit) & touching)
        return SlipEstimate(level / self.config.onset * touching, level, slipping)


class BlockFilter:
    """A digital filter that takes its input in blocks of equal length, as two matrix products.

    With state s and block u: y = [s, u] M_out and s' = [s, u] M_state, exactly what
    `scipy.signal.sosfilt` returns sample by sample.

    Args:
        sections: (N, 6) second-order sections.
        length: length of a block.
    """

    def __init__(self, sections: Array, length: int) -> None:
        states = 2 * len(sections)
        unit = np.eye(states + length)
        start = np.moveaxis(unit[:, :states].reshape(-1, len(sections), 2), 0, 1)
        self._out, end = sosfilt(sections, unit[:, states:], zi=start)
        self._end = np.moveaxis(end, 1, 0).reshape(-1, states)
        self.reset()

    def reset(self, shape: tuple[int, ...] = ()) -> None:
        """Forget what came before; blocks to come are of ``shape`` signals."""
        self._state = np.zeros((*shape, self._end.shape[1]))

    def __call__(self, block: Array) -> Array:
        """Return the filtered block (..., length) and remember the state at its end."""
        given = np.concatenate([self._state, block], axis=-1)
        self._state = given @ self._end
        return np.asarray(given @ self._out)
