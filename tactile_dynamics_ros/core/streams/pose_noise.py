"""What poses state of their own noise, and jumps that no body can have made.

One rule for live streams and recordings: a covariance that cannot be meant costs the statement, not
the pose; a pose whose tracker has lost the object is no pose, so that a gap is left.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.rigid_body.rotation import log_so3

Mask = NDArray[np.bool_]

ASSUMED_ROTATION_STD = 1e-3
"""Noise of an orientation that is assumed while none is stated and the scatter of the poses is not
measured yet (half a second), rad: 0.06 deg, as of trackers with markers. Larger trusts angular
accelerations, and so inertia, less; smaller claims intervals that real trackers do not keep."""
ASSUMED_POSITION_STD = 5e-4
"""Noise of a position in the same case, m: that of the trackers of published in-hand recordings.
Smaller claims, in the first half second, intervals that real trackers do not keep; larger delays
the first estimate."""
LEAST_STD = np.array([1e-5, 1e-6])
"""Noise of orientation, rad, and position, m, below which a statement is a mistake: 0.6 mdeg and 1
um are far below any tracker. Lower, numbers such as 1e-18 give poses unlimited weight; higher
refuses what a simulation states."""
LOST_POSITION_STD = 0.1
"""Standard deviation of a position, m, from which the tracker has lost the object: as large as a
grasp, so that not even the side of the centre of mass on which a finger presses is known. Lower
leaves poses out that still tell slow motion; higher lets in what tells nothing."""
LOST_ROTATION_STD = 1.0
"""Standard deviation of an orientation about its best known axis, rad, in the same case: where
gravity acts in the body is not known then. One axis alone may be unknown, as of a body that is
round about it."""

_HUGE = 1e30
"""Largest entry that is judged, rad^2 or m^2: of more the tracker knows as little, and products of
larger ones overflow. Below 1 it would change what trackers that are lost state."""
_NO_CORRELATION = 2.0
"""Size that a correlation is cut to; from 1 on the matrix is indefinite whatever it is, and the
eigenvalues of infinite ones are not defined."""

NOT_FINITE = "covariance is not finite"
"""A mistake. Words for people, also the key of its count."""
INDEFINITE = "covariance is not positive definite"
"""Likewise."""
TOO_SMALL = "covariance is smaller than that of any tracker"
"""Likewise, see `LEAST_STD`."""


@dataclass(frozen=True)
class StatedNoise:
    """What N poses state of their noise.

    Attributes:
        covariance: (N, 6, 6) [rotation, position], symmetric; of no use where not `stated`.
        stated: (N,) whether it can be believed.
        mistakes: by kind, how many are no statement although they are not zero.
        lost: (N,) whether the tracker says that it does not know where the object is.
    """

    covariance: Array
    stated: Mask
    mistakes: dict[str, int]
    lost: Mask


def read_covariances(covariance: Array, planar: bool = False) -> StatedNoise:
    """Judge covariances (N, 6, 6) [rotation, position]; all zero means that none is stated.

    Args:
        covariance: as stated.
        planar: whether x, y and yaw alone count, of what lies on a table: trackers of markers state
            anything of the others.
    """
    new = np.any(covariance[1:] != covariance[:-1], axis=(1, 2))
    # most trackers state the same again and again
    begins = np.flatnonzero(np.append(True, new)[: len(covariance)])
    of, covariance = np.diff(begins, append=len(covariance)), covariance[begins]
    finite: Mask = np.asarray(np.isfinite(covariance).all(axis=(1, 2)))
    clean = np.clip(np.where(finite[:, None, None], covariance, 0.0), -_HUGE, _HUGE)
    symmetric = 0.5 * (clean + np.swapaxes(clean, 1, 2))
    judged = _on_table(symmetric) if planar else symmetric
    absent = finite & ~judged.any(axis=(1, 2))
    blocks = np.stack([judged[:, :3, :3], judged[:, 3:, 3:]], axis=1)
    variances = np.linalg.eigvalsh(blocks)
    definite = np.linalg.eigvalsh(_unit_free(judged))[:, 0] > 0.0
    small = definite & (variances[:, :, -1] < LEAST_STD**2).any(axis=1)
    mistaken = {
        NOT_FINITE: ~finite,
        INDEFINITE: finite & ~absent & ~definite,
        TOO_SMALL: small,
    }
    mistakes = {kind: int(of[found].sum()) for kind, found in mistaken.items() if found.any()}
    lost = (variances[:, 1, -1] > LOST_POSITION_STD**2) | (
        variances[:, 0, 0] > LOST_ROTATION_STD**2
    )
    found = (np.repeat(one, of, axis=0) for one in (symmetric, definite & ~small, definite & lost))
    symmetric, stated, lost = found
    return StatedNoise(symmetric, stated, mistakes, lost)


def _on_table(covariance: Array) -> Array:
    """Covariances (N, 6, 6) whose roll and pitch are as yaw, and whose z is as x."""
    kept = np.array([2, 3, 4])
    found = np.zeros_like(covariance)
    found[:, kept[:, None], kept] = covariance[:, kept[:, None], kept]
    found[:, [0, 1], [0, 1]] = covariance[:, [2], [2]]
    found[:, 5, 5] = covariance[:, 3, 3]
    return found


def _unit_free(covariance: Array) -> Array:
    """Correlations (N, 6, 6), whose eigenvalues do not mix rad and m; -1 for a bad variance."""
    variance = np.einsum("nii->ni", covariance)
    scale = np.sqrt(np.where(variance > 0.0, variance, 1.0))
    with np.errstate(over="ignore"):
        found = covariance / (scale[:, :, None] * scale[:, None, :])
    found[:, range(6), range(6)] = np.where(variance > 0.0, 1.0, -1.0)
    return np.asarray(np.clip(found, -_NO_CORRELATION, _NO_CORRELATION))


FASTEST = np.array([1000.0, 100.0])
"""Angular, rad/s^2, and linear acceleration, m/s^2, that nothing exceeds which a hand or an arm
holds: arms do a tenth of it, shaken tools a third. Lower breaks windows at impacts, ten times
higher joins poses in mm with those in m."""
ASSUMED_STD = np.array([0.05, 0.02])
"""Noise, rad and m, of a tracker that states none, as far as it may not be called a jump: cameras
without depth do that. Less leaves noisy trackers without a window, more joins what a tracker that
found another object says."""
_SURE = 6.0
"""Standard deviations of noise that are no jump: chance exceeds them once in 10^8 poses. At 4 clean
recordings would break once in five minutes, at 12 jumps of 3 cm would pass."""


def jumps(time: Array, position: Array, rotation: Array, std: Array) -> bool:
    """Whether the last of three poses is farther from where the two before lead than bodies get.

    With steps h1 and h2, the deviation p3 - p2 - (p2 - p1) h2 / h1 is below a h2 (h1 + h2) / 2
    for accelerations below a, and noise of each pose adds to it.

    Args:
        time: (3,) s, increasing.
        position: (3, 3) m.
        rotation: (3, 3, 3).
        std: (2,) noise of a pose: rad, m.
    """
    first, second = np.diff(time)
    share = second / first
    turns = log_so3(rotation[1:] @ np.swapaxes(rotation[:-1], 1, 2))
    steps = np.stack([turns, np.diff(position, axis=0)])
    deviation = np.linalg.norm(steps[:, 1] - share * steps[:, 0], axis=1)
    noise = _SURE * np.sqrt(1.0 + (1.0 + share) ** 2 + share**2) * std
    return bool(np.any(deviation > 0.5 * FASTEST * second * (first + second) + noise))
