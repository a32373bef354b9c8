"""What the shape of a body tells of its inertia: density is a field whose spread the data decide.

Density at x, over the mean, is 1 + f(x); f has standard deviation s everywhere and is alike over a
length l; parts of the shape, and the surface against the inside, differ by s as well. Per unit of
mass the ten parameters then have the mean of the even body and a covariance s^2 K(l), integrals
over the volume. Spread, length and reading of the volume are averaged by their evidence.
Source: Rasmussen, Williams 2006, ch. 2 and 5 (Gaussian processes, evidence).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import nnls
from scipy.spatial.distance import cdist
from scipy.special import chdtrc, logsumexp

from tactile_dynamics_ros.core.inertia.batch.inertial_estimate import InertialEstimate
from tactile_dynamics_ros.core.inertia.batch.knowledge import larger_than_body
from tactile_dynamics_ros.core.inertia.batch.prior import LogCholeskyPrior
from tactile_dynamics_ros.core.numerics.least_squares import levenberg_marquardt
from tactile_dynamics_ros.core.rigid_body.inertial_parameters import (
    InertialParameters,
    dynamic_parameters_from_log_cholesky,
    dynamic_parameters_from_pseudo_inertia,
    log_cholesky,
    log_cholesky_jacobian,
)
from tactile_dynamics_ros.core.shape.solid import Solid, Volume

Array = NDArray[np.float64]

SPREADS = (0.02, 0.05, 0.1, 0.2, 0.4, 0.8, 1.6, 3.2)
"""Standard deviations of density over its mean that are weighed: from a cast block to a steel head
on a wooden handle. Each is as likely as the next before; where data tell nothing, intervals are
those of the larger ones. Without the largest, 90 % intervals of hammers hold too seldom."""
LENGTHS = (0.1, 0.3, 1.0)
"""Lengths over which density is alike, over the longest edge of the box around the body: a bolt in
a handle, a head, one end against the other. Longer ones are a slope from end to end, as 1 is."""
_EVEN = 0.1
"""Spread up to which a body counts as even, for the question whether data contradict the shape:
walls and labels of a full box, rounding of a mesh. Smaller ones call such bodies uneven."""
_CONTRADICTED = 1e-3
"""Probability, of an even body, below which the shape is said to be contradicted: one of a thousand
even bodies is by chance. Higher warns more often of nothing, lower later of ballast."""
_HOLLOW = 0.3
"""Share of the way from an even body to one whose mass is all in its skin, from which a body is
said to be denser at its surface. A box with walls of a tenth of its width is at 0.6."""
_LEAST_SHARE = 1e-3
"""Share of the even body that is mixed into one of point masses, so that it has a thickness. Larger
ones pull at bodies at the edge of what fits; at 0 flat bodies have no logarithm."""
_WIDE = np.array([2.0, 1.0, 1.0, 1.0])
"""Standard deviations of half the logarithm of the mass and of the logarithms of the three radii
with which a fit is begun from the shape; shears and centre have a radius of gyration. Wider than
density can make any body in the shape. What the fit learns from it is taken out again."""
_MOST_STEPS = 20
"""Steps of the search for the most likely body, at most; five are usual."""
_TOLERANCE = 1e-6
"""Relative fall of the squared error that ends it: bodies are then exact to a thousandth of a
standard deviation. Larger ones save a step, smaller ones change nothing."""
_FLATTEST = 1e-4
"""Variance of what density may change along a direction, over the largest, that is kept at least:
sheets and wires have none across. At 0 their thickness would be known exactly."""


@dataclass(frozen=True)
class Field:
    """Dynamic parameters per unit of mass under one reading of volume and length.

    Attributes:
        volume: the reading.
        mean: (10,) of the even body.
        at: (N, 10) of each point, less the mean.
        response: (N, 10) covariance of the density at each point with the parameters, at spread 1.
        skin: (10,) from the even body to one whose mass is all in its surface.
        covariance: (10, 10) at spread 1.
    """

    volume: Volume
    mean: Array
    at: Array
    response: Array
    skin: Array
    covariance: Array

    @classmethod
    def of(cls, volume: Volume, surface: Array, length: float) -> Field:
        """Integrate over the volume.

        Args:
            volume: its points.
            surface: (M, 3) m.
            length: m, over which density is alike.
        """
        points = point_masses(volume.points)
        mean = points.mean(axis=0)
        at, skin = points - mean, point_masses(surface).mean(axis=0) - mean
        alike = np.exp(-0.5 * cdist(volume.points, volume.points, "sqeuclidean") / length**2)
        alike += volume.part[:, None] == volume.part
        response = alike @ at / len(at)
        covariance = at.T @ response / len(at) + np.outer(skin, skin)
        return cls(volume, mean, at, response, skin, covariance)

    def white(self, spread: float, size: float) -> tuple[Array, Array, float]:
        """Normal prior of the nine coordinates that do not depend on the mass.

        Args:
            spread: of density.
            size: m, of the body.

        Returns:
            (9, 9) root of its information, (9,) its mean, half the logarithm of its determinant.
        """
        xi = log_cholesky(InertialParameters.from_dynamic_parameters(self.mean).pseudo_inertia)
        units = np.concatenate([np.zeros(3), np.full(6, np.log(size))])
        scale = np.exp(units)
        to_phi = log_cholesky_jacobian(xi)[1:, 1:] * scale
        back = np.linalg.inv(to_phi)
        values, vectors = np.linalg.eigh(back @ self.covariance[1:, 1:] @ back.T)
        std = spread * np.sqrt(np.maximum(values, _FLATTEST * values[-1]))
        white = (vectors / std).T / scale
        return white, xi[1:], float(np.log(std).sum() + units.sum())


@dataclass(frozen=True)
class ShapePrior:
    """The ten parameters of a body whose shape is known.

    Attributes:
        solid: what it fills.
    """

    solid: Solid

    @cached_property
    def fields(self) -> tuple[Field, ...]:
        """Readings of volume and length."""
        lengths = [share * self.solid.size for share in LENGTHS]
        volumes = self.solid.volumes
        return tuple(Field.of(v, self.solid.surface, one) for v in volumes for one in lengths)

    @cached_property
    def units(self) -> Array:
        """(10,) units in which parameters per unit of mass are near one: 1, m, m^2."""
        size = self.solid.size
        return np.concatenate([[1.0], np.full(3, size), np.full(6, size**2)])

    @property
    def start(self) -> LogCholeskyPrior:
        """A wide prior about the even body of 1 kg, for `fit_from`."""
        mean = np.mean([field.mean for field in self.fields], axis=0)
        xi = log_cholesky(InertialParameters.from_dynamic_parameters(mean).pseudo_inertia)
        radius = float(np.exp(xi[1:4].max()))
        return LogCholeskyPrior(xi, np.concatenate([_WIDE, np.full(6, radius)]))

    def weigh(self, seen: Seen) -> Weighed:
        """Hold every spread, length and volume against the data."""
        pairs = ((field, spread) for field in self.fields for spread in SPREADS)
        found = [Belief.of(field, spread, seen, self.solid.size) for field, spread in pairs]
        return Weighed(self, seen, tuple(found))


def point_masses(points: Array) -> Array:
    """Dynamic parameters (N, 10) of unit masses at points (N, 3)."""
    ends = np.concatenate([points, np.ones((len(points), 1))], axis=1)
    return dynamic_parameters_from_pseudo_inertia(ends[:, :, None] * ends[:, None, :])


@dataclass(frozen=True)
class Seen:
    """What the data alone say: |root (phi' - phi) - target|^2 / 2.

    Attributes:
        phi: (10,) where they are expanded.
        root: (k, 10).
        target: (k,).
    """

    phi: Array
    root: Array
    target: Array

    @classmethod
    def of(cls, estimate: InertialEstimate, prior: LogCholeskyPrior) -> Seen:
        """Take the prior of a fit out of its estimate.

        With C the covariance of z = (xi - mean) / std, the data have the information C^-1 - 1,
        where that is positive, and the slope z there.

        Args:
            estimate: fitted with the prior.
            prior: independent normal, of the log-Cholesky coordinates.
        """
        xi = log_cholesky(estimate.inertia.pseudo_inertia)
        to_unit = np.linalg.inv(log_cholesky_jacobian(xi) * prior.std)
        whole = np.linalg.inv(to_unit @ estimate.covariance @ to_unit.T)
        values, vectors = np.linalg.eigh(0.5 * (whole + whole.T) - np.eye(10))
        seen = values > 0.0
        root = np.sqrt(values[seen])[:, None] * vectors[:, seen].T
        slope = vectors[:, seen].T @ ((xi - prior.mean) / prior.std)
        target = slope / np.sqrt(values[seen])
        return cls(estimate.inertia.dynamic_parameters, root @ to_unit, target)


@dataclass(frozen=True)
class Belief:
    """The body under one spread, length and volume, after the data.

    Attributes:
        field: volume and length.
        spread: of density.
        xi: (10,) most likely log-Cholesky coordinates.
        covariance: (10, 10) of them.
        evidence: logarithm, up to a constant (Laplace).
        surprise: squared distance of the data from the even body, in the standard deviations that
            spread and data allow together.
    """

    field: Field
    spread: float
    xi: Array
    covariance: Array
    evidence: float
    surprise: float

    @classmethod
    def of(cls, field: Field, spread: float, seen: Seen, size: float) -> Belief:
        """Combine; the mass is free, and the other coordinates do not depend on it.

        Args:
            field: volume and length.
            spread: of density.
            seen: the data.
            size: m, of the body.
        """
        white, start, log_volume = field.white(spread, size)
        start = np.concatenate([[0.5 * np.log(seen.phi[0])], start])

        def evaluate(xi: Array) -> tuple[Array, Array]:
            apart = dynamic_parameters_from_log_cholesky(xi) - seen.phi
            residual = [seen.root @ apart - seen.target, white @ (xi[1:] - start[1:])]
            beside = np.zeros((9, 1))
            jacobian = [seen.root @ log_cholesky_jacobian(xi), np.hstack([beside, white])]
            return np.concatenate(residual), np.concatenate(jacobian)

        xi, _ = levenberg_marquardt(evaluate, start, _MOST_STEPS, _TOLERANCE)
        residual, jacobian = evaluate(xi)
        information = jacobian.T @ jacobian
        squares = float(residual @ residual)
        halves = 0.5 * float(np.linalg.slogdet(information)[1]) + log_volume
        covariance = np.linalg.inv(information)
        return cls(field, spread, xi, covariance, -0.5 * squares - halves, squares)


@dataclass(frozen=True)
class Weighed:
    """Beliefs under all spreads, lengths and volumes, with their weights.

    Attributes:
        prior: of the shape.
        seen: the data.
        beliefs: all of them.
    """

    prior: ShapePrior
    seen: Seen
    beliefs: tuple[Belief, ...]

    @cached_property
    def weights(self) -> Array:
        """(B,) probabilities."""
        evidence = np.array([belief.evidence for belief in self.beliefs])
        return np.asarray(np.exp(evidence - logsumexp(evidence)))

    @cached_property
    def xi(self) -> Array:
        """(10,) mean of the log-Cholesky coordinates."""
        return np.asarray(self.weights @ np.array([belief.xi for belief in self.beliefs]))

    @cached_property
    def phi(self) -> Array:
        """(10,) dynamic parameters there."""
        return dynamic_parameters_from_log_cholesky(self.xi)

    @cached_property
    def covariance(self) -> Array:
        """(10, 10) of phi, of the mixture."""
        total = np.zeros((10, 10))
        for weight, belief in zip(self.weights, self.beliefs, strict=True):
            apart = belief.xi - self.xi
            total += weight * (belief.covariance + np.outer(apart, apart))
        to_phi = log_cholesky_jacobian(self.xi)
        return np.asarray(to_phi @ total @ to_phi.T)

    @property
    def spread(self) -> float:
        """Root mean square of the spreads."""
        squares = np.array([belief.spread**2 for belief in self.beliefs])
        return float(np.sqrt(self.weights @ squares))

    @property
    def contradicts(self) -> bool:
        """Whether no reading of the shape with an even density explains the data."""
        least = min(b.surprise for b in self.beliefs if b.spread <= _EVEN)
        return bool(chdtrc(9, max(least, 0.0)) < _CONTRADICTED)

    @property
    def body(self) -> InertialParameters:
        """The nearest body of positive density inside the shape's hull."""
        hull = np.concatenate([self.prior.solid.surface, self.prior.fields[-1].volume.points])
        phi = nearest_density(self.phi, self.covariance, point_masses(hull), self.prior.units)
        return InertialParameters.from_dynamic_parameters(phi)

    @property
    def where(self) -> str:
        """Where the body is denser than even, in words."""
        best = self.beliefs[int(np.argmax(self.weights))]
        field, units = best.field, self.prior.units
        phi = dynamic_parameters_from_log_cholesky(best.xi)
        apart = (phi / phi[0] - field.mean)[1:] / units[1:]
        spread = field.covariance[1:, 1:] / np.outer(units[1:], units[1:])
        moved = np.linalg.lstsq(spread, apart, rcond=_FLATTEST)[0] / units[1:]
        skin = float(field.skin[1:] @ moved)
        density = field.response[:, 1:] @ moved
        if skin > _HOLLOW:
            return "its surface (hollow)"
        place = 1e3 * field.volume.points[int(np.argmax(density))]
        return "({:.0f}, {:.0f}, {:.0f}) mm".format(*place)


def nearest_density(phi: Array, covariance: Array, masses: Array, units: Array) -> Array:
    """Nearest dynamic parameters to phi, in its covariance, of masses that are not negative.

    Args:
        phi: (10,).
        covariance: (10, 10).
        masses: (N, 10) of unit point masses, wherever there may be mass.
        units: (10,) of parameters per unit of mass.

    Source: Lawson, Hanson 1974, ch. 23.
    """
    scale = phi[0] * units
    values, vectors = np.linalg.eigh(covariance / np.outer(scale, scale))
    white = (vectors / np.sqrt(np.maximum(values, 1e-12 * values[-1]))).T / scale
    rows = masses @ white.T * phi[0]
    even = rows.mean(axis=0)
    target = white @ phi - _LEAST_SHARE * even
    shares, _ = nnls(rows.T, target)
    found = shares @ masses + _LEAST_SHARE * masses.mean(axis=0)
    return np.asarray(phi[0] * found)


def with_shape(
    estimate: InertialEstimate, start: LogCholeskyPrior, prior: ShapePrior
) -> tuple[InertialEstimate, Weighed]:
    """Combine an estimate with what the shape tells.

    Args:
        estimate: of a fit from `start`.
        start: the prior of that fit, which is taken out again.
        prior: of the shape.

    Returns:
        The estimate of a body that fits in the shape's hull, and what was weighed.
    """
    weighed = prior.weigh(Seen.of(estimate, start))
    body = weighed.body
    unknown = set(larger_than_body(body, weighed.covariance))
    unknown |= {"mass"} & set(estimate.not_excited)
    names = tuple(name for name in estimate.not_excited if name in unknown)
    found = replace(
        estimate, inertia=body, covariance=weighed.covariance, not_excited=names, lasting=None
    )
    return found, weighed
