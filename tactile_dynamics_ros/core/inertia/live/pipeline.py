"""From raw samples to white rows: whitening, regressors, robust weights."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.inertia.live.config import IncrementalConfig
from tactile_dynamics_ros.core.inertia.live.residuals import (
    ContactRows,
    DenoisedMotion,
    ResidualBatch,
    linearise_residuals,
)
from tactile_dynamics_ros.core.inertia.live.sample_stream import Layout, SampleStream
from tactile_dynamics_ros.core.inertia.residuals.sampled_signals import balance_contacts
from tactile_dynamics_ros.core.inertia.residuals.systematic import lasting_basis
from tactile_dynamics_ros.core.numerics.banded import VARIANCE_FLOOR
from tactile_dynamics_ros.core.numerics.least_squares import Decorrelator
from tactile_dynamics_ros.core.numerics.stream_whitening import (
    DelayedSubstitution,
    StreamWhitener,
)

_SAMPLES = 500
"""Samples over which the scale of innovations is learnt, five seconds at 100 Hz. Fewer let a fault
of a second raise the scale and be believed; more leave a model that does not fit rejected for
longer."""
_SURPRISE = 2.0
"""How much more than the scale an innovation may add to it: a model that does not fit is learnt
within seconds at the start, where few samples count, but a fault that comes later would have to
last for ten seconds to triple the scale. At 9 five seconds of flipped forces were believed."""
_WORST = 20.0
"""Largest scale in standard deviations: where a model is further off nothing is published
(`live_estimate.GROSS`). Without a bound a fault that lasts would be believed in the end. Below
`GROSS` models that are still published would be learnt no more and be thrown away."""
_DOUBT_SAMPLES = 25
"""Doubtful samples over which the share of those that do not fit is learnt, a quarter of a second
at 100 Hz. Fewer decide by chance, more believe the first of a fault."""
_VETO = 0.1
"""Share of doubtful samples that do not fit from which none is believed: of true ones far less than
one in a hundred exceeds the threshold, and those of a fault that happen to fit are a choice that
biases the estimate. At a quarter the first samples of a fault pass into the estimate; at a few
percent a single outlier (1 / 25 of the average) keeps doubtful samples out."""

_NOISE_SAMPLES = 25
"""Samples over which `Judge.noise` is learnt, a quarter of a second at 100 Hz: clean data reach 1.2
times their scale less than once in an hour. Fewer follow chance, more let the first samples of a
fault in and throw away the first ones after it."""
_FITS, _MISFITS = 1.2, 1.5
"""Error over the noise up to which the scatter of residuals tells how far off the estimate may be,
and from which it does not: of what lasts as long as the recording there are few blocks. The upper
one is that from which the status warns (`live_estimate.MISFIT`); nearer to 1 intervals of clean
data grow by chance, higher ones leave those of hidden effects too small."""
_LASTING_FACTOR = 9.0
"""Factor by which variances grow beside the square of such an error, since it is not white: with 1,
truths of hidden effects were up to 9 standard deviations off in the first ten seconds
(`benchmarks.inertia`, recordings with one effect). More makes intervals of models that fit badly
say nothing."""


def misfit_factor(rms: float) -> float:
    """Factor >= 1 on variances for an error over the noise."""
    share = min(max((rms - _FITS) / (_MISFITS - _FITS), 0.0), 1.0)
    return max(1.0, rms) ** 2 * (1.0 + (_LASTING_FACTOR - 1.0) * share)


@dataclass
class Judge:
    """Robust weights of whitened innovations, relative to how well the model fits lately.

    Attributes:
        huber: relative innovation from which a sample loses weight.
        gate: relative innovation from which it is rejected.
        scale: mean square of innovations, at least 1.
        rejected: samples rejected so far.
        noise: factor >= 1 on variances while the model fits worse than it did before, so that a
            fault that ends leaves the estimate as it was.
    """

    huber: float
    gate: float
    scale: float = 1.0
    rejected: int = 0
    noise: float = 1.0
    _seen: int = 0
    _misfits: float = 0.0
    _mean: float = 1.0

    def weigh(self, square: float, doubtful: bool) -> float:
        """Share of an innovation that is believed.

        Args:
            square: its mean square in units of its predicted variance.
            doubtful: a sensor may be lying; only what fits is believed then.
        """
        relative = math.sqrt(square / self.scale)
        if doubtful:
            weight = self._doubt(relative)
        else:
            self._learn(square)
            weight = 0.0 if relative > self.gate else min(1.0, self.huber / max(relative, 1e-9))
            if weight > 0.0:
                self._mean += (square - self._mean) / _NOISE_SAMPLES
                self.noise = misfit_factor(math.sqrt(self._mean / self.scale))
        self.rejected += weight == 0.0
        return weight

    def _learn(self, square: float) -> None:
        self._seen += 1
        self._misfits *= 1.0 - 1.0 / _DOUBT_SAMPLES
        change = min(square, _SURPRISE * self.scale) - self.scale
        scale = self.scale + change / min(self._seen + 1, _SAMPLES)
        self.scale = min(max(1.0, scale), _WORST**2)

    def _doubt(self, relative: float) -> float:
        fits = relative <= self.huber
        self._misfits += ((not fits) - self._misfits) / _DOUBT_SAMPLES
        return float(fits and self._misfits < _VETO)


_SIZE = 10
"""Number of dynamic parameters: mass, first moments (3) and second moments (6) of one rigid body;
fixed by mechanics."""
_COLUMNS = 2 * _SIZE + 1
"""Columns of the final rows before the presumed errors: Jacobian, a draw of its noise, target. It
follows from these three; another one would shift targets into errors."""


@dataclass(frozen=True)
class WhiteRows:
    """One sample's white rows |J x - t|^2.

    Attributes:
        time: s.
        jacobian: (6, 10) by phi; target: (6,).
        noise: (6, 10) a draw of the noise that J carries.
        lasting: (6, 9 + 12 C) presumed errors that last, see `systematic.lasting_basis`.
        weight: share of it that is believed, 0 to 1.
        noise_ratio: its variance over the stated one, see `Judge.noise`.
        residual: (6,) unwhitened, at the phi of its time.
    """

    time: float
    jacobian: Array
    target: Array
    noise: Array
    lasting: Array
    weight: float
    noise_ratio: float
    residual: Array


@dataclass(frozen=True)
class _Record:
    """A sample between the two stages."""

    motion: DenoisedMotion
    contacts: ContactRows
    residual: Array
    phi: Array
    factor_row: Array
    weight: float
    noise_ratio: float


class WhiteningPipeline:
    """Whitening of one gapless stretch of samples.

    A residual is whitened at once, with a provisional regressor that serves to judge it. Its final
    regressor, independent of the residuals' noise, is known `lag` samples later.
    """

    def __init__(
        self,
        config: IncrementalConfig,
        stream: SampleStream,
        layout: Layout,
        lever: float,
        judge: Judge,
    ) -> None:
        """Start at the beginning of a stretch.

        Args:
            config: settings of the estimator.
            stream: stream of raw samples.
            layout: window sizes of the stretch.
            lever: m, of the presumed errors that last.
            judge: robust weights of innovations.
        """
        self.layout = layout
        self._config, self._stream, self._judge = config, stream, judge
        self._lever = lever
        self._whitener = StreamWhitener(2 * layout.short, _SIZE + 1)
        self._decorrelator = Decorrelator[_Record](layout.short, layout.long)
        self._substitution = DelayedSubstitution(2 * layout.short, _COLUMNS)
        self._rng = np.random.default_rng(1)

    def process(self, first: int, last: int, phi: Array, covariance: Array) -> Iterator[WhiteRows]:
        """Take rows first <= k < last and yield the white rows that become complete.

        Args:
            first: running number.
            last: running number, exclusive.
            phi: (10,) dynamic parameters to linearise at.
            covariance: (10, 10) covariance of phi, for judging innovations.
        """
        contacts = self._stream.contacts(first, last)
        windows = self._stream.windows(first, last, self.layout)
        batch = linearise_residuals(windows, contacts, self._config.window_degree, phi)
        usable, doubtful = self._stream.flags(first, last)
        complete: list[tuple[_Record, Array] | None] = []
        for k in range(last - first):
            if usable[k]:
                self._judge_row(batch, contacts, k, phi, covariance, bool(doubtful[k]))
            else:
                self._whitener.skip()
                self._decorrelator.skip()
            complete.append(self._centre())
        yield from self._finish(complete, phi)

    def _judge_row(
        self,
        batch: ResidualBatch,
        contacts: ContactRows,
        k: int,
        phi: Array,
        covariance: Array,
        doubtful: bool,
    ) -> None:
        own, noise = batch.contact_covariance[k], batch.pose_noise[k]
        drawn = batch.draw[k] + np.linalg.cholesky(
            own + VARIANCE_FLOOR * np.eye(6)
        ) @ self._rng.normal(size=6)
        values = np.column_stack([batch.jacobian[k], drawn, batch.residual[k]])
        white, row = self._whitener.predict(noise, own, values)
        jacobian, innovation = white[:, :-2], white[:, -1]
        spread = np.eye(6) + jacobian @ covariance @ jacobian.T
        square = float(innovation @ np.linalg.solve(spread, innovation)) / 6.0
        weight = self._judge.weigh(square, doubtful)
        white[:, -1] *= weight
        self._whitener.commit(noise, row, white)
        record = _Record(
            batch.motion.row(k),
            contacts.row(k),
            batch.residual[k],
            phi,
            row,
            weight,
            self._judge.noise,
        )
        self._decorrelator.push(noise, row, white[:, :-3:-1], record)

    def _centre(self) -> tuple[_Record, Array] | None:
        """Return the centre row, if it has a residual, and the correction of its motion."""
        record = self._decorrelator.centre
        if record is None:
            return None
        return record, self._decorrelator.correction(record.motion.response[0])

    def _finish(
        self, complete: list[tuple[_Record, Array] | None], phi: Array
    ) -> Iterator[WhiteRows]:
        """Final regressors of the centre rows, whitened with the rows of L kept."""
        found = [item for item in complete if item is not None]
        columns = iter(self._final_columns(found, phi) if found else ())
        for item in complete:
            if item is None:
                self._substitution.remember(np.zeros((6, _COLUMNS)))
            else:
                yield self._white_rows(item[0], next(columns))

    def _final_columns(self, found: list[tuple[_Record, Array]], phi: Array) -> Array:
        """Jacobians at the corrected motion, draws of their noise, targets, presumed errors.

        The errors are those of forces that balance the model, so that noise is not taken for load.
        """
        corrections = np.stack([correction for _, correction in found])
        motion = DenoisedMotion.stack([record.motion for record, _ in found])
        denoised = motion.corrected(corrections[:, 0])
        noisy = denoised.corrected(motion.draw + corrections[:, 1])
        jacobian, disturbed = np.split(DenoisedMotion.stack([denoised, noisy]).regressor(), 2)
        assumed = np.stack([record.phi for record, _ in found])
        residual = np.stack([record.residual for record, _ in found])
        samples = denoised.samples(ContactRows.stack([record.contacts for record, _ in found]))
        balanced = balance_contacts(samples, jacobian @ phi - samples.measured_wrench)
        lasting = lasting_basis(balanced, self._lever)
        target = (jacobian @ assumed[..., None])[..., 0] - residual
        return np.concatenate([jacobian, disturbed - jacobian, target[..., None], lasting], axis=2)

    def _white_rows(self, record: _Record, columns: Array) -> WhiteRows:
        white = self._substitution.whiten(record.factor_row, columns)
        jacobian, noise, known, lasting = np.split(white, [_SIZE, 2 * _SIZE, _COLUMNS], axis=1)
        remembered = white.copy()
        predicted = jacobian @ record.phi
        remembered[:, _COLUMNS - 1] += (1.0 - record.weight) * (predicted - known[:, 0])
        self._substitution.remember(remembered)
        return WhiteRows(
            float(record.motion.time[0]),
            jacobian,
            known[:, 0],
            noise,
            lasting,
            record.weight,
            record.noise_ratio,
            record.residual,
        )
