"""What the shape of a body tells of its inertia: density is a field whose spread the data decide.

The logarithm of the density is a normal field with a standard deviation s everywhere, the sum of
fields that are alike over several lengths, of one that differs by part, and of one that goes with
the depth below the surface. Bodies drawn from it have a mean and a covariance of the nine
log-Cholesky coordinates that do not depend on the mass, which is free. Spread and reading of the
volume are averaged by their evidence.
Source: Rasmussen, Williams 2006, ch. 2 and 5 (Gaussian processes, evidence).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import nnls
from scipy.spatial import cKDTree
from scipy.spatial.distance import cdist
from scipy.special import chdtrc, logsumexp

from tactile_dynamics_ros.core.inertia.batch.fitted_model import FittedModel
from tactile_dynamics_ros.core.inertia.batch.inertial_estimate import (
    PARAMETER_NAMES,
    InertialEstimate,
)
from tactile_dynamics_ros.core.inertia.batch.knowledge import larger_than_body
from tactile_dynamics_ros.core.inertia.batch.prior import LogCholeskyPrior
from tactile_dynamics_ros.core.numerics.least_squares import levenberg_marquardt
from tactile_dynamics_ros.core.rigid_body.inertial_parameters import (
    InertialParameters,
    dynamic_parameters_from_log_cholesky,
    dynamic_parameters_from_pseudo_inertia,
    log_cholesky,
    log_cholesky_jacobian,
    pseudo_inertia,
)
from tactile_dynamics_ros.core.shape.solid import Solid, Volume

Array = NDArray[np.float64]

SPREADS = (0.02, 0.05, 0.1, 0.2, 0.4, 0.8, 1.6)
"""Standard deviations of the logarithm of density that are weighed: from a cast block to a steel
head on a wooden handle. Each is as likely as the next before; where data tell nothing, intervals
are those of the larger ones. Without the largest, intervals of hammers hold too seldom."""
SKINS = (0.0, 1.0)
"""Standard deviations of the slope of the logarithm of density by depth, in standard deviations of
the depth: bodies that are even but hollow are common, and their centre does not show it. Without
the second, hollow boxes are taken for even ones of wrong inertia."""
LENGTHS = (0.1, 0.3, 1.0)
"""Lengths over which density is alike, over the longest edge of the box around the body: a bolt in
a handle, a head, one end against the other. With a single one, bodies that vary otherwise are too
far from the mean."""
_DRAWS = 200
"""Densities that are drawn, and as many that are their inverse: covariances are then known to 5 %.
More take longer, fewer make intervals scatter."""
_SEED = 66
"""Seed of the draws, so that the same file gives the same estimate."""
_ROUNDING = 1e-6
"""Variance of each point's own density, over that of the field, so that rounding leaves its
covariance positive. It averages out over the points; at 0 the root fails."""
_ROWS, _COLUMNS = np.array([0, 1, 0, 0, 1, 2]), np.array([1, 2, 2, 3, 3, 3])
"""Places of shears and centre in the factor of the pseudo-inertia. Fixed by the order of the
log-Cholesky coordinates."""
_INEXACT = 0.01
"""How exact shapes are: radii of gyration, and place and turn of the shape in the frame of the
object, to 1 % of the radius along each axis; 0.3 mm on a box of 10 cm. Random places in the volume, and meshes
beside what was made of them, are off by as much. At 0 boxes without products of inertia are
known to have none, which random places are not."""
_THINNEST = 1e-4
"""Standard deviation of the depth, over the body's size, that is presumed at least: sheets have
none, and nothing to tell hollow from even."""
_EVEN = 0.1
"""Spread up to which a body counts as even, for the question whether data contradict the shape:
walls and labels of a full box, rounding of a mesh. Smaller ones call such bodies uneven."""
_CONTRADICTED = 1e-3
"""Probability, of an even body, below which the shape is said to be contradicted: one of a thousand
even bodies is by chance. Higher warns more often of nothing, lower later of ballast."""
_HOLLOW = 0.7
"""Correlation of the most likely density with the height towards the surface from which a body is
said to be denser there. Ballast at one end has less than half."""
_LOST = 1e-10
"""Smallest eigenvalue of a covariance with unit diagonal, over its largest, that is believed; as
when an estimate is combined with an earlier one."""
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
    """Densities in one reading of a volume.

    Attributes:
        points: (N, 3) m.
        masses: (N, 10) dynamic parameters of unit masses there.
        alike: (N, N) covariance of the logarithm of the density at spread 1.
        depth: (N,) depth below the surface, over its standard deviation, about its mean.
    """

    points: Array
    masses: Array
    alike: Array
    depth: Array

    @classmethod
    def of(cls, volume: Volume, surface: Array, size: float) -> Field:
        """Measure depth and distances.

        Args:
            volume: its points.
            surface: (M, 3) m.
            size: m, of the body.
        """
        depth = cKDTree(surface).query(volume.points)[0]
        depth = (depth - depth.mean()) / max(float(depth.std()), _THINNEST * size)
        apart = cdist(volume.points, volume.points, "sqeuclidean") / size**2
        fields = [np.exp(-0.5 * apart / length**2) for length in LENGTHS]
        fields.append(volume.part[:, None] == volume.part)
        alike = np.mean(fields, axis=0)
        return cls(volume.points, point_masses(volume.points), alike, depth)

    @cached_property
    def drawn(self) -> Array:
        """(N, D) fields at spread 1, each with its negative."""
        root = np.linalg.cholesky(self.alike + _ROUNDING * np.eye(len(self.alike)))
        half = root @ np.random.default_rng(_SEED).normal(size=(len(root), _DRAWS))
        return np.concatenate([half, -half], axis=1)

    def bodies(self, spread: float, skin: float) -> Array:
        """(D, 9) coordinates of bodies of such densities: radii, shears, centre.

        Args:
            spread: of the logarithm of density.
            skin: of its slope by depth.
        """
        slope = np.random.default_rng(_SEED + 1).normal(size=_DRAWS)
        logs = spread * self.drawn + skin * np.outer(self.depth, np.append(slope, -slope))
        density = np.exp(logs - logs.max(axis=0))
        return coordinates(density.T @ self.masses)

    @property
    def even(self) -> Array:
        """(9,) coordinates of the even body."""
        return coordinates(self.masses.mean(axis=0))


@dataclass(frozen=True)
class ShapePrior:
    """The ten parameters of a body whose shape is known.

    Attributes:
        solid: what it fills.
    """

    solid: Solid

    @cached_property
    def fields(self) -> tuple[Field, ...]:
        """Readings of the volume."""
        surface, size = self.solid.surface, self.solid.size
        return tuple(Field.of(volume, surface, size) for volume in self.solid.volumes)

    @cached_property
    def unclear(self) -> Array:
        """(9, 9) covariance of the even body: readings of its volume, and how exact shapes are."""
        even = np.array([field.even for field in self.fields])
        apart = even - even.mean(axis=0)
        second = pseudo_inertia(self.fields[0].masses.mean(axis=0))
        radii = np.sqrt(np.diag(second)[:3] - second[:3, 3] ** 2)
        inexact = _INEXACT * np.append(np.ones(3), radii[_ROWS])
        return np.asarray(apart.T @ apart / max(len(even) - 1, 1) + np.diag(inexact**2))

    @property
    def scale(self) -> Array:
        """(9,) units in which coordinates are near one: 1, m."""
        return np.append(np.ones(3), np.full(6, self.solid.size))

    @property
    def start(self) -> LogCholeskyPrior:
        """A wide prior about the even body of 1 kg, for `fit_from`."""
        even = np.mean([field.even for field in self.fields], axis=0)
        radius = float(np.exp(even[:3].max()))
        return LogCholeskyPrior(np.append(0.0, even), np.append(_WIDE, np.full(6, radius)))

    def gaussian(self, field: Field, spread: float, skin: float) -> tuple[Array, Array, float]:
        """Normal prior of the nine coordinates that do not depend on the mass.

        Args:
            field: reading of the volume.
            spread: of the logarithm of density.
            skin: of its slope by depth.

        Returns:
            (9, 9) root of its information, (9,) its mean, half the logarithm of its determinant.
        """
        bodies = field.bodies(spread, skin) / self.scale
        covariance = np.cov(bodies.T) + self.unclear / np.outer(self.scale, self.scale)
        values, vectors = np.linalg.eigh(covariance)
        std = np.sqrt(np.maximum(values, _FLATTEST * values[-1]))
        white = (vectors / std).T / self.scale
        return white, bodies.mean(axis=0) * self.scale, float(np.log(std).sum())

    def weigh(self, seen: Seen) -> Weighed:
        """Hold every spread, length and volume against the data."""
        cases = product(self.fields, SPREADS, SKINS)
        found = [Belief.of(self, field, spread, skin, seen) for field, spread, skin in cases]
        return Weighed(self, seen, tuple(found))


def point_masses(points: Array) -> Array:
    """Dynamic parameters (N, 10) of unit masses at points (N, 3)."""
    ends = np.concatenate([points, np.ones((len(points), 1))], axis=1)
    return dynamic_parameters_from_pseudo_inertia(ends[:, :, None] * ends[:, None, :])


def coordinates(phi: Array) -> Array:
    """Log-Cholesky coordinates but the first, (..., 9), of dynamic parameters (..., 10)."""
    flipped = np.linalg.cholesky(pseudo_inertia(phi)[..., ::-1, ::-1])
    upper = flipped[..., ::-1, ::-1] / flipped[..., :1, :1]
    logs = np.log(np.diagonal(upper, axis1=-2, axis2=-1)[..., :3])
    shears = upper[..., _ROWS, _COLUMNS]
    return np.concatenate([logs, shears], axis=-1)


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
    def of(cls, model: FittedModel) -> Seen:
        """Take the data alone from a fit: they are quadratic in phi, wherever the fit has ended.

        Directions that the motion does not excite are left out as the fit does; what widens the
        fit's intervals beyond the noise counts as more noise of phi.
        """
        data, slope = _alone(model)
        excited = np.eye(10) - model.unexcited @ model.unexcited.T
        to_phi = log_cholesky_jacobian(model.prior.mean) * model.prior.std @ excited
        values, vectors = np.linalg.eigh(to_phi.T @ data @ to_phi)
        seen = values > _LOST * values[-1]
        size = np.sqrt(values[seen])
        back = np.linalg.inv(log_cholesky_jacobian(model.prior.mean) * model.prior.std)
        root = size[:, None] * (vectors[:, seen].T @ excited @ back)
        target = -vectors[:, seen].T @ to_phi.T @ slope / size
        more = np.linalg.cholesky(np.eye(len(root)) + root @ _beyond_noise(model) @ root.T)
        return cls(model.phi, np.linalg.solve(more, root), np.linalg.solve(more, target))


def _alone(model: FittedModel) -> tuple[Array, Array]:
    """Information (10, 10) of the data on phi and slope (10,) of their error, without effects."""
    rows, residual = model.white_jacobian, model.white_residual
    if model.corrected is not None:
        residual = residual - model.white_lasting_errors @ model.corrected.errors
    information, slope = rows.T @ rows - model.noise_information, rows.T @ residual
    known = np.diag(model.coordinate_information[1])[10:]
    information[10:, 10:] += np.diag(known)
    slope[10:] += known * np.concatenate([np.zeros(0), *model.theta])
    share = information[:10, 10:] @ np.linalg.inv(information[10:, 10:])
    alone = information[:10, :10] - share @ information[10:, :10]
    return 0.5 * (alone + alone.T), slope[:10] - share @ slope[10:]


def _beyond_noise(model: FittedModel) -> Array:
    """Part (10, 10) of a fit's covariance that is not noise: misfit, lasting errors, gains."""
    to_phi = log_cholesky_jacobian(model.xi)
    noise = to_phi @ np.linalg.inv(sum(model.coordinate_information))[:10, :10] @ to_phi.T
    more = model.covariance[:10, :10] - noise
    scale = np.sqrt(np.diag(model.covariance)[:10])
    values, vectors = np.linalg.eigh(0.5 * (more + more.T) / np.outer(scale, scale))
    return np.asarray((vectors * np.maximum(values, 0.0)) @ vectors.T * np.outer(scale, scale))


@dataclass(frozen=True)
class Belief:
    """The body under one spread, length and volume, after the data.

    Attributes:
        field: reading of the volume.
        spread: of the logarithm of density.
        skin: of its slope by depth.
        xi: (10,) most likely log-Cholesky coordinates.
        covariance: (10, 10) of them.
        evidence: logarithm, up to a constant (Laplace).
        surprise: squared distance of the data from the even body, in the standard deviations that
            spread and data allow together.
    """

    field: Field
    spread: float
    skin: float
    xi: Array
    covariance: Array
    evidence: float
    surprise: float

    @classmethod
    def of(
        cls, prior: ShapePrior, field: Field, spread: float, skin: float, seen: Seen
    ) -> Belief:
        """Combine; the mass is free, and the other coordinates do not depend on it.

        Args:
            prior: of the shape.
            field: reading of its volume.
            spread: of the logarithm of density.
            skin: of its slope by depth.
            seen: the data.
        """
        white, start, log_volume = prior.gaussian(field, spread, skin)
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
        return cls(field, spread, skin, xi, covariance, -0.5 * squares - halves, squares)


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
        least = min(b.surprise for b in self.beliefs if b.spread <= _EVEN and not b.skin)
        return bool(chdtrc(9, max(least, 0.0)) < _CONTRADICTED)

    @property
    def body(self) -> InertialParameters:
        """The nearest body of positive density inside the shape's hull."""
        inside = [field.masses for field in self.prior.fields]
        masses = np.concatenate([point_masses(self.prior.solid.surface), *inside])
        phi = nearest_density(self.phi, self.covariance, masses)
        return InertialParameters.from_dynamic_parameters(phi)

    @property
    def where(self) -> str:
        """Where the body is denser than even, in words."""
        best = self.beliefs[int(np.argmax(self.weights))]
        field, phi = best.field, dynamic_parameters_from_log_cholesky(best.xi)
        size = self.prior.solid.size
        units = np.append(np.full(3, size), np.full(6, size**2))
        mean = field.masses.mean(axis=0)
        at = (field.masses - mean)[:, 1:] / units
        alike = best.spread**2 * field.alike + best.skin**2 * np.outer(field.depth, field.depth)
        response = alike @ at / len(at)
        apart = (phi / phi[0] - mean)[1:] / units
        moved = np.linalg.lstsq(at.T @ response / len(at), apart, rcond=_FLATTEST)[0]
        density = response @ moved
        outward = -float(field.depth @ density) / len(density)
        if outward > _HOLLOW * float(density.std()):
            return "its surface (hollow)"
        place = 1e3 * field.points[int(np.argmax(density))]
        return "({:.0f}, {:.0f}, {:.0f}) mm".format(*place)


    @property
    def line(self) -> str:
        """Say what the shape adds, and whether the data contradict an even density."""
        if self.contradicts:
            return f"shape contradicts: {self.prior.solid.name} is denser at {self.where}"
        return f"together with {self.prior.solid.name}, of a density even to {self.spread:.0%}"

    def to_json(self) -> dict[str, Any]:
        """Return its part of the document of `estimate`."""
        return {
            "source": self.prior.solid.name,
            "density_spread": self.spread,
            "contradicts": self.contradicts,
            "denser_at": self.where if self.contradicts else None,
        }


def nearest_density(phi: Array, covariance: Array, masses: Array) -> Array:
    """Nearest dynamic parameters to phi, in its covariance, of masses that are not negative.

    Args:
        phi: (10,).
        covariance: (10, 10).
        masses: (N, 10) of unit point masses, wherever there may be mass.

    Source: Lawson, Hanson 1974, ch. 23.
    """
    scale = np.sqrt(np.diag(covariance))
    values, vectors = np.linalg.eigh(covariance / np.outer(scale, scale))
    white = (vectors / np.sqrt(np.maximum(values, _LOST * values[-1]))).T / scale
    even = _LEAST_SHARE * masses.mean(axis=0)
    shares, _ = nnls(phi[0] * white @ masses.T, white @ (phi - phi[0] * even))
    return np.asarray(phi[0] * (shares @ masses + even))


def with_shape(model: FittedModel, prior: ShapePrior) -> tuple[InertialEstimate, Weighed]:
    """Combine a fit with what the shape tells.

    Args:
        model: fitted from `prior.start`, which is taken out again.
        prior: of the shape.

    Returns:
        The estimate of a body that fits in the shape's hull, and what was weighed.
    """
    weighed, estimate = prior.weigh(Seen.of(model)), model.to_estimate()
    body = weighed.body
    unknown = set(larger_than_body(body, weighed.covariance))
    unknown |= {"mass"} & set(estimate.not_excited)
    names = tuple(name for name in PARAMETER_NAMES if name in unknown)
    found = replace(
        estimate, inertia=body, covariance=weighed.covariance, not_excited=names, lasting=None
    )
    return found, weighed
