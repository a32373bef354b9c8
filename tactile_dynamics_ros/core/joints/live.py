"""Torques of the world on an arm, while it moves: measured against what its model predicts."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.configuration import check_ranges, parameter
from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.joints.arm import Arm
from tactile_dynamics_ros.core.joints.known import KnownArm
from tactile_dynamics_ros.core.joints.samples import JointSamples
from tactile_dynamics_ros.core.joints.situation import Situation

WITH_HISTORY = ("backlash", "friction_warming", "torque_delay", "torque_drift")
"""Effects that depend on what happened before the last tenth of a second: a live model leaves them
out and says so."""
_WEAK = 0.003
"""Smallest singular value of the flange's Jacobian, m (or without a unit for turns), from which a
wrench is told: below, the arm is next to a singular pose, where a newton changes no torque by more
than 3 mN m. Above, the standard deviations of the wrench say which directions are weak."""
_STUCK = 0.5
"""Share of a block without motion from which a joint stands: friction may then be anything up to
its Coulomb friction, in either direction."""


@dataclass(frozen=True)
class MonitorConfig:
    """How torques are averaged, and what counts as touched."""

    block: float = parameter(
        0.04, "time over which torques are averaged; answers are one and a half of it late", "s",
        0.004, 0.5,
    )  # fmt: skip
    significance: float = parameter(
        4.0, "standard deviations of a joint's torque from which something touches the arm", "",
        2.0, 20.0,
    )  # fmt: skip

    def __post_init__(self) -> None:
        """Check the ranges."""
        check_ranges(self)


@dataclass(frozen=True, eq=False)
class ExternalTorque:
    """What the world applies on an arm at one time.

    Attributes:
        time: s, middle of the block.
        predicted: (n,) torques of the drives by the model, N m.
        external: (n,) torques of the world on the joints, N m: predicted minus measured.
        std: (n,) their standard deviations.
        wrench: (6,) [torque, force] on the flange in its axes that explains them best.
        wrench_std: (6,).
        doubt: why wrench and torques are not to be believed; empty if they are.
    """

    time: float
    predicted: Array
    external: Array
    std: Array
    wrench: Array
    wrench_std: Array
    doubt: str

    def touched(self, significance: float) -> tuple[int, ...]:
        """Joints whose torque is beyond what noise and friction make."""
        return tuple(np.flatnonzero(np.abs(self.external) > significance * self.std).tolist())


class JointMonitor:
    """Compares measured joint torques with a fitted model, block by block.

    Attributes:
        arm: whose torques come.
        known: its model.
    """

    def __init__(self, arm: Arm, known: KnownArm, config: MonitorConfig | None = None) -> None:
        """Begin without measurements.

        Args:
            arm: by its URDF.
            known: fitted, of `estimate --save`.
            config: of averaging.

        Raises:
            BadInputError: the model is of other joints.
        """
        if arm.names != known.joints:
            raise BadInputError(
                f"model of joints {', '.join(known.joints)}; the URDF has {', '.join(arm.names)}"
            )
        self.arm, self.known, self.config = arm, known, config or MonitorConfig()
        self._window: deque[tuple[float, Array, Array]] = deque(maxlen=4000)

    @cached_property
    def left_out(self) -> tuple[str, ...]:
        """Effects of the model that are not predicted live."""
        return tuple(e.name for e, _ in self.known.effects if e.name in WITH_HISTORY)

    def add(self, time: float, position: Array, effort: Array) -> None:
        """Take one measurement; what is older than needed is forgotten, as is all before a gap."""
        if self._window and not 0.0 < time - self._window[-1][0] < self.config.block:
            self._window.clear()
        self._window.append((time, position, effort))
        while self._window[-1][0] - self._window[0][0] > 3.5 * self.config.block:
            self._window.popleft()

    def latest(self) -> ExternalTorque | None:
        """What the world applied in the newest block with neighbours; None without enough yet."""
        if len(self._window) < 12:
            return None
        time, position, effort = (np.array(part) for part in zip(*self._window, strict=True))
        period = float(np.median(np.diff(time)))
        count = max(4, round(self.config.block / period))
        if len(time) < 3 * count:
            return None
        start = np.array([len(time) - 2 * count])
        signals = (time, position, effort)
        samples = JointSamples.of_blocks(self.arm, signals, start, count, period)
        return self._told(samples, float(time[0] + samples.time[0]))

    def _told(self, samples: JointSamples, time: float) -> ExternalTorque:
        known = self.known
        situation = Situation(samples, known.bodies, known.payload, known.friction)
        predicted = situation.total
        for effect, theta in known.effects:
            if effect.name not in WITH_HISTORY:
                predicted = predicted + effect.torque(situation, theta)
        external = (predicted - samples.effort)[0]
        standing = samples.turning[0] > _STUCK
        std = np.hypot(known.std, standing * known.friction[0])
        wrench, wrench_std, weakest = _at_flange(samples, external, std)
        doubts = []
        if weakest < _WEAK:
            doubts.append("the arm is next to a singular pose: no wrench is told")
        if standing.any():
            names = [n for n, s in zip(self.arm.names, standing, strict=True) if s]
            doubts.append(f"{', '.join(names)} stand still, held by friction")
        return ExternalTorque(
            time, predicted[0], external, std, wrench, wrench_std, "; ".join(doubts)
        )


def _at_flange(samples: JointSamples, external: Array, std: Array) -> tuple[Array, Array, float]:
    """Wrench on the flange with J^T w = tau in the sense of least squares, its std, and how well.

    Returns:
        (6,), (6,) and the smallest singular value of the flange's Jacobian.
    """
    jacobian = samples.arm.flange_jacobian(samples.motions[1])[0]
    weighed = (jacobian / std).T
    covariance = np.linalg.pinv(weighed.T @ weighed)
    wrench = covariance @ weighed.T @ (external / std)
    spread = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    values = np.linalg.svd(jacobian, compute_uv=False)
    return wrench, spread, float(values[-1]) if len(values) == 6 else 0.0
