"""Contact forces that balance the model, nearest to the measured ones."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.contact.wrench_samples import WrenchSamples
from tactile_dynamics_ros.core.rigid_body.rotation import skew

Array = NDArray[np.float64]

_DAMPING = 1e-6
"""Added to the Gram matrix of the contacts' unit wrenches (about the number of contacts), so that
two fingers, which cannot resist a torque about their line, leave it solvable. Their share of that
torque is then left out; a force is short by a millionth of itself. A thousandth and more shortens
forces by as much, below rounding (1e-16) two fingers have no solution."""


def balance_contacts(samples: WrenchSamples, lacking: Array) -> WrenchSamples:
    """Change contact forces (and measured torques) least so that their wrench grows by `lacking`.

    Effects that scale or turn measured forces must not see the misfit in them: a common gain of
    -1 would remove any residual. With balanced forces a common gain is a larger mass, no more.

    Args:
        samples: motion and contacts.
        lacking: (N, 6) wrench that the model needs beyond the measured one, body frame.

    Returns:
        Samples with df = G^T (G G^T)^+ lacking, G the grasp map of the contacts that touch.
    """
    arms = skew(samples.contact_point)
    unit = np.broadcast_to(np.eye(3), arms.shape)
    length = max(float(np.sqrt(np.mean(samples.contact_point**2))), 1e-3)
    touching = samples.in_contact[:, :, None, None]
    scaled = np.concatenate([arms / length, unit], axis=2) * touching
    joined = scaled.swapaxes(1, 2).reshape(len(scaled), 6, -1)
    gram = joined @ joined.swapaxes(1, 2) + _DAMPING * np.eye(6)
    measured = bool(np.any(samples.contact_torque))
    if measured:
        gram[:, :3, :3] += samples.in_contact.sum(axis=1)[:, None, None] * np.eye(3)
    target = lacking * np.array([1.0 / length] * 3 + [1.0] * 3)
    weights = np.linalg.solve(gram, target[..., None])
    force = (weights.swapaxes(1, 2) @ joined).reshape(samples.contact_force.shape)
    torque = samples.contact_torque
    if measured:
        torque = torque + length * touching[..., 0] * weights[:, None, :3, 0]
    return samples.with_forces(samples.contact_force + force, torque)
