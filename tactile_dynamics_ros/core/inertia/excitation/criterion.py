"""How much a motion would tell: information of its wrenches and scalar criteria on it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.contact.wrench_samples import WrenchSamples
from tactile_dynamics_ros.core.rigid_body.inertial_parameters import pseudo_inertia
from tactile_dynamics_ros.core.rigid_body.newton_euler import regressor
from tactile_dynamics_ros.core.rigid_body.rotation import skew

Array = NDArray[np.float64]

Criterion = Callable[[WrenchSamples], float]
"""Smaller is better; any function of the samples of a candidate motion can be minimised."""


def wrench_covariance(samples: WrenchSamples, force_std: float) -> Array:
    """Covariance (N, 6, 6) of the net wrench from independent force noise at every contact."""
    shape = (*samples.contact_point.shape, 3)
    unit = np.broadcast_to(np.eye(3), shape)
    maps = np.concatenate([skew(samples.contact_point), unit], axis=2)
    maps = maps * samples.in_contact[..., None, None]
    covariance = force_std**2 * np.einsum("ncij,nckj->nik", maps, maps, optimize=True)
    return np.asarray(covariance + 1e-12 * np.eye(6))


def wrench_information(
    samples: WrenchSamples, force_std: float, columns: Array | None = None
) -> Array:
    """Fisher information of the samples with exact motion and white force noise.

    Args:
        samples: samples of a motion.
        force_std: N per axis and contact.
        columns: (N, 6, n) derivatives of the wrench; the Newton-Euler regressor by default.

    Returns:
        (n, n).
    """
    if columns is None:
        columns = regressor(
            samples.specific_acceleration, samples.angular_velocity, samples.angular_acceleration
        )
    factor = np.linalg.cholesky(wrench_covariance(samples, force_std))
    white = np.linalg.solve(factor, columns).reshape(-1, columns.shape[2])
    return np.asarray(white.T @ white)


@dataclass(frozen=True)
class InertiaCriterion:
    """Expected uncertainty of the inertia after a motion, given what is known before it.

    "A": expected squared affine-invariant distance to the truth, tr(G Cov) with the metric
    G_jk = tr(P^-1 B_j P^-1 B_k); "D": log det of the covariance in the same metric. Neither
    depends on the units or the frame.

    Attributes:
        phi: (10,) present estimate.
        known: (10, 10) its information, on phi.
        force_std: N per axis and contact.
        rate_ratio: samples taken per sample of the candidate (a coarse grid stands for more).
        kind: "A" or "D".
    """

    phi: Array
    known: Array
    force_std: float = 0.03
    rate_ratio: float = 1.0
    kind: Literal["A", "D"] = "A"

    def __call__(self, samples: WrenchSamples) -> float:
        """Evaluate the criterion; smaller is better."""
        information = self.known + self.rate_ratio * wrench_information(samples, self.force_std)
        factor = np.linalg.cholesky(self.metric)
        half = np.linalg.solve(factor, information)
        scaled = np.linalg.solve(factor, half.T)
        values = np.maximum(np.linalg.eigvalsh(scaled), 1e-12)
        return float(np.sum(1.0 / values) if self.kind == "A" else -np.sum(np.log(values)))

    @property
    def metric(self) -> Array:
        """G (10, 10), the affine-invariant metric on phi at the present estimate."""
        basis = pseudo_inertia(np.eye(10))
        relative = np.linalg.solve(pseudo_inertia(self.phi), basis)
        return np.asarray(np.einsum("aij,bji->ab", relative, relative))
