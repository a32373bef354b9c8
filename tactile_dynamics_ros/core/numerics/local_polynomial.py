"""Value and derivatives of a sampled signal as linear functionals of nearby samples."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.array import Array

_WITHOUT_GAPS = 99.0
"""Percentile of steps up to which their mean counts: the largest 1 % may be gaps, which would make
the mean long. A stream with more gaps than that reads as bursts."""
_BURSTS = 1.3
"""Mean over median step from which samples come in bursts: then the mean is the period. Jitter of
even streams stays far below 1.3; a stream that sends pairs has 2 or more. Nearer to 1 jitter counts
as bursts, above 2 pairs count as an even stream of twice the rate."""
_PAUSE = 5.0
"""Step over the median step from which a stream pauses. Up to three samples lost in a row make a
step of 4; a recorder that is stopped between poses makes far more. At 3 lost samples count as
pauses, far higher ones overlook short pauses."""
_STRETCH = 0.2
"""Length, s, of even samples between pauses from which the pauses are gaps and not the rhythm of
bursts: a pose that is held is recorded for longer, a burst of a driver that sends what it has
gathered lasts milliseconds. Anything from 0.05 to 0.5 s tells these two apart."""
_LEAST_DEGREE = 2
"""Degree that a polynomial keeps where a stretch between gaps is shorter than its window: with less
no acceleration could be read. Three would need longer stretches."""
_SPARE = 2
"""Samples that a tapered window has at least beyond those that determine its polynomial: its
outermost count little. With none, noise of derivatives explodes."""
_FAINT = 1e-3
"""Share to which samples beyond the half width of a taper fall (before squaring): windows with few
samples inside stay solvable by those outside, which otherwise count a millionth. Ten times more
would let quick motion far away in."""
_LOST = 1.0 / 6.0
"""Share of its samples that a window may lack, at least one: of 15 poses two. More would read
derivatives across gaps with far more noise than stated; fewer would drop whole windows for single
lost poses."""
_ORDERS = np.arange(3)
"""Derivatives that are read: value, first, second. Three are what Newton and Euler need; more are
noise."""
_FACTORIALS = np.array([1.0, 1.0, 2.0])
"""Factorials of these orders. They follow from the orders."""
_SLOPE_SEEN = 0.2
"""Least spread of samples over the square of their distance from zero that a line needs; with less
their plain mean is taken, since a line through samples on one side would be carried far beyond
them. At zero such lines are taken, near one hardly any line is."""


@dataclass(frozen=True)
class Window:
    """Samples around a time and the polynomial through them.

    Attributes:
        half_width: s.
        degree: degree of the polynomial.
        tapered: samples count less the farther they are. What polynomials on untapered windows let
            through of the noise at high frequencies comes back as slow noise where the grid is
            slower than the samples. Source: Schmid, Rath & Diebold 2022, ACS Meas. Sci. Au 2, 185.
    """

    half_width: float
    degree: int
    tapered: bool = False

    def size(self, period: float) -> int:
        """Samples of a window, at least so many that the ends of a tapered one may weigh little."""
        least = self.degree + 1 + (_SPARE + 1 if self.tapered else 1)
        return max(2 * round(self.half_width / period) + 1, least)


@dataclass(frozen=True)
class LocalFunctional:
    """Linear functionals x^(o)(t_n) = sum_k weights[n, o, k] x[start_n + k].

    Attributes:
        start: (N,) index of the first sample used.
        weights: (N, O, W), order o = 0 value, 1 first, 2 second derivative.
        valid: (N,) False where the samples leave a gap around t_n.
    """

    start: NDArray[np.int64]
    weights: Array
    valid: NDArray[np.bool_]

    @property
    def indices(self) -> NDArray[np.int64]:
        """(N, W) sample indices."""
        return self.start[:, None] + np.arange(self.weights.shape[2])

    def gather(self, values: Array) -> Array:
        """Samples of each window, (K, ...) -> (N, W, ...)."""
        return values[self.indices]

    def apply(self, values: Array, order: int) -> Array:
        """Derivative of the given order at every grid time, (K, d) -> (N, d)."""
        return np.asarray((self.weights[:, order, None] @ self.gather(values))[:, 0])

    def apply_all(self, values: Array) -> Array:
        """Value and derivatives at every grid time, (K, d) -> (O, N, d)."""
        return np.moveaxis(self.weights @ self.gather(values), 1, 0)


def typical_period(sample_time: Array) -> float:
    """Period of samples in s: the median step, or the mean where samples come in bursts.

    Stretches of even samples with pauses between them, as of poses that are held one after the
    other, are no bursts.
    """
    steps = np.diff(sample_time)
    median = float(np.median(steps))
    mean = float(np.mean(steps[steps <= np.percentile(steps, _WITHOUT_GAPS)]))
    if mean <= _BURSTS * median:
        return median
    first, last = _runs(sample_time, _PAUSE * median)
    lasting = float(np.median(sample_time[last] - sample_time[first]))
    return median if lasting >= _STRETCH else mean


def _runs(time: Array, longest: float) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """First and last sample (K,) of the run of each sample; steps above `longest` part runs."""
    breaks = np.flatnonzero(np.diff(time) > longest)
    starts = np.concatenate([[0], breaks + 1])
    ends = np.concatenate([breaks, [len(time) - 1]])
    run = np.repeat(np.arange(len(starts)), ends - starts + 1)
    return starts[run], ends[run]


def centred_weights(shares: Array, offset: Array) -> Array:
    """Weights (N, W) of the mean, at offset zero, of a line through samples that count by `shares`.

    w_k = s_k (S_2 - S_1 o_k) / (S_0 S_2 - S_1^2), S_j = sum s_k o_k^j. A plain mean of samples that
    come unevenly, or of which one is lost, would read a force early or late. Where the samples do
    not tell a slope it is that mean; where there are none, zero.

    Args:
        shares: (N, W) not negative.
        offset: (N, W) s.
    """
    zeroth, first, second = (np.sum(shares * offset**k, axis=-1, keepdims=True) for k in range(3))
    determinant = zeroth * second - first**2
    several = determinant > _SLOPE_SEEN * zeroth * second
    slope = np.divide(first, second, where=several, out=np.zeros_like(first))
    weights = shares * (1.0 - slope * offset)
    total = np.sum(weights, axis=-1, keepdims=True)
    return np.asarray(np.divide(weights, total, where=total > 0.0, out=np.zeros_like(weights)))


def lagrange_weights(nodes: Array, at: Array) -> Array:
    """Weights (N, W) by which values at nodes (N, W) give their polynomial at (N,) times."""
    count = nodes.shape[1]
    others = ~np.eye(count, dtype=bool)
    to_nodes = (at[:, None] - nodes)[:, None, :]
    between = nodes[:, :, None] - nodes[:, None, :] + np.eye(count)
    return np.asarray(np.prod(np.where(others, to_nodes / between, 1.0), axis=2))


def local_polynomial(
    sample_time: Array, grid_time: Array, window: Window, orders: int = 3
) -> LocalFunctional:
    """Least-squares polynomial through the samples around each grid time.

    Args:
        sample_time: (K,) s, increasing.
        grid_time: (N,) s, increasing.
        window: the samples used and the degree, which is less if there are too few at all.
        orders: number of derivative orders wanted, including the value.

    Returns:
        The functionals; windows are clipped at the ends of the recording and at gaps, and not
        tapered there, so that no sample beyond a gap is read. Of those that ought to be tapered
        none is valid that lacks more than a quarter at one side.
    """
    period = typical_period(sample_time)
    size = min(window.size(period), len(sample_time))
    degree = min(window.degree, size - 1)
    lost = max(1.0, _LOST * size)
    nearest = _nearest(sample_time, grid_time)
    first, last = (ends[nearest] for ends in _runs(sample_time, (lost + 1.5) * period))
    middle = 0.5 * period if size % 2 else 0.0
    unclipped = np.searchsorted(sample_time, grid_time - middle) - size // 2
    whole = last - first + 1 >= size
    start = np.where(whole, np.clip(unclipped, first, last - size + 1), first)
    start = np.clip(start, 0, len(sample_time) - size).astype(np.int64)
    clipped = np.abs(start - unclipped)
    offset = sample_time[start[:, None] + np.arange(size)] - grid_time[:, None]
    shares = np.ones_like(offset)
    if window.tapered:
        even = clipped == 0
        shares[even] = tapered_shares(offset[even], 0.5 * (size + 1) * period)
    span = offset[:, -1] - offset[:, 0]
    near = np.abs(sample_time[nearest] - grid_time) < 1.5 * period
    valid = (span < (size + lost - 0.5) * period) & near
    # where there are no samples no polynomial is determined: such windows read as if there were
    offset[~valid] = period * (np.arange(size) - 0.5 * (size - 1))
    shares[~valid] = 1.0
    weights = polynomial_weights(shares, offset, degree, orders)
    if window.tapered:
        valid &= clipped <= size // 4
    functional = LocalFunctional(start, weights, valid)
    if window.tapered or whole.all():
        return functional
    stretches = (first, last, near & ~whole)
    return _within_stretches(functional, sample_time, grid_time, stretches, degree)


def _nearest(stamps: Array, time: Array) -> NDArray[np.int64]:
    """Index (N,) of the sample nearest to each time."""
    right = np.clip(np.searchsorted(stamps, time), 1, len(stamps) - 1)
    return np.where(time - stamps[right - 1] <= stamps[right] - time, right - 1, right)


def _within_stretches(
    functional: LocalFunctional,
    sample_time: Array,
    grid_time: Array,
    stretches: tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.bool_]],
    degree: int,
) -> LocalFunctional:
    """Read stretches between gaps that are shorter than the window by what samples they have.

    The degree falls with the number of samples, so that noise is smoothed about as much.

    Args:
        functional: with windows of full size.
        sample_time: (K,) s.
        grid_time: (N,) s.
        stretches: first and last sample (N,) of the stretch of each grid time, and which are short.
        degree: of the polynomial in windows of full size.
    """
    first, last, short = stretches
    start, weights, valid = functional.start, functional.weights.copy(), functional.valid.copy()
    orders, size = weights.shape[1:]
    counts = last - first + 1
    for count in np.unique(counts[short]):
        lower = max(_LEAST_DEGREE, degree * int(count) // size)
        if count <= lower + 1:
            continue
        rows = np.flatnonzero(short & (counts == count))
        inside = first[rows, None] + np.arange(count)
        offset = sample_time[inside] - grid_time[rows, None]
        found = polynomial_weights(np.ones_like(offset), offset, lower, orders)
        weights[rows] = 0.0
        places = inside - start[rows, None]
        weights[rows[:, None, None], np.arange(orders)[:, None], places[:, None, :]] = found
        valid[rows] = True
    return LocalFunctional(start, weights, valid)


def polynomial_weights(shares: Array, offset: Array, degree: int, orders: int = 3) -> Array:
    """Weights (N, O, W) of value and derivatives, at offset zero, of a least-squares polynomial.

    Args:
        shares: (N, W) by which squared deviations count, positive.
        offset: (N, W) s.
        degree: less than W.
        orders: O, number of derivative orders, including the value; at most 3.
    """
    scale = np.abs(offset).max(axis=1)[:, None]
    basis = (offset / scale)[..., None] ** np.arange(degree + 1)
    counted = np.swapaxes(basis * shares[..., None], 1, 2)
    solution = np.linalg.solve(counted @ basis, counted)[:, :orders]
    factors = _FACTORIALS[:orders] / scale ** _ORDERS[:orders]
    return np.asarray(solution * factors[..., None])


def tapered_shares(offset: Array, half_width: float) -> Array:
    """(1 - u^2)^2 of distances u in half widths, and hardly anything beyond one."""
    return np.asarray(np.maximum(1.0 - (offset / half_width) ** 2, _FAINT) ** 2)
