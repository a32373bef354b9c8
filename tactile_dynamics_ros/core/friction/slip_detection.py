"""Slip from vibration, electrodes, kinematics and forces together, and when it began."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.configuration import check_ranges, parameter
from tactile_dynamics_ros.core.tactile.electrodes import ELECTRODES
from tactile_dynamics_ros.core.tactile.signal_change import check_frame

_SMOOTHING = 0.3
"""Share by which smoothed electrodes follow a frame: an average of about three frames, 30 ms at 100
Hz. More lets noise in (the excess at rest then scatters by more than 0.2), less delays an alarm."""


class ElectrodeMotion:
    """Excess of the electrodes' step between smoothed frames over its level at rest.

    x = (rms_e(s_t - s_{t-3}) / level at rest) - 1, with s the smoothed counts: 0 at rest with a
    scatter of about 0.2, larger where the skin moves.
    """

    def __init__(self) -> None:
        self._level = 3.0
        self._smooth: Array | None = None
        self._past: list[Array] = []

    def tare(self, raw: ArrayLike) -> None:
        """Take frames (K, 44) without contact as rest."""
        self._smooth, self._past = None, []
        steps = [self._step(frame) for frame in np.atleast_2d(check_frame(raw))]
        if len(steps) > 5:
            self._level = max(float(np.median(steps[5:])), 0.3)

    def update(self, raw: ArrayLike) -> float:
        """Return the excess for the next frame (44,)."""
        return self._step(check_frame(raw)) / self._level - 1.0

    def _step(self, counts: Array) -> float:
        electrodes = counts[ELECTRODES]
        last = electrodes if self._smooth is None else self._smooth
        self._smooth = last + _SMOOTHING * (electrodes - last)
        self._past = [*self._past[-3:], self._smooth]
        return float(np.sqrt(np.mean((self._past[-1] - self._past[0]) ** 2)))


_MOST_NEARNESS = 0.5
"""Share of what silence of the other channels takes away per sample that nearness to earlier slips
may add: at one half forces alone tell no slip and hide none. From 1 on, forces near those of
earlier slips would raise an alarm in silence."""


@dataclass(frozen=True)
class SlipFusionConfig:
    """Level of each channel at rest and in a slip, and how sure the detector has to be."""

    vibration: float = parameter(1.0, "weight of the vibration", "", 0.0, 10.0)
    kinematics: float = parameter(0.5, "weight of the fingertip's motion", "", 0.0, 10.0)
    electrodes: float = parameter(0.15, "weight of the electrodes' change", "", 0.0, 10.0)
    vibration_std: float = parameter(0.25, "scatter of the log level at rest", "", 0.01, 2.0)
    vibration_rise: float = parameter(0.6, "log level of a slow slip", "", 0.1, 3.0)
    speed_std: float = parameter(1.8e-3, "scatter of the tip's speed at rest", "m/s", 1e-5, 0.1)
    speed_rise: float = parameter(2.5e-3, "speed of a slow slip", "m/s", 1e-4, 0.1)
    electrode_std: float = parameter(1.0, "scatter of the electrodes' change at rest", "", 0.01, 9)
    electrode_rise: float = parameter(
        2.5, "change of the electrodes in a slip, in rest levels", "", 0.1, 50.0
    )
    share_rest: float = parameter(
        0.85, "share of the ratio of earlier slips, at rest", "", 0.1, 1.0
    )
    share_std: float = parameter(0.06, "scatter of that share", "", 0.01, 1.0)
    share_rise: float = parameter(0.1, "rise of that share where it slips", "", 0.01, 1.0)
    threshold: float = parameter(12.0, "log likelihood ratio that is a slip", "", 1.0, 100.0)
    least_ratio: float = parameter(
        0.2, "ratio of forces below which no surface slips", "", 0.0, 1.0
    )
    window: float = parameter(0.04, "window of the tip's speed and the mean ratio", "s", 0.02, 0.5)
    recent: float = parameter(0.2, "within which the greatest ratio counts", "s", 0.02, 2.0)

    def __post_init__(self) -> None:
        check_ranges(self)


@dataclass(frozen=True)
class SlipObservation:
    """Signals of a contact at one instant.

    Attributes:
        vibration: PAC level over rest (1 = silence), or None where the tip has no such channel.
        electrodes: change of the electrodes between frames over its scatter at rest, or None.
        path: path of the fingertip on the object along the pull, m, or None.
        ratio: ratio of the tangential to the normal force that is measured, or None.
    """

    vibration: float | None = None
    electrodes: float | None = None
    path: float | None = None
    ratio: float | None = None


@dataclass(frozen=True)
class SlipState:
    """Answer of the detector.

    Attributes:
        slipping: whether the contact slips now.
        score: log likelihood ratio of slip against rest, accumulated.
        onset: when the slip is thought to have begun, s (meaningful while slipping).
        speed: along the pull, m/s.
    """

    slipping: bool
    score: float
    onset: float
    speed: float


class SlipFusion:
    """Cumulative sum of log likelihood ratios of four channels.

    S = max(0, S + sum_k w_k (m_k z_k - m_k^2 / 2) + n), with z_k a channel over its scatter at rest
    and m_k its level in a slow slip; what is hardly pulled is at rest. Where it is known at which
    ratio of the forces this contact slipped before, n is the log likelihood ratio of the share of
    it that was reached lately: it delays alarms far below and hastens them near it, by no more
    than half of what the other channels take away in silence. A slip is reported where S passes the
    threshold; it began about where S last was zero, so that the delay of every detection is known.

    Args:
        config: levels.

    Source: Page 1954 (cumulative sum and change point).
    """

    def __init__(self, config: SlipFusionConfig | None = None) -> None:
        self.config = config or SlipFusionConfig()
        self.reset()

    def reset(self, expected: float | None = None) -> None:
        """Forget the past, for a contact at rest that slips at about the expected ratio."""
        self._expected = expected
        self._score, self._onset = 0.0, -np.inf
        self._path: deque[tuple[float, float]] = deque()
        self._ratios: deque[tuple[float, float]] = deque()
        self._means: deque[tuple[float, float]] = deque()
        self._state = SlipState(False, 0.0, -np.inf, 0.0)

    def update(self, time: float, seen: SlipObservation) -> SlipState:
        """Take one instant (s) and return the state of the contact."""
        speed = self._speed(time, seen.path)
        channels = self._channels(seen, speed)
        gain = sum(weight * _ratio(z, mean) for weight, z, mean in channels)
        silence = -sum(weight * _ratio(0.0, mean) for weight, _, mean in channels)
        most = _MOST_NEARNESS * silence
        gain += float(np.clip(self._nearness(time, seen.ratio), -most, most))
        if self._score == 0.0:
            self._onset = time
        highest = 2.0 * self.config.threshold
        pulled = seen.ratio is None or seen.ratio >= self.config.least_ratio
        self._score = min(max(0.0, self._score + gain), highest) if pulled else 0.0
        slipping = self._score > (0.5 if self._state.slipping else 1.0) * self.config.threshold
        onset = self._state.onset if self._state.slipping else self._onset
        self._state = SlipState(slipping, self._score, onset, 0.0 if speed is None else speed)
        return self._state

    def _channels(
        self, seen: SlipObservation, speed: float | None
    ) -> list[tuple[float, float, float]]:
        """Weight, level and level in a slow slip, over the scatter at rest, of what is seen."""
        config, found = self.config, []
        if seen.vibration is not None:
            level, std = float(np.log(max(seen.vibration, 1e-3))), config.vibration_std
            found.append((config.vibration, level / std, config.vibration_rise / std))
        if seen.electrodes is not None:
            std = config.electrode_std
            found.append((config.electrodes, seen.electrodes / std, config.electrode_rise / std))
        if speed is not None:
            std = config.speed_std
            found.append((config.kinematics, speed / std, config.speed_rise / std))
        return found

    def _nearness(self, time: float, ratio: float | None) -> float:
        """Log likelihood ratio of how near the forces were to those of earlier slips.

        The greatest ratio of late counts, since it falls once the contact slides.
        """
        config = self.config
        if ratio is None or self._expected is None:
            return 0.0
        _remember(self._ratios, time, ratio, config.window)
        mean = float(np.mean([value for _, value in self._ratios]))
        _remember(self._means, time, mean, config.recent)
        share = max(value for _, value in self._means) / self._expected
        z = (share - config.share_rest) / config.share_std
        return _ratio(z, config.share_rise / config.share_std)

    def _speed(self, time: float, path: float | None) -> float | None:
        """Slope of the path over the window, m/s."""
        if path is None:
            return None
        _remember(self._path, time, path, self.config.window)
        if len(self._path) < 3:
            return 0.0
        times, places = np.array(self._path).T
        times = times - times.mean()
        return float(times @ places / (times @ times))


def _remember(past: deque[tuple[float, float]], time: float, value: float, span: float) -> None:
    """Append a value and forget those older than the span, s."""
    past.append((time, value))
    while time - past[0][0] > span + 1e-9:
        past.popleft()


def _ratio(z: float, mean: float) -> float:
    """Log likelihood ratio of N(mean, 1) against N(0, 1), bounded so that no channel rules."""
    return float(np.clip(mean * z - 0.5 * mean**2, -4.0, 6.0))
