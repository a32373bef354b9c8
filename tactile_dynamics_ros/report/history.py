"""How an estimate settles while data come in."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.rigid_body.inertial_parameters import (
    InertialParameters,
    com_inertia_jacobian,
    dynamic_parameters_from_log_cholesky,
    log_cholesky_jacobian,
)

if TYPE_CHECKING:
    from tactile_dynamics_ros.core.inertia.batch.fitted_model import FittedModel

Array = NDArray[np.float64]

PARAMETERS = 10


@dataclass(frozen=True)
class EstimateHistory:
    """Estimates after more and more data.

    Attributes:
        time: (K,) s.
        value: (K, 10) [mass kg, com m, inertia about the centre of mass kg m^2].
        std: (K, 10) standard deviations.
    """

    time: Array
    value: Array
    std: Array

    def of_last_model(self) -> EstimateHistory:
        """Without estimates that a later one for the same or an earlier instant replaces.

        An estimator whose model is changed goes back to the data that it keeps.
        """
        ahead = np.minimum.accumulate(np.append(self.time, np.inf)[::-1])[::-1][1:]
        kept = self.time < ahead
        return EstimateHistory(self.time[kept], self.value[kept], self.std[kept])


def settle(model: FittedModel, points: int = 80) -> EstimateHistory:
    """Return what the data up to each of several instants say, linearised at the final fit.

    xi_k = xi - (J_k' J_k + P)^-1 (J_k' r_k - J' r) with the white residual r, its Jacobian J by the
    log-Cholesky coordinates xi and effect parameters, the first rows J_k, r_k and the prior's
    information P.

    Args:
        model: fitted to the whole recording.
        points: number of instants.
    """
    time = np.concatenate([samples.time for samples in model.samples])
    jacobian = model.white_jacobian.copy()
    jacobian[:, :PARAMETERS] = jacobian[:, :PARAMETERS] @ log_cholesky_jacobian(model.xi)
    residual = model.white_residual
    _, prior = model.coordinate_information
    ends = np.unique(np.linspace(len(time) / points, len(time), points).astype(int))
    pieces = np.split(np.arange(len(residual)), 6 * ends[:-1])
    information = np.cumsum([jacobian[p].T @ jacobian[p] for p in pieces], axis=0)
    gradient = np.cumsum([jacobian[p].T @ residual[p] for p in pieces], axis=0)
    covariance = np.asarray(np.linalg.inv(information + prior))
    step = -np.einsum("kij,kj->ki", covariance, gradient - gradient[-1])
    return _physical(model, time[ends - 1], step[:, :PARAMETERS], covariance)


def _physical(model: FittedModel, time: Array, step: Array, covariance: Array) -> EstimateHistory:
    """Return the history in mass, centre of mass and inertia; bands end at the final deviation."""
    values, stds = [], []
    for move, spread in zip(step, covariance[:, :PARAMETERS, :PARAMETERS], strict=True):
        xi = model.xi + np.clip(move, -3.0, 3.0)
        phi = dynamic_parameters_from_log_cholesky(xi)
        body = InertialParameters.from_dynamic_parameters(phi)
        upper = body.inertia_com[[0, 0, 1, 0, 1, 2], [0, 1, 1, 2, 2, 2]]
        values.append(np.concatenate([[body.mass], body.com, upper]))
        mapped = com_inertia_jacobian(phi) @ log_cholesky_jacobian(xi)
        stds.append(np.sqrt(np.diag(mapped @ spread @ mapped.T)))
    std = np.array(stds) * (model.to_estimate().parameter_std / stds[-1])
    return EstimateHistory(time, np.array(values), std)
