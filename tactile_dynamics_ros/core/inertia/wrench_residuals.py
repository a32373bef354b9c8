"""Wrench residuals of a fitted model for people: channels, frames, what they may depend on."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.contact.wrench_samples import WrenchSamples
from tactile_dynamics_ros.core.discrepancy.model import Quantity, Residuals
from tactile_dynamics_ros.core.inertia.fitted_model import FittedModel

Array = NDArray[np.float64]

CHANNELS = ("torque_x", "torque_y", "torque_z", "force_x", "force_y", "force_z")
UNITS = ("N m", "N m", "N m", "N", "N", "N")


def wrench_residuals(model: FittedModel, white: Array) -> Residuals:
    """Measured minus predicted wrench about the body origin, with named quantities.

    Args:
        model: whose parameters predict.
        white: (N, 6) white residual of the same samples.
    """
    physical = -model.smooth_residual()
    rotation = np.concatenate([s.rotation for s in model.samples])
    world = (rotation[:, None] @ physical.reshape(-1, 2, 3, 1)).reshape(-1, 6)
    parts = [_quantities(samples) for samples in model.samples]
    joined = tuple(
        Quantity(q.name, q.symbol, q.unit, np.concatenate([p[k].values for p in parts]), q.frame)
        for k, q in enumerate(parts[0])
    )
    time = np.concatenate([samples.time for samples in model.samples])
    return Residuals(time, white, physical, CHANNELS, UNITS, {"world": world}, joined)


def _quantities(samples: WrenchSamples) -> list[Quantity]:
    """Motion, gravity and forces by name."""

    def world(vectors: Array) -> Array:
        return np.asarray(np.einsum("nij,nj->ni", samples.rotation, vectors))

    force = samples.contact_force
    normal = np.einsum("nci,nci->nc", samples.contact_rotation[..., 2], force)
    up = np.broadcast_to(-samples.gravity / 9.81, samples.position.shape)
    found = [
        Quantity("time", "t", "s", samples.time[:, None]),
        Quantity("position", "p", "m", samples.position, "world"),
        Quantity("velocity", "v", "m/s", samples.velocity, "world"),
        Quantity("acceleration", "a", "m/s^2", samples.acceleration, "world"),
        Quantity("angular_velocity", "omega", "rad/s", world(samples.angular_velocity), "world"),
        Quantity(
            "angular_acceleration", "alpha", "rad/s^2", world(samples.angular_acceleration), "world"
        ),
        Quantity("gravity", "up", "", up, "world"),
        Quantity("grip", "f_n", "N", normal.sum(axis=1, keepdims=True)),
    ]
    for index, name in enumerate(samples.contact_names):
        found.append(Quantity(f"force:{name}", f"f_{name}", "N", force[:, index], "body"))
        found.append(
            Quantity(f"point:{name}", f"r_{name}", "m", samples.contact_point[:, index], "body")
        )
    return found
