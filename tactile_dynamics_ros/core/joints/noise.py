"""Noise of mean joint torques in blocks: sensors, accelerations, reversals."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import lapack

from tactile_dynamics_ros.core.errors import NotIdentifiableError
from tactile_dynamics_ros.core.joints.samples import JointSamples
from tactile_dynamics_ros.core.numerics.banded import VARIANCE_FLOOR, BandedWhitener

Array = NDArray[np.float64]

_AT_REVERSAL = 0.5
"""Std of the friction in a block in which a joint turns back, over its Coulomb friction: a law of
sliding says nothing there, where presliding goes from one sign to the other. With 0 reversals count
as much as other blocks, which no real drive bears; with 1 they count for nothing."""
_APART = 3
"""Blocks from which accelerations share no sample: windows are three blocks long."""


def whitener(
    samples: JointSamples, effort_std: Array, coulomb: Array, mass_matrix: Array
) -> BandedWhitener:
    """Whitener of rows (K n, ...), block by block, joint fastest.

    C_kl = M_k diag(s_q^2) M_l^T c_|k-l| + diag(s_tau^2 + (turning F / 2)^2) [k = l].

    Args:
        samples: blocks.
        effort_std: (n,) s_tau of a block's mean torque.
        coulomb: (n,) friction F.
        mass_matrix: (K, n, n) M, which passes noise of accelerations on to torques.

    Raises:
        NotIdentifiableError: the noise cannot be whitened.
    """
    count, n = samples.effort.shape
    band = np.zeros((_APART * n, count * n))
    carried = mass_matrix * samples.position_std
    linked = np.ones(count, dtype=bool)
    for apart in range(_APART):
        later = carried[apart:] @ np.swapaxes(carried[: count - apart], 1, 2)
        later = later * samples.lags[apart]
        if apart:
            linked = linked[: count - apart] & samples.follows[apart - 1 :]
            later = later * linked[:, None, None]
        _put(band, later, apart, n)
    own = effort_std**2 + (_AT_REVERSAL * samples.turning * coulomb) ** 2
    band[0] += own.reshape(-1) + VARIANCE_FLOOR
    factor, info = lapack.dpbtrf(band, lower=1)
    if info != 0:
        raise NotIdentifiableError(
            f"joints: the noise cannot be whitened (row {info}); check the stamps of the recording"
        )
    return BandedWhitener(factor)


def _put(band: Array, blocks: Array, apart: int, n: int) -> None:
    """Put blocks (K', n, n) of rows `apart` blocks below their columns into lower band storage."""
    columns = np.arange(len(blocks)) * n
    for i in range(n):
        for j in range(n):
            below = apart * n + i - j
            if below >= 0:
                band[below, columns + j] = blocks[:, i, j]
