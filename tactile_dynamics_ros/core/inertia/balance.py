"""Contact forces that balance the model, nearest to the measured ones."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.contact.wrench_samples import WrenchSamples
from tactile_dynamics_ros.core.rigid_body.rotation import skew

Array = NDArray[np.float64]

_DAMPING = 1e-6


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
    grasp = np.concatenate([arms, unit], axis=2) * samples.in_contact[:, :, None, None]
    length = max(float(np.sqrt(np.mean(samples.contact_point**2))), 1e-3)
    scale = np.array([1.0 / length] * 3 + [1.0] * 3)
    scaled = grasp * scale[:, None]
    torque_map = np.zeros_like(scaled)
    if np.any(samples.contact_torque):
        torque_map[:, :, :3] = np.eye(3) * samples.in_contact[:, :, None, None]
    gram = np.einsum("ncik,ncjk->nij", scaled, scaled)
    gram = gram + np.einsum("ncik,ncjk->nij", torque_map, torque_map)
    weights = np.linalg.solve(gram + _DAMPING * np.eye(6), (lacking * scale)[..., None])[..., 0]
    force = np.einsum("ncik,ni->nck", scaled, weights)
    torque = np.einsum("ncik,ni->nck", torque_map, weights) * length
    return samples.with_forces(samples.contact_force + force, samples.contact_torque + torque)
