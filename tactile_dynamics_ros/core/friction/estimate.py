"""Friction coefficients of a region from slips in several directions, with intervals."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.special import stdtrit

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.configuration import check_ranges, parameter
from tactile_dynamics_ros.core.errors import NotIdentifiableError


@dataclass(frozen=True)
class SlipEvent:
    """One slip: the forces just before it, and while it went on.

    Attributes:
        time: onset, s. region: of the surface.
        angle: direction of the tangential force in the plane of contact, rad.
        normal, tangential: N just before the slip.
        std: standard deviation of their ratio, from the scatter of the forces alone.
        kinetic: ratio while sliding, or nan. speed: of the sliding, m/s.
        variant: "unload" (normal force ramped down) or "drag" (tangential force ramped up).
        tilt: slope of the path of the sliding fingertip against the mesh, rad, or nan.
        delay: between onset and detection, s.
        sliding_normal: normal force while sliding, N.
        give: how far the surface went with the fingertip per newton, m/N, or nan.
        memory_normal, memory_tangential: past forces, averaged with 2 s, N.
    """

    time: float
    region: str
    angle: float
    normal: float
    tangential: float
    std: float
    kinetic: float = float("nan")
    speed: float = 0.0
    variant: str = "unload"
    tilt: float = float("nan")
    delay: float = 0.0
    sliding_normal: float = float("nan")
    give: float = float("nan")
    memory_normal: float = 0.0
    memory_tangential: float = 0.0

    @property
    def ratio(self) -> float:
        """Tangential over normal force before the slip."""
        return self.tangential / self.normal


@dataclass(frozen=True)
class FrictionEstimateConfig:
    """Errors of a fingertip's force that are known beforehand, and the interval that is wanted."""

    tilt_std_deg: float = parameter(4.0, "error of the force's direction", "deg", 0.0, 20.0)
    gain: float = parameter(1.0, "true over measured coefficient of this fingertip", "", 0.5, 2.0)
    gain_std: float = parameter(0.05, "uncertainty of that gain", "", 0.0, 0.5)
    scatter: float = parameter(0.03, "relative scatter of single slips", "", 0.001, 0.5)
    confidence: float = parameter(0.95, "confidence of the intervals", "", 0.5, 0.999)
    most_tilt_deg: float = parameter(
        6.0, "movement of the contact normal that spoils a result", "deg", 0.5, 45.0
    )
    most_give: float = parameter(
        8e-4, "motion of the surface per newton that spoils a result", "m/N", 1e-4, 0.1
    )

    def __post_init__(self) -> None:
        check_ranges(self)


@dataclass(frozen=True)
class FrictionEstimate:
    """Friction of one region.

    Attributes:
        region: its name. slips: number of slips it rests on.
        static, kinetic: coefficients; kinetic is nan where nothing slid long enough.
        std: standard deviation of the static one, kinetic_std: of the kinetic one.
        interval: interval of the static one at the configured confidence.
        repeatable: half width that more slips could still shrink; the rest is the sensor's gain.
        tilt: (2,) slope of the contact normal that the slips show, rad.
        normal_moves: whether the contact normal moved, so that the number means little.
    """

    region: str
    slips: int
    static: float
    std: float
    interval: tuple[float, float]
    kinetic: float
    kinetic_std: float
    repeatable: float
    tilt: Array = field(default_factory=lambda: np.zeros(2))
    normal_moves: bool = False

    @property
    def width(self) -> float:
        """Width of the interval."""
        return self.interval[1] - self.interval[0]


def estimate_friction(
    events: Sequence[SlipEvent], config: FrictionEstimateConfig | None = None
) -> dict[str, FrictionEstimate]:
    """Return the friction of every region that slipped at least twice."""
    config = config or FrictionEstimateConfig()
    regions = dict.fromkeys(event.region for event in events)
    found = {}
    for region in regions:
        own = [event for event in events if event.region == region]
        if len(own) >= 2:
            found[region] = estimate_region(region, own, config)
    return found


def estimate_region(
    region: str, events: Sequence[SlipEvent], config: FrictionEstimateConfig
) -> FrictionEstimate:
    """Fit mu and the error b of the force's direction to slips in several directions.

    ratio_i = mu + (1 + mu^2) b . (cos a_i, sin a_i) + e_i, b ~ N(0, tilt^2),
    e_i ~ N(0, std_i^2 + (scatter mu)^2); mu is multiplied by the gain of the fingertip. The scatter
    is raised to that of the residuals where they are larger, with Student's quantile.

    Raises:
        NotIdentifiableError: fewer than two slips.
    """
    if len(events) < 2:
        raise NotIdentifiableError(
            f"friction of '{region}': {len(events)} slips, expected at least 2; probe longer"
        )
    ratios = np.array([event.ratio for event in events])
    angles = np.array([event.angle for event in events])
    middle = float(np.median(ratios))
    spread = np.hypot([event.std for event in events], config.scatter * middle)
    design = _design(angles, middle)
    prior = np.array([0.0, *2 * [np.deg2rad(config.tilt_std_deg) ** -2]])
    solution, covariance, excess = _fit(design, ratios, spread, prior)
    freedom = max(len(events) - 1, 1)
    quantile = float(stdtrit(freedom + 4.0, 0.5 + 0.5 * config.confidence))
    static = config.gain * float(solution[0])
    fit_std = config.gain * excess * float(np.sqrt(covariance[0, 0]))
    std = float(np.hypot(fit_std, config.gain_std * static))
    kinetic, kinetic_std = _kinetic(events, config)
    moves = _normal_moves(events, solution[1:], config)
    if moves:
        std = float(np.hypot(std, (1.0 + static**2) * np.deg2rad(config.most_tilt_deg)))
    half = quantile * std
    return FrictionEstimate(
        region=region,
        slips=len(events),
        static=static,
        std=std,
        interval=(max(static - half, 0.0), static + half),
        kinetic=kinetic,
        kinetic_std=kinetic_std,
        repeatable=quantile * fit_std,
        tilt=solution[1:],
        normal_moves=moves,
    )


def _design(angles: Array, middle: float) -> Array:
    steep = 1.0 + middle**2
    return np.column_stack([np.ones_like(angles), steep * np.cos(angles), steep * np.sin(angles)])


def _fit(design: Array, ratios: Array, spread: Array, prior: Array) -> tuple[Array, Array, float]:
    """Return weighted least squares with a prior, its covariance, and the excess of the scatter.

    One slip far off the others (a false alarm) is weighed down by Huber's factor.
    """
    weight = spread**-2.0
    for _ in range(8):
        information = design.T @ (weight[:, None] * design) + np.diag(prior)
        covariance = np.linalg.inv(information)
        solution = covariance @ (design.T @ (weight * ratios))
        error = np.abs(ratios - design @ solution) / spread
        weight = spread**-2.0 * np.minimum(1.0, 2.0 / np.maximum(error, 1e-9))
    freedom = max(len(ratios) - 1, 1)
    excess = np.sqrt(
        (float(np.sum(weight * (ratios - design @ solution) ** 2)) + 4.0) / (freedom + 4.0)
    )
    return np.asarray(solution), np.asarray(covariance), float(max(excess, 0.5))


def _kinetic(events: Sequence[SlipEvent], config: FrictionEstimateConfig) -> tuple[float, float]:
    ratios = np.array([event.kinetic for event in events])
    ratios = ratios[np.isfinite(ratios)]
    if len(ratios) < 2:
        return float("nan"), float("nan")
    mean = config.gain * float(np.median(ratios))
    scatter = config.gain * float(ratios.std(ddof=1)) / np.sqrt(len(ratios))
    return mean, float(np.hypot(scatter, config.gain_std * mean))


def _normal_moves(events: Sequence[SlipEvent], tilt: Array, config: FrictionEstimateConfig) -> bool:
    """Whether the surface gives way, or slips and paths show another normal than the mesh."""
    limit = np.deg2rad(config.most_tilt_deg)
    slopes = np.array([event.tilt for event in events])
    slopes = slopes[np.isfinite(slopes)]
    along_path = len(slopes) >= 3 and float(np.median(np.abs(slopes))) > limit
    gives = np.array([event.give for event in events])
    gives = gives[np.isfinite(gives)]
    soft = len(gives) >= 2 and float(np.median(gives)) > config.most_give
    return bool(soft or along_path or float(np.linalg.norm(tilt)) > 2.0 * limit)
