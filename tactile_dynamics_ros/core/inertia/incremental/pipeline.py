"""From raw samples to white rows: causal whitening, then regressors with a fixed lag."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.inertia.incremental.config import IncrementalConfig
from tactile_dynamics_ros.core.inertia.incremental.decorrelation import Decorrelator
from tactile_dynamics_ros.core.inertia.incremental.judge import Judge
from tactile_dynamics_ros.core.inertia.incremental.residuals import (
    ContactRows,
    DenoisedMotion,
    LinearisedModel,
    ResidualBatch,
    contact_noise_response,
    linearise_residuals,
)
from tactile_dynamics_ros.core.inertia.incremental.sample_stream import Layout, SampleStream
from tactile_dynamics_ros.core.inertia.incremental.whitening import (
    DelayedSubstitution,
    StreamWhitener,
)
from tactile_dynamics_ros.core.inertia.systematic import SYSTEMATIC_SIZE, systematic_basis

Array = NDArray[np.float64]

_FLOOR = 1e-14 * np.eye(6)
_HISTORY = 50
_LEAST_CONTEXT = 4


@dataclass(frozen=True)
class WhiteRows:
    """One sample's white rows |J x - t|^2.

    Attributes:
        time: s.
        jacobian: (6, n); target: (6,).
        noise: (6, n) a draw of the noise that J carries.
        systematic: (6, 9) presumed errors that last, see `systematic_basis`.
        weight: share of it that is believed, 0 to 1.
        residual: (6,) unwhitened, at the parameters it was linearised at.
    """

    time: float
    jacobian: Array
    target: Array
    noise: Array
    systematic: Array
    weight: float
    residual: Array


@dataclass(frozen=True)
class _Record:
    """A sample between the two stages."""

    motion: DenoisedMotion
    contacts: ContactRows
    residual: Array
    state: Array
    factor_row: Array
    weight: float


class WhiteningPipeline:
    """Whitening of one gapless segment of samples.

    A residual is whitened at once, with a provisional regressor that serves to judge it. Its final
    regressor, independent of the residuals' noise, is known `lag` samples later.
    """

    def __init__(
        self,
        config: IncrementalConfig,
        stream: SampleStream,
        layout: Layout,
        size: int,
        lever: float,
        judge: Judge,
    ) -> None:
        """Start at the beginning of a segment.

        Args:
            config: of the estimator.
            stream: of raw samples.
            layout: of the segment.
            size: n, number of parameters.
            lever: m, of the presumed errors that last.
            judge: of innovations.
        """
        self.layout = layout
        self._config, self._stream, self._judge = config, stream, judge
        self._size, self._lever = size, lever
        self._columns = 2 * size + SYSTEMATIC_SIZE + 1
        self._whitener = StreamWhitener(2 * layout.short, size + 1)
        self._decorrelator = Decorrelator[_Record](layout.short, layout.long)
        self._substitution = DelayedSubstitution(2 * layout.short, self._columns)
        self._history: tuple[deque[DenoisedMotion], deque[DenoisedMotion]]
        self._history = deque(maxlen=_HISTORY), deque(maxlen=_HISTORY)
        self._history_contacts: deque[ContactRows] = deque(maxlen=_HISTORY)
        self._rng = np.random.default_rng(1)

    def process(
        self, first: int, last: int, model: LinearisedModel, state: Array, covariance: Array
    ) -> Iterator[WhiteRows]:
        """Take rows first <= k < last and yield the white rows that become complete.

        Args:
            first: running number.
            last: running number, exclusive.
            model: at `state`.
            state: (n,) parameters to linearise at.
            covariance: (n, n) of the state, for judging innovations.
        """
        begin = self._stream.lowest(first - _HISTORY, self.layout) if model.effects else first
        if model.effects and last - begin < _LEAST_CONTEXT:
            self._skip(last - first)
            return
        contacts = self._stream.contacts(begin, last)
        windows = self._stream.windows(begin, last, self.layout)
        batch = linearise_residuals(windows, contacts, self._config.window_degree, model)
        usable, doubtful = self._stream.flags(begin, last)
        complete: list[tuple[_Record, Array] | None] = []
        for k in range(first - begin, last - begin):
            if usable[k]:
                self._judge_row(batch, contacts, k, state, covariance, bool(doubtful[k]))
            else:
                self._whitener.skip()
                self._decorrelator.skip()
            complete.append(self._centre(bool(model.effects)))
        yield from self._finish(complete, model)

    def _skip(self, count: int) -> None:
        for _ in range(count):
            self._whitener.skip()
            self._decorrelator.skip()
            self._substitution.remember(np.zeros((6, self._columns)))

    def _judge_row(
        self,
        batch: ResidualBatch,
        contacts: ContactRows,
        k: int,
        state: Array,
        covariance: Array,
        doubtful: bool,
    ) -> None:
        own, noise = batch.contact_covariance[k], batch.pose_noise[k]
        drawn = batch.draw[k] + np.linalg.cholesky(own + _FLOOR) @ self._rng.normal(size=6)
        values = np.column_stack([batch.jacobian[k], drawn, batch.residual[k]])
        white, row = self._whitener.predict(noise, own, values)
        jacobian, innovation = white[:, :-2], white[:, -1]
        spread = np.eye(6) + jacobian @ covariance @ jacobian.T
        square = float(innovation @ np.linalg.solve(spread, innovation)) / 6.0
        weight = self._judge.weigh(square, doubtful)
        white[:, -1] *= weight
        self._whitener.commit(noise, row, white)
        record = _Record(
            batch.motion.row(k), contacts.row(k), batch.residual[k], state, row, weight
        )
        self._decorrelator.push(noise, row, white[:, :-3:-1], record)

    def _centre(self, with_forces: bool) -> tuple[_Record, Array] | None:
        record = self._decorrelator.centre
        if record is None:
            return None
        known = len(self._history_contacts) + 1 + len(self._decorrelator.later)
        if with_forces and known < _LEAST_CONTEXT:
            return None
        own = np.zeros((6, 0))
        if with_forces:
            own = contact_noise_response(record.motion, record.contacts)
        return record, self._decorrelator.correction(record.motion.response[0], own)

    def _finish(
        self, complete: list[tuple[_Record, Array] | None], model: LinearisedModel
    ) -> Iterator[WhiteRows]:
        """Final regressors of the centre rows, whitened with the rows of L kept."""
        found = [item for item in complete if item is not None]
        if not found:
            for _ in complete:
                self._substitution.remember(np.zeros((6, self._columns)))
            return
        jacobians = iter(self._jacobians(found, model))
        for item in complete:
            if item is None:
                self._substitution.remember(np.zeros((6, self._columns)))
                continue
            yield self._white_rows(item[0], next(jacobians))

    def _jacobians(self, found: list[tuple[_Record, Array]], model: LinearisedModel) -> Array:
        """Jacobians at the corrected motion, draws of their noise, presumed errors."""
        corrections = np.stack([correction for _, correction in found])
        motion = DenoisedMotion.stack([record.motion for record, _ in found])
        contacts = ContactRows.stack([record.contacts for record, _ in found])
        denoised = motion.corrected(corrections[:, 0, :18])
        noisy = denoised.corrected(motion.draw + corrections[:, 1, :18])
        if model.effects:
            contacts = contacts.corrected(corrections[:, 0, 18:])
            jacobian, disturbed = self._jacobians_in_context(denoised, noisy, contacts, model)
        else:
            both = DenoisedMotion.stack([denoised, noisy])
            held = ContactRows.stack([contacts, contacts])
            jacobian, disturbed = np.split(model.jacobian(both.samples(held)), 2)
        lasting = systematic_basis(denoised.rotation, self._lever)
        return np.concatenate([jacobian, disturbed - jacobian, lasting], axis=2)

    def _jacobians_in_context(
        self,
        denoised: DenoisedMotion,
        noisy: DenoisedMotion,
        contacts: ContactRows,
        model: LinearisedModel,
    ) -> tuple[Array, Array]:
        """Jacobians of effects with memory need the samples before and after."""
        later = self._decorrelator.later
        after = [record.motion for record in later], [record.contacts for record in later]
        held = ContactRows.stack([*self._history_contacts, contacts, *after[1]])
        jacobians = []
        for history, motion in zip(self._history, (denoised, noisy), strict=True):
            rows = slice(len(history), len(history) + len(motion.time))
            joined = DenoisedMotion.stack([*history, motion, *after[0]])
            jacobians.append(model.jacobian(joined.samples(held, model.origin))[rows])
        for k in range(len(denoised.time)):
            self._history_contacts.append(contacts.row(k))
            for history, motion in zip(self._history, (denoised, noisy), strict=True):
                history.append(motion.row(k))
        return jacobians[0], jacobians[1]

    def _white_rows(self, record: _Record, columns: Array) -> WhiteRows:
        size = self._size
        target = columns[:, :size] @ record.state - record.residual
        white = self._substitution.whiten(record.factor_row, np.column_stack([columns, target]))
        remembered = white.copy()
        predicted = white[:, :size] @ record.state
        remembered[:, -1] += (1.0 - record.weight) * (predicted - white[:, -1])
        self._substitution.remember(remembered)
        return WhiteRows(
            float(record.motion.time[0]),
            white[:, :size],
            white[:, -1],
            white[:, size : 2 * size],
            white[:, 2 * size : -1],
            record.weight,
            record.residual,
        )
