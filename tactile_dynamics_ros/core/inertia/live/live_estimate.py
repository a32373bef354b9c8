"""What the live estimator publishes at every update."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum
from functools import cached_property

import numpy as np

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.inertia.batch.inertial_estimate import (
    PARAMETER_NAMES,
    InertialEstimate,
    describe_parameter,
)
from tactile_dynamics_ros.core.rigid_body.inertial_parameters import (
    com_inertia_jacobian,
    log_cholesky_jacobian,
)

_IDENTIFIED = 4.0
"""Prior over posterior variance above which a direction is identified: the standard deviation has
been halved, as `uncertainty._OPEN` asks of a recording. Lower, noise counts as an estimate sooner;
higher, the status says "unknown" for longer."""


MISFIT = 1.5
"""Error over the noise from which the model is said not to fit. Noise alone stays below 1.1 over 2
s; between 1.1 and 1.5 intervals that are widened by the scatter still hold. Lower warns of what
intervals cover, higher keeps quiet where they do not."""
GROSS = 20.0
"""Error over the noise from which nothing is published: effects of the catalogue raise it to 10 at
most in recordings with known truth, wrong units and broken sensors to hundreds. Below 10 effects
would silence the estimator instead of being named."""
FEW = 50
"""Samples before which a moderate error says nothing: ten parameters were just fitted to them. Half
a second at 100 Hz; more withhold warnings for longer. Fewer warn of misfit by chance."""
EXPLAINED = 0.5
"""Share of the squared wrenches below which a misfit leaves nothing of the model: with forces of
the wrong sign no mass explains any, beside the effects of the catalogue a body explains most. Near
1 any misfit would silence the estimator, near 0 a wrong sign would be published."""


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
class RecentFit:
    """How the model fits the last seconds, samples included that were left out as outliers.

    Attributes:
        rms: whitened RMS; 1 where only the stated noise remains.
        explained: share of the squared white wrenches that the model explains; negative where it
            is worse than no object at all.
        change: share by which the load of the newest samples differs; 0 if the estimate covers it.
    """

    rms: float = 1.0
    explained: float = 1.0
    change: float = 0.0

    @classmethod
    def of_rows(cls, residual: Array, wrench: Array) -> RecentFit:
        """Compare white residuals (6 N,) with the white wrenches (6 N,) that were measured."""
        left, whole = float(np.mean(residual**2)), float(np.mean(wrench**2))
        return cls(float(np.sqrt(left)), 1.0 - left / max(whole, 1.0))


@dataclass(frozen=True)
class LiveEstimate(InertialEstimate):
    """An `InertialEstimate` at one instant of a running estimation.

    Attributes:
        time: s, stamp of the newest sample used.
        information: (2, 10, 10) information of the data and of the prior on log-Cholesky
            coordinates.
        coordinates: (10,) the log-Cholesky coordinates.
        rejected: samples left out as outliers so far.
        latency: s of computing in this update.
        recent: how the model fits lately.
        shape: what the shape of the body adds, in words; "" without one.
        shape_doubtful: whether the data contradict it.
    """

    time: float
    information: Array
    coordinates: Array
    rejected: int
    latency: float
    recent: RecentFit
    shape: str = ""
    shape_doubtful: bool = False

    @cached_property
    def directions(self) -> tuple[Direction, ...]:
        """Ten directions of parameter space, best determined first."""
        by_xi = log_cholesky_jacobian(self.coordinates)
        mapped = com_inertia_jacobian(self.inertia.dynamic_parameters) @ by_xi
        return data_directions(mapped, *self.information)

    @property
    def adequate(self) -> bool:
        """Whether the model explains the measurements, all of them and the newest ones."""
        return max(self.recent.rms, self.error.whitened_rms) <= MISFIT

    @property
    def remarks(self) -> tuple[str, ...]:
        """One plain sentence per parameter that the motion so far does not determine."""
        return tuple(
            f"{describe_parameter(name)}: not excited by this motion" for name in self.not_excited
        )


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


class Level(Enum):
    """How much an estimate may be believed."""

    OK = "ok"
    WARN = "warn"
    ERROR = "error"


@dataclass(frozen=True)
class Verdict:
    """Level and sentence for people; whether value and interval may be published at all."""

    level: Level
    text: str

    @property
    def withheld(self) -> bool:
        """Whether nobody should use the estimate."""
        return self.level is Level.ERROR


def judge_estimate(estimate: LiveEstimate, obstacles: Sequence[str], check: str) -> Verdict:
    """Say how far an estimate can be trusted.

    Args:
        estimate: the newest.
        obstacles: what is wrong with the measurements now, so that it cannot be believed.
        check: what to call to learn why the model does not fit.
    """
    if obstacles:
        return Verdict(Level.ERROR, "; ".join(obstacles))
    error = max(estimate.recent.rms, estimate.error.whitened_rms)
    off = error > MISFIT
    gross = error > GROSS or (off and estimate.recent.explained < EXPLAINED)
    if gross or (off and estimate.samples >= FEW):
        text = f"the model does not fit: error {error:.3g} times the noise; call {check}"
        return Verdict(Level.ERROR if gross else Level.WARN, text)
    if change := estimate.recent.change:
        text = f"the newest samples need a load that differs by {100.0 * change:+.0f} %"
        return Verdict(Level.WARN, f"{text}: it has changed (then reset), or call {check}")
    directions = estimate.directions
    found = [direction for direction in directions if direction.identified]
    text = f"{len(found)} of {len(directions)} directions identified"
    if estimate.remarks:
        text = "; ".join(estimate.remarks)
    if estimate.shape:
        text = f"{text}; {estimate.shape}"
    good = len(found) == len(directions) and not estimate.shape_doubtful
    return Verdict(Level.OK if good else Level.WARN, text)
