"""Linear filters along time with exact derivatives: first-order lag and spring-damper."""

from __future__ import annotations

import math
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicHermiteSpline

from tactile_dynamics_ros.core.array import Array

_GAP = 1.8
"""Steps longer than so many periods are gaps if they are longer than `_SHORT`: one lost sample
makes a step of 2. It counts for recordings slower than 3.6 Hz only. Nearer to 1 jitter makes gaps
there, above 2 filters carry on across lost samples."""
_SHORT = 0.5
"""Gap, s, over which filters carry on: motion that was smooth before is read across it by cubics.
After a longer one they start settled again, as at the beginning. Longer reads motion across pauses
that nobody saw, shorter starts filters at every hiccup as settled, which they are not."""
_SERIES = 8
"""Terms of the exponential of a step beyond those of its input. With `_LONGEST_STEP` it is exact to
1e-10; with 6, to 1e-8. More only cost time."""
_PADDING = 4
"""Length to which a spectrum is padded, in lengths of the stretch: a peak is then found to an
eighth of 1 / T, where half of that would put a mass that rings for the whole time out of phase."""
_LONGEST_STEP = 1.0
"""Step times the fastest rate of a spring-damper up to which the series of `discretise` is summed;
of longer steps it is summed for a part and doubled. At 6 a series of 8 terms diverges within a
recording (5 Hz and 6.5 Hz of sloshing); at 0.5 it costs one more doubling and changes nothing."""


def stretches(time: Array) -> list[slice]:
    """The stretches of samples without gaps longer than half a second or 1.8 periods."""
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


def spectral_peaks(time: Array, values: Array, band: tuple[float, float], count: int) -> Array:
    """Frequencies (at most `count`,) of the highest peaks of the power of all columns, Hz.

    Of the longest stretch without gaps, with a Hann window; none if it is too short for the band.

    Args:
        time: (n,) s.
        values: (n, d).
        band: lowest and highest frequency, Hz.
        count: of peaks.
    """
    part = max(stretches(time), key=lambda piece: piece.stop - piece.start)
    filled, _ = evenly_filled(time[part])
    if len(filled) < 3:
        return np.zeros(0)
    even = local_cubic(time[part], values[part])(filled)
    even = (even - even.mean(axis=0)) * np.hanning(len(filled))[:, None]
    size = _PADDING * len(filled)
    power = np.sum(np.abs(np.fft.rfft(even, size, axis=0)) ** 2, axis=1)
    hz = np.fft.rfftfreq(size, float(np.median(np.diff(filled))))
    inner = (power[1:-1] >= power[:-2]) & (power[1:-1] > power[2:])
    at = 1 + np.flatnonzero(inner & (hz[1:-1] >= band[0]) & (hz[1:-1] <= band[1]))
    return np.asarray(hz[at[np.argsort(-power[at])[:count]]])


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
        self._stretches = [_LagStretch(time[part], flat[part], tau) for part in stretches(time)]

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


def discretise(matrix: Array, steps: Array, fastest: float) -> tuple[Array, Array]:
    """Transitions exp(M h) and responses to inputs t^j / j! of the lower half of the states.

    Args:
        matrix: (n, S, S) M.
        steps: (n,) h, s.
        fastest: largest modulus of an eigenvalue of M, 1/s; bounds what the series is summed for.

    Returns:
        (n, S, S) and (4, n, S, S / 2) for j = 0 to 3: integrals of exp(M (h - t)) t^j / j!.
    """
    longest = fastest * float(np.max(steps, initial=0.0)) / _LONGEST_STEP
    doublings = max(0, math.ceil(math.log2(longest))) if longest > 1.0 else 0
    part = steps / 2.0**doublings
    found, pushes = _discretise_short(matrix, part)
    for _ in range(doublings):
        found, pushes = _doubled(found, pushes, part)
        part = 2.0 * part
    return found, pushes


def _discretise_short(matrix: Array, steps: Array) -> tuple[Array, Array]:
    """`discretise` by a series, for steps of at most `_LONGEST_STEP`."""
    step = steps[:, None, None]
    scaled = matrix * step
    size = matrix.shape[-1]
    place = np.arange(size)
    found = np.zeros_like(scaled)
    pushes = np.empty((4, *matrix.shape[:-1], size // 2))
    for order in range(_SERIES + 4, -1, -1):  # phi_j = 1 / j! + M h phi_j+1
        found = scaled @ found
        found[:, place, place] += 1.0 / math.factorial(order)
        if 1 <= order <= 4:
            pushes[order - 1] = step**order * found[..., size // 2 :]
    return found, pushes


def _doubled(transition: Array, pushes: Array, steps: Array) -> tuple[Array, Array]:
    """`discretise` of twice the step: P_j(2h) = T P_j(h) + sum_i P_i(h) h^(j - i) / (j - i)!."""
    step = steps[:, None, None]
    twice = transition @ pushes
    for j in range(len(pushes)):
        for i in range(j + 1):
            twice[j] += pushes[i] * step ** (j - i) / math.factorial(j - i)
    return transition @ transition, twice


def pushed(pushes: Array, rises: Array) -> Array:
    """Input of every step, (n, S, m), for a drive with derivatives (4, n, S / 2, m)."""
    return np.asarray(np.sum(pushes @ rises, axis=0))
