"""Scalars that say what a held object was going through, by symbol: time, place, speeds, loads."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.contact.wrench_samples import WrenchSamples, once_per_samples
from tactile_dynamics_ros.core.errors import BadInputError

Array = NDArray[np.float64]

_LEAST_FORCE = 1e-9
"""Grip force by which shares are divided at least, N: shares are zero where nothing is touched.
It is far below what any sensor reads, so that it acts nowhere else."""


@dataclass(frozen=True)
class SampleScalar:
    """One scalar at N instants.

    Attributes:
        name: in words.
        unit: SI, degrees for angles.
        values: (N,).
    """

    name: str
    unit: str
    values: Array


@once_per_samples
def sample_scalars(samples: WrenchSamples) -> dict[str, SampleScalar]:
    """Scalars of samples by symbol.

    `t`, `x y z` (place), `speed`, `turn` (rate of turn), `acceleration`, `up_x up_y up_z` (body
    axes against the vertical), `grip`, and per contact `load_<contact>` and `share_<contact>`.
    """
    size = np.linalg.norm
    force = size(samples.contact_force, axis=2)
    grip = force.sum(axis=1)
    found = {"t": SampleScalar("time", "s", samples.time)}
    for k, axis in enumerate("xyz"):
        found[axis] = SampleScalar(axis, "m", samples.position[:, k])
    found["speed"] = SampleScalar("speed", "m/s", size(samples.velocity, axis=1))
    found["turn"] = SampleScalar("rate of turn", "rad/s", size(samples.angular_velocity, axis=1))
    acceleration = size(samples.acceleration, axis=1)
    found["acceleration"] = SampleScalar("acceleration", "m/s^2", acceleration)
    for k, axis in enumerate("xyz"):
        angle = np.degrees(np.arccos(np.clip(samples.rotation[:, 2, k], -1.0, 1.0)))
        found[f"up_{axis}"] = SampleScalar(
            f"angle of body axis {axis} to the vertical", "deg", angle
        )
    several = force.shape[1] > 1
    if several:
        found["grip"] = SampleScalar("grip force", "N", grip)
    for k, name in enumerate(samples.contact_names):
        found[f"load_{name}"] = SampleScalar(f"force of {name}", "N", force[:, k])
        if several:
            share = force[:, k] / np.maximum(grip, _LEAST_FORCE)
            found[f"share_{name}"] = SampleScalar(f"share of {name} in the grip", "", share)
    return found


def values_of(samples: WrenchSamples, symbol: str) -> Array:
    """Values (N,) of one scalar.

    Raises:
        BadInputError: the samples have no scalar of that symbol.
    """
    known = sample_scalars(samples)
    if symbol not in known:
        raise BadInputError(f"regime: '{symbol}' is unknown; there are {', '.join(known)}")
    return known[symbol].values
