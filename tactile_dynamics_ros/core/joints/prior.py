"""What a URDF says of an arm's bodies, and how far it may be off."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag

from tactile_dynamics_ros.core.joints.arm import Arm
from tactile_dynamics_ros.core.rigid_body.inertial_parameters import (
    dynamic_parameters_from_pseudo_inertia,
    pseudo_inertia,
)

Array = NDArray[np.float64]

SHARES = (0.1, 0.2, 0.4)
"""How far the bodies of a URDF may be off, as a relative std, from which the recording chooses:
files made from CAD are within 10 %, those guessed from the outside within 40 %. Lower ones would be
chosen where something else is missing, and then hold what bodies cannot explain against effects."""
USUAL_SHARE = 0.1
"""The share that is taken until a recording says otherwise."""
_LOAD_SHARE = 0.3
"""Prior std of a payload's mass over that of all moving links: arms carry up to a third of their
moving mass. Wider ones tell less where the arm does not."""
_LOAD_RADIUS = 0.15
"""Prior std of a payload's centre from the flange, m: grippers and boxes reach as far. It holds
the directions that a recording does not tell."""
_SMALLEST = 1e-4
"""Share of a body's size that its thinnest direction has at least: points and rods in a URDF are
bodies of some width."""
_NO_BODY = 1e-6
"""Mass below which a URDF says nothing of a link, kg."""
_UNKNOWN_MASS, _UNKNOWN_RADIUS = 2.0, 0.1
"""Prior std of the mass, kg, and size, m, of a link of which a URDF says nothing: those of a link
of a table-top arm."""


@dataclass(frozen=True, eq=False)
class BodyPrior:
    """Prior N(mean, root root^T) of the dynamic parameters of n links and of a payload.

    Attributes:
        mean: (10 n + 10,); the payload's are zero, in the flange's frame.
        links: (10 n, 10 n) root of the links' covariance for a share of 1.
        load: (10, 10) root of the payload's covariance.
        stated: (n,) whether the URDF says anything of a link.
    """

    mean: Array
    links: Array
    load: Array
    stated: NDArray[np.bool_]

    @classmethod
    def of(cls, arm: Arm) -> BodyPrior:
        """Prior of an arm's URDF."""
        stated = arm.inertia[:, 0] > _NO_BODY
        roots = [
            _root(pseudo_inertia(phi)) if known else _unknown()
            for phi, known in zip(arm.inertia, stated, strict=True)
        ]
        mean = np.append(arm.inertia.reshape(-1), np.zeros(10))
        moving = float(arm.inertia[:, 0].sum())
        mass = _LOAD_SHARE * (moving or _UNKNOWN_MASS * len(stated))
        radius = _LOAD_RADIUS
        load = np.diag([mass] + [mass * radius] * 3 + [mass * radius**2] * 6)
        return cls(mean, block_diag(*roots), load, stated)

    def root(self, share: float) -> Array:
        """Root (P, P) of the covariance where the URDF is off by a share."""
        return np.asarray(block_diag(share * self.links, self.load))


def _root(matrix: Array) -> Array:
    """Root (10, 10) of the covariance of a body whose every dimension may be off by 100 %.

    P = L L^T becomes L (1 + E) L^T with E symmetric: to first order these are the bodies at a
    Riemannian distance |E| from it, whatever its size and frame.

    Source: Lee, Wensing, Park 2020 (constant pullback of the affine-invariant metric).
    """
    size = np.trace(matrix)
    factor = np.linalg.cholesky(matrix + _SMALLEST * size * np.eye(4))
    columns = []
    for i in range(4):
        for j in range(i + 1):
            change = np.zeros((4, 4))
            change[i, j] = change[j, i] = 1.0 if i == j else 1.0 / np.sqrt(2.0)
            columns.append(dynamic_parameters_from_pseudo_inertia(factor @ change @ factor.T))
    return np.stack(columns, axis=1)


def _unknown() -> Array:
    mass, radius = _UNKNOWN_MASS / USUAL_SHARE, _UNKNOWN_RADIUS
    return np.diag([mass] + [mass * radius] * 3 + [mass * radius**2] * 6)
