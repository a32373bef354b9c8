"""Search for the motion that tells most within the limits."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.configuration import check_ranges, parameter
from tactile_dynamics_ros.core.contact.wrench_samples import WrenchSamples
from tactile_dynamics_ros.core.errors import BadInputError, NotIdentifiableError
from tactile_dynamics_ros.core.inertia.excitation.limits import (
    ArmLimits,
    Grip,
    MotionLimits,
    fit_to_limits,
    usage_at_rest,
)
from tactile_dynamics_ros.core.inertia.excitation.trajectory import (
    CHANNELS,
    FourierOffsets,
    HeldPose,
)
from tactile_dynamics_ros.core.rigid_body.inertial_parameters import pseudo_inertia
from tactile_dynamics_ros.core.rigid_body.newton_euler import regressor
from tactile_dynamics_ros.core.rigid_body.rotation import skew

Criterion = Callable[[WrenchSamples], float]
"""Smaller is better; any function of the samples of a candidate motion can be minimised."""


def wrench_covariance(samples: WrenchSamples, force_std: float) -> Array:
    """Covariance (N, 6, 6) of the net wrench from independent force noise at every contact."""
    shape = (*samples.contact_point.shape, 3)
    unit = np.broadcast_to(np.eye(3), shape)
    maps = np.concatenate([skew(samples.contact_point), unit], axis=2)
    maps = maps * samples.in_contact[..., None, None]
    covariance = force_std**2 * np.einsum("ncij,nckj->nik", maps, maps, optimize=True)
    return np.asarray(covariance + 1e-12 * np.eye(6))


def wrench_information(
    samples: WrenchSamples, force_std: float, columns: Array | None = None
) -> Array:
    """Fisher information of the samples with exact motion and white force noise.

    Args:
        samples: samples of a motion.
        force_std: N per axis and contact.
        columns: (N, 6, n) derivatives of the wrench; the Newton-Euler regressor by default.

    Returns:
        (n, n).
    """
    if columns is None:
        columns = regressor(
            samples.specific_acceleration, samples.angular_velocity, samples.angular_acceleration
        )
    factor = np.linalg.cholesky(wrench_covariance(samples, force_std))
    white = np.linalg.solve(factor, columns).reshape(-1, columns.shape[2])
    return np.asarray(white.T @ white)


@dataclass(frozen=True)
class InertiaCriterion:
    """Expected uncertainty of the inertia after a motion, given what is known before it.

    "A": expected squared affine-invariant distance to the truth, tr(G Cov) with the metric
    G_jk = tr(P^-1 B_j P^-1 B_k); "D": log det of the covariance in the same metric. Neither
    depends on the units or the frame.

    Attributes:
        phi: (10,) present estimate.
        known: (10, 10) its information, on phi.
        force_std: N per axis and contact.
        rate_ratio: samples taken per sample of the candidate (a coarse grid stands for more).
        kind: "A" or "D".
    """

    phi: Array
    known: Array
    force_std: float = 0.03
    rate_ratio: float = 1.0
    kind: Literal["A", "D"] = "A"

    def __call__(self, samples: WrenchSamples) -> float:
        """Evaluate the criterion; smaller is better."""
        information = self.known + self.rate_ratio * wrench_information(samples, self.force_std)
        factor = np.linalg.cholesky(self.metric)
        half = np.linalg.solve(factor, information)
        scaled = np.linalg.solve(factor, half.T)
        values = np.maximum(np.linalg.eigvalsh(scaled), 1e-12)
        return float(np.sum(1.0 / values) if self.kind == "A" else -np.sum(np.log(values)))

    @property
    def metric(self) -> Array:
        """G (10, 10), the affine-invariant metric on phi at the present estimate."""
        basis = pseudo_inertia(np.eye(10))
        relative = np.linalg.solve(pseudo_inertia(self.phi), basis)
        return np.asarray(np.einsum("aij,bji->ab", relative, relative))


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

    Source: Swevers et al. 1997 on Fourier excitation.
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

    value, motion, reference = search_motion(
        judge, 2 * CHANNELS * config.sines, config.evaluations, rng
    )
    usage = grip.usage(grip.load(start.follow(motion, time), phi))
    return DesignedMotion(motion, value, reference, usage)


def search_motion(
    judge: Callable[[Array], tuple[float, FourierOffsets]],
    size: int,
    evaluations: int,
    rng: np.random.Generator,
) -> tuple[float, FourierOffsets, float]:
    """Minimise over the amplitudes of a motion by a self-adapting evolution strategy.

    Args:
        judge: gives value and allowed motion for amplitudes (size,) of about unit size.
        size: number of amplitudes.
        evaluations: candidates tried.
        rng: of the draws.

    Returns:
        Value and motion of the best, and the value of the first, a random one.

    Source: Schwefel 1995 (log-normal step sizes).
    """
    best = rng.normal(size=size) * 3.0
    value, motion = judge(best)
    reference, step = value, 1.0
    for _ in range(evaluations - 1):
        trial_step = step * np.exp(0.3 * rng.normal())
        mask = rng.random(size) < 0.3
        trial = best + trial_step * mask * rng.normal(size=size)
        found, candidate = judge(trial)
        if found < value:
            best, value, motion, step = trial, found, candidate, trial_step * 1.2
        else:
            step = max(step * 0.985, 0.02)
    return value, motion, reference


def _family(config: DesignConfig) -> FourierOffsets:
    frequency = np.geomspace(config.lowest_hz, config.highest_hz, config.sines)
    empty = np.zeros((CHANNELS, config.sines))
    return FourierOffsets(config.duration, frequency, empty, empty, config.ramp)
