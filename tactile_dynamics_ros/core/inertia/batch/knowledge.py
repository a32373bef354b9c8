"""An estimate together with what is known beforehand: without a tool, or with an earlier grasp."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np
from scipy.optimize import least_squares
from scipy.special import chdtrc

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.discrepancy.verdict.wording import write_interval
from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.inertia.batch.inertial_estimate import (
    PARAMETER_NAMES,
    InertialEstimate,
)
from tactile_dynamics_ros.core.rigid_body.inertial_parameters import (
    InertialParameters,
    KnownBody,
    com_inertia_jacobian,
    dynamic_parameters_from_log_cholesky,
    inertia_vector,
    log_cholesky,
    log_cholesky_jacobian,
    pseudo_inertia,
)

Estimate = TypeVar("Estimate", bound=InertialEstimate)

_CHANGED = 1e-4
"""Probability, of an object that is the same, below which it is said to have changed. One grasp in
three thousand is doubted by chance (three tests); at 1e-2 one in thirty, and at 1e-8 a sip of water
is averaged away."""
_CANNOT_BE = 1e-6
"""Probability, of a body that can exist, below which a rest that cannot is refused: the tool is not
the one that was carried. Nearer to 1 refuses light loads beside heavy tools by chance."""
_LEAST = 1e-6
"""Smallest eigenvalue of the pseudo-inertia, over the largest, from which the search for a body
that can exist begins. It moves the start only; at 0 there is no logarithm to begin with."""
_STEPS = 60
"""Steps of that search at most: the nearest body may be flat, whose logarithms lie at infinity, and
steps towards it go on for ever while nothing changes. Fewer end before ordinary ones do (20)."""
_SETTLED = 1e-4
"""Relative fall of the squared distance below which the search ends: it is a few units, of which a
ten-thousandth is nothing. Smaller costs steps, larger stops beside the nearest body."""
_LOST = 1e-10
"""Smallest eigenvalue of a covariance with unit diagonal, over its largest, that is believed.
Rounding moves them by 1e-12 (live estimates of a grasp's first second, some below zero); larger
would widen what is measured well beside what is not."""
_GROUPS = {"mass": slice(0, 1), "centre of mass": slice(1, 4), "inertia": slice(4, 10)}
"""What is compared with an earlier grasp, each with a test of its own, so that a change of mass is
not diluted by nine others. Fixed by the order of PARAMETER_NAMES."""


@dataclass(frozen=True)
class Comparison:
    """An estimate compared with an earlier one of what may be the same object.

    Attributes:
        p_value: by group, the probability of such a difference if nothing changed.
    """

    p_value: dict[str, float]

    @property
    def changed(self) -> list[str]:
        """Groups that differ beyond chance."""
        return [name for name, p in self.p_value.items() if p < _CHANGED]


def without_tool(estimate: Estimate, tool: KnownBody, same_sensor: bool = False) -> Estimate:
    """Take a tool's share out of the estimate of tool and load together.

    phi is linear in the bodies that move as one: phi_load = phi - phi_tool, with the sum of the
    covariances. A rest that cannot exist is moved to the nearest body that can, in that covariance,
    and its inertia is undetermined.

    Args:
        estimate: of tool and load, in the frame of the tool.
        tool: known.
        same_sensor: whether one sensor has measured both, so that its gain errs alike: of its
            lasting errors the load's share remains.

    Raises:
        BadInputError: no body that can exist is left.
    """
    covariance = estimate.covariance + tool.covariance
    rest = estimate.inertia.dynamic_parameters - tool.phi
    if same_sensor and estimate.lasting is not None and tool.lasting is not None:
        share = rest[0] / estimate.inertia.mass
        covariance = covariance - tool.lasting - (1.0 - share**2) * estimate.lasting
    body, distance = nearest_body(rest, covariance)
    if chdtrc(10, distance) < _CANNOT_BE:
        raise BadInputError(
            f"tool {tool.name}: {tool.phi[0]:.3g} kg cannot be part of what was carried "
            f"({estimate.inertia.mass:.3g} kg); expected its inertia in the frame of the object's "
            "pose"
        )
    unknown = {*estimate.not_excited, *tool.undetermined, *larger_than_body(body, covariance)}
    if distance > 0.0:
        unknown |= set(PARAMETER_NAMES[4:])
    return _with_body(estimate, body, covariance, unknown)


def with_memory(
    estimate: InertialEstimate, known: KnownBody
) -> tuple[InertialEstimate, Comparison]:
    """Combine an estimate with an earlier one, unless the object has changed.

    Both are independent but for their weak priors: what neither tells stays undetermined. With
    information L = C^-1: C = (L_1 + L_2)^-1, phi = C (L_1 phi_1 + L_2 phi_2); changed if
    (y_1 - y_2)^T (C_1 + C_2)^-1 (y_1 - y_2) is large, y mass, centre of mass or inertia.

    Returns:
        The estimate, combined if nothing has changed; how they compare.
    """
    comparison = _compare(estimate, known)
    if comparison.changed:
        return estimate, comparison
    covariances = (estimate.covariance, known.covariance)
    if known.is_exact:
        return estimate, comparison
    first, second = (root.T @ root for root in map(whitening, covariances))
    covariance = np.linalg.inv(first + second)
    covariance = 0.5 * (covariance + covariance.T)
    phi = covariance @ (first @ estimate.inertia.dynamic_parameters + second @ known.phi)
    body, _ = nearest_body(phi, covariance)
    unknown = set(estimate.not_excited) & set(known.undetermined)
    return _with_body(estimate, body, covariance, unknown), comparison


def beside_rivals(
    estimate: InertialEstimate, rivals: Sequence[InertialEstimate]
) -> InertialEstimate:
    """Widen an estimate by those with other effects, which the data cannot tell from its own.

    C + sum d d^T, d = phi_rival - phi: the body of a rival is as likely, and so lies within one
    standard deviation.

    Args:
        estimate: with the effects that are named.
        rivals: with another effect in the place of one of them.
    """
    away = [
        rival.inertia.dynamic_parameters - estimate.inertia.dynamic_parameters for rival in rivals
    ]
    spread = sum((np.outer(d, d) for d in away), start=np.zeros((10, 10)))
    return replace(estimate, covariance=estimate.covariance + spread)


def say_rivals(
    estimate: InertialEstimate, chosen: str, rivals: Mapping[str, InertialEstimate]
) -> str:
    """The mass by each effect that cannot be told from the chosen one, as a sentence.

    Args:
        estimate: with the chosen effects, before it was widened.
        chosen: their names, as people read them.
        rivals: estimates by the name of the effect in the place of one of them.
    """
    masses = {chosen: estimate} | dict(rivals)
    parts = [
        f"{write_interval(one.inertia.mass, float(one.parameter_std[0]))} kg with {name}"
        for name, one in masses.items()
    ]
    return f"The mass is {' or '.join(parts)}; intervals hold all of them."


def nearest_body(phi: Array, covariance: Array) -> tuple[InertialParameters, float]:
    """Find the body that can exist nearest to dynamic parameters, in their covariance.

    Args:
        phi: (10,), which may be no body's.
        covariance: (10, 10) of phi.

    Returns:
        The body, and the square of its distance in standard deviations; phi itself and 0 if it is a
        body's.
    """
    values, vectors = np.linalg.eigh(pseudo_inertia(phi))
    if values[0] > 0.0:
        return InertialParameters.from_dynamic_parameters(phi), 0.0
    least = _LEAST * float(np.abs(values).max())
    lifted = vectors * np.maximum(values, least) @ vectors.T
    start = log_cholesky(lifted)
    white = whitening(covariance)
    found = least_squares(
        lambda xi: white @ (dynamic_parameters_from_log_cholesky(xi) - phi),
        start,
        jac=lambda xi: white @ log_cholesky_jacobian(xi),
        max_nfev=_STEPS,
        ftol=_SETTLED,
    )
    return InertialParameters.from_log_cholesky(found.x), float(2.0 * found.cost)


def whitening(covariance: Array) -> Array:
    """Matrix W (n, n) with W C W^T = I; along directions whose variance is lost, the least one.

    Covariances of a body that is almost flat, as in the first second of a grasp, have eigenvalues
    that rounding makes zero or negative.
    """
    scale = np.sqrt(np.diag(covariance))
    values, vectors = np.linalg.eigh(covariance / np.outer(scale, scale))
    root = np.sqrt(np.maximum(values, _LOST * values[-1]))
    return np.asarray(vectors.T / root[:, None] / scale)


def _compare(estimate: InertialEstimate, known: KnownBody) -> Comparison:
    """Compare mass, centre of mass and inertia, each with all that widens it."""
    before = InertialParameters.from_dynamic_parameters(known.phi)
    to_com = com_inertia_jacobian(known.phi)
    covariance = estimate.parameter_covariance + to_com @ known.covariance @ to_com.T
    apart = _ten(estimate.inertia) - _ten(before)
    p_value = {}
    for name, rows in _GROUPS.items():
        white = whitening(covariance[rows, rows]) @ apart[rows]
        p_value[name] = float(chdtrc(len(white), float(white @ white)))
    return Comparison(p_value)


def larger_than_body(body: InertialParameters, covariance: Array) -> list[str]:
    """Names of mass and moments whose standard deviation is larger than they are."""
    to_com = com_inertia_jacobian(body.dynamic_parameters)
    std = np.sqrt(np.diag(to_com @ covariance @ to_com.T))
    radii = np.sqrt(np.diag(body.inertia_com))
    sizes = np.concatenate(
        [[body.mass], np.full(3, np.inf), inertia_vector(np.outer(radii, radii))]
    )
    return [name for name, one, size in zip(PARAMETER_NAMES, std, sizes, strict=True) if one > size]


def _with_body(
    estimate: Estimate, body: InertialParameters, covariance: Array, unknown: set[str]
) -> Estimate:
    names = tuple(name for name in PARAMETER_NAMES if name in unknown)
    return replace(estimate, inertia=body, covariance=covariance, not_excited=names, lasting=None)


def _ten(body: InertialParameters) -> Array:
    return np.concatenate([[body.mass], body.com, inertia_vector(body.inertia_com)])
