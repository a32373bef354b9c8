"""Summary of an accumulation: the estimate, its uncertainty and what was not excited."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.inertia.batch.inertial_estimate import ModelError
from tactile_dynamics_ros.core.inertia.batch.uncertainty import undetermined_parameters
from tactile_dynamics_ros.core.inertia.live.accumulation import Accumulation
from tactile_dynamics_ros.core.inertia.live.live_estimate import LiveEstimate
from tactile_dynamics_ros.core.inertia.live.pipeline import misfit_factor
from tactile_dynamics_ros.core.inertia.live.shape_watch import ShapeWatch
from tactile_dynamics_ros.core.inertia.residuals.systematic import PresumedErrors
from tactile_dynamics_ros.core.rigid_body.inertial_parameters import InertialParameters
from tactile_dynamics_ros.core.shape.solid import CentreHull, keep_in_hull

_NEAR = 0.05
"""How far log-Cholesky coordinates may move (5 % of scales, 5 cm) until what lasting errors change
is found again. Zero finds it with each update, at the cost of a solution; kept over ten updates
regardless, it could throw inertia far off for a moment."""

_CHANGED = 4.0
"""Standard deviations by which the load of the newest samples must differ to be said to have
changed: by chance once in 16 000 looks. Lower warns of clean data, higher keeps quiet of a change
that the interval does not cover."""
_LEAST_CHANGE = 0.02
"""Share of the load that may differ without a word: errors of poses and fingertips that last for
half a second do a percent. Lower warns of these, higher lets small payloads pass for longer."""


_MORE = 0.1
"""Share of new samples after which lasting errors are found again, which costs as much as five
updates: over a minute at 100 Hz less than one update in ten. Half as much costs twice that, twice
as much leaves intervals a fifth of the data late."""


class Summariser:
    """Turns what an `Accumulation` knows now into a `LiveEstimate`.

    What changes slowly (inflation and excitation) is found again at every tenth call only, each at
    another one; lasting errors as the samples grow.
    """

    _EVERY = 10
    _TURNS = (0, 6)

    def __init__(self, hull: CentreHull | None = None, shape: ShapeWatch | None = None) -> None:
        """Start without a past; a hull bounds the centre of mass, a shape the whole body."""
        self._hull, self._shape = hull, shape
        self._calls = 0
        self._model: Accumulation | None = None
        self._widen = np.ones(0)
        self._presumed: PresumedErrors | None = None
        self._next_presumption = 0
        self._corrected_at, self._step = np.full(10, np.inf), np.zeros(10)
        self._not_excited: tuple[str, ...] = ()

    def summarise(self, model: Accumulation, latency: float) -> LiveEstimate:
        """Present estimate with its uncertainty."""
        assert model.solver is not None
        solver, error = model.solver, model.rms_error
        covariance = model.covariance
        data, prior = model.coordinate_information()
        widening, excitation = self._due(model)
        if widening:
            scatter = model.scores.inflation(model.phi, covariance)
            self._widen = np.sqrt(scatter * misfit_factor(model.information.whitened_rms))
        if self._presumed is None or model.samples >= self._next_presumption:
            self._presumed = model.presume_lasting_errors()
            self._next_presumption = int((1.0 + _MORE) * model.samples) + 1
            self._corrected_at = np.full(10, np.inf)
        if excitation:
            widened = covariance * np.outer(self._widen, self._widen)
            self._not_excited = undetermined_parameters(solver.xi, data, prior, widened)
        xi = self._corrected(model, self._presumed.errors)
        if self._hull is not None:
            xi = keep_in_hull(xi, data + prior, self._hull)
        covariance = covariance * np.outer(self._widen, self._widen) + self._presumed.covariance
        recent = replace(model.recent, change=self._load_change(model, covariance[0, 0]))
        covariance += recent.change**2 * np.outer(model.phi, model.phi)
        found = LiveEstimate(
            inertia=InertialParameters.from_log_cholesky(xi),
            covariance=covariance,
            effects={},
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
            recent=recent,
        )
        return self._shape.hold(found, model, self._presumed.errors) if self._shape else found

    @staticmethod
    def _load_change(model: Accumulation, variance: float) -> float:
        """Share by which the load of the newest samples differs beyond its interval, else 0.

        Args:
            model: the accumulation.
            variance: kg^2, of the mass as it is to be published.
        """
        change, deviation = model.newest_load()
        uncertain = math.hypot(deviation, math.sqrt(variance) / model.phi[0])
        return change if abs(change) > max(_CHANGED * uncertain, _LEAST_CHANGE) else 0.0

    def _corrected(self, model: Accumulation, errors: Array) -> Array:
        """Coordinates xi (10,) of the estimate without lasting errors.

        The step is kept as long as xi stays near to where it was found: at another xi it may be far
        off, where the data say little.
        """
        assert model.solver is not None
        xi = model.solver.xi
        if not errors.any():
            return xi
        if np.max(np.abs(xi - self._corrected_at)) > _NEAR:
            self._corrected_at, self._step = xi, model.corrected(errors) - xi
        return np.asarray(xi + self._step)

    def _due(self, model: Accumulation) -> list[bool]:
        """Which of the slow parts this call finds again: all of them for another model."""
        turn = self._calls % self._EVERY
        due = [model is not self._model or turn == own for own in self._TURNS]
        if model is not self._model:
            self._next_presumption = 0
        self._model = model
        self._calls += 1
        return due
