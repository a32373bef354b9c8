"""Points from the surfaces of some superquadrics and from strays: likelihood and its maximum."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

from tactile_dynamics_ros.core.shape.superquadric.chart import SHAPE_NAMES, Chart
from tactile_dynamics_ros.core.shape.superquadric.superquadric import Superquadric, areas

Array = NDArray[np.float64]

_STRAYS = 0.1
"""Share of strays that is presumed at first, as the simulated camera has; it is estimated then. At
0.01 the first steps follow strays, at 0.5 they give up parts of the object."""
_FLATTEST = 0.5
"""Least extent of the box in which strays lie, as a share of its largest: of an object that is seen
from above alone points fill a flat box, in which strays would be likelier than the surface."""
_LEAST_STRAYS, _MOST_STRAYS = 1e-3, 0.9
"""Between which the share of strays is estimated: with none at all one stray would count like any
number of points, and with nothing but strays no part would be left to estimate."""
_LEAST_NOISE = 1e-4
"""Least standard deviation of points across the surface, as a share of the cloud's size: 10 um on
10 cm, less than any camera has. At zero the likelihood of exact points has no maximum."""
_DAMPING = 1e-3
"""First damping of Levenberg-Marquardt, as a share of the diagonal; from 1e-4 to 1e-2 the same
optima are found."""
_PRIOR_STD = np.array([2.0, 2.0, 2.0, 1.0, 1.0, 0.5, 0.5])
"""Standard deviations of the shape's coordinates before any point: axes within a factor of 7, all
exponents alike, tapers that seldom reach a triangle. They decide only what no point shows."""
_USUAL = np.array([0.0, 0.0, 0.0, 0.5, 0.7, 0.0, 0.0])
"""Centre of the prior: between box and cylinder, not tapered. Its axes are those of the start."""
_TRIES = 6
"""Dampings that are tried for a step before a part is left as it is: a factor of a million."""
_SETTLED = 1e-3
"""Relative change of the noise from which it counts as settled: 0.1 %, far below what its own
uncertainty is with a thousand points (2 %)."""
_AREA_STEP = 1e-4
"""Step of the numeric derivative of the logarithm of the area."""


@dataclass(frozen=True)
class Mixture:
    """Superquadrics on which points lie, with noise and strays.

    The density of a point is, with r the distance to a surface of area A and s the known scale of
    the noise at the point,

        p(x) = w0 / V + (1 - w0) sum_k pi_k / (A_k + 4 pi sigma^2) N(r_k; 0, (sigma s)^2).

    Source: paper B, Eq. 3 to 9, integrated along the surface; the term beside the area is what the
    layer around a small surface has more, without which a part that shrinks to a point would be
    infinitely likely.

    Attributes:
        shapes: the K parts.
        shares: (K,) pi, their sum is 1.
        strays: w0.
        noise: sigma, m.
        volume: V, m^3, of the box in which strays lie.
        scale: (N,) s of the points.
        chart: coordinates of the shapes.
    """

    shapes: tuple[Superquadric, ...]
    shares: Array
    strays: float
    noise: float
    volume: float
    scale: Array
    chart: Chart

    @classmethod
    def around(
        cls, shapes: Sequence[Superquadric], points: Array, scale: Array, chart: Chart, noise: float
    ) -> Mixture:
        """Equal shares of all parts, and a tenth of strays in the box around the points."""
        extent = np.ptp(points, axis=0)
        volume = float(np.prod(np.maximum(extent, _FLATTEST * extent.max())))
        shares = np.full(len(shapes), 1.0 / len(shapes))
        return cls(tuple(shapes), shares, _STRAYS, noise, volume, scale, chart)

    def log_densities(self, distances: Sequence[Array]) -> Array:
        """Return the logarithms (N, K + 1) of the summands of p, strays last.

        Args:
            distances: (N,) m to each part.
        """
        std = self.noise * self.scale
        ball = 4.0 * np.pi * self.noise**2
        parts = [
            np.log((1.0 - self.strays) * share / (shape.area + ball))
            - 0.5 * (r / std) ** 2
            - np.log(std * np.sqrt(2.0 * np.pi))
            for r, share, shape in zip(distances, self.shares, self.shapes, strict=True)
        ]
        stray = np.full(len(std), np.log(self.strays / self.volume))
        return np.stack([*parts, stray], axis=1)

    def distances(self, points: Array) -> list[Array]:
        """Return the distances (N,), m, of points (N, 3) to each part."""
        return [self.chart.linearise(shape, points)[0] for shape in self.shapes]

    def memberships(self, points: Array) -> Array:
        """Return the probabilities (N, K + 1) that points belong to each part, strays last."""
        return self._shared(self.distances(points))

    def _shared(self, distances: Sequence[Array]) -> Array:
        """Return `memberships` of points at distances (N,) from each part."""
        logs = self.log_densities(distances)
        return np.asarray(np.exp(logs - logsumexp(logs, axis=1, keepdims=True)))

    def cost(self, points: Array) -> float:
        """Return -log likelihood of points (N, 3)."""
        return -float(logsumexp(self.log_densities(self.distances(points)), axis=1).sum())

    def covariance(self, points: Array, member: Array) -> Array:
        """Return the covariance (P, P) of the only part's coordinates.

        Args:
            points: (N, 3) world, m.
            member: (N,) probabilities that they belong to it.
        """
        _, jacobian = self.chart.linearise(self.shapes[0], points)
        weighted = jacobian * (member / (self.noise * self.scale) ** 2)[:, None]
        information = weighted.T @ jacobian
        count = len(SHAPE_NAMES)
        information[np.arange(count), np.arange(count)] += 1.0 / _PRIOR_STD**2
        free = ~self.chart.held(self.shapes[0], np.zeros(len(information)))
        covariance = np.zeros_like(information)
        inverse = np.linalg.pinv(information[np.ix_(free, free)], hermitian=True)
        covariance[np.ix_(free, free)] = inverse
        return covariance


def maximise(
    mixture: Mixture, points: Array, steps: int, tolerance: float = 1e-7, least: float = 0.0
) -> Mixture:
    """Raise the likelihood by expectation maximisation, one damped step of each part at a time.

    Args:
        mixture: start.
        points: (N, 3) world, m.
        steps: at most.
        tolerance: relative change of axes below which it has converged.
        least: noise below which none is believed, m.
    """
    size = float(np.ptp(points, axis=0).max())
    floor = max(least, _LEAST_NOISE * size)
    damping = [_DAMPING] * len(mixture.shapes)
    at = [_Linear(shape, *mixture.chart.linearise(shape, points)) for shape in mixture.shapes]
    for _ in range(steps):
        member = mixture._shared([linear.distance for linear in at])
        precision = 1.0 / (mixture.noise * mixture.scale) ** 2
        squares, change = 0.0, 0.0
        for k, linear in enumerate(at):
            part = _Part(mixture.chart, points, member[:, k], precision)
            at[k], damping[k], moved = part.step(linear, damping[k])
            squares += part.square(at[k]) / precision[0] / mixture.scale[0] ** 2
            change = max(change, moved / size)
        inliers = member[:, :-1].sum(axis=0)
        noise = max(float(np.sqrt(squares / max(inliers.sum(), 1.0))), floor)
        settled = abs(np.log(noise / mixture.noise)) < _SETTLED
        mixture = replace(
            mixture,
            shapes=tuple(linear.shape for linear in at),
            shares=np.maximum(inliers, 1.0) / np.maximum(inliers, 1.0).sum(),
            strays=float(np.clip(member[:, -1].mean(), _LEAST_STRAYS, _MOST_STRAYS)),
            noise=noise,
        )
        if change < tolerance and settled:
            break
    return mixture


@dataclass(frozen=True)
class _Linear:
    """A shape with the distances (N,) of all points and their Jacobian (N, P)."""

    shape: Superquadric
    distance: Array
    jacobian: Array


@dataclass(frozen=True)
class _Part:
    """One part while the memberships of the points are fixed.

    Attributes:
        chart: coordinates.
        points: (N, 3) world, m.
        member: (N,) probability that a point belongs to it.
        precision: (N,) 1 / variance across the surface, 1/m^2.
    """

    chart: Chart
    points: Array
    member: Array
    precision: Array

    def square(self, at: _Linear) -> float:
        """Sum of squared distances over their variances, by membership."""
        return float(np.sum(self.member * self.precision * at.distance**2))

    def objective(self, at: _Linear) -> float:
        """What a step lowers: squares, the logarithm of the area, the prior."""
        apart = _coordinates(at.shape) - _USUAL
        prior = 0.5 * float(np.sum((apart[3:] / _PRIOR_STD[3:]) ** 2))
        size = float(self.member.sum() * np.log(at.shape.area))
        return 0.5 * self.square(at) + size + prior

    def step(self, at: _Linear, damping: float) -> tuple[_Linear, float, float]:
        """Return a better shape (or the same), the damping, and how far the surface moved, m."""
        count = len(SHAPE_NAMES)
        shape, distance, jacobian = at.shape, at.distance, at.jacobian
        weighted = jacobian * (self.member * self.precision)[:, None]
        curvature, slope = weighted.T @ jacobian, weighted.T @ distance
        slope[:count] += self.member.sum() * _log_area_slope(shape)
        slope[3:count] += (_coordinates(shape) - _USUAL)[3:] / _PRIOR_STD[3:] ** 2
        curvature[np.arange(count), np.arange(count)] += 1.0 / _PRIOR_STD**2
        free = ~self.chart.held(shape, slope)
        curvature, slope = curvature[np.ix_(free, free)], slope[free]
        before = self.objective(at)
        for _ in range(_TRIES):
            move = np.zeros(len(free))
            move[free] = -np.linalg.solve(curvature + damping * np.diag(np.diag(curvature)), slope)
            moved_shape = self.chart.moved(shape, move)
            tried = _Linear(moved_shape, *self.chart.linearise(moved_shape, self.points))
            if self.objective(tried) <= before:
                moved = float(np.max(np.abs(jacobian @ move), initial=0.0))
                return tried, max(0.2 * damping, 1e-9), moved
            damping = min(10.0 * damping, 1e6)
        return at, damping, 0.0


def _coordinates(shape: Superquadric) -> Array:
    """Coordinates (7,) of the shape, the axes as zero: their prior is centred where they are."""
    return np.concatenate([np.zeros(3), shape.exponents, shape.taper])


def _log_area_slope(shape: Superquadric) -> Array:
    """Derivatives (7,) of ln A by the coordinates of the shape."""
    steps = _AREA_STEP * np.eye(len(SHAPE_NAMES) + 1)[:, : len(SHAPE_NAMES)]
    found = areas(
        shape.semi_axes * np.exp(steps[:, :3]),
        shape.exponents + steps[:, 3:5],
        shape.taper + steps[:, 5:],
    )
    return np.asarray(np.log(found[:-1] / found[-1]) / _AREA_STEP)
