"""Weak prior on a body of which only the contacts are known, in log-Cholesky coordinates."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.contact.wrench_samples import WrenchSamples
from tactile_dynamics_ros.core.rigid_body.inertial_parameters import (
    dynamic_parameters_from_log_cholesky,
    log_cholesky,
    pseudo_inertia,
)

_SMALLEST_RADIUS = 0.02
"""Radius of gyration, m, that the prior presumes at least, where contacts lie closer together. Two
fingertips of 14 mm that touch each other are as far apart. Half as much moved no estimate of an
excited recording by 0.01 standard deviations, twice as much by 0.03."""
_DEFAULT_RADIUS = 0.05
"""Radius of gyration, m, that the prior presumes of what one contact (a wrist sensor) holds: that
of a cube of 12 cm, an object for one hand. The prior's standard deviation is a factor of e^1.5 =
4.5 about it. Another value changes what undetermined inertia is reported as, not one that the
motion excites."""
_MINIMUM_MASS = 1e-3
"""Mass, kg, that the prior presumes at least; its logarithm must exist where nothing is carried. A
lighter object is still found, two standard deviations of the prior lie a factor of 3000 away. Far
larger ones pull at light objects, far smaller ones begin far from any that a hand holds."""
_STD_LOG_SCALE = 2.0
"""Prior standard deviation of half the logarithm of the mass. Two such deviations are a factor of
e^8 = 3000 in mass: data decide. Half and twice as much changed no estimate of three synthetic
recordings by a thousandth of its standard deviation."""
_STD_LOG_RADIUS = 1.5
"""Prior standard deviation of the logarithm of each radius of gyration: a factor of e^1.5 = 4.5.
Undetermined inertia keeps it as its interval. Where the motion excites it, half as much moves
estimates by 0.03 standard deviations, twice as much by 0.01."""
_STD_SHEAR_RADII = 2.0
"""Prior standard deviation of the shears of the pseudo-inertia's factor, in radii of gyration:
large enough that no orientation of the principal axes is preferred. Half and twice as much move
estimates by at most 0.002 standard deviations."""
_STD_COM = 0.5
"""Prior standard deviation of the centre of mass about the middle of the contacts, m: farther than
a hand holds anything. Half and twice as much changed no estimate by a thousandth of its standard
deviation; a few centimetres would pull where the motion hardly tells."""

_FLATTEST = 0.1
"""Smallest eigenvalue of a start's pseudo-inertia, as a share of that of a usual body: a third of
its thickness (sqrt 0.1). Larger values start thin objects too thick, which costs steps; much
smaller ones start where the error hardly depends on the thickness (see `fit_unfolded`), and there
intervals are too small: a second moment of next to nothing hardly moves with its logarithm."""


@dataclass(frozen=True)
class LogCholeskyPrior:
    """Independent normal prior of the log-Cholesky coordinates.

    Attributes:
        mean: (10,).
        std: (10,).
    """

    mean: Array
    std: Array

    def opened(self, phi: Array) -> Array:
        """Coordinates (10,) about which intervals of dynamic parameters phi are linear.

        Those of a body that is not flat: thinner ones are made as thick as a start (`_FLATTEST`).
        """
        return nearest_body(phi, dynamic_parameters_from_log_cholesky(self.mean))

    @property
    def information(self) -> Array:
        """(10, 10) inverse covariance."""
        return np.diag(self.std**-2.0)

    def weighted(self, factor: float) -> LogCholeskyPrior:
        """Return the prior with standard deviations divided by a factor."""
        return LogCholeskyPrior(self.mean, self.std / factor)


def contact_prior(samples: WrenchSamples) -> LogCholeskyPrior:
    """A body that weighs what is carried, centred between the contacts and about as large.

    The standard deviations span factors of e^2 in mass scale, e^1.5 in radius of gyration and
    half a metre in the centre of mass, so that any direction that the motion excites is decided
    by the data.
    """
    force = np.linalg.norm(samples.measured_wrench[:, 3:], axis=1)
    mass = max(float(np.median(force)) / 9.81, _MINIMUM_MASS)
    points = samples.contact_point[samples.in_contact]
    return body_prior(mass, points, single=samples.contact_point.shape[1] == 1)


def body_prior(mass: float, points: Array, single: bool = False) -> LogCholeskyPrior:
    """A body of a mass that is centred between points and spreads about as far as they.

    Args:
        mass: kg.
        points: (N, 3) m, where it is touched.
        single: whether they are one contact, which says nothing of the size.
    """
    centre = points.mean(axis=0)
    spread = float(np.sqrt(np.mean(np.sum((points - centre) ** 2, axis=1)) / 3.0))
    radius = _DEFAULT_RADIUS if single else max(spread, _SMALLEST_RADIUS)
    log_radius = np.full(3, np.log(radius))
    mean = np.concatenate([[0.5 * np.log(mass)], log_radius, np.zeros(3), centre])
    std = np.array(
        [_STD_LOG_SCALE] + 3 * [_STD_LOG_RADIUS] + 3 * [_STD_SHEAR_RADII * radius] + 3 * [_STD_COM]
    )
    return LogCholeskyPrior(mean, std)


def nearest_body(phi: Array, reference: Array) -> Array:
    """Log-Cholesky coordinates of phi with the eigenvalues of its pseudo-inertia made positive."""
    values, vectors = np.linalg.eigh(pseudo_inertia(phi))
    floor = _FLATTEST * np.linalg.eigvalsh(pseudo_inertia(reference))
    return log_cholesky(vectors * np.maximum(values, floor) @ vectors.T)
