"""Tare and calibration of fingertips, and how far their counts drift with temperature."""

from __future__ import annotations

import json
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import nnls

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.errors import BadInputError, NotIdentifiableError
from tactile_dynamics_ros.core.files import written_whole
from tactile_dynamics_ros.core.reading import read_json
from tactile_dynamics_ros.core.tactile.electrodes import ELECTRODES, PDC, TDC
from tactile_dynamics_ros.core.tactile.signal_change import (
    COUNTS_PER_KELVIN,
    MIRROR,
    check_frame,
    force_features,
    place_features,
    temperature,
)

SHIPPED_CALIBRATION = Path(__file__).parent / "data" / "analytic_force.json"
"""File of the constants of the analytic estimator that comes with the package; made by the module
`sim.sensors.biotac.calibrate`. Another file gives other forces; one of a unit of one's own is given
to the node instead."""
CREEP_TIMES = np.array([0.2, 4.0])
"""Time constants of the skin's creep, s. Source: facts on skin relaxation (0.1 to 0.3 s, and
several s). The amplitudes that go with them are fitted. Far from them forces drift in a hold or lag
after a touch, since amplitudes alone cannot follow."""

NORMAL_90 = 1.6449
"""Standard deviations of a normal variable within which 90 % lie (0.95 quantile, 1.64485, rounded).
Another share (1.96 for 95 %) would let rarer errors, of which there are fewer samples, set standard
deviations."""
MIRROR_AXES = np.array([1.0, -1.0, 1.0])
"""Signs of a vector's components in the mirror image of the sensor, which is symmetric in y. Fixed
by the sensor's axes; with another sign mirrored presses teach forces that no finger feels."""
_FIELDS = ("force_weights", "place_weights", "force_std", "place_std", "creep")
"""Arrays that the file holds. Names in files that exist: another one is a file that cannot be
read."""


@dataclass(frozen=True)
class ForceCalibration:
    """Constants that turn tared signals into force, contact place and standard deviations.

    Attributes:
        force_weights: (668, 3) N per feature. place_weights: (230, 3) m per feature.
        force_std: (2, 3) std = row 0 + row 1 * |force|, N and dimensionless.
        place_std: (2,) std of the contact point = entry 0 + entry 1 / |force|, m and N m.
        creep: (3,) gain, and the shares of what came within 0.2 s and 4 s that are added to it.
        origin: what it was fitted to.
    """

    force_weights: Array
    place_weights: Array
    force_std: Array
    place_std: Array
    creep: Array
    origin: str

    def save(self, path: Path) -> None:
        """Write as JSON with six significant digits."""
        content: dict[str, Any] = {"origin": self.origin}
        for name in _FIELDS:
            values = np.asarray(getattr(self, name))
            content[name] = [[float(f"{v:.6g}") for v in row] for row in np.atleast_2d(values)]
        with written_whole(path) as part:
            part.write_text(json.dumps(content, separators=(",", ":")) + "\n")

    @classmethod
    def load(cls, path: Path) -> ForceCalibration:
        """Read what `save` wrote.

        Raises:
            BadInputError: the file is missing or is no calibration.
        """
        try:
            content = read_json(path, "a calibration file")
            return cls(
                np.array(content["force_weights"]),
                np.array(content["place_weights"]),
                np.array(content["force_std"]),
                np.array(content["place_std"][0]),
                np.array(content["creep"][0]),
                str(content["origin"]),
            )
        except (OSError, ValueError, KeyError, TypeError, IndexError) as error:
            raise BadInputError(f"calibration file {path}: {error}") from error


@lru_cache(maxsize=1)
def shipped_calibration() -> ForceCalibration:
    """Return the calibration that comes with the package."""
    return ForceCalibration.load(SHIPPED_CALIBRATION)


@dataclass(frozen=True)
class LabelledPresses:
    """Tared signals with the true contact, for fitting and testing; U sequences of T frames.

    Attributes:
        change: (U, T, 20) hundreds of counts. force: (U, T, 3) N. point: (U, T, 3) m.
        rest: (U, 19) electrode counts without contact. period: s between frames.
    """

    change: Array
    force: Array
    point: Array
    rest: Array
    period: float = 0.01

    def frames(self, every: int = 1) -> tuple[Array, Array, Array]:
        """Return change (N, 20), force (N, 3) and point (N, 3) of every ``every``-th frame."""
        parts = (self.change, self.force, self.point)
        change, force, point = (part[:, ::every].reshape(-1, part.shape[-1]) for part in parts)
        return change, force, point


class CreepFilter:
    """Takes the skin's creep out of a force estimate, frame by frame.

    f = g f_hat + sum_j k_j (f_hat - lag_j f_hat): under constant force the signal keeps growing,
    so what has come lately counts for more than what has been there for long.

    Args:
        creep: (3,) g, k of 0.2 s, k of 4 s.
        period: s between frames.
    """

    def __init__(self, creep: Array, period: float) -> None:
        self._creep = creep
        self._follow = (1.0 - np.exp(-period / CREEP_TIMES))[:, None]
        self._lag: Array | None = None

    def reset(self) -> None:
        """Forget the past."""
        self._lag = None

    def update(self, force: Array) -> Array:
        """Return the compensated force (..., 3) of the next frame."""
        recent = self.recent(force)
        return np.asarray(self._creep[0] * force + np.tensordot(self._creep[1:], recent, axes=1))

    def recent(self, force: Array) -> Array:
        """Return (2, ...) the part of the force that has come within each time constant."""
        if self._lag is None:
            self._lag = np.zeros((2, *force.shape))
        follow = self._follow.reshape(2, *([1] * force.ndim))
        self._lag += follow * (force - self._lag)
        return np.asarray(force - self._lag)


def recent_changes(force: Array, period: float) -> Array:
    """Return (2, T, ...) how much of a force sequence (T, ...) has come within the creep times."""
    filter_ = CreepFilter(np.zeros(3), period)
    return np.stack([filter_.recent(sample) for sample in force], axis=1)


def fit_calibration(
    presses: LabelledPresses,
    held_out: LabelledPresses,
    origin: str,
    ridge: float = 3.0,
    every: int = 12,
) -> ForceCalibration:
    """Fit weights by ridge regression; creep and standard deviations on held-out units.

    Mirrored copies of all presses are added, since the finger is symmetric. Samples are weighted
    by 1 / (0.05 N + 0.1 |f|), about the error that is reached.

    Args:
        presses: to fit the weights to.
        held_out: presses of other units, to fit creep and standard deviations to.
        origin: description that is stored.
        ridge: penalty on standardised weights.
        every: use every such frame for the weights.
    """
    change, force, point = presses.frames(every)
    change = np.concatenate([change, change[:, MIRROR]])
    force = np.concatenate([force, force * MIRROR_AXES])
    point = np.concatenate([point, point * MIRROR_AXES])
    strength = np.linalg.norm(force, axis=1)
    force_weights = _ridge(force_features(change), force, 1.0 / (0.05 + 0.1 * strength), ridge)
    touching = strength > 0.1
    place_weights = _ridge(
        place_features(change[touching]),
        point[touching],
        1.0 / (1e-3 + 2e-4 / strength[touching]),
        ridge,
    )
    creep, error = _fit_creep(held_out, force_weights)
    _, force, point = held_out.frames()
    strength = np.linalg.norm(force, axis=1)
    force_std = np.stack([_fit_std(strength, axis) for axis in error.T], axis=1)
    place_std = _fit_place_std(held_out, place_weights)
    return ForceCalibration(force_weights, place_weights, force_std, place_std, creep, origin)


def _fit_creep(presses: LabelledPresses, weights: Array) -> tuple[Array, Array]:
    """Return creep constants (3,) and the remaining errors of all frames (U T, 3)."""
    raw = np.stack([force_features(change) @ weights for change in presses.change], axis=1)
    recent = recent_changes(raw, presses.period)
    design = np.stack([raw, *recent], axis=-1)
    target = np.swapaxes(presses.force, 0, 1)
    weight = 1.0 / (0.05 + 0.1 * np.linalg.norm(target, axis=-1))[..., None]
    creep = np.linalg.lstsq(
        (design * weight[..., None]).reshape(-1, 3), (target * weight).ravel(), rcond=None
    )[0]
    error = np.swapaxes(design @ creep - target, 0, 1)
    return np.asarray(creep), error.reshape(-1, 3)


def _fit_place_std(presses: LabelledPresses, weights: Array) -> Array:
    change, force, point = presses.frames(every=4)
    strength = np.linalg.norm(force, axis=1)
    pressed = strength > 0.1
    error = place_features(change[pressed]) @ weights - point[pressed]
    return _fit_std(1.0 / strength[pressed], np.sqrt(np.mean(error**2, axis=1)))


def _ridge(features: Array, target: Array, weight: Array, penalty: float) -> Array:
    scale = features.std(axis=0) + 1e-9
    weighted = features / scale * weight[:, None]
    gram = weighted.T @ weighted + penalty * np.eye(weighted.shape[1])
    return np.asarray(
        np.linalg.solve(gram, weighted.T @ (target * weight[:, None])) / scale[:, None]
    )


def _fit_std(driver: Array, error: Array) -> Array:
    """Return (2,) a, b >= 0 of std = a + b driver, matched to 90 % quantiles in bins."""
    edges = np.quantile(driver, np.linspace(0.0, 1.0, 13))
    rows, deviations = [], []
    for low, high in zip(edges[:-1], edges[1:], strict=True):
        inside = (driver >= low) & (driver <= high)
        if high > low and inside.sum() > 20:
            rows.append([1.0, float(np.mean(driver[inside]))])
            deviations.append(float(np.quantile(np.abs(error[inside]), 0.9)) / NORMAL_90)
    target = np.array(deviations)
    solution, _ = nnls(np.array(rows) / target[:, None], np.ones_like(target))
    return np.asarray(solution)


USUAL_SPREAD = 3.0
"""How far electrodes differ, counts/K. Source: fits of one sensor, 27 to 38 counts/K. It is the
prior's standard deviation: larger believes short warm-ups more, smaller keeps electrodes at the
mean."""
LEAST_SPAN = 1.0
"""Warming below which nothing is learnt, K: the prior's 3 counts/K then are 3 counts, no more than
electrodes wander. A core warms by some 10 K after switching on. Lower learns slopes of noise,
higher refuses warm-ups that tell something."""

_TOUCH = 10.0
"""Deviation of PDC from its median, counts, from which a frame shows a touch and is left out: that
from which the LL4MA driver calls it a contact too, and twenty times the noise of PDC. Lower throws
away frames at rest whose pressure drifts, higher takes light touches for warmth."""
_STRETCHES = 60
"""Means to which frames are averaged before lines are fitted. In a warm-up of ten minutes each is
of 10 s, longer than the seconds within which electrodes wander; their scatter then tells the
standard deviation. Ten frames each are asked for. More stretches are shorter than what is common to
neighbours, and standard deviations become too small; fewer scatter."""


@dataclass(frozen=True)
class ThermalDrift:
    """Drift of one unit, for `FingertipConfig.drift`.

    Attributes:
        slope: (19,) counts per kelvin. std: (19,) their standard deviations.
        span: K, between the coldest and the warmest stretch. frames: that it rests on.
    """

    slope: Array
    std: Array
    span: float
    frames: int


def fit_thermal_drift(raw: ArrayLike) -> ThermalDrift:
    """Fit E_k = a_k + s_k T to frames in which nothing is touched, s_k ~ N(31.7, 3^2) before.

    Electrodes wander by a count within seconds, so that neighbouring frames say the same: means of
    sixty stretches are fitted, whose scatter, and how alike neighbours are, tell the standard
    deviation.

    Args:
        raw: (N, 44) counts in order of time; frames whose PDC is 10 counts off the usual are left
            out.

    Raises:
        BadInputError: the frames are malformed.
        NotIdentifiableError: too few frames, or the temperature hardly changes.
    """
    counts = np.atleast_2d(check_frame(raw))
    free = counts[np.abs(counts[:, PDC] - np.median(counts[:, PDC])) < _TOUCH]
    if len(free) < 10 * _STRETCHES:
        raise NotIdentifiableError(
            f"drift: {len(free)} frames without contact, expected at least {10 * _STRETCHES}"
        )
    means = np.array([part.mean(axis=0) for part in np.array_split(free, _STRETCHES)])
    warmth = temperature(means[:, TDC])
    span = float(np.ptp(warmth))
    if span < LEAST_SPAN:
        raise NotIdentifiableError(
            f"drift: the temperature changes by {span:.2f} K, expected at least {LEAST_SPAN} K; "
            "record for ten minutes from switching the sensors on"
        )
    slope, std = _fit_lines(warmth - warmth.mean(), means[:, ELECTRODES])
    return ThermalDrift(slope, std, span, len(free))


def _fit_lines(warmth: Array, electrodes: Array) -> tuple[Array, Array]:
    """Return slopes and standard deviations (19,) with the usual spread as prior."""
    level = electrodes - electrodes.mean(axis=0)
    squares = float(warmth @ warmth)
    plain = warmth @ level / squares
    left = level - np.outer(warmth, plain)
    alike = np.clip(np.sum(left[1:] * left[:-1]) / np.sum(left**2), 0.0, 0.9)
    scatter = np.sum(left**2, axis=0) / (len(warmth) - 2) * (1.0 + alike) / (1.0 - alike)
    share = USUAL_SPREAD**2 / (USUAL_SPREAD**2 + scatter / squares)
    slope = COUNTS_PER_KELVIN + share * (plain - COUNTS_PER_KELVIN)
    return np.asarray(slope), np.asarray(USUAL_SPREAD * np.sqrt(1.0 - share))
