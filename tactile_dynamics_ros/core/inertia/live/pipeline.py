"""From raw samples to white rows: causal whitening, then regressors with a fixed lag."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.inertia.live.config import IncrementalConfig
from tactile_dynamics_ros.core.inertia.live.judge import Judge
from tactile_dynamics_ros.core.inertia.live.residuals import (
    ContactRows,
    DenoisedMotion,
    ResidualBatch,
    linearise_residuals,
)
from tactile_dynamics_ros.core.inertia.live.sample_stream import Layout, SampleStream
from tactile_dynamics_ros.core.inertia.residuals.balanced_forces import balance_contacts
from tactile_dynamics_ros.core.inertia.residuals.systematic import lasting_basis
from tactile_dynamics_ros.core.numerics.banded import VARIANCE_FLOOR
from tactile_dynamics_ros.core.numerics.decorrelation import Decorrelator
from tactile_dynamics_ros.core.numerics.stream_whitening import (
    DelayedSubstitution,
    StreamWhitener,
)

Array = NDArray[np.float64]

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
