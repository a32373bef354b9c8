"""Numbers of messages of any type as columns: poses, wrenches, joints, and states of drivers."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from operator import attrgetter
from typing import Any

import numpy as np

from tactile_dynamics_ros.core.errors import BadInputError

Getter = Callable[[Any], Iterable[float]]
"""Takes the numbers of a message."""

POSE_COLUMNS = (*(f"position.{a}" for a in "xyz"), *(f"orientation.{a}" for a in "xyzw"))
"""Columns of poses and transforms."""
WRENCH_COLUMNS = (*(f"force.{a}" for a in "xyz"), *(f"torque.{a}" for a in "xyz"))
"""Columns of wrenches."""
TWIST_COLUMNS = (*(f"linear.{a}" for a in "xyz"), *(f"angular.{a}" for a in "xyz"))
"""Columns of twists, as which some drivers of force sensors publish wrenches too."""
_KINDS: tuple[tuple[str, str, tuple[str, ...]], ...] = (
    ("force", "torque", WRENCH_COLUMNS),
    ("position", "orientation", POSE_COLUMNS),
    ("translation", "rotation", POSE_COLUMNS),
    ("linear", "angular", TWIST_COLUMNS),
)
"""The two members of a vector kind of geometry_msgs, and its columns."""
_WRAPPED = ("wrench", "pose", "transform", "twist")
"""Members that hold one of these in a stamped message; of odometry it is the pose."""
_LONGEST = 64
"""Numbers of an array that become columns: matrices have 16, covariances 36, clouds thousands."""
_DEEPEST = 5
"""Levels of messages within messages that are looked into; drivers nest three."""


def columns_of(message: Any) -> tuple[tuple[str, ...], Getter]:
    """Return the names of a message's numbers, and what takes them from messages alike.

    Poses, wrenches, twists and joint states have plain names; the numbers of other types are named
    by their path, as `o_t_ee.position.x` or `data.3`; those of an array are 0, 1, ...
    """
    if isinstance(message, np.ndarray):
        return tuple(str(k) for k in range(message.size)), lambda one: np.ravel(one).tolist()
    parts = _parts(message, "", 0)
    names = tuple(name for part in parts for name in part[0])
    getters = [part[1] for part in parts]
    return names, lambda one: [float(number) for get in getters for number in get(one)]


def joints_of(message: Any) -> tuple[str, ...]:
    """Return the names of the joints of a joint state, in order; none of another message."""
    known = hasattr(message, "name") and hasattr(message, "position")
    return tuple(sorted(map(str, message.name))) if known and len(message.position) else ()


def _by_name(path: str, joints: Sequence[str]) -> Getter:
    """Return what takes the positions of joints, in whatever order messages have them."""
    get = attrgetter(path) if path else lambda message: message

    def positions(message: Any) -> list[float]:
        state = get(message)
        at = dict(zip(map(str, state.name), state.position, strict=False))
        return [at.get(name, float("nan")) for name in joints]

    return positions


def member_of(message: Any, field: str) -> Any:
    """Return the part of a message at a path such as `state.o_t_ee`; all of it for "".

    Raises:
        BadInputError: it has none there.
    """
    for name in filter(None, field.split(".")):
        known = [key for key in getattr(message, "__dataclass_fields__", {}) if key[:2] != "__"]
        if name not in known:
            raise BadInputError(f"no field '{name}'; it has {', '.join(known) or 'none'}")
        message = getattr(message, name)
    return message


def _parts(message: Any, path: str, depth: int) -> list[tuple[Sequence[str], Getter]]:
    """Return names and getters of a message and of those in it."""
    vectors = _vectors(message)
    if vectors is not None:
        inside, names = vectors
        own = [".".join(filter(None, (path, member))) for member in inside]
        return [([_joined(path, name) for name in names], attrgetter(*own))]
    if joints := joints_of(message):
        return [([_joined(path, name) for name in joints], _by_name(path, joints))]
    found = []
    for key in getattr(message, "__dataclass_fields__", {}):
        if not key.startswith("__") and key not in ("header", "layout", "stamp"):
            found += _member_parts(getattr(message, key), _joined(path, key), depth)
    return found


def _member_parts(value: Any, path: str, depth: int) -> list[tuple[Sequence[str], Getter]]:
    """Return names and getters of one member: a number, an array, or a message."""
    if isinstance(value, bool | int | float | np.number):
        get = attrgetter(path)
        return [([path], lambda message: (get(message),))]
    if isinstance(value, np.ndarray):
        flat = value.ravel()
        if flat.dtype.kind not in "fiub" or not 0 < len(flat) <= _LONGEST:
            return []
        return [([f"{path}.{k}" for k in range(len(flat))], _member(path))]
    if hasattr(value, "__dataclass_fields__") and depth < _DEEPEST:
        return _parts(value, path, depth + 1)
    return []


def _vectors(message: Any) -> tuple[list[str], tuple[str, ...]] | None:
    """Return the paths of six or seven components of a vector kind, and their columns."""
    inside, prefix = message, ""
    while wrapped := [key for key in _WRAPPED if hasattr(inside, key)]:
        if len(wrapped) > 1 and wrapped != ["pose", "twist"]:
            return None
        inside, prefix = getattr(inside, wrapped[0]), _joined(prefix, wrapped[0])
    for first, second, names in _KINDS:
        pair = (first, second)
        if all(hasattr(getattr(inside, member, None), "x") for member in pair):
            axes = "xyzw"[: len(names) - 3]
            members = [f"{first}.{a}" for a in "xyz"] + [f"{second}.{a}" for a in axes]
            return [_joined(prefix, member) for member in members], names
    return None


def _member(path: str) -> Getter:
    get = attrgetter(path)
    return lambda message: np.ravel(get(message))


def _joined(path: str, name: str) -> str:
    return f"{path}.{name}" if path else name
