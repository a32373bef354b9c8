"""The dual filter: parameters by weighted hypotheses, motion by a Kalman step given them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag, solve_triangular

from tactile_dynamics_ros.core.configuration import check_ranges, parameter
from tactile_dynamics_ros.core.planar.filter.belief import (
    Belief,
    joined,
    root_of,
    slope_of,
    unit_points,
)
from tactile_dynamics_ros.core.planar.filter.observation import Observation
from tactile_dynamics_ros.core.planar.filter.process import (
    LINK_PARAMETERS,
    Prediction,
    Process,
    PusherMotion,
)

Array = NDArray[np.float64]

_DISTANCE = 0.02
"""Distance over which friction stays alike, m, as in the fits to recordings. Half of it makes
products of long pushes look known better by a third."""
_MOST_SURPRISE = 9.0
"""Squared innovation per number, in units of its variance, above which a measurement counts as
uncertain by more: three standard deviations. At 4 one good sample in twenty is widened."""
_LEAST_COUNT = 0.5
"""Share of the hypotheses that must go on counting after a step. What a measurement says beyond is
left out: with a tenth of them their covariance would be of ten points."""
_NOISE = (2e-5, 2e-5, 4e-4, 1e-3, 1e-3, 2e-2)
"""Standard deviation that a step of 10 ms adds to x, y, yaw and their rates: what the mechanics
miss of a link (m, rad, m/s, rad/s). At a tenth poses lag behind pushes whose contact point is off by
0.3 mm; at ten times forces tell nothing, since each follows from a change of velocity."""
_STANDING = (1e-3, 1e-3, 1e-2)
"""Standard deviation of the rates of an object that nothing touches and that has stopped, m/s and
rad/s; it is taken to stand still."""


@dataclass(frozen=True)
class DualConfig:
    """How many hypotheses there are, and what tables are like."""

    hypotheses: int = parameter(100, "weighted at each step; even", "", 40, 2000)
    variation: float = parameter(
        0.08, "standard deviation of friction from place to place, over its mean", "", 0.0, 0.5
    )
    seed: int = parameter(0, "of the hypotheses", "", 0)

    def __post_init__(self) -> None:
        check_ranges(self)


@dataclass(frozen=True, eq=False)
class _Ahead:
    """Hypotheses at the end of a step and what they expect.

    Attributes:
        values: (C, D) parameters, state, local friction. seen: (C, m).
        noise: (q, D + m) rows of independent noise that the step adds.
    """

    values: Array
    seen: Array
    noise: Array

    def moments(self) -> tuple[Array, Array]:
        """Mean (D + m,) and lower root (D + m, D + m) of both together."""
        both = np.concatenate([self.values, self.seen], axis=1)
        mean = both.mean(axis=0)
        return mean, root_of(np.concatenate([(both - mean) / np.sqrt(len(both)), self.noise]))


class DualFilter:
    """Belief about one object while it is pushed.

    Beside the parameters and the state it keeps, for each link, how friction differs here from its
    mean: relatively, and by a shift of the centre of pressure, both of which fade with the distance
    travelled. Without them ten seconds of one push would know the friction of all of the table.

    Args:
        process: the model.
        pose: (3 L,) where the links are. pose_std: (3,).
        config: of the filter.
        prior: mean (p,) and covariance (p, p) of the parameters; the process's own by default.

    Source: paper B, III-F (dual filter); errata 8, 12 and 13.
    """

    def __init__(
        self,
        process: Process,
        pose: Array,
        pose_std: Array,
        config: DualConfig | None = None,
        prior: tuple[Array, Array] | None = None,
    ) -> None:
        self.process, self.config = process, config or DualConfig()
        self._rng = np.random.default_rng(self.config.seed)
        mean, covariance = process.prior if prior is None else prior
        self._own = len(mean)
        self._moving = 6 * process.links
        reach = np.sqrt(np.diag(process.prior[1]))
        self._local = np.concatenate(
            [self.config.variation * np.array([1.0, *(2.0 * reach[k + 2 : k + 4])])
             for k in range(0, 4 * process.links, 4)]
        )  # fmt: skip
        state = np.zeros((process.links, 6))
        state[:, :3] = np.reshape(pose, (-1, 3))
        spread = np.tile(np.concatenate([pose_std, _STANDING]), process.links)
        roots = np.linalg.cholesky(covariance), np.diag(spread), np.diag(self._local)
        self.belief = Belief(
            np.concatenate([mean, state.ravel(), np.zeros(len(self._local))]),
            np.asarray(block_diag(*roots)),
            len(mean),
        )
        self.kept = 1.0
        """Share of the last measurement that was not left out."""
        size = len(self.belief.mean)
        self._unit = unit_points(self.config.hypotheses, size, self._rng)

    @property
    def parameters(self) -> tuple[Array, Array]:
        """Mean (p,) and covariance (p, p) of the parameters."""
        root = self.belief.root[: self._own, : self._own]
        return self.belief.mean[: self._own], np.asarray(root @ root.T)

    @property
    def state(self) -> tuple[Array, Array]:
        """Mean (6 L,) and covariance (6 L, 6 L) of the state."""
        part = slice(self._own, self._own + self._moving)
        root = self.belief.root[part]
        return self.belief.mean[part], np.asarray(root @ root.T)

    def step(self, motion: PusherMotion | None, seen: Observation) -> None:
        """Advance by a step and learn from what was seen.

        Args:
            motion: of the pusher; None while nothing is touched and the object has stopped.
            seen: during the step.
        """
        ahead = self._ahead(motion, seen)
        mean, root = ahead.moments()
        size = len(self.belief.mean)
        if len(seen.value) == 0:
            self.belief = Belief(mean[:size], root[:size, :size], self._own)
            return
        noise = self._believed_noise(seen, mean[size:], root[size:])
        self.belief = self._updated(ahead, mean, root, seen.value, noise, motion is None)

    def _ahead(self, motion: PusherMotion | None, seen: Observation) -> _Ahead:
        """Hypotheses of the belief, moved by the process."""
        turn = np.linalg.qr(self._rng.standard_normal((len(self.belief.mean),) * 2))[0]
        values = self.belief.points(self._unit @ turn)
        own, size = self._own, len(self.belief.mean)
        start = values[:, own : own + self._moving]
        step = 0.01 if motion is None else motion.step
        noise = np.tile(_NOISE, self.process.links) * np.sqrt(step / 0.01)
        if motion is None:
            begin = start.copy()
            begin.reshape(len(begin), -1, 6)[:, :, 3:] = 0.0
            noise = np.tile([1e-6, 1e-6, 1e-6, *_STANDING], self.process.links)
            prediction, memory = Prediction(begin, np.zeros((len(begin), 3))), 1.0
        else:
            prediction = self._predict(values, motion)
            moved = float(np.linalg.norm(self.belief.mean[own + 3 : own + 5])) * step
            memory = float(np.exp(-moved / _DISTANCE))
        values = np.concatenate(
            [values[:, :own], prediction.states, memory * values[:, own + self._moving :]], axis=1
        )
        rows = np.zeros((size - own, size + len(seen.value)))
        fresh = self._local * np.sqrt(1.0 - memory**2)
        rows[:, own:size] = np.diag(np.concatenate([noise, fresh]))
        rows[: self._moving, size:] = noise[:, None] * seen.by_state(self._moving).T
        return _Ahead(values, seen.expected(prediction), rows)

    def _predict(self, values: Array, motion: PusherMotion) -> Prediction:
        """Predict all hypotheses; impossible ones are kept, and follow the others' linear trend.

        Clipping them to what is possible would shrink the belief; dropping them too.

        Source: paper B, III-F1.
        """
        own = self._own
        states = values[:, own : own + self._moving]
        here = self._here(values)
        possible = self.process.feasible(here)
        if possible.all():
            return self.process.predict(states, here, motion)
        found = self.process.predict(states[possible], here[possible], motion)
        columns = np.column_stack([np.ones(len(values)), values])
        known = np.concatenate([found.states, found.wrench], axis=1)
        trend = np.linalg.lstsq(columns[possible], known, rcond=None)[0]
        both = columns @ trend
        both[possible] = known
        return Prediction(both[:, : self._moving], both[:, self._moving :])

    def _here(self, values: Array) -> Array:
        """Parameters (C, p) with what friction is at this place."""
        here = values[:, : self._own].copy()
        local = values[:, self._own + self._moving :]
        for link in range(self.process.links):
            first = len(LINK_PARAMETERS) * link
            here[:, [first, first + 2, first + 3]] += local[:, 3 * link : 3 * link + 3]
        return here

    def _believed_noise(self, seen: Observation, mean: Array, root: Array) -> Array:
        """Standard deviations (m,) of the noise, larger where a measurement is a surprise."""
        std = seen.std.copy()
        covariance = root @ root.T
        for group in seen.groups:
            lack = seen.value[group] - mean[group]
            spread = covariance[group, group] + np.diag(std[group] ** 2)
            surprise = float(lack @ np.linalg.solve(spread, lack)) / len(lack)
            if surprise > _MOST_SURPRISE:
                std[group] = np.sqrt(
                    std[group] ** 2
                    + np.diag(spread) * (surprise / _MOST_SURPRISE - 1.0)
                )  # fmt: skip
        return std

    def _updated(
        self, ahead: _Ahead, mean: Array, root: Array, value: Array, noise: Array, resting: bool
    ) -> Belief:
        """Parameter step, then the motion's step given the parameters, then both joined."""
        own, size = self._own, len(self.belief.mean)
        by_own = root[:own, :own]
        inner, seen_inner = root[own:size, own:size], root[size:, own:size]
        slope = slope_of(root[own:size, :own], by_own)
        gain = slope_of(seen_inner, inner)
        off_own = ahead.values[:, :own] - mean[:own]
        off = ahead.values[:, own:] - mean[own:size] - off_own @ slope.T
        told = ahead.seen - off @ gain.T
        spread = seen_inner @ seen_inner.T + np.diag(noise**2)
        weights = np.full(len(told), 1.0 / len(told))
        self.kept = 1.0
        if not resting:
            weights, self.kept = tempered_weights(_log_likelihood(value - told, spread))
        marginal = weighted_moments(ahead.values[:, :own], weights)
        expected = weights @ told
        deviation = told - expected
        about = ahead.values[:, :own] - marginal[0]
        seen_slope = np.linalg.lstsq(
            np.sqrt(weights)[:, None] * about, np.sqrt(weights)[:, None] * deviation, rcond=None
        )[0].T
        rest = deviation - about @ seen_slope.T
        doubt = np.diag(noise**2) + (1.0 / self.kept - 1.0) * spread + (rest.T * weights) @ rest
        gain, inner = kalman_step(inner, seen_inner, doubt)
        middle = mean[own:size] + slope @ (marginal[0] - mean[:own]) + gain @ (value - expected)
        return joined(marginal, slope - gain @ seen_slope, (middle, inner))


def _log_likelihood(lack: Array, covariance: Array) -> Array:
    """Logarithms (C,) of the likelihood of deviations (C, m)."""
    white = solve_triangular(np.linalg.cholesky(covariance), lack.T, lower=True)
    return np.asarray(-0.5 * np.sum(white**2, axis=0))


def tempered_weights(log_likelihood: Array) -> tuple[Array, float]:
    """Weights (C,) ~ likelihood^b with the largest b <= 1 for which enough hypotheses count.

    They count as 1 / sum w^2. With b below 1 a part of the measurement is left out, which is
    honest: no hypothesis is near enough to say what all of it means.
    """
    raised = log_likelihood - log_likelihood.max()

    def weights(power: float) -> Array:
        w = np.exp(power * raised)
        return np.asarray(w / w.sum())

    wanted = _LEAST_COUNT * len(raised)
    full = weights(1.0)
    if 1.0 / np.sum(full**2) >= wanted:
        return full, 1.0
    low, high = -12.0, 0.0
    for _ in range(20):
        middle = 0.5 * (low + high)
        if 1.0 / np.sum(weights(float(np.exp(middle))) ** 2) >= wanted:
            low = middle
        else:
            high = middle
    return weights(float(np.exp(low))), float(np.exp(low))


def weighted_moments(points: Array, weights: Array) -> tuple[Array, Array]:
    """Mean (p,) and lower root (p, p) of the covariance of weighted points (C, p).

    They are those of the kernel mixture at a x_i + (1 - a) mean with covariance (1 - a^2) V, for
    any a: a^2 V + (1 - a^2) V = V. Paper B's Eq. 32 and 33 lack the outer product, and take the
    shrunken places for V, which lets the belief collapse.

    Source: Liu and West 2001, section 10.3.
    """
    mean = weights @ points
    return mean, root_of(np.sqrt(weights)[:, None] * (points - mean))


def kalman_step(inner: Array, seen: Array, noise: Array) -> tuple[Array, Array]:
    """Gain (n, m) and posterior root (n, n) of a motion given the parameters.

    [[N, H], [0, R]] Q = [[S, 0], [K S, R']]: triangular, so that nothing is ever subtracted.

    Args:
        inner: (n, n) root R.
        seen: (m, n) root H = dz/dpsi R of what is expected.
        noise: (m, m) covariance N N^T.
    """
    m, n = seen.shape
    rows = np.zeros((m + n, m + n))
    rows[:m, :m], rows[:m, m:], rows[m:, m:] = np.linalg.cholesky(noise), seen, inner
    lower = root_of(rows.T)
    return slope_of(lower[m:, :m], lower[:m, :m]), lower[m:, m:]
