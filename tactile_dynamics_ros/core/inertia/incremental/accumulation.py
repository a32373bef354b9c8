"""One model, fed with samples: whitening, robust weights, summary and solution."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.contact.wrench_samples import WrenchSamples
from tactile_dynamics_ros.core.inertia.incremental.config import IncrementalConfig
from tactile_dynamics_ros.core.inertia.incremental.information import (
    BlockScores,
    SquareRootInformation,
)
from tactile_dynamics_ros.core.inertia.incremental.residuals import (
    ResidualBatch,
    linearise_residuals,
)
from tactile_dynamics_ros.core.inertia.incremental.sample_stream import Layout, SampleStream
from tactile_dynamics_ros.core.inertia.incremental.solver import DivergencePrior, SummarySolver
from tactile_dynamics_ros.core.inertia.incremental.whitening import StreamWhitener
from tactile_dynamics_ros.core.inertia.prior import contact_prior
from tactile_dynamics_ros.core.rigid_body.inertial_parameters import (
    dynamic_parameters_from_log_cholesky,
)

if TYPE_CHECKING:
    from tactile_dynamics_ros.core.effects.effect import Effect, EffectParameter

Array = NDArray[np.float64]

_BLOCK_SAMPLES = 25
_SCALE_SAMPLES = 500
_CLIP = 9.0
_ERROR_SAMPLES = 500


class Accumulation:
    """All that is known from the samples since `start`, in constant memory."""

    def __init__(
        self, config: IncrementalConfig, stream: SampleStream, effects: Sequence[Effect], start: int
    ) -> None:
        """Begin at a running number of the stream.

        Args:
            config: of the estimator.
            stream: where samples come from.
            effects: of the model; empty for the rigid body alone.
            start: first sample to take.
        """
        self._config, self._stream = config, stream
        self.effects = tuple(effects)
        self.start = self.next = start
        self.names = stream.names
        self.assumed: Array | None = None
        self.samples = 0
        self.rejected = 0
        self.first_time = self.last_time = np.nan
        self.solver: SummarySolver | None = None
        self._layout: Layout | None = None
        self._whitener: StreamWhitener | None = None
        self.effect_parameters: tuple[tuple[EffectParameter, ...], ...] = ()
        self._assumption: tuple[Array, Array] | None = None
        self._scale = 1.0
        self._squared_error = np.zeros(6)

    @property
    def state(self) -> Array:
        """Present [phi, theta]."""
        assert self.solver is not None
        phi = dynamic_parameters_from_log_cholesky(self.solver.xi)
        return np.concatenate([phi, self.solver.theta])

    @property
    def is_current(self) -> bool:
        """Whether no complete sample is waiting."""
        return self._stream.next_range(self.next, 1) is None

    @property
    def rms_error(self) -> Array:
        """(6,) running RMS of measured minus predicted wrench, [torque, force]."""
        return np.sqrt(self._squared_error)

    def advance(self, limit: int) -> int:
        """Take at most `limit` samples; return how many informed the estimate."""
        before, budget = self.samples, limit
        while budget > 0:
            found = self._stream.next_range(self.next, budget)
            if found is None:
                break
            first, last, layout = found
            self._enter(first, layout)
            self._take(first, last, layout)
            self.next = last
            budget -= last - first
        if self.samples > before and self.solver is not None:
            self.solver.replace_summary(self.information.factor, self.information.target)
        return self.samples - before

    def assume(self, other: Accumulation) -> None:
        """Weigh samples as another model's estimate implies, until `resume`."""
        self._assumption = other.state, other.state_covariance()
        self.assumed = other.state[:10]
        self._scale = other._scale

    def resume(self) -> None:
        """Weigh further samples as the own estimate implies."""
        self._assumption = None

    def state_covariance(self) -> Array:
        """Covariance of [phi, theta], data and prior, as the stated noise has it."""
        assert self.solver is not None
        jacobian = self.solver.coordinate_jacobian()
        information = self.solver.posterior_information(self.information.factor)
        return np.asarray(jacobian @ np.linalg.solve(information, jacobian.T))

    def _enter(self, first: int, layout: Layout) -> None:
        """Follow a change of segment or a jump within it."""
        if self._layout != layout or first > self.next:
            self._whitener = None
            self._layout = layout

    def _begin(self, first: int, last: int, layout: Layout) -> bool:
        """Place the prior at the first held sample."""
        usable, _ = self._stream.flags(first, last)
        if not usable.any():
            return False
        at = first + int(np.argmax(usable))
        samples, _ = linearise_residuals(
            self._stream.windows(at, at + 1, layout),
            self._stream.contacts(at, at + 1),
            self._config.window_degree,
            np.zeros(10),
        )
        self.effect_parameters = tuple(e.parameters(samples) for e in self.effects)
        stds = [p.prior_std for parameters in self.effect_parameters for p in parameters]
        self._splits = np.cumsum([len(parameters) for parameters in self.effect_parameters])[:-1]
        prior = DivergencePrior(contact_prior(samples).mean, self._config.prior_weight)
        self.solver = SummarySolver(prior, np.array(stds))
        self.information = SquareRootInformation(10 + len(stds))
        self.scores = BlockScores(10 + len(stds), _BLOCK_SAMPLES)
        self.first_time = float(samples.time[0])
        if self.assumed is None:
            self.assumed = self.state[:10]
        return True

    def _take(self, first: int, last: int, layout: Layout) -> None:
        if self.solver is None and not self._begin(first, last, layout):
            return
        if self._whitener is None:
            self._whitener = StreamWhitener(2 * layout.short, self.information.size)
        whitener = self._whitener
        state, covariance = self._assumption or (self.state, self.state_covariance())
        samples, batch = self._linearise(first, last, layout, state)
        usable, doubtful = self._stream.flags(first, last)
        for k in range(last - first):
            if usable[k]:
                self._absorb(whitener, batch, k, state, covariance, bool(doubtful[k]))
            else:
                whitener.skip()
        if usable.any():
            self.last_time = float(samples.time[-1]) + self.first_time
            self._follow_error(samples, batch, usable)

    def _linearise(
        self, first: int, last: int, layout: Layout, state: Array
    ) -> tuple[WrenchSamples, ResidualBatch]:
        theta = np.split(state[10:], self._splits) if self.effects else []
        return linearise_residuals(
            self._stream.windows(first, last, layout),
            self._stream.contacts(first, last),
            self._config.window_degree,
            state[:10],
            self.effects,
            theta,
            self.first_time,
        )

    def _absorb(
        self,
        whitener: StreamWhitener,
        batch: ResidualBatch,
        k: int,
        state: Array,
        covariance: Array,
        doubtful: bool,
    ) -> None:
        """Whiten one sample, judge its innovation and add what it is worth."""
        values = np.concatenate([batch.jacobian[k], batch.residual[k][:, None]], axis=1)
        noise = batch.pose_noise[k]
        white, row = whitener.predict(noise, batch.contact_covariance[k], values)
        jacobian, innovation = white[:, :-1], white[:, -1]
        spread = np.eye(6) + jacobian @ covariance @ jacobian.T
        square = float(innovation @ np.linalg.solve(spread, innovation)) / 6.0
        keep = self._weight(square, doubtful)
        white[:, -1] *= keep
        whitener.commit(noise, row, white)
        if keep == 0.0:
            self.rejected += 1
            return
        root = np.sqrt(keep)
        target = root * (jacobian @ state) - innovation * root
        self.information.add(root * jacobian, target)
        self.scores.add(root * jacobian, target)
        self.samples += 1

    def _weight(self, square: float, doubtful: bool) -> float:
        """Share of an innovation that is believed, given its mean square deviation."""
        relative = float(np.sqrt(square / self._scale))
        gate = self._config.huber_threshold if doubtful else self._config.outlier_gate
        if not doubtful:
            change = min(square, _CLIP * self._scale) - self._scale
            self._scale = max(1.0, self._scale + change / _SCALE_SAMPLES)
        if relative > gate:
            return 0.0
        return min(1.0, self._config.huber_threshold / max(relative, 1e-9))

    def _follow_error(
        self, samples: WrenchSamples, batch: ResidualBatch, usable: NDArray[np.bool_]
    ) -> None:
        gain = min(1.0, usable.sum() / max(min(self.samples, _ERROR_SAMPLES), 1))
        new = np.mean(batch.residual[usable] ** 2, axis=0)
        self._squared_error = self._squared_error + gain * (new - self._squared_error)
