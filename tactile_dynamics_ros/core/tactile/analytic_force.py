"""Analytic force model: a linear map of features of the tared signals, with creep taken out.

The classic estimate F_k = S_k sum_i e_i n_ki is linear in the electrodes' changes e_i; here the
linear part is extended by pressure and low-order products (`features`), still one matrix product.

Source: Lin, Erickson, Fishel, Wettels and Loeb, 2009; Su et al., 2012 (classic formula).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.shape.skin_surface import project_to_skin
from tactile_dynamics_ros.core.tactile.calibration import (
    CreepFilter,
    ForceCalibration,
    shipped_calibration,
)
from tactile_dynamics_ros.core.tactile.electrodes import ELECTRODE_NORMAL, ELECTRODE_POSITION
from tactile_dynamics_ros.core.tactile.fingertip import (
    Felt,
    FingertipConfigs,
    FingertipEstimator,
    frame_period,
)
from tactile_dynamics_ros.core.tactile.signal_change import force_features, place_features

Array = NDArray[np.float64]


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

    def predict(self, change: Array) -> Felt:
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
