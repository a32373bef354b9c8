"""How a body's weight spreads over its feet: springs of equal length that only push."""

from __future__ import annotations

import numpy as np

_SCALE = 0.05
"""m; makes the two lever arms as large as the 1 beside them, so that the small systems are well
conditioned."""
_ROUNDS = 6
"""Most changes of the set of feet that touch, in one step: it rarely changes at all."""


def spread_weight(
    feet: np.ndarray,
    stiffness: np.ndarray,
    load: np.ndarray,
    moment: np.ndarray,
    touching: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """Return the forces of all feet and which of them touch.

    The underside is a plane that sinks and leans: foot i at b_i carries
    n_i = max(0, k_i (s + l . b_i)) with sum n_i = W and sum n_i b_i = M.

    Args:
        feet: (..., N, 2) m.
        stiffness: (..., N) k_i of each foot, any unit; 0 for none.
        load: (...) N.
        moment: (..., 2) N m, the weight times the place of its resultant.
        touching: (..., N) which feet touched before.

    Returns:
        (..., N) N and (..., N).
    """
    basis = np.concatenate([np.ones((*feet.shape[:-1], 1)), feet / _SCALE], axis=-1)
    wanted = np.concatenate([load[..., None], moment / _SCALE], axis=-1)[..., None]
    for _ in range(_ROUNDS):
        weight = np.where(touching, stiffness, 0.0)
        system = basis.swapaxes(-1, -2) @ (basis * weight[..., None])
        system += 1e-9 * np.trace(system, axis1=-2, axis2=-1)[..., None, None] * np.eye(3)
        depth = (basis @ np.linalg.solve(system, wanted))[..., 0]
        found = (depth > 0.0) & (stiffness > 0.0)
        if np.array_equal(found, touching):
            break
        touching = found
    return np.where(depth > 0.0, weight * depth, 0.0), touching
