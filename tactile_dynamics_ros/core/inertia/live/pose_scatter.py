"""Noise of poses, stated or assumed, held against how the poses scatter."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.inertia.residuals.motion import OVERSTATED, UNDERSTATED
from tactile_dynamics_ros.core.numerics.noise import white_pose_noise_std

Array = NDArray[np.float64]

_NOISE_FLOOR = (1e-5, 1e-6)
"""Noise of poses, rad and m, that is presumed at least: what is smoother than this was filtered or
generated, and would get unlimited weight. 0.6 mdeg and 1 um are far below any tracker. Higher
overstates the noise of good trackers in simulation and widens intervals; at zero poses without
noise make the weights overflow."""


class PoseScatter:
    """Scatter of the poses beside the noise that they state, or that is assumed of them.

    Assumed noise becomes that of the scatter. So does stated noise that is far from it: a tracker's
    covariance also covers slow errors, which differentiation does not see; one that is a small
    fraction of the scatter is a mistake.
    """

    def __init__(self) -> None:
        self._seen = np.zeros(2)
        self._scale = np.ones((2, 2))

    def measure(
        self, time: Array, rotation: Array, position: Array, noise: Array, stated: Array
    ) -> bool:
        """Take the scatter of N poses; return whether what they state is a mistake.

        Args:
            time: (N,) s.
            rotation: (N, 3, 3).
            position: (N, 3) m.
            noise: (N, 2, 3, 3) square roots of the covariances, stated or assumed.
            stated: (N,) 1 where they are stated, else 0.
        """
        mistaken = np.zeros(2, dtype=bool)
        seen = np.array(white_pose_noise_std(time, rotation, position))
        self._seen = np.maximum(seen, _NOISE_FLOOR)
        for kind in (0, 1):
            chosen = noise[stated == kind]
            if not len(chosen):
                continue
            ratio = self._seen / np.median(_levels(chosen), axis=0)
            far = seen > 0.0
            if kind:
                mistaken = ratio > 1.0 / UNDERSTATED
                far = mistaken | (ratio < OVERSTATED)
            self._scale[kind] = np.where(far, ratio, 1.0)
        return bool(mistaken.any())

    def scaled(self, noise: Array, stated: Array) -> Array:
        """Noise (N, 2, 3, 3) of poses as it is to be believed; none is moved beyond the scatter."""
        scale = self._scale[stated.astype(int)]
        own = self._seen / _levels(noise)
        factor = np.clip(own, np.minimum(scale, 1.0), np.maximum(scale, 1.0))
        return np.asarray(factor[..., None, None] * noise)


def _levels(noise: Array) -> Array:
    """Standard deviations (N, 2) of rotation and position, means of the axes."""
    return np.asarray(np.sqrt(np.einsum("nsij,nsij->ns", noise, noise) / 3.0))
