"""Points from the surfaces of some superquadrics and from strays: their likelihood."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import logsumexp

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.shape.superquadric.chart import SHAPE_NAMES, Chart, Placed
from tactile_dynamics_ros.core.shape.superquadric.gauge import areas
from tactile_dynamics_ros.core.shape.superquadric.superquadric import Superquadric

_STRAYS = 0.1
"""Share of strays that is presumed at first, as the simulated camera has; it is estimated then. At
0.01 the first steps follow strays, at 0.5 they give up parts of the object."""
_FLATTEST = 0.5
"""Least extent of the box in which strays lie, as a share of its largest: of an object that is seen
from above alone points fill a flat box, in which strays would be likelier than the surface. At zero
an object seen from above loses its points to strays; at 1 strays of a flat cloud are spread too
thin and pull at the surface."""
PRIOR_STD = np.array([2.0, 2.0, 2.0, 1.0, 1.0, 0.5, 0.5])
"""Standard deviations of the shape's coordinates before any point: axes within a factor of 7, all
exponents alike, tapers that seldom reach a triangle. They decide only what no point shows. Smaller
bends shapes that few points show towards `_USUAL`, larger lets unseen sides grow far out."""


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
        least: noise below which none is believed, m.
    """

    shapes: tuple[Superquadric, ...]
    shares: Array
    strays: float
    noise: float
    volume: float
    scale: Array
    chart: Chart
    least: float = 0.0

    @classmethod
    def around(
        cls,
        shapes: Sequence[Superquadric],
        points: Array,
        scale: Array,
        chart: Chart,
        noise: float,
        least: float = 0.0,
    ) -> Mixture:
        """Equal shares of all parts, and a tenth of strays in the box around the points."""
        extent = np.ptp(points, axis=0)
        volume = float(np.prod(np.maximum(extent, _FLATTEST * extent.max())))
        shares = np.full(len(shapes), 1.0 / len(shapes))
        return cls(tuple(shapes), shares, _STRAYS, noise, volume, scale, chart, least)

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
        return [self.chart.distance(shape, points) for shape in self.shapes]

    def memberships(self, points: Array) -> Array:
        """Return the probabilities (N, K + 1) that points belong to each part, strays last."""
        logs = self.log_densities(self.distances(points))
        return np.asarray(np.exp(logs - logsumexp(logs, axis=1, keepdims=True)))

    def cost(self, points: Array, weights: Array | float = 1.0) -> float:
        """Return -log likelihood of points (N, 3), m, with weights (N,)."""
        logs = logsumexp(self.log_densities(self.distances(points)), axis=1)
        return -float(np.sum(weights * logs))

    def covariance(self, points: Array, member: Array) -> Array:
        """Return the covariance (P, P) of the only part's coordinates.

        The area term decides what no point shows. With information I it shifts coordinates by
        I^-1 N d(ln A), whatever the number N of points; that shift counts as uncertain as well, up
        to a prior's standard deviation.

        Args:
            points: (N, 3) world, m.
            member: (N,) probabilities that they belong to it.
        """
        placed = Placed.of([self.shapes])[0, 0]
        _, jacobian = self.chart.linearise(placed, points.T)
        information = (jacobian * (member / (self.noise * self.scale) ** 2)) @ jacobian.T
        count = len(SHAPE_NAMES)
        information[np.arange(count), np.arange(count)] += 1.0 / PRIOR_STD**2
        pull = np.zeros(len(information))
        pull[:count] = member.sum() * areas(placed.shape)[1]
        free = ~self.chart.held(placed.shape, np.zeros(len(information)))
        covariance, shift = np.zeros_like(information), np.zeros(len(information))
        inverse = np.linalg.pinv(information[np.ix_(free, free)], hermitian=True)
        covariance[np.ix_(free, free)] = inverse
        shift[free] = inverse @ pull[free]
        shift /= max(1.0, float(np.max(np.abs(shift[:count]) / PRIOR_STD)))
        return covariance + np.outer(shift, shift)
