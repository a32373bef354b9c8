"""What the shape of a body tells of its inertia: density is a field whose spread the data decide.

The logarithm of the density is a normal field with a standard deviation s everywhere, the sum of
fields that are alike over several lengths, of one that differs by part, and of one that goes with
the depth below the surface. Bodies drawn from it have a mean and a covariance of the nine
log-Cholesky coordinates that do not depend on the mass, which is free. Spread and reading of the
volume are averaged by their evidence.
Source: Rasmussen, Williams 2006, ch. 2 and 5 (Gaussian processes, evidence).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import product

import numpy as np
from scipy.spatial import cKDTree
from scipy.spatial.distance import cdist

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.inertia.batch.prior import LogCholeskyPrior
from tactile_dynamics_ros.core.rigid_body.inertial_parameters import (
    dynamic_parameters_from_pseudo_inertia,
    pseudo_inertia,
)
from tactile_dynamics_ros.core.shape.solid import Solid, Volume

SPREADS = (0.05, 0.1, 0.2, 0.4, 0.8, 1.6)
"""Standard deviations of the logarithm of density that are weighed: from a cast block to a steel
head on a wooden handle. Each is as likely as the next before; where data tell nothing, intervals
are those of the larger ones. At 3.2 bodies are drawn that have shrunk to a few points, and noise
then passes for one of them."""
SKINS = (0.0, 1.0)
"""Standard deviations of the slope of the logarithm of density by depth, in standard deviations of
the depth: bodies that are even but hollow are common, and their centre does not show it. Without
the second, hollow boxes are taken for even ones of wrong inertia."""
LENGTHS = (0.1, 0.3, 1.0)
"""Lengths over which density is alike, over the longest edge of the box around the body: a bolt in
a handle, a head, one end against the other. With a single one, bodies that vary otherwise are too
far from the mean."""
_DRAWS = 200
"""Densities that are drawn, and as many that are their inverse: standard deviations are then known
to 4 %. More take longer, fewer make intervals scatter."""
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
object, to 1 % of the radius along each axis; 0.3 mm on a box of 10 cm. Places in the volume, and
meshes beside what was made of them, are off by as much. At 0 a box is known to have no products of
inertia at all, which no box in a hand is."""
_THINNEST = 1e-4
"""Standard deviation of the depth, over the body's size, that is presumed at least: sheets have
none, and nothing to tell hollow from even."""
WIDE = np.array([2.0, 1.0, 1.0, 1.0])
"""Standard deviations of half the logarithm of the mass and of the logarithms of the three radii
with which a fit is begun from the shape; shears and centre have a radius of gyration. Wider than
density can make any body in the shape. What the fit learns from it is taken out again."""
FLATTEST = 1e-4
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
class Gaussian:
    """Normal prior of the nine coordinates that do not depend on the mass.

    Attributes:
        field: reading of the volume.
        spread: of the logarithm of density.
        skin: of its slope by depth.
        mean: (9,).
        white: (9, 9) root of the information.
        log_volume: half the logarithm of the covariance's determinant, up to a constant.
    """

    field: Field
    spread: float
    skin: float
    mean: Array
    white: Array
    log_volume: float


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
    def masses(self) -> Array:
        """(N, 10) dynamic parameters of unit masses wherever there may be mass."""
        inside = [field.masses for field in self.fields]
        return np.concatenate([point_masses(self.solid.surface), *inside])

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
        return LogCholeskyPrior(np.append(0.0, even), np.append(WIDE, np.full(6, radius)))

    @cached_property
    def gaussians(self) -> tuple[Gaussian, ...]:
        """Priors of every reading of the volume, spread and slope by depth."""
        return tuple(self._gaussian(*case) for case in product(self.fields, SPREADS, SKINS))

    def _gaussian(self, field: Field, spread: float, skin: float) -> Gaussian:
        bodies = field.bodies(spread, skin) / self.scale
        covariance = np.cov(bodies.T) + self.unclear / np.outer(self.scale, self.scale)
        values, vectors = np.linalg.eigh(covariance)
        std = np.sqrt(np.maximum(values, FLATTEST * values[-1]))
        white = (vectors / std).T / self.scale
        mean = bodies.mean(axis=0) * self.scale
        return Gaussian(field, spread, skin, mean, white, float(np.log(std).sum()))


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
