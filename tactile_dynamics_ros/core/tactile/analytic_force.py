"""Analytic force of a BioTac, the estimators of force by name, and the gain of one unit."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.errors import BadInputError, NotIdentifiableError
from tactile_dynamics_ros.core.shape.skin_surface import project_to_skin
from tactile_dynamics_ros.core.tactile.calibration import (
    CreepFilter,
    ForceCalibration,
    shipped_calibration,
)
from tactile_dynamics_ros.core.tactile.electrodes import ELECTRODE_NORMAL, ELECTRODE_POSITION
from tactile_dynamics_ros.core.tactile.fingertip import (
    FingertipConfigs,
    FingertipEstimator,
    TactileReading,
    frame_period,
)
from tactile_dynamics_ros.core.tactile.network.weights import NetworkForceEstimator, NetworkWeights
from tactile_dynamics_ros.core.tactile.signal_change import force_features, place_features


class AnalyticForceModel:
    """Force and contact point by the calibrated linear map.

    Args:
        calibration: constants; those shipped with the package if None.
        period: s between frames.
    """

    def __init__(self, calibration: ForceCalibration | None = None, period: float = 0.01) -> None:
        self.calibration = calibration or shipped_calibration()
        self._creep = CreepFilter(self.calibration.creep, period)

    def reset(self, rest: Array) -> None:
        """Forget past frames; the rest counts (..., 19) do not matter here."""
        self._creep.reset()

    def predict(self, change: Array) -> TactileReading:
        """Return the contacts in the next frame, given its tared signals (..., 20)."""
        force = self._creep.update(estimate_force(change, self.calibration))
        point, point_std = estimate_point(change, force, self.calibration)
        return force, force_std(force, self.calibration), point, point_std


class AnalyticForceEstimator(FingertipEstimator):
    """Live force of one fingertip, or of several, by the analytic model.

    Args:
        config: thresholds and constants of the fingertip, or of each of several.
        calibration: constants; those shipped with the package if None.
    """

    def __init__(
        self,
        config: FingertipConfigs | None = None,
        calibration: ForceCalibration | None = None,
    ) -> None:
        super().__init__(AnalyticForceModel(calibration, frame_period(config)), config)


def estimate_force(change: Array, calibration: ForceCalibration) -> Array:
    """Return the force (..., 3) of tared signals (..., 20) before creep is taken out, N."""
    return np.asarray(force_features(change) @ calibration.force_weights)


def estimate_sequence(
    change: Array, calibration: ForceCalibration, period: float = 0.01
) -> tuple[Array, Array]:
    """Return force and std (T, 3) of a sequence of tared signals (T, 20), sensor frame, N."""
    creep = CreepFilter(calibration.creep, period)
    force = np.array([creep.update(raw) for raw in estimate_force(change, calibration)])
    return force, force_std(force, calibration)


def force_std(force: Array, calibration: ForceCalibration) -> Array:
    """Return the standard deviation (..., 3) that goes with an estimated force (..., 3), N."""
    strength = np.linalg.norm(force, axis=-1, keepdims=True)
    return np.asarray(calibration.force_std[0] + calibration.force_std[1] * strength)


def estimate_point(
    change: Array, force: Array, calibration: ForceCalibration
) -> tuple[Array, Array]:
    """Return contact points (..., 3) on the skin and their std (...), sensor frame, m."""
    point = project_to_skin(place_features(change) @ calibration.place_weights)
    strength = np.maximum(np.linalg.norm(force, axis=-1), 0.02)
    return point, np.asarray(calibration.place_std[0] + calibration.place_std[1] / strength)


def classic_force(change: Array, scale: Array) -> Array:
    """Return the classic estimate f_k = -S_k sum_i e_i n_ki (..., 3), N.

    Args:
        change: (..., 20) tared signals, hundreds of counts.
        scale: (3,) S_k in N per hundred counts.

    Source: Lin et al., 2009.
    """
    return np.asarray(-scale * (change[..., :19] @ ELECTRODE_NORMAL))


def electrode_centroid(change: Array) -> Array:
    """Return the contact point (..., 3) as centroid of electrodes weighted by squared change, m.

    Source: contact-point estimate of the biotac_force_net package.
    """
    weight = np.minimum(change[..., :19], 0.0) ** 2
    total = np.maximum(weight.sum(axis=-1, keepdims=True), 1e-9)
    return project_to_skin(weight @ ELECTRODE_POSITION / total)


FORCE_MODELS = ("network", "analytic")
"""Names of the force models, the default first; they are API (`biotac_force` parameter `model`).
Another order makes another model the default."""


def create_force_estimator(
    model: str = "network", config: FingertipConfigs | None = None
) -> FingertipEstimator:
    """Return the live estimator of one fingertip, or of several that are read together.

    Args:
        model: one of FORCE_MODELS, or a file of weights that `train biotac` has written (.npz).
        config: thresholds and constants of the fingertip, or of each of several.

    Raises:
        BadInputError: there is no such model, or the file holds none.
    """
    if model.endswith(".npz"):
        return NetworkForceEstimator(config, NetworkWeights.load(Path(model)))
    if model == "network":
        return NetworkForceEstimator(config)
    if model == "analytic":
        return AnalyticForceEstimator(config)
    raise BadInputError(
        f"force model '{model}': expected one of {', '.join(FORCE_MODELS)}, or a .npz file of "
        "`train biotac`"
    )


_STRETCHES = 10
"""Parts of a recording whose spread tells the standard deviation of the gain, since errors of
neighbouring frames are alike: it is known to a quarter then (nine degrees of freedom). More parts
are shorter than a press and their errors alike, so that the standard deviation becomes too small;
fewer make it chance."""
_RIDGE = 10.0
"""Weight that holds the gain matrix at the identity, a quarter of what one frame of 1 N weighs.
Directions that presses contain have thousands of frames and ignore it; others stay at one. With
none, presses along one direction leave the matrix undetermined; a thousand times more would pull
gains to one."""


@dataclass(frozen=True)
class UnitGain:
    """Gain that a unit's force estimates need, for `FingertipConfig.gain`.

    Attributes:
        scale: the best number. std: its standard deviation. samples: frames it rests on.
        matrix: (3, 3) the best matrix, which turns the force too. matrix_std: (3, 3).
    """

    scale: float
    std: float
    samples: int
    matrix: Array
    matrix_std: Array


def fit_unit_gain(estimated: Array, reference: Array, weakest: float = 0.1) -> UnitGain:
    """Fit f_reference = s f_estimated and f_reference = G f_estimated, frames with a clear force.

    G is kept at the identity where no press tells otherwise. Errors of neighbouring frames are
    alike, so standard deviations are taken from the spread between ten stretches of the recording.

    Args:
        estimated: (N, 3) forces of the unit with scale 1, N.
        reference: (N, 3) known forces in the same frame, N.
        weakest: references below this are left out, N.

    Raises:
        BadInputError: the two have different shapes.
        NotIdentifiableError: fewer than 20 frames have a clear force.
    """
    estimated, reference = np.asarray(estimated, float), np.asarray(reference, float)
    if estimated.shape != reference.shape or estimated.ndim != 2 or estimated.shape[1] != 3:
        raise BadInputError(
            f"unit gain: estimated forces {estimated.shape} and known forces {reference.shape}; "
            "expected two arrays (N, 3)"
        )
    clear = np.linalg.norm(reference, axis=1) > weakest
    count = int(clear.sum())
    if count < 20:
        raise NotIdentifiableError(
            f"unit gain: {count} frames with more than {weakest} N, expected at least 20; "
            "press harder or longer"
        )
    estimated, reference = estimated[clear], reference[clear]
    weight = 1.0 / (0.05 + 0.1 * np.linalg.norm(reference, axis=1)) ** 2
    across = weight * np.sum(estimated * reference, axis=1)
    along = weight * np.sum(estimated**2, axis=1)
    stretches = np.array_split(np.arange(count), _STRETCHES)
    factors = np.array([across[rows].sum() / along[rows].sum() for rows in stretches])
    matrices = [_fit_matrix(estimated[r], reference[r], weight[r]) for r in stretches]
    return UnitGain(
        float(across.sum() / along.sum()),
        float(factors.std(ddof=1) / np.sqrt(_STRETCHES)),
        count,
        _fit_matrix(estimated, reference, weight),
        np.asarray(np.std(matrices, axis=0, ddof=1) / np.sqrt(_STRETCHES)),
    )


def _fit_matrix(estimated: Array, reference: Array, weight: Array) -> Array:
    """Weighted ridge fit of G (3, 3) towards the identity."""
    weighted = weight[:, None] * estimated
    gram = weighted.T @ estimated + _RIDGE * np.eye(3)
    return np.asarray(np.eye(3) + np.linalg.solve(gram, weighted.T @ (reference - estimated)).T)
