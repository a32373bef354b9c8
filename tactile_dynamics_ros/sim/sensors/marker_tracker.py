"""A marker tracker on the object: poses with white noise, a constant bias and drop-outs."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.configuration import check_ranges, parameter
from tactile_dynamics_ros.core.rigid_body.rotation import exp_so3

Array = NDArray[np.float64]


@dataclass(frozen=True)
class MarkerTrackerConfig:
    """Errors of the tracked pose."""

    position_noise: float = parameter(5e-4, "white noise of position", "m", 0.0, 0.1)
    rotation_noise_deg: float = parameter(0.2, "white noise of rotation", "deg", 0.0, 45.0)
    position_bias: float = parameter(2e-4, "std of the constant error of position", "m", 0.0, 0.1)
    rotation_bias_deg: float = parameter(0.05, "std of that of rotation", "deg", 0.0, 45.0)
    loss_probability: float = parameter(0.0, "share of frames without a pose", "", 0.0, 1.0)

    def __post_init__(self) -> None:
        check_ranges(self)


class MarkerTracker:
    """Reports noisy poses of the object.

    Args:
        config: errors.
        seed: of noise, bias and losses.

    Attributes:
        covariance: (6, 6) of a reported pose [rotation, position], world axes.
    """

    def __init__(self, config: MarkerTrackerConfig | None = None, seed: int = 0) -> None:
        self.config = config = config or MarkerTrackerConfig()
        self._rng = np.random.default_rng([seed, 17])
        noise = [np.deg2rad(config.rotation_noise_deg)] * 3 + [config.position_noise] * 3
        bias = [np.deg2rad(config.rotation_bias_deg)] * 3 + [config.position_bias] * 3
        self._noise = np.array(noise)
        self._bias = np.array(bias) * self._rng.standard_normal(6)
        self.covariance = np.diag(self._noise**2 + np.array(bias) ** 2)

    def read(self, pose: Array) -> Array | None:
        """Return the reported X_WO (4, 4), or None where tracking was lost.

        Args:
            pose: (4, 4) true X_WO.
        """
        if self._rng.random() < self.config.loss_probability:
            return None
        error = self._bias + self._noise * self._rng.standard_normal(6)
        reported = np.array(pose, dtype=float)
        reported[:3, :3] = exp_so3(error[:3]) @ reported[:3, :3]
        reported[:3, 3] += error[3:]
        return reported
