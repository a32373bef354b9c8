"""What a wrist sensor tells of a held object, beside the fingertips: mass, inertia, their gains."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.inertia.batch.fitted_model import FittedModel
from tactile_dynamics_ros.core.inertia.batch.inertial_estimate import (
    PARAMETER_NAMES,
    InertialEstimate,
)
from tactile_dynamics_ros.core.inertia.residuals.rigid_grasp import displacement_jacobian
from tactile_dynamics_ros.core.rigid_body.inertial_parameters import (
    InertialParameters,
    com_inertia_jacobian,
    dynamic_parameters_from_pseudo_inertia,
    pseudo_inertia,
)
from tactile_dynamics_ros.core.rigid_body.rotation import skew
from tactile_dynamics_ros.core.streams.streams import PoseStream, places_at
from tactile_dynamics_ros.core.tracking.pose_fusion import average_poses

_FEWEST_POSES = 10
"""Poses of object and flange at one time, at least, of which the grip is averaged: how far it gives
way shows in their scatter. Fewer make that a guess; a second of a slow camera has fifteen."""

_FARTHEST = 1.0
"""Radius of gyration, m, that an inertia may have of which the wrist tells nothing: larger than
that of anything a hand holds, so that nothing of it counts beside the fingertips. Half and twice as
much change no estimate by a thousandth of its standard deviation."""


def grip(flange: PoseStream, held: PoseStream) -> tuple[Array, Array]:
    """Mean pose (4, 4) X_OF of the flange in the object, and the covariance (6, 6) of a single one.

    The object gives way in the grip, so that the scatter counts as it is and not over their number.

    Args:
        flange: X_WF of the sensor.
        held: X_WO, while it is held.

    Raises:
        BadInputError: they hardly overlap.
    """
    inside = (held.time >= flange.time[0]) & (held.time <= flange.time[-1])
    count = int(np.sum(inside))
    if count < _FEWEST_POSES:
        raise BadInputError(
            f"wrist: {count} poses of the object while the wrist sensor was read; expected "
            f"{_FEWEST_POSES} at least, of the same recording"
        )
    place, turn = places_at(flange.time, flange.position, flange.rotation, held.time[inside])
    back = np.swapaxes(held.rotation[inside], 1, 2)
    apart = np.tile(np.eye(4), (count, 1, 1))
    apart[:, :3, :3] = back @ turn
    apart[:, :3, 3] = np.einsum("nij,nj->ni", back, place - held.position[inside])
    mean, covariance = average_poses(apart)
    return mean, covariance * count


def seen_from(estimate: InertialEstimate, pose: Array, covariance: Array) -> InertialEstimate:
    """The same body in another frame: P' = T P T^T with T its own frame in the other.

    Args:
        estimate: in its frame.
        pose: (4, 4) T.
        covariance: (6, 6) of T, [rotation, position] about the axes of the other frame.
    """
    unit = pseudo_inertia(np.eye(10))
    turned = dynamic_parameters_from_pseudo_inertia(pose @ unit @ pose.T).T
    phi = turned @ estimate.inertia.dynamic_parameters
    about_origin = np.eye(6)
    about_origin[3:, :3] = skew(pose[:3, 3])
    moved = displacement_jacobian(phi) @ about_origin
    known = turned @ estimate.covariance @ turned.T + moved @ covariance @ moved.T
    return replace(
        estimate,
        inertia=InertialParameters.from_dynamic_parameters(phi),
        covariance=0.5 * (known + known.T),
        not_excited=_mixed(estimate.not_excited),
        lasting=None,
    )


def _mixed(unknown: tuple[str, ...]) -> tuple[str, ...]:
    """Names that a turned frame mixes with those that are unknown: all of a kind."""
    kinds = {name.split("_")[0] for name in unknown}
    return tuple(name for name in PARAMETER_NAMES if name.split("_")[0] in kinds)


def told_apart(estimate: InertialEstimate) -> Array:
    """Covariance (10, 10) of dynamic parameters in which mass, centre and inertia are independent.

    Errors that are common to hand and object, and a grip that gives way, tie the mass to the
    centre only where the model is exact; what such ties seem to tell beside the fingertips is not
    told. An inertia that is undetermined counts as unknown.
    """
    to_com = com_inertia_jacobian(estimate.inertia.dynamic_parameters)
    blocks = np.zeros((10, 10))
    for rows in (slice(0, 1), slice(1, 4), slice(4, 10)):
        blocks[rows, rows] = estimate.parameter_covariance[rows, rows]
    if any(name.startswith("inertia") for name in estimate.not_excited):
        blocks[4:, 4:] = (estimate.inertia.mass * _FARTHEST**2) ** 2 * np.eye(6)
    back = np.linalg.inv(to_com)
    return np.asarray(back @ blocks @ back.T)


def fingertip_gains(fitted: FittedModel, mass: float, std: float) -> dict[str, tuple[float, float]]:
    """How much too large each contact reports its force, of a body whose mass is known.

    Contacts tell factors c_i that make their forces agree, and the mass m_f that they feel then;
    the rest is common: 1 + gain_i = m_f / (c_i m).

    Args:
        fitted: with the effect `force_scale` of all contacts alone.
        mass: kg, from elsewhere.
        std: kg of it.

    Returns:
        Gain and standard deviation by contact; 0 is right.

    Raises:
        BadInputError: the fit has another effect.
    """
    samples, effect, theta = fitted.samples[0], fitted.effects[0], fitted.theta[0]
    names, measured = samples.contact_names, fitted.phi[0] / mass
    relative, derived = effect.coefficients(samples, theta), effect.factored(samples, theta)
    if relative is None or derived is None:
        raise BadInputError(f"gains: expected a fit with force_scale, got {effect.label}")
    factors = 1.0 + relative
    total = measured / factors
    by_theta = -(total / factors)[:, None] * derived[1]
    rows = np.zeros((len(names), 10 + len(theta)))
    rows[:, 0], rows[:, 10:] = 1.0 / (factors * mass), by_theta
    spread = rows @ fitted.seen_covariance @ rows.T + np.outer(total, total) * (std / mass) ** 2
    pairs = zip(total - 1.0, np.sqrt(np.diag(spread)), strict=True)
    return {name: (float(gain), float(one)) for name, (gain, one) in zip(names, pairs, strict=True)}
