"""Wrench residuals of a fitted model for people: channels, frames, what was going on."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.contact.wrench_samples import WrenchSamples
from tactile_dynamics_ros.core.discrepancy.model.residual_model import Condition, Residuals
from tactile_dynamics_ros.core.inertia.batch.fitted_model import FittedModel

Array = NDArray[np.float64]

CHANNELS = ("torque_x", "torque_y", "torque_z", "force_x", "force_y", "force_z")
"""Channels of a wrench residual in the order of `core`, [torque, force]; names that documents and
reports show. Another order here alone would name a force a torque."""
UNITS = ("N m", "N m", "N m", "N", "N", "N")
"""Units of these channels. They follow the channels."""


def wrench_residuals(model: FittedModel, white: Array) -> Residuals:
    """Measured minus predicted wrench about the body origin, with what was going on.

    Args:
        model: whose parameters predict.
        white: (N, 6) white residual of the same samples.
    """
    rotation = np.concatenate([samples.rotation for samples in model.samples])
    to_world = np.zeros((len(rotation), 6, 6))
    to_world[:, :3, :3] = to_world[:, 3:, 3:] = rotation
    parts = [conditions(samples) for samples in model.samples]
    joined = tuple(
        replace(first, values=np.concatenate([part[k].values for part in parts]))
        for k, first in enumerate(parts[0])
    )
    return Residuals(
        time=np.concatenate([samples.time for samples in model.samples]),
        white=white,
        physical=-model.smooth_residual(),
        channels=CHANNELS,
        units=UNITS,
        frames={"world": to_world},
        conditions=joined,
        drivers=np.concatenate(
            [np.concatenate([s.velocity, s.angular_velocity], axis=1) for s in model.samples]
        ),
        factors=_factors(model, white.ravel()),
        frame="body",
        alone="rigid body alone",
        about="The model predicts, from the motion of a rigid body, what forces the contacts must "
        "apply.",
    )


def _factors(model: FittedModel, white: Array) -> tuple[Array, Array]:
    """Residual e = L white and C^-1 e = L^-T white, (N, 6) each."""
    whiteners = [stretch.linearisation.whitener for stretch in model.stretches]
    parts = np.split(white, np.cumsum([len(stretch.residual) for stretch in model.stretches])[:-1])
    pairs = list(zip(whiteners, parts, strict=True))
    plain = np.concatenate([whitener.colour(part) for whitener, part in pairs])
    weighted = np.concatenate([whitener.whiten_transposed(part) for whitener, part in pairs])
    return plain.reshape(-1, 6), weighted.reshape(-1, 6)


def conditions(samples: WrenchSamples) -> list[Condition]:
    """Speeds, tilt, grip and contact state, (N,) each."""
    size = np.linalg.norm
    up = -samples.rotation[:, 2]
    force = size(samples.contact_force, axis=2)
    tilt = np.degrees(np.arccos(np.clip(up @ (up.mean(axis=0) / size(up.mean(axis=0))), -1, 1)))
    found = [
        Condition("speed", "m/s", size(samples.velocity, axis=1)),
        Condition("rate of turn", "rad/s", size(samples.angular_velocity, axis=1)),
        Condition("acceleration", "m/s^2", size(samples.acceleration, axis=1)),
        Condition("tilt from the mean orientation", "deg", tilt),
        Condition("height", "m", samples.position[:, 2]),
        Condition("grip force", "N", force.sum(axis=1)),
        Condition("time", "s", samples.time),
    ]
    if samples.contact_force.shape[1] > 1:
        found += [
            Condition(f"force of {name}", "N", force[:, index])
            for index, name in enumerate(samples.contact_names)
        ]
        held = samples.in_contact.sum(axis=1).astype(float)
        found.append(Condition("contacts", "", held, below_most="while a finger is off the object"))
    return found
