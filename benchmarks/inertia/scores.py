"""Error measures of one estimate, and medians over many."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import asdict, dataclass

import numpy as np

from tactile_dynamics_ros.core.inertia.batch.inertial_estimate import InertialEstimate
from tactile_dynamics_ros.core.rigid_body.inertial_parameters import (
    InertialParameters,
    affine_invariant_distance,
    is_feasible,
    log_det_divergence,
    pseudo_inertia,
    trace_error,
)


@dataclass(frozen=True)
class Score:
    """Errors of one estimate.

    Attributes:
        trace_error: paper A, Eq. 34.
        distance: affine-invariant; inf if infeasible.
        divergence: log-det; inf if infeasible.
        mass_kg, mass_percent: absolute error.
        com_mm: norm of the error.
        inertia: kg m^2, Frobenius norm of the error about the centre of mass.
        feasible: whether such a body can exist.
        seconds: of computing.
    """

    trace_error: float
    distance: float
    divergence: float
    mass_kg: float
    mass_percent: float
    com_mm: float
    inertia: float
    feasible: bool
    seconds: float

    @classmethod
    def of(cls, truth: InertialParameters, phi: np.ndarray, seconds: float) -> Score:
        """Score dynamic parameters (10,)."""
        exact = truth.pseudo_inertia
        if not np.all(np.isfinite(phi)):
            return cls(*(float("inf"),) * 7, feasible=False, seconds=seconds)
        found = InertialParameters.from_dynamic_parameters(phi)
        matrix, feasible = pseudo_inertia(phi), is_feasible(phi)
        return cls(
            trace_error(exact, matrix),
            affine_invariant_distance(exact, matrix) if feasible else float("inf"),
            log_det_divergence(exact, matrix) if feasible else float("inf"),
            abs(found.mass - truth.mass),
            100.0 * abs(found.mass / truth.mass - 1.0),
            1e3 * float(np.linalg.norm(found.com - truth.com)),
            float(np.linalg.norm(found.inertia_com - truth.inertia_com)),
            feasible,
            seconds,
        )


def medians(scores: Iterable[Score]) -> dict[str, float]:
    """Median of every measure; `feasible` becomes a share."""
    rows = [asdict(score) for score in scores]
    result = {
        name: float(np.median([row[name] for row in rows]))
        for name in rows[0]
        if name != "feasible"
    }
    return result | {"feasible": float(np.mean([row["feasible"] for row in rows]))}


def physical(inertia: InertialParameters) -> np.ndarray:
    """[m, com, I_xx, I_xy, I_yy, I_xz, I_yz, I_zz about the centre of mass], (10,)."""
    rows, columns = [0, 0, 1, 0, 1, 2], [0, 1, 1, 2, 2, 2]
    return np.concatenate([[inertia.mass], inertia.com, inertia.inertia_com[rows, columns]])


def deviations(estimate: InertialEstimate, truth: InertialParameters) -> np.ndarray:
    """Errors (10,) of `physical` in stated standard deviations."""
    return (physical(estimate.inertia) - physical(truth)) / estimate.parameter_std
