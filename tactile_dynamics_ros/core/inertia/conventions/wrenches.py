"""Readings of forces and torques: sign, unit, axes."""

from __future__ import annotations

from functools import partial
from itertools import permutations, product, zip_longest

import numpy as np
from scipy.constants import inch, kgf, lbf

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.inertia.conventions.reading import (
    Reading,
    axes_of,
    moved_axes,
    scaled_wrenches,
    turned_world,
    turned_wrenches,
)
from tactile_dynamics_ros.core.streams.streams import Streams

_FORCE_UNITS = {
    "kgf": kgf,
    "mN": 1e-3,
    "gf": 1e-3 * kgf,
    "lbf": lbf,
    "kN": 1e3,
    "cN": 1e-2,
    "ozf": lbf / 16.0,
}
"""Newton per unit that force sensors report, the commonest first. They are definitions; a unit that
is missing here is not found, each costs one reading to be weighed."""
_TORQUE_UNITS = {
    "N mm": 1e-3,
    "N cm": 1e-2,
    "kgf cm": 1e-2 * kgf,
    "kgf m": kgf,
    "kgf mm": 1e-3 * kgf,
    "lbf in": lbf * inch,
    "lbf ft": 12.0 * lbf * inch,
    "ozf in": lbf / 16.0 * inch,
    "gf cm": 1e-5 * kgf,
}
"""Newton metres per unit that torque sensors report, the commonest first. They are definitions; a
unit that is missing here is not found, each costs one reading to be weighed."""
_ALIKE = 1e-6
"""Difference of the entries of rotation matrices up to which two frames are the same: rounding. An
axis that is put on another one changes entries by 1; at 1e-2 and more frames that differ by half a
degree count as one, at 0 equal frames are read twice, at twice the time."""


def signed_permutations(determinant: float) -> list[Array]:
    """The 24 rotations (determinant 1) or mirrors (-1) that put axes on axes."""
    found = [
        np.diag(signs)[list(order)]
        for order in permutations(range(3))
        for signs in product((1.0, -1.0), repeat=3)
    ]
    return [matrix for matrix in found if np.linalg.det(matrix) * determinant > 0.0]


def describe_axes(matrix: Array) -> str:
    """``(y, -x, z)``: which recorded axes are x, y and z."""
    letters = []
    for row in matrix:
        column = int(np.argmax(np.abs(row)))
        letters.append(("-" if row[column] < 0 else "") + "xyz"[column])
    return f"({', '.join(letters)})"


def wrench_readings(streams: Streams) -> list[Reading]:
    """Readings of signs, units and axes of the contacts of a recording."""
    torque = any(contact.carries_torque for contact in streams.contacts.values())
    found = [
        Reading(
            "force_sign",
            "negate forces and torques: they are those of the object on the sensor"
            if torque
            else "negate forces: they are those of the object on the fingers",
            partial(scaled_wrenches, force=-1.0, torque=-1.0),
        )
    ]
    if torque:
        found += _of_torques()
    for frame in _frames(streams):
        found += _axes(frame, torque)
    return found + _world(streams)


def _of_torques() -> list[Reading]:
    found = [
        Reading("force_sign", "negate forces", partial(scaled_wrenches, force=-1.0, torque=1.0)),
        Reading("torque_sign", "negate torques", partial(scaled_wrenches, force=1.0, torque=-1.0)),
    ]
    forces = [
        Reading(
            "force_unit",
            f"forces are in {unit}, not N",
            partial(scaled_wrenches, force=size, torque=1.0),
        )
        for unit, size in _FORCE_UNITS.items()
    ]
    torques = [
        Reading(
            "torque_unit",
            f"torques are in {unit}, not N m",
            partial(scaled_wrenches, force=1.0, torque=size),
        )
        for unit, size in _TORQUE_UNITS.items()
    ]
    negated = [
        Reading(
            "torque_unit",
            f"torques are in {unit}, not N m, and negated",
            partial(scaled_wrenches, force=1.0, torque=-size),
        )
        for unit, size in _TORQUE_UNITS.items()
    ]
    in_turn = [one for pair in zip_longest(torques, forces) for one in pair if one is not None]
    return found + in_turn + negated


def _frames(streams: Streams) -> list[str]:
    """Frames whose axes are sensors': those of contacts, and of the body where they differ."""
    differ = any(
        not np.allclose(axes_of(streams, c, "sensor"), axes_of(streams, c, "body"), atol=_ALIKE)
        for c in streams.contacts.values()
    )
    return ["sensor", "body"] if differ else ["sensor"]


def _axes(frame: str, torque: bool) -> list[Reading]:
    """Axes of the sensors in another order or mirrored."""
    found = []
    for matrix in signed_permutations(1.0):
        if np.trace(matrix) < 2.5:
            text = f"x, y, z of the {frame} axes are the recorded {describe_axes(matrix)}"
            apply = partial(turned_wrenches, frame=frame, by_force=matrix)
            found.append(Reading("sensor_axes", text, apply))
    for matrix in signed_permutations(-1.0):
        if np.trace(matrix) < -2.5:
            continue
        text = f"x, y, z of the {frame} axes are the recorded {describe_axes(matrix)}, mirrored"
        apply = partial(turned_wrenches, frame=frame, by_force=matrix)
        found.append(Reading("mirrored_axes", text, apply))
        if torque:
            other = partial(turned_wrenches, frame=frame, by_force=matrix, by_torque=-matrix)
            found.append(Reading("mirrored_axes", f"{text}, torques of the other hand", other))
    return found + (_mirrored_alone(frame) if torque else [])


def _mirrored_alone(frame: str) -> list[Reading]:
    """One axis of the forces or of the torques alone points the other way, both negated or not."""
    found = []
    for sign, also in ((1.0, ""), (-1.0, ", all else negated")):
        for axis, letter in enumerate("xyz"):
            mirror = sign * (np.eye(3) - 2.0 * np.diag(np.eye(3)[axis]))
            for what, force, torque in (
                ("forces", mirror, sign * np.eye(3)),
                ("torques", sign * np.eye(3), mirror),
            ):
                apply = partial(turned_wrenches, frame=frame, by_force=force, by_torque=torque)
                text = f"{letter} of the {what} alone points the other way, {frame} axes{also}"
                found.append(Reading("mirrored_axes", text, apply))
    return found


def _world(streams: Streams) -> list[Reading]:
    """Sensor axes taken as the world's and the reverse; worlds of pose and forces that differ."""
    found = []
    for frame in _frames(streams):
        found += [
            Reading(
                "world_axes",
                f"forces are in {frame} axes, not in the world's",
                partial(moved_axes, frame=frame, back=False),
            ),
            Reading(
                "world_axes",
                f"forces were in world axes before they were turned from {frame} axes",
                partial(moved_axes, frame=frame, back=True),
            ),
        ]
    for matrix in signed_permutations(1.0):
        if np.trace(matrix) > 2.5:
            continue
        axes = describe_axes(matrix)
        found += [
            Reading(
                "world_axes",
                f"x, y, z of the poses' world are the forces' {axes}",
                partial(turned_wrenches, frame="world", by_force=matrix),
            ),
            Reading(
                "world_axes",
                f"x, y, z of the forces' world are the poses' {axes}",
                partial(turned_world, turn=matrix, forces=False),
            ),
        ]
    return found
