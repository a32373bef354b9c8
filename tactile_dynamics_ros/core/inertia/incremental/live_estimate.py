"""What the live estimator publishes at every update."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.inertia.estimate import (
    PARAMETER_NAMES,
    EffectEstimate,
    InertialEstimate,
    ModelError,
)
from tactile_dynamics_ros.core.inertia.hull import CentreHull, keep_in_hull
from tactile_dynamics_ros.core.inertia.incremental.accumulation import Accumulation
from tactile_dynamics_ros.core.inertia.systematic import PresumedErrors
from tactile_dynamics_ros.core.inertia.uncertainty import unexcited_parameters
from tactile_dynamics_ros.core.rigid_body.inertial_parameters import (
    InertialParameters,
    com_inertia_jacobian,
    log_cholesky_jacobian,
)

Array = NDArray[np.float64]

_IDENTIFIED = 4.0
_NEAR = 0.05
"""How far log-Cholesky coordinates may move until what lasting errors change is found again."""
_WORDS = {
    "mass": "mass",
    "com": "centre of mass along",
    "inertia": "inertia about",
    "product": "product of inertia",
}


@dataclass(frozen=True)
class Direction:
    """One direction in the space of inertial parameters and how well the data determine it.

    Attributes:
        name: the parameter that it mostly is.
        gain: prior over posterior standard deviation along it; 1 means no data.
    """

    name: str
    gain: float

    @property
    def identified(self) -> bool:
        """Whether the data at least halved the prior's standard deviation."""
        return self.gain**2 > _IDENTIFIED


@dataclass(frozen=True)
class LiveEstimate(InertialEstimate):
    """An `InertialEstimate` at one instant of a running estimation.

    Attributes:
        time: s, stamp of the newest sample used.
        information: (2, 10, 10) of the data and of the prior on log-Cholesky coordinates.
        coordinates: (10,) the log-Cholesky coordinates.
        rejected: samples left out as outliers so far.
        latency: s of computing in this update.
        pending: complete samples that are still to be processed, after a change of the model.
    """

    time: float
    information: Array
    coordinates: Array
    rejected: int
    latency: float
    pending: int

    @cached_property
    def directions(self) -> tuple[Direction, ...]:
        """Ten directions of parameter space, best determined first."""
        by_xi = log_cholesky_jacobian(self.coordinates)
        mapped = com_inertia_jacobian(self.inertia.dynamic_parameters) @ by_xi
        return data_directions(mapped, *self.information)

    @property
    def remarks(self) -> tuple[str, ...]:
        """One plain sentence per parameter that the motion so far does not determine."""
        return tuple(f"{describe(name)}: not excited by this motion" for name in self.not_excited)


def describe(parameter: str) -> str:
    """Plain words for one of PARAMETER_NAMES.

    >>> describe("inertia_xx"), describe("com_y")
    ('inertia about x', 'centre of mass along y')
    """
    kind, _, axes = parameter.partition("_")
    if kind == "inertia" and axes[0] != axes[1]:
        return f"{_WORDS['product']} {axes}"
    return f"{_WORDS[kind]} {axes[:1]}".strip()


def data_directions(mapped: Array, data: Array, prior: Array) -> tuple[Direction, ...]:
    """Directions in which the data inform beyond the prior, best first.

    Generalised eigenvectors of the data's information relative to the prior's on xi; each is
    named by the physical parameter that it moves most, in units of the prior's deviation.

    Args:
        mapped: (10, 10) derivative of [m, c, I_c] by xi.
        data: (10, 10) information of the data on xi.
        prior: (10, 10) information of the prior on xi.
    """
    factor = np.linalg.cholesky(prior)
    whitened = np.linalg.solve(factor, np.linalg.solve(factor, data).T)
    values, vectors = np.linalg.eigh(0.5 * (whitened + whitened.T))
    moves = mapped @ np.linalg.solve(factor.T, vectors)
    share = np.abs(moves) / np.sqrt(np.sum(moves**2, axis=1, keepdims=True))
    free, names = set(range(10)), {}
    for k in range(9, -1, -1):
        best = max(free, key=lambda row: share[row, k])
        free.discard(best)
        names[k] = PARAMETER_NAMES[best]
    gains = np.sqrt(1.0 + np.maximum(values, 0.0))
    return tuple(Direction(names[k], float(gains[k])) for k in range(9, -1, -1))


class Summariser:
    """Turns a model's present state into a `LiveEstimate`.

    What changes slowly (inflation, lasting errors, excitation) is found again at every tenth call
    only, each of them at another one.
    """

    _EVERY = 10
    _TURNS = (0, 3, 6)

    def __init__(self, hull: CentreHull | None = None) -> None:
        """Start without a past; a hull bounds the centre of mass."""
        self._hull = hull
        self._calls = 0
        self._model: Accumulation | None = None
        self._widen = np.ones(0)
        self._presumed: PresumedErrors | None = None
        self._corrected_at, self._step = np.full(10, np.inf), np.zeros(10)
        self._not_excited: tuple[str, ...] = ()

    def summarise(self, model: Accumulation, latency: float, pending: int) -> LiveEstimate:
        """Present estimate with its uncertainty."""
        assert model.solver is not None
        solver, error = model.solver, model.rms_error
        covariance = model.state_covariance()
        data, prior = (part[:10, :10] for part in model.coordinate_information())
        widening, lasting, excitation = self._due(model)
        if widening:
            self._widen = np.sqrt(model.scores.inflation(model.state, covariance))
        if lasting or self._presumed is None:
            self._presumed = model.presume_lasting_errors()
            self._corrected_at = np.full(10, np.inf)
        if excitation:
            self._not_excited = unexcited_parameters(solver.xi, data, prior)
        xi = self._corrected(model, self._presumed.errors)
        if self._hull is not None:
            xi = keep_in_hull(xi, data + prior, self._hull)
        mapping = solver.coordinate_jacobian()
        lasting_covariance = mapping @ self._presumed.covariance @ mapping.T
        covariance = covariance * np.outer(self._widen, self._widen) + lasting_covariance
        return LiveEstimate(
            inertia=InertialParameters.from_log_cholesky(xi),
            covariance=covariance[:10, :10],
            effects=_effect_estimates(model, covariance[10:, 10:]),
            error=ModelError(
                math.sqrt(error[3:] @ error[3:] / 3.0),
                math.sqrt(error[:3] @ error[:3] / 3.0),
                model.information.whitened_rms,
            ),
            not_excited=self._not_excited,
            samples=model.samples,
            duration=model.last_time - model.first_time,
            converged=True,
            time=model.last_time,
            information=np.stack([data, prior]),
            coordinates=xi,
            rejected=model.judge.rejected,
            latency=latency,
            pending=pending,
        )

    def _corrected(self, model: Accumulation, errors: Array) -> Array:
        """Return xi (10,) without lasting errors; as it is beside effects, which may be those.

        The step is kept as long as xi stays near to where it was found: at another xi it may be far
        off, where the data say little.
        """
        assert model.solver is not None
        xi = model.solver.xi
        if model.effects or not errors.any():
            return xi
        if np.max(np.abs(xi - self._corrected_at)) > _NEAR:
            self._corrected_at, self._step = xi, model.corrected(errors) - xi
        return np.asarray(xi + self._step)

    def _due(self, model: Accumulation) -> list[bool]:
        """Which of the slow parts this call finds again: all of them for another model."""
        turn = self._calls % self._EVERY
        due = [model is not self._model or turn == own for own in self._TURNS]
        self._model = model
        self._calls += 1
        return due


def _effect_estimates(model: Accumulation, covariance: Array) -> dict[str, EffectEstimate]:
    stds = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    estimates, first = {}, 0
    for effect, parameters in zip(model.effects, model.effect_parameters, strict=True):
        rows = slice(first, first + len(parameters))
        first += len(parameters)
        names = [p.name for p in parameters]
        values = model.state[10:][rows]
        estimates[effect.name] = EffectEstimate(
            dict(zip(names, map(float, values), strict=True)),
            dict(zip(names, map(float, stds[rows]), strict=True)),
            {p.name: p.unit for p in parameters},
        )
    return estimates
