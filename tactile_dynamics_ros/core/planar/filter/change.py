"""Whether an object slides unlike what is known of it: forces against those that are expected."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np
from scipy.stats import chi2

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.configuration import check_ranges, parameter
from tactile_dynamics_ros.core.planar.filter.observation import MeasuredWrench, SeenPose
from tactile_dynamics_ros.core.planar.filter.patch import PatchProcess
from tactile_dynamics_ros.core.planar.filter.pieces import Piece, PieceMeter
from tactile_dynamics_ros.core.planar.filter.process import PusherMotion

_CALM = 0.3
"""Share of the threshold below which a reference may be renewed: a change shows more by its first
push; without it, fits that contain a change would become what is known."""
_AS_LIKELY = 4.0
"""Fall of the statistic, a chi-square, up to which a later beginning of the change is as likely as
the likeliest: two standard deviations. At 0 two of forty drawn changes have a clean push in them,
and one of three simulated leans came out a third of what it was; larger loses changed pushes."""
_EARLIER = 0.2
"""Time before a touch, s, from which a push counts as whole: fits look at 0.15 s before a touch."""
_ACROSS = 0.05
"""Standard deviation of a piece's force across its direction over the force, which friction that
differs along a face causes beside its turning. From clean simulated pushes, not from theory."""
_FLOOR = 0.02
"""Standard deviation of a piece's mean force, N: offsets of sensors, which do not average out."""


@dataclass(frozen=True)
class ChangeConfig:
    """How a change is distinguished from friction that differs from place to place."""

    piece: float = parameter(0.02, "of a way over which friction is alike", "m", 1e-3, 0.5)
    pieces: int = parameter(12, "of the latest pushes that are looked at", "", 2, 100)
    variation: float = parameter(
        0.1, "standard deviation of friction from piece to piece, over its mean", "", 0.0, 0.5
    )
    inflation: float = parameter(
        1.0, "of the statistic, by which clean pushes exceed the chi-square", "", 0.1, 100.0
    )
    false_alarms_per_hour: float = parameter(1.0, "stated, of touch", "1/h", 1e-6, 1e3)

    def __post_init__(self) -> None:
        check_ranges(self)


@dataclass(frozen=True, eq=False)
class Change:
    """What the latest pieces say.

    Attributes:
        statistic: chi-square of three numbers under no change, over the inflation.
        threshold: above which a change is reported.
        since: s, just before what must have changed: the latest beginning that is likely.
        force: (2,) N that seems to act on the object beside friction, axes of S.
        friction: factor on friction less 1 that seems to have come.
        touch: s of touch since the reference was taken.
    """

    statistic: float
    threshold: float
    since: float
    force: Array
    friction: float
    touch: float

    @property
    def alarmed(self) -> bool:
        """Whether it is beyond chance."""
        return self.statistic > self.threshold

    @property
    def text(self) -> str:
        """One sentence."""
        return (
            f"from {self.since:.1f} s on it slides unlike before (statistic {self.statistic:.0f}, "
            f"chance stays below {self.threshold:.0f}): what was known does not hold; ask "
            "/model_check/diagnose after pushes in other directions, or explore anew"
        )


class ChangeMonitor:
    """Holds forces against those that a reference expects.

    Along each piece of a way it takes the mean of measured less expected force, e = J d + B b +
    noise: d is what is not known of the reference, b a force that stays and a factor on friction.
    The statistic is the largest over the latest k pieces of the score test of b = 0, with the
    covariance J P J' + R. Each piece differs by its own friction, so that many steps of one place
    count once.

    Args:
        process: the model.
        config: of the statistic.

    Attributes:
        change: what the latest pieces say; None before there is any. alarm: the first beyond
            chance, kept until `restart`. touch: s of touch since the reference.
    """

    def __init__(self, process: PatchProcess, config: ChangeConfig | None = None) -> None:
        self.process, self.config = process, config or ChangeConfig()
        self._meter: PieceMeter | None = None
        self.restart()

    def restart(self) -> None:
        """Forget pieces and alarm; the reference stays."""
        self.pieces: deque[Piece] = deque(maxlen=self.config.pieces)
        self.change: Change | None = None
        self.alarm: Change | None = None
        self.touch = 0.0

    def dismiss(self) -> None:
        """Have no reference any more: what was known does not hold."""
        self._meter = None
        self.restart()

    def refer(self, mean: Array, covariance: Array) -> None:
        """Hold what comes against the numbers of a link (4,), with their covariance (4, 4)."""
        self._meter = PieceMeter(self.process, self.config.piece, mean, covariance)
        self.restart()

    @property
    def watches(self) -> bool:
        """Whether there is a reference."""
        return self._meter is not None

    @property
    def calm(self) -> bool:
        """Whether the latest pieces are what chance makes of the reference, four times in five."""
        return self.change is None or self.change.statistic < _CALM * self.change.threshold

    def see(
        self,
        time: float,
        state: tuple[Array, Array],
        motion: PusherMotion,
        measured: MeasuredWrench | None,
        poses: tuple[SeenPose, ...] = (),
    ) -> None:
        """Take a step in which something is touched; arguments as of `PieceMeter.see`."""
        if self._meter is not None:
            self.touch += motion.step
            self._take(self._meter.see(time, state, motion, measured, poses))

    def release(self, time: float) -> None:
        """Note that nothing is touched any more."""
        if self._meter is not None:
            self._take(self._meter.release(time))

    def _take(self, piece: Piece | None) -> None:
        """Judge anew where a piece has ended."""
        if piece is None:
            return
        self.pieces.append(piece)
        self.change = self._judge()
        if self.alarm is None and self.change.alarmed:
            self.alarm = self.change

    def _judge(self) -> Change:
        rows = list(self.pieces)
        found = [self._scored(rows[-k:]) for k in range(1, len(rows) + 1)]
        statistics = np.array([statistic for statistic, _ in found]) / self.config.inflation
        statistic, told = statistics.max(), found[int(np.argmax(statistics))][1]
        latest = int(np.argmax(statistics > statistic - _AS_LIKELY))
        return Change(
            float(statistic),
            self.threshold,
            rows[-1 - latest].start - _EARLIER,
            -told[:2],
            float(told[2]),
            self.touch,
        )

    @property
    def threshold(self) -> float:
        """Of the statistic, for the stated rate of false alarms; a piece takes a fifth of a second.

        The latest k pieces are strongly dependent; each piece counts as one trial.
        """
        trials = 3600.0 / 0.2
        return float(chi2.isf(self.config.false_alarms_per_hour / trials, 3))

    def _scored(self, rows: list[Piece]) -> tuple[float, Array]:
        """Score statistic and the three numbers (3,) that explain pieces best."""
        lack = np.concatenate([row.lack for row in rows])
        slopes = np.concatenate([row.slopes for row in rows])
        spread = slopes @ slopes.T
        for k, row in enumerate(rows):
            spread[2 * k : 2 * k + 2, 2 * k : 2 * k + 2] += self._noise(row)
        away = np.concatenate([np.column_stack([np.eye(2), row.expected]) for row in rows])
        root = np.linalg.cholesky(spread)
        white, columns = np.linalg.solve(root, lack), np.linalg.solve(root, away)
        told = np.linalg.lstsq(columns, white, rcond=1e-6)[0]
        return float(np.sum(np.square(columns @ told))), told

    def _noise(self, row: Piece) -> Array:
        """Covariance (2, 2) of a piece's mean force, N^2.

        Friction that differs acts with all of the object's friction even where a push turns it.
        """
        assert self._meter is not None
        way = row.expected / max(float(np.linalg.norm(row.expected)), 1e-9)
        along = (self.config.variation * self._meter.friction) ** 2 * np.outer(way, way)
        across = ((_ACROSS * self._meter.friction) ** 2 + _FLOOR**2) * np.eye(2)
        return np.asarray(along + across + row.rest)
