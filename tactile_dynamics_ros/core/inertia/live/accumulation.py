"""One rigid body, fed with samples: whitening, robust weights, summary and solution."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.contact.wrench_samples import GRAVITY_W
from tactile_dynamics_ros.core.inertia.batch.prior import contact_prior
from tactile_dynamics_ros.core.inertia.batch.uncertainty import (
    HOLD,
    SCATTER,
    excited_projection,
    unexcited_directions,
)
from tactile_dynamics_ros.core.inertia.live.config import IncrementalConfig
from tactile_dynamics_ros.core.inertia.live.information import (
    BlockScores,
    LastingErrors,
    SquareRootInformation,
    positive_part,
)
from tactile_dynamics_ros.core.inertia.live.live_estimate import RecentFit
from tactile_dynamics_ros.core.inertia.live.pipeline import Judge, WhiteningPipeline, WhiteRows
from tactile_dynamics_ros.core.inertia.live.residuals import denoise_motion
from tactile_dynamics_ros.core.inertia.live.sample_stream import Layout, SampleStream
from tactile_dynamics_ros.core.inertia.live.solver import DivergencePrior, SummarySolver
from tactile_dynamics_ros.core.inertia.residuals.stated_noise import states_shares
from tactile_dynamics_ros.core.inertia.residuals.systematic import (
    PresumedErrors,
    systematic_lever,
)
from tactile_dynamics_ros.core.inertia.shape_weighing import Seen, beyond_noise
from tactile_dynamics_ros.core.rigid_body.inertial_parameters import (
    dynamic_parameters_from_log_cholesky,
    log_cholesky_jacobian,
)

_BLOCK_SAMPLES = 25
"""Samples of a first block of scores, a quarter of a second at 100 Hz; blocks are merged in pairs
when there are 128, so that longer ones follow. A shorter one costs time, a longer one sees quick
correlation late."""
_ERROR_SAMPLES = 500
"""Samples over which the published RMS of force and torque runs, five seconds at 100 Hz, as the
judge's scale does (`judge._SAMPLES`). Fewer flicker, more show a fault late."""
_RECENT_SAMPLES = 200
"""Samples whose error says whether the model fits now, two seconds at 100 Hz: long enough that
noise alone stays within a tenth of 1, short enough that a fault is over soon after its end. Half as
many would warn by chance, twice as many for twice as long."""
_NEWEST_SAMPLES = 50
"""Samples of which the load is compared with the estimate of all, half a second at 100 Hz: a change
is known in full after so long. Fewer see small changes later, more see large ones in part."""
_LOOK_SHARE = 0.1
"""Share of new samples after which it is looked again at which directions are excited: the cost per
sample falls as 1 / n, and an interval is at most a tenth of the data late. Half as much costs twice
as many looks, twice as much leaves directions called unknown for longer."""


_LOUD = 9.0
"""Square of the presumed noise of a sample's regressor, over that of the samples so far, from which
the sample is left out: windows at the border of unsure poses reach into them while the residual
does not, and such noise would be taken out of what all samples before have told. Draws of equal
poses stay below but for one in ten thousand. At 100 sixteen samples of a border cost as much as
sixteen seconds told, near to 1 clean samples are left out."""


@dataclass(frozen=True)
class _Knowledge:
    """Information of data and prior on xi, and covariance of phi, all (10, 10).

    `mapping` is the derivative of phi by xi, of a body that is not flat, `excited` that by the part
    of xi that is excited.
    """

    data: Array
    prior: Array
    covariance: Array
    mapping: Array
    excited: Array


class Accumulation:
    """All that is known from the samples since `start`, in constant memory."""

    def __init__(self, config: IncrementalConfig, stream: SampleStream) -> None:
        """Begin at the oldest sample that the stream keeps."""
        self._config, self._stream = config, stream
        self.start = self.next = stream.first
        self.assumed: Array | None = None
        self.samples = 0
        self.first_time = self.last_time = np.nan
        self.solver: SummarySolver | None = None
        self.information = SquareRootInformation(10)
        self.noise_information = np.zeros((10, 10))
        self.lasting = LastingErrors(10)
        self.scores = BlockScores(10, _BLOCK_SAMPLES)
        self.judge = Judge(config.huber_threshold, config.outlier_gate)
        self._assumption: tuple[Array, Array] | None = None
        self._pipeline: WhiteningPipeline | None = None
        self._known: _Knowledge | None = None
        self._squared_error = np.zeros(6)
        self._recent: deque[tuple[Array, Array]] = deque(maxlen=_RECENT_SAMPLES)
        self._unexcited, self._next_look = np.zeros((10, 0)), 0

    @property
    def phi(self) -> Array:
        """Present dynamic parameters (10,)."""
        assert self.solver is not None
        return dynamic_parameters_from_log_cholesky(self.solver.xi)

    @property
    def is_current(self) -> bool:
        """Whether no complete sample is waiting."""
        return self._stream.next_range(self.next, 1) is None

    @property
    def rms_error(self) -> Array:
        """(6,) running RMS of measured minus predicted wrench, [torque, force]."""
        return np.sqrt(self._squared_error)

    @property
    def recent(self) -> RecentFit:
        """How the present estimate fits the last samples, rejected ones too."""
        if not self._recent:
            return RecentFit()
        rows = np.concatenate([jacobian for jacobian, _ in self._recent])
        wrench = np.concatenate([target for _, target in self._recent])
        return RecentFit.of_rows(rows @ self.phi - wrench, wrench)

    def newest_load(self) -> tuple[float, float]:
        """Share by which the load of the newest samples differs, and its standard deviation.

        The one factor on the predicted white wrenches that fits best: a misfit within the noise
        that all samples share shows in it.
        """
        newest = list(self._recent)[-_NEWEST_SAMPLES:]
        if not newest:
            return 0.0, np.inf
        predicted = np.concatenate([jacobian @ self.phi for jacobian, _ in newest])
        missing = np.concatenate([target for _, target in newest]) - predicted
        square = max(float(predicted @ predicted), 1e-12)
        scatter = max(float(np.sqrt(np.mean(missing**2))), 1.0)
        return float(predicted @ missing) / square, scatter / float(np.sqrt(square))

    def advance(self, limit: int) -> int:
        """Take at most `limit` samples; return how many informed the estimate."""
        before, budget = self.samples, limit
        while budget > 0:
            found = self._stream.next_range(self.next, budget)
            if found is None:
                break
            first, last, layout = found
            if self.solver is not None or self._begin(first, last, layout):
                self._take(first, last, layout)
            self.next = last
            budget -= last - first
        if self.samples > before and self.solver is not None:
            self._hold_unexcited()
            self.solver.replace_summary(self.information.factor, self.information.target)
            self._known = None
        return self.samples - before

    def _hold_unexcited(self) -> None:
        """Keep at the prior what the motion has not excited, else noise of the poses decides it."""
        assert self.solver is not None
        if self.samples < self._next_look:
            return
        self._next_look = self.samples + max(1, int(_LOOK_SHARE * self.samples))
        factor, noise = self.information.factor, self.noise_information
        scatter = SCATTER / np.sqrt(self.samples)
        found = unexcited_directions(factor.T @ factor, noise, self._prior, scatter)
        if found.shape[1] == self._unexcited.shape[1] == 0:
            return
        self._unexcited = found
        rows = np.zeros((10, 10))
        rows[: found.shape[1]] = HOLD * found.T / self._prior.std
        self.solver.hold(rows)

    def assume(self, other: Accumulation) -> None:
        """Weigh samples as another estimate implies, until `resume`."""
        self._assumption = other.phi, other.covariance
        self.assumed = other.phi
        self.judge.scale = other.judge.scale

    def resume(self) -> None:
        """Weigh further samples as the own estimate implies."""
        self._assumption = None

    def coordinate_information(self) -> tuple[Array, Array]:
        """Information of the data, without that of noise, and of the prior on xi."""
        return self._knowledge().data, self._knowledge().prior

    def _knowledge(self) -> _Knowledge:
        """What follows from the present summary; kept until it changes."""
        if self._known is None:
            self._known = self._derive()
        return self._known

    def _derive(self) -> _Knowledge:
        assert self.solver is not None
        opened = self._prior.opened(self.phi)
        mapping, prior = log_cholesky_jacobian(opened), self.solver.prior_information(opened)
        kept = mapping @ excited_projection(self._unexcited, self._prior, len(prior)).T
        seen = self.information.factor @ kept
        noise = kept.T @ self.noise_information @ kept
        data = positive_part(seen.T @ seen - noise, prior)
        bread = mapping @ np.linalg.inv(data + prior)
        filling = data + prior + noise
        return _Knowledge(data, prior, np.asarray(bread @ filling @ bread.T), mapping, kept)

    def presume_lasting_errors(self) -> PresumedErrors:
        """Lasting errors that the residuals show, on phi."""
        known = self._knowledge()
        load = float(self.phi[0] * np.linalg.norm(GRAVITY_W))
        inverse = np.asarray(np.linalg.inv(known.data + known.prior))
        rows = self._stream.contacts(self._stream.first, self.next)
        held = [(rows.in_contact[:, k], k) for k in range(len(rows.names))]
        fingertips = states_shares([rows.force[h] for h in held], [rows.std[h] for h in held])
        prior = self._prior.information if fingertips else None
        found = self.lasting.presume(self.phi, inverse, known.excited, load, prior)
        return found.mapped(known.mapping)

    def corrected(self, errors: Array) -> Array:
        """Coordinates xi (10,) of the estimate without these lasting errors (q,)."""
        assert self.solver is not None
        factor = self.information.factor
        target = self.information.target + self.lasting.in_target(errors, factor)
        return self.solver.nearby_optimum(factor, target)

    def seen(self, covariance: Array, errors: Array) -> Seen:
        """What the data alone say, to be held against other priors of the body.

        Args:
            covariance: (10, 10) of phi, with all that widens it.
            errors: (q,) lasting ones that are taken off.
        """
        known, factor, phi = self._knowledge(), self.information.factor, self.phi
        target = self.information.target + self.lasting.in_target(errors, factor)
        slope = factor.T @ (factor @ phi - target)
        noise = known.mapping @ np.linalg.inv(known.data + known.prior) @ known.mapping.T
        beyond = beyond_noise(covariance, noise)
        data = factor.T @ factor - self.noise_information
        return Seen.of_sums(phi, data, slope, self._prior, self._unexcited, beyond)

    @property
    def covariance(self) -> Array:
        """Covariance (10, 10) of phi, data and prior, as the stated noise has it.

        With M = J^T J - E[dJ^T dJ] + prior: M^-1 (J^T J + prior) M^-1, since noise of the
        regressors adds scatter and no information. Source: Fuller 1987, Eq. 3.1.12.
        """
        return self._knowledge().covariance

    def _begin(self, first: int, last: int, layout: Layout) -> bool:
        """Place the prior at the first held sample."""
        usable, _ = self._stream.flags(first, last)
        if not usable.any():
            return False
        at = first + int(np.argmax(usable))
        motion = denoise_motion(
            self._stream.windows(at, at + 1, layout), self._config.window_degree
        )[0]
        samples = motion.samples(self._stream.contacts(at, at + 1))
        self._prior = contact_prior(samples)
        prior = DivergencePrior(self._prior.mean, self._config.prior_weight)
        self.solver = SummarySolver(prior)
        self._lever = systematic_lever(samples)
        self.first_time = self.last_time = float(samples.time[0])
        if self.assumed is None:
            self.assumed = self.phi
        return True

    def _take(self, first: int, last: int, layout: Layout) -> None:
        """Pass rows of one stretch through the whitening and add what leaves it."""
        pipeline = self._pipeline
        if pipeline is None or pipeline.layout != layout or first > self.next:
            pipeline = WhiteningPipeline(
                self._config, self._stream, layout, self._lever, self.judge
            )
            self._pipeline = pipeline
        phi, covariance = self._assumption or (self.phi, self.covariance)
        for rows in pipeline.process(first, last, phi, covariance):
            self._add(rows)

    def _add(self, rows: WhiteRows) -> None:
        self._recent.append((rows.jacobian, rows.target))
        if rows.weight > 0.0 and not self._is_border(rows):
            weight = rows.weight / rows.noise_ratio
            root = np.sqrt(weight)
            self.information.add(root * rows.jacobian, root * rows.target, 1.0 / rows.noise_ratio)
            self.noise_information += weight * rows.noise.T @ rows.noise
            self.lasting.add(root * rows.jacobian, root * rows.target, root * rows.lasting)
            self.scores.add(root * rows.jacobian, root * rows.target)
            self.samples += 1
            gain = 1.0 / min(self.samples, _ERROR_SAMPLES)
            self._squared_error += gain * (rows.residual**2 - self._squared_error)
        self.last_time = rows.time

    def _is_border(self, rows: WhiteRows) -> bool:
        """Whether the presumed noise of mass or inertia is far above that of the samples so far."""
        own = np.sum(rows.noise**2, axis=0)
        usual = self.noise_information.diagonal() / max(self.samples, 1)
        loud = [own[part].sum() > _LOUD * usual[part].sum() for part in (slice(1), slice(4, 10))]
        return self.samples >= _BLOCK_SAMPLES and any(loud)
