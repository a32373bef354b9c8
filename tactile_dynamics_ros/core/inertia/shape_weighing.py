"""A fit held against what the shape of its body tells, see `shape_prior`."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from scipy.linalg import block_diag
from scipy.optimize import nnls
from scipy.special import chdtrc, logsumexp

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.inertia.batch.fitted_model import FittedModel
from tactile_dynamics_ros.core.inertia.batch.inertial_estimate import (
    PARAMETER_NAMES,
    InertialEstimate,
)
from tactile_dynamics_ros.core.inertia.batch.knowledge import larger_than_body, whitening
from tactile_dynamics_ros.core.inertia.batch.prior import LogCholeskyPrior
from tactile_dynamics_ros.core.inertia.shape_prior import (
    FLATTEST,
    WIDE,
    Gaussian,
    ShapePrior,
)
from tactile_dynamics_ros.core.numerics.least_squares import levenberg_marquardt
from tactile_dynamics_ros.core.rigid_body.inertial_parameters import (
    InertialParameters,
    dynamic_parameters_from_log_cholesky,
    log_cholesky_jacobian,
)

_EVEN = 0.1
"""Spread up to which a body counts as even, for the question whether data contradict the shape:
walls and labels of a full box, rounding of a mesh. Smaller ones call such bodies uneven."""
_CAUTION = 0.5
"""Power of the evidence by which beliefs are weighed: no body is drawn from any of these priors,
and the evidence of wrong ones is as precise as that of the right one. At 1 hollow boxes that look
even by chance are wrong by 4.1 standard deviations (20 of them, 10 parameters), at 0.7 by 3.1, at
0.5 by 2.6, where intervals are a third wider; on 20 others at 0.5 by 3.4.
Source: Gruenwald, van Ommen 2017."""
_CANNOT_BE = 1e-6
"""Probability of the data, of the best body inside the hull, below which the shape is refused: it
lies elsewhere, or is of another unit. Nearer to 1 refuses rough meshes."""
_CONTRADICTED = 1e-3
"""Probability, of an even body, below which the shape is said to be contradicted: one of a thousand
even bodies is by chance. Higher warns more often of nothing, lower later of ballast."""
_HOLLOW = 0.7
"""Correlation of the most likely density with the depth, either way, from which a body is said to
be denser at its surface or its core. Ballast at one end has less than half."""
_LOST = 1e-10
"""Smallest eigenvalue of a covariance with unit diagonal, over its largest, that is believed; as
when an estimate is combined with an earlier one."""
_LEAST_SHARE = 1e-3
"""Share of the even body that is mixed into one of point masses, so that it has a thickness. Larger
ones pull at bodies at the edge of what fits; at 0 flat bodies have no logarithm."""
_MOST_STEPS = 20
"""Steps of the search for the most likely body, at most; five are usual."""
_TOLERANCE = 1e-6
"""Relative fall of the squared error that ends it: bodies are then exact to a thousandth of a
standard deviation. Larger ones save a step, smaller ones change nothing."""


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
        """Take the data alone from a fit, wherever it has ended."""
        to_phi = model.coordinate_jacobian[:10, :10]
        noise = to_phi @ np.linalg.inv(sum(model.coordinate_information))[:10, :10] @ to_phi.T
        beyond = beyond_noise(model.covariance[:10, :10], noise)
        return cls.of_sums(model.phi, *_alone(model), model.prior, model.unexcited, beyond)

    @classmethod
    def of_sums(
        cls,
        phi: Array,
        data: Array,
        slope: Array,
        prior: LogCholeskyPrior,
        unexcited: Array,
        beyond: Array,
    ) -> Seen:
        """Take the data alone from their sums: they are quadratic in phi.

        Directions that the motion does not excite are left out as the fit does; what widens the
        fit's intervals beyond the noise counts as more noise of phi.

        Args:
            phi: (10,).
            data: (10, 10) information of the data, without that of noise.
            slope: (10,) of half their squared error, at phi.
            prior: of the fit, whose directions are
            unexcited: (10, q).
            beyond: (10, 10) covariance beyond the noise.
        """
        excited = np.eye(10) - unexcited @ unexcited.T
        to_phi = log_cholesky_jacobian(prior.mean) * prior.std @ excited
        values, vectors = np.linalg.eigh(to_phi.T @ data @ to_phi)
        seen = values > _LOST * values[-1]
        size = np.sqrt(values[seen])
        back = np.linalg.inv(log_cholesky_jacobian(prior.mean) * prior.std)
        root = size[:, None] * (vectors[:, seen].T @ excited @ back)
        target = -vectors[:, seen].T @ to_phi.T @ slope / size
        more = np.linalg.cholesky(np.eye(len(root)) + root @ beyond @ root.T)
        return cls(phi, np.linalg.solve(more, root), np.linalg.solve(more, target))


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


def beyond_noise(covariance: Array, noise: Array) -> Array:
    """Part (10, 10) of a covariance that is not noise: misfit, lasting errors, gains."""
    scale = np.sqrt(np.diag(covariance))
    more = 0.5 * (covariance + covariance.T) - 0.5 * (noise + noise.T)
    values, vectors = np.linalg.eigh(more / np.outer(scale, scale))
    return np.asarray((vectors * np.maximum(values, 0.0)) @ vectors.T * np.outer(scale, scale))


@dataclass(frozen=True)
class Belief:
    """The body under one prior, after the data.

    Attributes:
        prior: one of them.
        xi: (10,) most likely log-Cholesky coordinates.
        covariance: (10, 10) of them.
        evidence: logarithm, up to a constant (Laplace).
        surprise: squared distance of the data from the even body, in the standard deviations that
            spread and data allow together.
    """

    prior: Gaussian
    xi: Array
    covariance: Array
    evidence: float
    surprise: float

    @classmethod
    def of(cls, prior: Gaussian, seen: Seen) -> Belief:
        """Combine; the mass is as good as free, and the other coordinates do not depend on it."""
        centre = np.append(0.5 * np.log(seen.phi[0]), prior.mean)
        white = block_diag(1.0 / WIDE[0], prior.white)
        start = centre.copy()
        start[7:] = seen.phi[1:4] / seen.phi[0]  # far from it, a small mass fits as well

        def evaluate(xi: Array) -> tuple[Array, Array]:
            apart = dynamic_parameters_from_log_cholesky(xi) - seen.phi
            residual = [seen.root @ apart - seen.target, white @ (xi - centre)]
            jacobian = [seen.root @ log_cholesky_jacobian(xi), white]
            return np.concatenate(residual), np.concatenate(jacobian)

        xi, _ = levenberg_marquardt(evaluate, start, _MOST_STEPS, _TOLERANCE)
        residual, jacobian = evaluate(xi)
        information = jacobian.T @ jacobian
        squares = float(residual @ residual)
        halves = 0.5 * float(np.linalg.slogdet(information)[1]) + prior.log_volume
        covariance = np.asarray(np.linalg.inv(information))
        return cls(prior, xi, covariance, -0.5 * squares - halves, squares)


@dataclass(frozen=True)
class Weighed:
    """Beliefs under all spreads, lengths and volumes, with their weights.

    Attributes:
        prior: of the shape.
        beliefs: all of them.
    """

    prior: ShapePrior
    beliefs: tuple[Belief, ...]

    @cached_property
    def weights(self) -> Array:
        """(B,) probabilities."""
        evidence = _CAUTION * np.array([belief.evidence for belief in self.beliefs])
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
        """(10, 10) of phi, of the mixture, wider where even the best density does not fit.

        By the ratio of its surprise to the nine numbers that it may differ in.
        Source: Birge 1932.
        """
        total = np.zeros((10, 10))
        for weight, belief in zip(self.weights, self.beliefs, strict=True):
            apart = belief.xi - self.xi
            wider = max(1.0, belief.surprise / len(belief.prior.mean))
            total += weight * (wider * belief.covariance + np.outer(apart, apart))
        to_phi = log_cholesky_jacobian(self.xi)
        return np.asarray(to_phi @ total @ to_phi.T)

    @property
    def spread(self) -> float:
        """Root mean square of the spreads."""
        squares = np.array([belief.prior.spread**2 for belief in self.beliefs])
        return float(np.sqrt(self.weights @ squares))

    @cached_property
    def contradicts(self) -> bool:
        """Whether no reading of the shape with an even density explains the data."""
        even = [one for one in self.beliefs if one.prior.spread <= _EVEN and not one.prior.skin]
        least = min(one.surprise for one in even)
        return bool(chdtrc(9, max(least, 0.0)) < _CONTRADICTED)

    @cached_property
    def body(self) -> InertialParameters:
        """The nearest body of positive density inside the shape's hull."""
        phi = nearest_density(self.phi, self.covariance, self.prior.masses)
        return InertialParameters.from_dynamic_parameters(phi)

    def parts(self, not_excited: tuple[str, ...]) -> dict[str, Any]:
        """What it replaces in an estimate, by the names of its fields.

        Args:
            not_excited: parameters that the motion did not determine without the shape.
        """
        unknown = set(larger_than_body(self.body, self.covariance)) | {"mass"} & set(not_excited)
        names = tuple(name for name in PARAMETER_NAMES if name in unknown)
        return {
            "inertia": self.body,
            "covariance": self.covariance,
            "not_excited": names,
            "lasting": None,
        }

    @property
    def where(self) -> str:
        """Where the body is denser than even, in words."""
        best = self.beliefs[int(np.argmax(self.weights))]
        field, phi = best.prior.field, dynamic_parameters_from_log_cholesky(best.xi)
        size = self.prior.solid.size
        units = np.append(np.full(3, size), np.full(6, size**2))
        mean = field.masses.mean(axis=0)
        at = (field.masses - mean)[:, 1:] / units
        alike = best.prior.spread**2 * field.alike
        alike = alike + best.prior.skin**2 * np.outer(field.depth, field.depth)
        response = alike @ at / len(at)
        apart = (phi / phi[0] - mean)[1:] / units
        moved = np.linalg.lstsq(at.T @ response / len(at), apart, rcond=FLATTEST)[0]
        density = response @ moved
        outward = -float(field.depth @ density) / len(density)
        if abs(outward) > _HOLLOW * float(density.std()):
            return "its surface (hollow)" if outward > 0.0 else "its core"
        place = 1e3 * field.points[int(np.argmax(density))]
        return "({:.0f}, {:.0f}, {:.0f}) mm".format(*place)

    @cached_property
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


def weigh(seen: Seen, prior: ShapePrior) -> Weighed:
    """Hold every spread, slope by depth and volume against the data."""
    return Weighed(prior, tuple(Belief.of(one, seen) for one in prior.gaussians))


def nearest_density(phi: Array, covariance: Array, masses: Array) -> Array:
    """Nearest dynamic parameters to phi, in its covariance, of masses that are not negative.

    Args:
        phi: (10,).
        covariance: (10, 10).
        masses: (N, 10) of unit point masses, wherever there may be mass.

    Source: Lawson, Hanson 1974, ch. 23.
    """
    white = whitening(covariance)
    even = _LEAST_SHARE * masses.mean(axis=0)
    shares, _ = nnls(phi[0] * white @ masses.T, white @ (phi - phi[0] * even))
    return np.asarray(phi[0] * (shares @ masses + even))


def require_fit(seen: Seen, prior: ShapePrior) -> None:
    """Refuse a shape inside of which no body explains the data.

    Args:
        seen: the data.
        prior: of the shape.

    Raises:
        BadInputError: it lies elsewhere, or is of another unit.
    """
    rows = seen.root @ prior.masses.T
    _, misfit = nnls(rows, seen.root @ seen.phi + seen.target)
    if chdtrc(10, misfit**2) < _CANNOT_BE:
        centre = ", ".join(f"{1e3 * one:.0f}" for one in seen.phi[1:4] / seen.phi[0])
        low, high = (getattr(1e3 * prior.solid.surface, one)(axis=0) for one in ("min", "max"))
        reach = ", ".join(f"{a:.0f} to {b:.0f}" for a, b in zip(low, high, strict=True))
        raise BadInputError(
            f"shape {prior.solid.name}: no body inside it moves as measured (centre of mass "
            f"({centre}) mm, shape {reach} mm); expected metres in the axes of the object's pose; "
            "--shape-pose moves it"
        )


def with_shape(model: FittedModel, prior: ShapePrior) -> tuple[InertialEstimate, Weighed]:
    """Combine a fit with what the shape tells.

    Args:
        model: fitted from `prior.start`, which is taken out again.
        prior: of the shape.

    Returns:
        The estimate of a body that fits in the shape's hull, and what was weighed.

    Raises:
        BadInputError: no body inside the shape's hull explains the data.
    """
    seen, estimate = Seen.of(model), model.to_estimate()
    require_fit(seen, prior)
    weighed = weigh(seen, prior)
    return replace(estimate, **weighed.parts(estimate.not_excited)), weighed
