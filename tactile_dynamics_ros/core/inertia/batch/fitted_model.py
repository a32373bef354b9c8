"""A rigid body with effects fitted to a recording: residuals, covariance, summary."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.contact.wrench_samples import GRAVITY_W, WrenchSamples
from tactile_dynamics_ros.core.discrepancy.model.residual_model import Misfit
from tactile_dynamics_ros.core.effects.present import PresentEffects
from tactile_dynamics_ros.core.inertia.batch.inertial_estimate import (
    EffectEstimate,
    InertialEstimate,
    LoadEvent,
    ModelError,
)
from tactile_dynamics_ros.core.inertia.batch.prior import LogCholeskyPrior
from tactile_dynamics_ros.core.inertia.batch.uncertainty import (
    excited_projection,
    misfit_inflation,
    undetermined_parameters,
)
from tactile_dynamics_ros.core.inertia.residuals.newton_euler_residual import (
    Linearisation,
    WrenchProblem,
)
from tactile_dynamics_ros.core.inertia.residuals.rigid_grasp import displacement_jacobian
from tactile_dynamics_ros.core.inertia.residuals.stated_noise import states_shares
from tactile_dynamics_ros.core.inertia.residuals.systematic import (
    PresumedErrors,
    lasting_basis,
    systematic_lever,
    with_gains,
)
from tactile_dynamics_ros.core.numerics.regime import split_label
from tactile_dynamics_ros.core.rigid_body.inertial_parameters import (
    InertialParameters,
    dynamic_parameters_from_log_cholesky,
    log_cholesky_jacobian,
)

if TYPE_CHECKING:
    from tactile_dynamics_ros.core.effects.effect import Effect


_TURNS = 0.05
"""Angular velocity, rad/s, from which an object turns: 3 deg/s, more than trackers drift."""


@dataclass(frozen=True)
class Stretch:
    """One stretch of the recording at the present parameters, whitened.

    Attributes:
        problem: its residuals.
        linearisation: its whitening.
        residual: (6 N,) white residual.
        jacobian: (6 N, 10) its derivative by phi.
    """

    problem: WrenchProblem
    linearisation: Linearisation
    residual: Array
    jacobian: Array


@dataclass(frozen=True)
class Survey:
    """The error of every stretch of a recording.

    Attributes:
        edges: (K + 1,) s, times that bound the stretches.
        rms: (K,) white RMS; NaN where nothing was held.
        fitted: (K,) which of them were fitted.
    """

    edges: Array
    rms: Array
    fitted: NDArray[np.bool_]

    @property
    def remark(self) -> str:
        """Sentence that says which stretches were fitted."""
        minutes = (self.edges[-1] - self.edges[0]) / 60.0
        seconds = 60.0 * minutes / len(self.rms)
        return (
            f"{minutes:.0f} minutes: fitted to {int(self.fitted.sum())} of {len(self.rms)} "
            f"stretches of {seconds:.0f} s, spread evenly and those with the largest error; "
            f"the error of all stretches lies between {np.nanmin(self.rms):.2f} and "
            f"{np.nanmax(self.rms):.2f}"
        )


@dataclass(frozen=True)
class FittedModel:
    """A rigid body with effects, fitted to a recording.

    Attributes:
        stretches: whitened residuals and Jacobians by stretch, at the solution.
        xi: (10,) log-Cholesky coordinates.
        effects: the effects of the model.
        theta: parameters of each effect.
        prior: prior of xi.
        unexcited: (10, q) orthonormal directions of (xi - mean) / std that the motion does not
            excite beyond what pose noise feigns; the fit keeps them at the prior.
        converged: whether the iteration converged.
        frame_covariance: (6, 6) covariance of a displacement of the body frame that all poses
            share, body axes [rotation, translation]; None where their noise is independent.
        corrected: the presumed lasting errors by which xi is corrected; None where it is not.
        survey: survey of all stretches where only some were fitted.
        restated: seen over stated noise of the streams whose own scatter was used.
        event_std: s, of the time of an event that was looked for; None where there is none.
        noise_bias: (10 + k,) by how much noise of the poses may have moved [phi, theta]; None where
            it cannot, see `pose_noise_bias`.
    """

    stretches: tuple[Stretch, ...]
    xi: Array
    effects: tuple[Effect, ...]
    theta: tuple[Array, ...]
    prior: LogCholeskyPrior
    unexcited: Array
    converged: bool
    frame_covariance: Array | None = None
    corrected: PresumedErrors | None = None
    survey: Survey | None = None
    restated: dict[str, float] = field(default_factory=dict)
    event_std: float | None = None
    noise_bias: Array | None = None

    @property
    def phi(self) -> Array:
        """(10,) dynamic parameters."""
        return dynamic_parameters_from_log_cholesky(self.xi)

    @cached_property
    def white_residual(self) -> Array:
        """(6 N,) white residual of all stretches."""
        return np.concatenate([stretch.residual for stretch in self.stretches])

    @cached_property
    def white_jacobian(self) -> Array:
        """(6 N, 10 + k) derivative of the white residual by phi and all effect parameters."""
        return np.concatenate([self._stretch_jacobian(stretch) for stretch in self.stretches])

    @property
    def whitened_rms(self) -> float:
        """RMS of the white residual per degree of freedom; 1 at the noise floor."""
        freedom = len(self.white_residual) - self.white_jacobian.shape[1]
        return float(np.sqrt(np.sum(self.white_residual**2) / freedom))

    @cached_property
    def misfit(self) -> Misfit:
        """White RMS, and mean logarithm of the diagonal of the Cholesky factor of the noise."""
        bands = [stretch.linearisation.whitener.band[0] for stretch in self.stretches]
        return Misfit(self.whitened_rms, float(np.mean(np.log(np.concatenate(bands)))))

    @cached_property
    def coordinate_jacobian(self) -> Array:
        """(10 + k, 10 + k) derivative of [phi, theta] by [xi, theta] of no flat body."""
        mapping = np.eye(self.white_jacobian.shape[1])
        mapping[:10, :10] = log_cholesky_jacobian(self.prior.opened(self.phi))
        return mapping

    @cached_property
    def noise_information(self) -> Array:
        """(10 + k, 10 + k) part of J^T J that is noise of the regressors, on [phi, theta]."""
        information = np.zeros((self.white_jacobian.shape[1],) * 2)
        information[:10, :10] = regressor_noise_information(self.stretches)
        return information

    @cached_property
    def coordinate_information(self) -> tuple[Array, Array]:
        """Information of the data, without that of noise, and of the prior on [xi, theta]."""
        mapping = self.coordinate_jacobian
        jacobian = self.white_jacobian
        data = mapping.T @ (jacobian.T @ jacobian - self.noise_information) @ mapping
        stds = [p.prior_std for e in self.effects for p in e.parameters(self.samples[0])]
        prior = np.diag(np.concatenate([self.prior.std**-2.0, np.array(stds, dtype=float) ** -2.0]))
        keep = self._excited_projection
        return _positive_part(keep @ data @ keep.T, prior), prior

    @cached_property
    def _excited_projection(self) -> Array:
        return excited_projection(self.unexcited, self.prior, self.white_jacobian.shape[1])

    @cached_property
    def covariance(self) -> Array:
        """(10 + k, 10 + k) `seen_covariance`, and a gain common to all sensors that none shows."""
        covariance = self.seen_covariance.copy()
        unseen = self._unseen_gain(covariance)
        covariance[:10, :10] += unseen**2 * np.outer(self.phi, self.phi)
        return covariance

    @cached_property
    def seen_covariance(self) -> Array:
        """(10 + k, 10 + k) covariance of [phi, theta], widened where the model does not fit.

        With M = J^T J - E[dJ^T dJ] + prior: M^-1 (J^T J + prior) M^-1, since noise of the
        regressors adds scatter and no information. Source: Fuller 1987, Eq. 3.1.12.
        """
        data, prior = self.coordinate_information
        mapping = self.coordinate_jacobian
        bread = np.linalg.inv(data + prior)
        to_excited = mapping @ self._excited_projection.T
        filling = data + prior + to_excited.T @ self.noise_information @ to_excited
        covariance = mapping @ bread @ filling @ bread @ mapping.T
        widen = misfit_inflation(self.white_residual, self.white_jacobian)
        covariance = covariance * np.outer(widen, widen) + self.lasting_covariance
        if self.frame_covariance is not None:
            moved = displacement_jacobian(self.phi)
            covariance[:10, :10] += moved @ self.frame_covariance @ moved.T
        if self.noise_bias is not None:
            covariance = covariance + np.outer(self.noise_bias, self.noise_bias)
        return np.asarray(covariance)

    @cached_property
    def lasting_covariance(self) -> Array:
        """(10 + k, 10 + k) part of `covariance` that lasting errors of the sensors make."""
        return (self.corrected or self.presumed_errors).covariance

    def _unseen_gain(self, covariance: Array) -> float:
        """Standard deviation of a gain common to all sensors that an effect may have, unseen."""
        stds = np.sqrt(np.diag(covariance)[10:])
        gains, first = [0.0], 0
        for effect, theta in zip(self.effects, self.theta, strict=True):
            own = stds[first : first + len(theta)]
            gains.append(effect.unseen_gain(self.samples[0], theta, own))
            first += len(theta)
        return float(np.linalg.norm(gains))

    @cached_property
    def presumed_errors(self) -> PresumedErrors:
        """Lasting errors that the residuals show, on [phi, theta]."""
        data, prior = self.coordinate_information
        rows = self.white_jacobian @ self.coordinate_jacobian @ self._excited_projection.T
        found = PresumedErrors.of_rows(
            np.asarray(np.linalg.inv(data + prior)),
            rows,
            self.white_lasting_errors,
            self.white_residual,
            self.load,
            prior if self._states_shares else None,
        )
        return found.mapped(self.coordinate_jacobian)

    @property
    def _states_shares(self) -> bool:
        """Whether this is a body alone, held by sensors that state shares of their load."""
        contacts = self.stretches[0].problem.raw.contacts
        stated = [contact.signals["force"].noise_factor for contact in contacts]
        return not self.effects and states_shares([contact.force for contact in contacts], stated)

    @property
    def corrected_wrench(self) -> Array:
        """(6,) body wrench [torque, force] that sensors are taken to read too much, N m and N."""
        if self.corrected is None:
            return np.zeros(6)
        lever = systematic_lever(self.samples[0])
        return np.asarray(self.corrected.errors[:6] * np.repeat([lever, 1.0], 3))

    @property
    def corrected_wrench_std(self) -> Array:
        """(6,) standard deviation of `corrected_wrench`."""
        if self.corrected is None or not self.corrected.errors.any():
            return np.zeros(6)
        lever = systematic_lever(self.samples[0])
        return np.asarray(self.corrected.spread[:6] * np.repeat([lever, 1.0], 3))

    @property
    def load(self) -> float:
        """Weight of the body, N."""
        return float(self.phi[0] * np.linalg.norm(GRAVITY_W))

    @cached_property
    def white_lasting_errors(self) -> Array:
        """(6 N, 9 + 13 C) white wrenches of presumed lasting errors, see `systematic`."""
        lever = systematic_lever(self.samples[0])
        white = whiten_stretches(self.stretches, [lasting_basis(s, lever) for s in self.samples])
        return np.asarray(white @ with_gains(white.shape[1]))

    @property
    def samples(self) -> tuple[WrenchSamples, ...]:
        """Denoised samples by stretch."""
        return tuple(stretch.problem.samples for stretch in self.stretches)

    @property
    def unplaced(self) -> bool:
        """Whether no place was recorded of an object that turned: accelerations are unknown."""
        return any(
            stretch.problem.raw.motion.at_one_place
            and np.abs(stretch.problem.samples.angular_velocity).max() > _TURNS
            for stretch in self.stretches
        )

    def smooth_residual(self) -> Array:
        """(N, 6) predicted minus measured wrench with smoothed motion and measured forces."""
        return np.concatenate(
            [s.problem.smooth_residual(self.phi, self.effects, self.theta) for s in self.stretches]
        )

    def _stretch_jacobian(self, stretch: Stretch) -> Array:
        present = PresentEffects(self.effects, self.theta)
        columns = [
            stretch.linearisation.whiten(part)
            for part in present.jacobians(stretch.problem.samples, self.phi)
        ]
        return np.concatenate([stretch.jacobian, *[-column for column in columns]], axis=1)

    def to_estimate(self) -> InertialEstimate:
        """Summarise for people and programs."""
        covariance = self.covariance
        smooth = self.smooth_residual()
        data, prior = self.coordinate_information
        times = [stretch.problem.grid for stretch in self.stretches]
        return InertialEstimate(
            inertia=InertialParameters.from_log_cholesky(self.xi),
            covariance=covariance[:10, :10],
            effects=self._effect_estimates(covariance),
            error=ModelError(
                force_rms_n=float(np.sqrt(np.mean(smooth[:, 3:] ** 2))),
                torque_rms_nm=float(np.sqrt(np.mean(smooth[:, :3] ** 2))),
                whitened_rms=self.whitened_rms,
            ),
            not_excited=undetermined_parameters(
                self.xi,
                data[:10, :10] / max(1.0, self.whitened_rms) ** 2,
                prior[:10, :10],
                covariance[:10, :10],
                self.unplaced,
            ),
            samples=sum(stretch.problem.count for stretch in self.stretches),
            duration=float(times[-1][-1] - times[0][0]),
            converged=self.converged,
            lasting=self.lasting_covariance[:10, :10],
            event=self._load_event(covariance),
        )

    def _load_event(self, covariance: Array) -> LoadEvent | None:
        """The first event of the model, with the load after it."""
        for effect, theta, rows in self._effect_rows():
            if effect.event and split_label(effect.name)[1] is not None:
                own = np.append(np.arange(10), rows)
                spread = covariance[np.ix_(own, own)]
                return LoadEvent.of(effect, self.phi, theta, spread, self.event_std)
        return None

    def _effect_rows(self) -> Iterator[tuple[Effect, Array, NDArray[np.int64]]]:
        """Effects with their parameters (k,) and where these are among [phi, theta]."""
        first = 10
        for effect, theta in zip(self.effects, self.theta, strict=True):
            yield effect, theta, np.arange(first, first + len(theta))
            first += len(theta)

    def _effect_estimates(self, covariance: Array) -> dict[str, EffectEstimate]:
        estimates = {}
        for effect, theta, rows in self._effect_rows():
            parameters = effect.parameters(self.samples[0])
            own = covariance[np.ix_(rows, rows)]
            names = [p.name for p in parameters]
            found = [
                (p.name, float(value), float(std), p.unit)
                for p, value, std in zip(parameters, theta, np.sqrt(np.diag(own)), strict=True)
            ]
            sums = effect.sums(self.samples[0])
            found += [(s.name, *s.entry(names, theta, own), s.unit) for s in sums]
            estimates[effect.name] = EffectEstimate(
                {name: value for name, value, _, _ in found},
                {name: std for name, _, std, _ in found},
                {name: unit for name, _, _, unit in found},
            )
        return estimates


def _positive_part(information: Array, scale: Array) -> Array:
    """Nearest information without negative directions, measured in units of `scale`."""
    unit = np.sqrt(np.diag(scale))
    values, vectors = np.linalg.eigh(information / np.outer(unit, unit))
    clipped = vectors * np.maximum(values, 0.0) @ vectors.T
    return np.asarray(clipped * np.outer(unit, unit))


def whiten_stretches(stretches: Sequence[Stretch], values: Sequence[Array]) -> Array:
    """White form of values (N, 6, ...) per stretch, one after the other."""
    parts = zip(stretches, values, strict=True)
    return np.concatenate([stretch.linearisation.whiten(value) for stretch, value in parts])


def regressor_noise_information(stretches: Sequence[Stretch]) -> Array:
    """Noise part of J^T J, (10, 10) on phi, from one seeded draw of the pose noise."""
    draws = [s.linearisation.whiten(s.problem.regressor_noise(s.linearisation)) for s in stretches]
    return np.asarray(sum((draw.T @ draw for draw in draws), start=np.zeros((10, 10))))
