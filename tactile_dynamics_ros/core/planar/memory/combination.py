"""An estimate of a pushed object together with what earlier recordings told of it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtrc

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.planar.known import KnownPushed
from tactile_dynamics_ros.core.planar.properties.estimate import PushedEstimate

_CHANGED = 1e-4
"""Probability, of an object that is the same on the same table, below which it is said to have
changed, as for held objects: one recording in three thousand is doubted by chance."""
_GROUPS = {"friction force": [0], "mass": [1], "centre of mass": [2, 3]}
"""What is compared, each with a test of its own, as rows of KNOWN_NAMES; fixed by their order."""
_TELLS = ("friction_force_n", "mass", "com", "com")
"""Names in `undetermined` by which each of KNOWN_NAMES is not told; fixed by the estimate."""


def known_of(found: PushedEstimate, name: str, recordings: int = 1) -> KnownPushed:
    """What an estimate leaves for later ones.

    Args:
        found: the estimate.
        name: where it comes from.
        recordings: that are in it.
    """
    return KnownPushed(_values(found), found.covariance, name, found.undetermined, recordings)


def with_memory(found: PushedEstimate, known: KnownPushed) -> tuple[PushedEstimate, list[str]]:
    """Combine an estimate with an earlier one, unless something differs beyond chance.

    Information of what each tells is added up; what neither tells stays undetermined, with the
    uncertainty that it has. Friction is that of the table: on another one it differs.

    Returns:
        The estimate, combined if nothing differs; what differs.
    """
    tells, told = _told(found.undetermined), _told(known.undetermined)
    changed = _changed(found, known, tells & told)
    if changed:
        return found, changed
    first, second = _information(found.covariance, tells), _information(known.covariance, told)
    rest = np.diag(np.where(tells | told, 0.0, 1.0 / np.diag(found.covariance)))
    covariance = np.linalg.inv(first + second + rest)
    values = covariance @ (first @ _values(found) + second @ known.values + rest @ _values(found))
    return _combined(found, values, 0.5 * (covariance + covariance.T), tells | told), []


def _values(found: PushedEstimate) -> Array:
    v = found.values
    return np.array(
        [
            np.log(v["friction_force_n"][0]),
            np.log(v["mass"][0]),
            v["com_x"][0],
            v["com_y"][0],
        ]
    )


def _told(undetermined: tuple[str, ...]) -> NDArray[np.bool_]:
    return np.array([name not in undetermined for name in _TELLS])


def _information(covariance: Array, told: NDArray[np.bool_]) -> Array:
    """Information (4, 4) on what is reported, the rest unknown; zero elsewhere."""
    found, rows = np.zeros((4, 4)), np.flatnonzero(told)
    found[np.ix_(rows, rows)] = np.linalg.inv(covariance[np.ix_(rows, rows)])
    return found


def _changed(found: PushedEstimate, known: KnownPushed, both: NDArray[np.bool_]) -> list[str]:
    """Groups that both tell, and that differ beyond chance."""
    apart, spread = _values(found) - known.values, found.covariance + known.covariance
    names = []
    for name, rows in _GROUPS.items():
        if both[rows].all():
            square = apart[rows] @ np.linalg.solve(spread[np.ix_(rows, rows)], apart[rows])
            names += [name] * bool(chdtrc(len(rows), float(square)) < _CHANGED)
    return names


def _combined(
    found: PushedEstimate, values: Array, covariance: Array, told: NDArray[np.bool_]
) -> PushedEstimate:
    """The estimate with other values of the four, and what follows from them."""
    std = np.sqrt(np.diag(covariance))
    force, mass = np.exp(values[:2])
    was = found.values
    friction = was["friction"][0] * (force / was["friction_force_n"][0]) / (mass / was["mass"][0])
    ratio = max(covariance[0, 0] + covariance[1, 1] - 2.0 * covariance[0, 1], 0.0)
    changed = {
        "mass": (mass, mass * std[1]),
        "friction": (friction, friction * np.sqrt(ratio)),
        "friction_force_n": (force, force * std[0]),
        "com_x": (values[2], std[2]),
        "com_y": (values[3], std[3]),
    }
    plain = {name: (float(value), float(spread)) for name, (value, spread) in changed.items()}
    unknown = {name for name, one in zip(_TELLS, told, strict=True) if not one}
    if unknown & {"mass", "friction_force_n"}:
        unknown.add("friction")
    kept = [n for n in found.undetermined if n in unknown or n not in (*_TELLS, "friction")]
    return replace(found, values=was | plain, covariance=covariance, undetermined=tuple(kept))
