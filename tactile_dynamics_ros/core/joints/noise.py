"""Noise of mean joint torques in blocks: sensors, accelerations, reversals."""

from __future__ import annotations

import numpy as np
from scipy.linalg import lapack

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.errors import NotIdentifiableError
from tactile_dynamics_ros.core.joints.samples import JointSamples
from tactile_dynamics_ros.core.numerics.banded import VARIANCE_FLOOR, BandedWhitener
from tactile_dynamics_ros.core.numerics.noise import white_noise_std

_AT_REVERSAL = 0.5
"""Std of the friction in a block in which a joint turns back, over its Coulomb friction: a law of
sliding says nothing there, where presliding goes from one sign to the other. With 0 reversals count
as much as other blocks, which no real drive bears; with 1 they count for nothing."""
_LEAST_NOISE = 1e-6
"""Noise of a mean torque at least, N m: data without any noise stay finite."""
_CORRELATED = 1.0
"""Time over which correlation of residuals is looked for, s: errors of a model follow motions,
whose strokes last as long."""
_APART = 3
"""Blocks from which accelerations share no sample: windows are three blocks long."""


def whitener(samples: JointSamples, effort_std: Array, friction: Array) -> BandedWhitener:
    """Whitener of rows (K n, ...), block by block, joint fastest.

    C_kl = M_k diag(s_q^2) M_l^T c_|k-l| + diag(s_tau^2 + (turning F / 2)^2) [k = l].

    Args:
        samples: blocks.
        effort_std: (n,) s_tau of a block's mean torque.
        friction: (n,) Coulomb friction F.

    Raises:
        NotIdentifiableError: the noise cannot be whitened.
    """
    count, n = samples.effort.shape
    band = np.zeros((_APART * n, count * n))
    carried = samples.mass_matrix * samples.position_std
    linked = np.ones(count, dtype=bool)
    for apart in range(_APART):
        later = carried[apart:] @ np.swapaxes(carried[: count - apart], 1, 2)
        later = later * samples.lags[apart]
        if apart:
            linked = linked[: count - apart] & samples.follows[apart - 1 :]
            later = later * linked[:, None, None]
        _put(band, later, apart, n)
    own = effort_std**2 + (_AT_REVERSAL * samples.turning * friction) ** 2
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


def stated_noise(samples: JointSamples) -> Array:
    """(n,) noise of mean torques by the white noise of their samples, N m."""
    return np.asarray(np.maximum(samples.effort_std, _LEAST_NOISE))


def seen_noise(samples: JointSamples, effort_std: Array, white: Array) -> Array:
    """(n,) noise of torques at which what changes from block to block has a variance of 1.

    What a model misses follows the motion or jumps at reversals: differences of high order and
    their median see little of it, whatever it is, so that models with more effects are held against
    the same noise.

    Args:
        samples: blocks.
        effort_std: (n,) by which the residual was made white.
        white: (K, n) residual.
    """
    seen = np.array([white_noise_std(samples.time, one[:, None]) for one in white.T])
    return np.asarray(np.maximum(effort_std * seen, 0.5 * stated_noise(samples)))


def dispersion(white: Array, length: float) -> float:
    """Factor on variances: mean square of a residual (K, n), 1 at least, times its correlation.

    1 + 2 sum of the correlations of blocks up to a second apart, as far as they are significant.

    Args:
        white: (K, n).
        length: of a block, s.
    """
    centred = white - white.mean(axis=0)
    power, total = float(np.sum(centred**2)), 1.0
    for apart in range(1, min(round(_CORRELATED / length), len(white) // 4)):
        correlation = float(np.sum(centred[apart:] * centred[:-apart])) / max(power, 1e-300)
        if correlation <= 2.0 / np.sqrt(white.size):
            break
        total += 2.0 * correlation
    return max(1.0, float(np.mean(white**2))) * total
