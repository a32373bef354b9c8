"""Search for the motion that a criterion likes best within the limits."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.configuration import check_ranges, parameter
from tactile_dynamics_ros.core.errors import BadInputError, NotIdentifiableError
from tactile_dynamics_ros.core.inertia.excitation.criterion import Criterion
from tactile_dynamics_ros.core.inertia.excitation.grip import Grip
from tactile_dynamics_ros.core.inertia.excitation.limits import (
    ArmLimits,
    MotionLimits,
    fit_to_limits,
    usage_at_rest,
)
from tactile_dynamics_ros.core.inertia.excitation.trajectory import (
    CHANNELS,
    FourierOffsets,
    HeldPose,
)

Array = NDArray[np.float64]


@dataclass(frozen=True)
class DesignConfig:
    """Family of motions and effort of the search."""

    duration: float = parameter(15.0, "length of the motion", "s", 1.0, 600.0)
    lowest_hz: float = parameter(0.15, "lowest frequency", "Hz", 0.01, 5.0)
    highest_hz: float = parameter(1.5, "highest frequency", "Hz", 0.02, 5.0)
    sines: int = parameter(5, "frequencies per axis", "", 1, 20)
    ramp: float = parameter(1.0, "time to fade in and out", "s", 0.05, 30.0)
    evaluations: int = parameter(240, "candidate motions tried", "", 8, 100000)
    grid_rate_hz: float = parameter(20.0, "rate at which candidates are evaluated", "Hz", 2.0)
    seed: int = parameter(0, "seed of the search", "", 0, 2**31 - 1)

    def __post_init__(self) -> None:
        """Check ranges and the order of the frequencies."""
        check_ranges(self)
        if self.lowest_hz >= self.highest_hz:
            raise BadInputError(
                f"DesignConfig.lowest_hz = {self.lowest_hz} Hz: expected below "
                f"highest_hz = {self.highest_hz} Hz"
            )


@dataclass(frozen=True)
class DesignedMotion:
    """A motion within the limits, and what it is expected to bring.

    Attributes:
        offsets: the motion.
        value: value of the criterion.
        reference: value of the criterion for the first, random motion of the same family.
        grip_usage: largest share of the friction cones that it needs.
    """

    offsets: FourierOffsets
    value: float
    reference: float
    grip_usage: float


def design_motion(
    criterion: Criterion,
    start: HeldPose,
    grip: Grip,
    phi: Array,
    limits: MotionLimits | None = None,
    arm: ArmLimits | None = None,
    config: DesignConfig | None = None,
) -> DesignedMotion:
    """Minimise a criterion over sums of sines by a self-adapting evolution strategy.

    Every candidate is first scaled into the limits, so that the answer always respects them.

    Args:
        criterion: function of the samples of a candidate; smaller is better.
        start: pose of the held object.
        grip: grip of the hand.
        phi: (10,) dynamic parameters presumed, for the loads.
        limits: amplitudes and margins.
        arm: joint limits; None if the arm does not limit.
        config: family and effort.

    Raises:
        NotIdentifiableError: the grip would slip even at rest.

    Source: Schwefel 1995 (log-normal step sizes); Swevers et al. 1997 on Fourier excitation.
    """
    config, limits = config or DesignConfig(), limits or MotionLimits()
    resting = usage_at_rest(start, grip, phi)
    if resting > 1.0:
        raise NotIdentifiableError(
            f"excitation: holding still takes {resting:.0%} of the friction cones, so that no "
            "motion is safe: squeeze harder or state more friction"
        )
    rng = np.random.default_rng(config.seed)
    time = np.arange(0.0, config.duration, 1.0 / config.grid_rate_hz)
    family = _family(config)
    scale = np.repeat(limits.amplitude / config.sines, config.sines)
    scale = np.tile(scale, 2)

    def judge(genes: Array) -> tuple[float, FourierOffsets]:
        motion = family.with_coefficients(genes * scale)
        fitted = fit_to_limits(motion, start, grip, phi, limits, arm, time)
        return criterion(grip.load(start.follow(fitted, time), phi)), fitted

    best = rng.normal(size=2 * CHANNELS * config.sines) * 3.0
    value, motion = judge(best)
    reference, step = value, 1.0
    for _ in range(config.evaluations - 1):
        trial_step = step * np.exp(0.3 * rng.normal())
        mask = rng.random(len(best)) < 0.3
        trial = best + trial_step * mask * rng.normal(size=len(best))
        found, candidate = judge(trial)
        if found < value:
            best, value, motion, step = trial, found, candidate, trial_step * 1.2
        else:
            step = max(step * 0.985, 0.02)
    usage = grip.usage(grip.load(start.follow(motion, time), phi))
    return DesignedMotion(motion, value, reference, usage)


def _family(config: DesignConfig) -> FourierOffsets:
    frequency = np.geomspace(config.lowest_hz, config.highest_hz, config.sines)
    empty = np.zeros((CHANNELS, config.sines))
    return FourierOffsets(config.duration, frequency, empty, empty, config.ramp)
