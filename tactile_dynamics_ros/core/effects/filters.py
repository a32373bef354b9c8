"""Linear filters along time with exact derivatives: first-order lag and spring-damper."""

from __future__ import annotations

import math
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicHermiteSpline

Array = NDArray[np.float64]

_GAP = 1.8
"""Steps longer than so many periods are gaps if they are longer than `_SHORT`: one lost sample
makes a step of 2. It counts for recordings slower than 3.6 Hz only."""
_SHORT = 0.5
"""Gap, s, over which filters carry on: motion that was smooth before is read across it by cubics.
After a longer one they start settled again, as at the beginning."""


def segments(time: Array) -> list[slice]:
    """Stretches of samples without gaps longer than half a second or 1.8 periods."""
    if len(time) < 2:
        return [slice(0, len(time))]
    steps = np.diff(time)
    edges = np.flatnonzero(steps > max(_SHORT, _GAP * float(np.median(steps)))) + 1
    bounds = [0, *edges.tolist(), len(time)]
    return [slice(a, b) for a, b in zip(bounds[:-1], bounds[1:], strict=True)]


def taylor(time: Array, values: Array) -> Array:
    """Values and first three derivatives of `local_cubic` at the begin of each interval.

    Args:
        time: (n,) s, of one stretch.
        values: (n, ...).

    Returns:
        (4, n - 1, ...).
    """
    if len(time) < 2:
        return np.zeros((4, 0, *values.shape[1:]))
    step = np.diff(time).reshape(-1, *[1] * (values.ndim - 1))
    first = slopes(time, values)
    rise = np.diff(values, axis=0) / step
    bend = (first[:-1] + first[1:] - 2.0 * rise) / step
    second = 2.0 * ((rise - first[:-1]) / step - bend)
    return np.stack([values[:-1], first[:-1], second, 6.0 * bend / step])


def slopes(time: Array, values: Array) -> Array:
    """Slopes (n, ...) of parabolas through three values, as those of `local_cubic`."""
    return np.gradient(values, time, axis=0, edge_order=2 if len(time) > 2 else 1)


def local_cubic(time: Array, values: Array) -> CubicHermiteSpline:
    """Cubics between samples with the slopes of parabolas through three of them."""
    return CubicHermiteSpline(time, values, slopes(time, values))


def evenly_filled(time: Array) -> tuple[Array, NDArray[np.intp]]:
    """Times with as many between as make all steps about equal, and where the given ones are."""
    steps = np.diff(time)
    if len(steps) == 0:
        return time, np.arange(len(time))
    counts = np.maximum(np.round(steps / np.median(steps)), 1.0).astype(np.intp)
    places = np.concatenate([[0], np.cumsum(counts)])
    return np.interp(np.arange(places[-1] + 1), places, time), places


def first_order_lag(time: Array, values: Array, tau: float) -> tuple[Array, Array]:
    """Response y of ``tau y' + y = u`` from rest at the first value, and d y / d tau.

    Exact for cubics between the values (`taylor`): within an interval
    y = p + (y_k - p_k) exp(-(t - t_k) / tau) with p = u - tau u' + tau^2 u'' - tau^3 u'''. Each
    stretch starts settled.

    Args:
        time: (N,) s.
        values: (N, ...) u.
        tau: s, positive.

    Returns:
        y and dy/dtau, both (N, ...).
    """
    lag = FirstOrderLag(time, values, tau)
    return lag.response, lag.change


class FirstOrderLag:
    """The two results of `first_order_lag`, each computed where it is asked for."""

    def __init__(self, time: Array, values: Array, tau: float) -> None:
        """Args as those of `first_order_lag`."""
        flat, self._shape = values.reshape(len(values), -1), values.shape
        self._stretches = [_LagStretch(time[part], flat[part], tau) for part in segments(time)]

    @cached_property
    def response(self) -> Array:
        """(N, ...) y."""
        return np.concatenate([part.response for part in self._stretches]).reshape(self._shape)

    @cached_property
    def change(self) -> Array:
        """(N, ...) dy/dtau."""
        return np.concatenate([part.change for part in self._stretches]).reshape(self._shape)


class _LagStretch:
    """A first-order lag of (n, m) values without gaps."""

    def __init__(self, time: Array, values: Array, tau: float) -> None:
        self._steps, self._values, self._tau = np.diff(time)[:, None], values, tau
        self._decay = np.exp(-self._steps / tau)
        self._begin = taylor(time, values)
        _, _, second, third = self._begin
        first = slopes(time, values)[1:] if len(time) > 1 else values[1:]
        self._end = np.stack([values[1:], first, second + self._steps * third, third])

    @cached_property
    def response(self) -> Array:
        """(n, m) y."""
        begin, end = (_following(rises, self._tau) for rises in (self._begin, self._end))
        return self._integrated(end - self._decay * begin, self._values[:1])

    @cached_property
    def change(self) -> Array:
        """(n, m) dy/dtau."""
        begin, end = (_following_change(rises, self._tau) for rises in (self._begin, self._end))
        change_of_decay = self._decay * self._steps / self._tau**2
        beyond = self.response[:-1] - _following(self._begin, self._tau)
        drive = end - self._decay * begin + change_of_decay * beyond
        return self._integrated(drive, np.zeros_like(self._values[:1]))

    def _integrated(self, drive: Array, start: Array) -> Array:
        return integrate_linear(self._decay[..., None], drive[:, None], start)[:, 0]


def _following(rises: Array, tau: float) -> Array:
    """P = u - tau u' + tau^2 u'' - tau^3 u'''."""
    value, first, second, third = rises
    return np.asarray(value - tau * (first - tau * (second - tau * third)))


def _following_change(rises: Array, tau: float) -> Array:
    """dp/dtau."""
    _, first, second, third = rises
    return np.asarray(-first + tau * (2.0 * second - 3.0 * tau * third))


def integrate_linear(system: Array, drive: Array, start: Array) -> Array:
    """States of s_k+1 = A_k s_k + d_k, in about sqrt(N) blocks that advance side by side.

    Each block is integrated from zero together with its transition matrix; the states at the
    beginnings of the blocks follow one from the other.

    Args:
        system: (N - 1, S, S).
        drive: (N - 1, S, m).
        start: (S, m).

    Returns:
        (N, S, m).
    """
    count, size = drive.shape[:2]
    length = max(1, math.isqrt(count))
    blocks = -(-count // length)
    spare = blocks * length - count
    steps = np.concatenate([system, np.tile(np.eye(size), (spare, 1, 1))])
    pushes = np.concatenate([drive, np.zeros((spare, *drive.shape[1:]))])
    joined = np.concatenate([steps, pushes], axis=2)
    joined = joined.reshape(blocks, length, size, joined.shape[2])
    for k in range(1, length):
        onwards = joined[:, k, :, :size] @ joined[:, k - 1]
        onwards[..., size:] += joined[:, k, :, size:]
        joined[:, k] = onwards
    begin = np.empty((blocks + 1, *start.shape))
    begin[0] = start
    for k in range(blocks):
        begin[k + 1] = joined[k, -1, :, :size] @ begin[k] + joined[k, -1, :, size:]
    states = joined[..., :size] @ begin[:-1, None] + joined[..., size:]
    return np.concatenate([start[None], states.reshape(-1, *start.shape)[:count]])
