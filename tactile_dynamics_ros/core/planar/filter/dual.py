"""The dual filter: parameters by weighted hypotheses, motion by a Kalman step given them."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.configuration import check_ranges, parameter
from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.planar.filter.belief import (
    LEARNINGS,
    Belief,
    Evidence,
    joined,
    kalman_step,
    root_of,
    unit_points,
)
from tactile_dynamics_ros.core.planar.filter.observation import Observation
from tactile_dynamics_ros.core.planar.filter.process import (
    LINK_PARAMETERS,
    Prediction,
    Process,
    PusherMotion,
)
from tactile_dynamics_ros.core.planar.properties.intervals import COARSE

_DISTANCE = 0.02
"""Distance over which friction stays alike, m, as in the fits to recordings. Half of it makes
products of long pushes look known better by a third."""
_MOST_SURPRISE = 9.0
"""Squared innovation per number, in units of its variance, above which a measurement counts as
uncertain by more: three standard deviations. At 4 one good sample in twenty is widened."""
_NOISE = (5e-5, 5e-5, 4e-4, 1e-3, 1e-3, 2e-2)
"""Standard deviation that a step of 10 ms adds to x, y, yaw and their rates: what the mechanics
miss of a link (m, rad, m/s, rad/s). At a tenth poses lag behind pushes whose contact point is off
by 0.3 mm; at ten times forces tell nothing, since each follows from a change of velocity."""
_SHAKEN, _RATES = 0.5, np.array([0.0, 0.0, 0.0, 1.0, 1.0, 30.0])
"""Share of the velocity by which a touched point may lag that all rates of the object may differ
by, and how much of it each gets (1/m for the yaw's rate, of an arm of 3 cm): impacts turn an object
as they push it. At 0 the filter explains turns of fast impacts by a slippery tip."""
FADING, _FADES = ("ln_tip_friction",), 0.5
"""Parameters that return to what is known beforehand, and within which time of touch, s: they
differ from touch to touch, and a wrong one makes every push slide."""
_RESTING = (2e-5, 2e-5, 2e-4)
"""Standard deviation that a step adds to the pose of an object that stands, m and rad: with poses
of 0.5 mm it is then known to 0.1 mm. A tenth would keep the error of the last push for seconds."""
_STANDING = (1e-3, 1e-3, 1e-2)
"""Standard deviation of the rates of an object that nothing touches and that has stopped, m/s and
rad/s; it is taken to stand still."""
_STARTS = 0.3
"""Change of the pusher's velocity from one coarse step to the next, over its speed, from which it
counts as started or stopped within the step. At 1 products of slow pushes on even tables are up to
a tenth too low."""


@dataclass(frozen=True)
class DualConfig:
    """How many hypotheses there are, and what tables are like."""

    hypotheses: int = parameter(50, "of parameters, weighted at each step; even", "", 20, 2000)
    motions: int = parameter(30, "of state and local friction at each step; even", "", 20, 2000)
    variation: float = parameter(
        0.08, "standard deviation of friction from place to place, over its mean", "", 0.0, 0.5
    )
    learning: str = parameter("trend", "of parameters: by trend, weights, or as printed (worse)")
    seed: int = parameter(0, "of the hypotheses", "", 0)

    def __post_init__(self) -> None:
        check_ranges(self)
        if self.learning not in LEARNINGS:
            known = ", ".join(LEARNINGS)
            raise BadInputError(f"DualConfig.learning = '{self.learning}': expected {known}")


@dataclass(frozen=True, eq=False)
class _Ahead:
    """What hypotheses are and expect at the end of a step, each row what moves (n) and is seen (m).

    Attributes:
        own: (C, p) parameters. acting: by what they act, as `Process.acting` has it.
        by_own: (C, n + m) of each, its motion at its likeliest.
        spread: (K, n + m) rows whose product is the covariance of the rest, given the parameters.
        said: states, and how far off the model says it is.
        seen: m.
    """

    own: Array
    acting: tuple[Array, tuple[int, ...]]
    by_own: Array
    spread: Array
    said: Prediction
    seen: int

    @property
    def told(self) -> Array:
        """(C, m) that is expected to be seen of each parameter."""
        return self.by_own[:, self.by_own.shape[1] - self.seen :]

    @property
    def expected(self) -> tuple[Array, Array]:
        """Mean (m,) and covariance (m, m) of what is seen, without noise of measurements."""
        told, spread = self.told, self.spread[:, self.spread.shape[1] - self.seen :]
        covariance = np.cov(told.T, bias=True).reshape(self.seen, self.seen)
        return told.mean(axis=0), np.asarray(covariance + spread.T @ spread)


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
        mean, covariance = self._prior = process.prior if prior is None else prior
        self._own = len(mean)
        self._moving = 6 * process.links
        reach = 2.0 * np.sqrt(np.diag(process.prior[1]))
        each = [[1.0, *reach[k + 2 : k + 4]] for k in range(0, 4 * process.links, 4)]
        self._local = self.config.variation * np.concatenate(each)
        state = np.zeros((process.links, 6))
        state[:, :3] = np.reshape(pose, (-1, 3))
        spread = np.tile(np.concatenate([pose_std, _STANDING]), process.links)
        roots = np.linalg.cholesky(covariance), np.diag(spread), np.diag(self._local)
        self.belief = Belief(
            np.concatenate([mean, state.ravel(), np.zeros(len(self._local))]),
            np.asarray(block_diag(*roots)),
            len(mean),
        )
        self._velocity = np.zeros(2)
        self.kept = 1.0
        """Share of the last measurement that was not left out."""
        n = self._moving + len(self._local)
        self._unit_own = unit_points(self.config.hypotheses, self._own, self._rng)
        self._unit_moving = unit_points(self.config.motions, n, self._rng)

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

    def inform(self, mean: Array, covariance: Array) -> None:
        """Replace what is believed of the first parameters (k,); the rest and the motion stay."""
        own, k, n = self._own, len(mean), len(self.belief.mean) - self._own
        marginal = self.belief.covariance[:own, :own]
        marginal[:k], marginal[:, :k] = 0.0, 0.0
        marginal[:k, :k] = covariance
        middle = self.belief.mean[:own].copy()
        middle[:k] = mean
        moving = np.asarray(np.linalg.cholesky(self.belief.covariance[own:, own:]), dtype=float)
        known = np.asarray(np.linalg.cholesky(marginal), dtype=float)
        rest = self.belief.mean[own:], moving
        self.belief = joined((middle, known), np.zeros((n, own)), rest)

    def expected(self, motion: PusherMotion, seen: Observation) -> tuple[Array, Array]:
        """Mean (m,) and covariance (m, m) of what a step will show, without its own noise."""
        return self._ahead(motion, seen).expected

    def step(self, motion: PusherMotion | None, seen: Observation) -> None:
        """Advance by a step and learn from what was seen.

        Args:
            motion: of the pusher; None while nothing is touched and the object has stopped.
            seen: during the step.
        """
        coarse = motion is not None and motion.step > COARSE
        if not self._steady(motion, coarse, float(np.linalg.norm(seen.slack))):
            seen = replace(seen, wrench=None)
        ahead = self._ahead(motion, seen)
        noise = self._believed_noise(seen, ahead)
        self.belief = self._updated(ahead, seen.value, noise, motion is None, coarse)

    def _steady(self, motion: PusherMotion | None, coarse: bool, slack: float) -> bool:
        """Whether the mean force of a step follows from the mean motion of the pusher.

        A tip that stands, or that moves by no more than it may give way, holds the object with any
        force up to friction; in a coarse step that begins or ends a motion it does so for an
        unknown part of the step.
        """
        velocity = np.zeros(2)
        if motion is not None:
            velocity = (motion.after - motion.before)[:2] / motion.step
        change, self._velocity = np.linalg.norm(velocity - self._velocity), velocity
        speed = np.linalg.norm(velocity)
        if motion is None or (motion.grip and motion.after[2] != motion.before[2]):
            return True
        starts = coarse and change > _STARTS * speed
        return bool(speed > _STANDING[0] + slack and not starts)

    def _ahead(self, motion: PusherMotion | None, seen: Observation) -> _Ahead:
        """Parameters with their likeliest motion, and motions with the mean parameters, moved on.

        So neither blurs what the other is told: a heavy hypothesis is not judged by the velocity
        that was drawn with it. What is expected is that of the mean parameters: forces grow with
        the exponential of a parameter, and their mean would be that of heavier objects.
        """
        own = self._own
        values, split = self._hypotheses()
        if motion is not None:
            self._fade(values[1 : split[1]], motion.step)
        states, memory = self._moved(values, motion, split)
        local = memory * values[:, own + self._moving :]
        both = np.concatenate([states.states, local, seen.expected(states)], axis=1)
        _, by_own, moved = np.split(both, split)
        average = moved.mean(axis=0)
        rows = (moved - average) / np.sqrt(len(moved))
        here = values[1 : split[1], :own]
        return _Ahead(
            here,
            self.process.acting(values[1 : split[1], own : own + self._moving], here),
            by_own + average - by_own.mean(axis=0),
            np.concatenate([rows, self._noise_rows(motion, seen, memory, states)]),
            states,
            len(seen.value),
        )

    def _hypotheses(self) -> tuple[Array, NDArray[np.intp]]:
        """The mean, then hypotheses of parameters and of motions; where each part begins."""
        own, mean, root = self._own, self.belief.mean, self.belief.root
        parts = [
            (unit @ self._turn(unit.shape[1])) @ block.T
            for unit, block in (
                (self._unit_own, root[:, :own]),
                (self._unit_moving, root[:, own:]),
            )
        ]
        values = mean + np.concatenate([np.zeros((1, len(mean))), *parts])
        return values, np.cumsum([1, len(parts[0])])

    def _turn(self, size: int) -> Array:
        """Random rotation, so that no direction is always between the hypotheses."""
        return np.asarray(np.linalg.qr(self._rng.standard_normal((size, size)))[0])

    def _fade(self, values: Array, step: float) -> None:
        """Let parameters of single touches return to what is known beforehand, with its spread."""
        mean, covariance = self._prior
        keep = float(np.exp(-step / _FADES))
        for name in FADING:
            if name in self.process.names:
                k = self.process.names.index(name)
                here, middle = values[:, k], values[:, k].mean()
                variance = float(np.var(here))
                grown = keep**2 * variance + (1.0 - keep**2) * covariance[k, k]
                back = mean[k] + keep * (middle - mean[k])
                values[:, k] = back + (here - middle) * np.sqrt(grown / max(variance, 1e-12))

    def _moved(
        self, values: Array, motion: PusherMotion | None, split: NDArray[np.intp]
    ) -> tuple[Prediction, float]:
        """States at the end of the step, and how much of the local friction is the same there."""
        states = values[:, self._own : self._own + self._moving].copy()
        if motion is None:
            states.reshape(len(states), -1, 6)[:, :, 3:] = 0.0
            return Prediction(states, np.zeros((len(states), 3))), 1.0
        speed = float(np.linalg.norm(states[0, 3:5]))
        memory = float(np.exp(-speed * motion.step / _DISTANCE))
        return self._predict(states, self._here(values), motion, split), memory

    def _noise_rows(
        self, motion: PusherMotion | None, seen: Observation, memory: float, ahead: Prediction
    ) -> Array:
        """Rows (q, n + m) of independent noise that a step adds."""
        if motion is None:
            noise = np.tile([*_RESTING, *_STANDING], self.process.links)
        else:
            shaken = _SHAKEN * float(np.linalg.norm(seen.slack)) * _RATES
            noise = np.hypot(np.array(_NOISE) * np.sqrt(motion.step / 0.01), shaken)
            noise = np.hypot(np.tile(noise, self.process.links), ahead.state_std)
        fresh = self._local * np.sqrt(1.0 - memory**2)
        n = self._moving + len(fresh)
        by_state = seen.by_state(self._moving)
        rows = np.zeros((n, n + len(by_state)))
        rows[:, :n] = np.diag(np.concatenate([noise, fresh]))
        rows[: self._moving, n:] = noise[:, None] * by_state.T
        if motion is None or not seen.slack.any():
            return rows
        return np.concatenate([rows, self._given_way(motion, seen, by_state)])

    def _given_way(self, motion: PusherMotion, seen: Observation, by_state: Array) -> Array:
        """Row (1, n + m) of what a lag of the touched point behind the pusher changes."""
        first, slack = 6 * motion.link, seen.slack
        state = np.zeros(self._moving)
        state[first : first + 2], state[first + 3 : first + 5] = -slack * motion.step, -slack
        measured = by_state @ state
        if seen.wrench is not None:
            mass = np.exp(self.belief.mean[len(LINK_PARAMETERS) * motion.link + 1])
            start = len(measured) - len(seen.wrench.value)
            measured[start : start + 2] -= mass * slack / motion.step
        local = np.zeros(len(self._local))
        return np.concatenate([state, local, measured])[None]

    def _predict(
        self, states: Array, here: Array, motion: PusherMotion, split: NDArray[np.intp]
    ) -> Prediction:
        """Predict all hypotheses; impossible ones are kept, and follow the others' linear trend.

        Clipping them to what is possible would shrink the belief; dropping them too.

        Source: paper B, III-F1.
        """
        possible = self.process.feasible(here)
        if possible.all():
            return self.process.predict(states, here, motion)
        possible[0] = True
        found = self.process.predict(states[possible], here[possible], motion)
        both = np.zeros((len(states), self._moving + 3))
        both[possible] = np.concatenate([found.states, found.wrench], axis=1)
        columns = np.column_stack([np.ones(len(states)), here, states])
        for part in np.split(np.arange(len(states)), split)[1:]:
            known, lacking = part[possible[part]], part[~possible[part]]
            trend = np.linalg.lstsq(columns[known], both[known], rcond=None)[0]
            both[lacking] = columns[lacking] @ trend
        states, wrench = both[:, : self._moving], both[:, self._moving :]
        return replace(found, states=states, wrench=wrench)

    def _here(self, values: Array) -> Array:
        """Parameters (C, p) with what friction is at this place."""
        here = values[:, : self._own].copy()
        local = values[:, self._own + self._moving :]
        for link in range(self.process.links):
            first = len(LINK_PARAMETERS) * link
            here[:, [first, first + 2, first + 3]] += local[:, 3 * link : 3 * link + 3]
        return here

    def _believed_noise(self, seen: Observation, ahead: _Ahead) -> Array:
        """Standard deviations (m,) of the noise, larger where a measurement is a surprise."""
        std, (told, covariance) = seen.noise(ahead.said.force_std), ahead.expected
        lack = seen.value - told
        for group in seen.groups:
            spread = covariance[group, group] + np.diag(std[group] ** 2)
            surprise = float(lack[group] @ np.linalg.solve(spread, lack[group]))
            excess = surprise / (_MOST_SURPRISE * len(lack[group]))
            if excess > 1.0:
                std[group] = np.sqrt(std[group] ** 2 + np.diag(spread) * (excess - 1.0))
        return std

    def _updated(
        self, ahead: _Ahead, value: Array, noise: Array, resting: bool, coarse: bool
    ) -> Belief:
        """Parameter step, then the motion's step given the parameters, then both joined."""
        n, own = self._moving + len(self._local), ahead.own
        certain = np.diag(noise**2)
        spread = certain + ahead.spread[:, n:].T @ ahead.spread[:, n:]
        mean, middle = own.mean(axis=0), ahead.by_own.mean(axis=0)
        away, deviation = (own - mean) / np.sqrt(len(own)), ahead.by_own - middle
        slope = np.linalg.lstsq(away, deviation / np.sqrt(len(own)), rcond=None)[0].T
        rest = deviation / np.sqrt(len(own)) - away @ slope.T
        marginal, self.kept = (mean, root_of(away)), 1.0
        if not resting and len(value):
            acting, inertial = ahead.acting
            blind = list(inertial) if coarse else []
            evidence = Evidence(own, acting, ahead.told, value, spread, blind, ahead.said.lasting)
            marginal, self.kept = LEARNINGS[self.config.learning](evidence)
        middle = middle + slope @ (marginal[0] - mean)
        lower = root_of(np.concatenate([ahead.spread, rest]))
        doubt = certain + lower[n:, n:] @ lower[n:, n:].T
        doubt += (1.0 / self.kept - 1.0) * spread
        if len(value) == 0:
            return joined(marginal, slope, (middle, lower))
        gain, inner = kalman_step(lower[:n, :n], lower[n:, :n], doubt)
        corrected = middle[:n] + gain @ (value - middle[n:])
        return self._rebuilt(marginal, slope[:n] - gain @ slope[n:], (corrected, inner))

    def _rebuilt(
        self, marginal: tuple[Array, Array], slope: Array, conditional: tuple[Array, Array]
    ) -> Belief:
        """The joint of parameters and motion, as `joined` has it."""
        return joined(marginal, slope, conditional)
