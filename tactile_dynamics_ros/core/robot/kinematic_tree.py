"""The joints of a URDF."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from urdf_parser_py import urdf as parser
from urdf_parser_py.xml_reflection import core as reflection

from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.rigid_body.poses import pose_of
from tactile_dynamics_ros.core.rigid_body.rotation import exp_so3
from tactile_dynamics_ros.core.robot.robot import Joint

Array = NDArray[np.float64]

_TURNING, _SLIDING = ("revolute", "continuous"), ("prismatic",)
"""Types of joints in a URDF that move along or about one axis; one that moves otherwise (planar,
floating) has no single position and is refused."""
_FULL_TURN = 2.0 * np.pi
"""Limit of a joint without end, rad, either way: encoders that count turns begin within one. A
smaller one would keep such a joint from places that it can reach."""


def parse_urdf(urdf: str) -> Any:
    """Return the model of a URDF's text, whatever else for simulators is in it."""
    reflection.on_error = lambda message: None  # told of unknown tags
    return parser.URDF.from_xml_string(urdf.encode())


def read_tree(urdf: str, what: str) -> tuple[Joint, ...]:
    """Return the joints of a URDF, parents first.

    Args:
        urdf: text of a URDF.
        what: named in errors: file or topic.

    Raises:
        BadInputError: it is no URDF, or has a joint of another kind.
    """
    try:
        joints = {joint.child: _joint(joint) for joint in parse_urdf(urdf).joints}
    except BadInputError as error:
        raise BadInputError(f"{what}: {error}") from error
    except Exception as error:  # the parser raises whatever lxml and its assertions do
        raise BadInputError(f"{what}: no URDF ({error})") from error
    return tuple(_parents_first(joints))


def chain(tree: Sequence[Joint], base: str, link: str) -> list[Joint]:
    """Return the joints from one link to another that it carries.

    Raises:
        BadInputError: the link does not exist, or is not carried by the base.
    """
    by_child = {joint.child: joint for joint in tree}
    found: list[Joint] = []
    while link != base:
        if link not in by_child:
            where = found[0].child if found else link
            raise BadInputError(f"no joints lead from link '{base}' to link '{where}'")
        found.insert(0, by_child[link])
        link = by_child[link].parent
    return found


def placed(joint: Joint, position: float) -> Array:
    """Return the pose (4, 4) of a joint's child in its parent.

    Args:
        joint: that moves or is fixed.
        position: rad, or m if it slides.
    """
    if joint.axis is None:
        return joint.origin
    moved = np.eye(4)
    if joint.slides:
        moved[:3, 3] = position * joint.axis
    else:
        moved[:3, :3] = exp_so3(position * joint.axis)
    return np.asarray(joint.origin @ moved)


def mimicked(urdf: str) -> dict[str, tuple[str, float, float]]:
    """Return, for each joint that follows another one, its name, factor and offset."""
    return {
        joint.name: (joint.mimic.joint, *_line(joint.mimic))
        for joint in parse_urdf(urdf).joints
        if joint.mimic is not None
    }


def _line(mimic: Any) -> tuple[float, float]:
    """Return factor and offset of a mimic tag, 1 and 0 where it says nothing."""
    factor = 1.0 if mimic.multiplier is None else float(mimic.multiplier)
    return factor, float(mimic.offset or 0.0)


def _joint(given: Any) -> Joint:
    turning, sliding = given.type in _TURNING, given.type in _SLIDING
    if given.type != "fixed" and not turning and not sliding:
        raise BadInputError(
            f"joint {given.name}: type {given.type}, expected one of fixed, revolute, continuous, "
            "prismatic"
        )
    pose = given.origin
    origin = np.eye(4) if pose is None else pose_of(pose.xyz or (0, 0, 0), pose.rpy or (0, 0, 0))
    if not (turning or sliding):
        return Joint(given.name, given.parent, given.child, origin)
    axis = np.array(given.axis or (1.0, 0.0, 0.0), dtype=float)
    endless, limit = given.type == "continuous", given.limit
    return Joint(
        given.name,
        given.parent,
        given.child,
        origin,
        axis / np.linalg.norm(axis),
        sliding,
        -_FULL_TURN if endless else float(limit.lower or 0.0),
        _FULL_TURN if endless else float(limit.upper or 0.0),
        effort=0.0 if limit is None else float(limit.effort),
        velocity=0.0 if limit is None else float(limit.velocity),
    )


def _parents_first(by_child: dict[str, Joint]) -> Iterator[Joint]:
    """Yield joints so that each comes after the one that carries its parent."""
    done: set[str] = set()
    for child in by_child:
        waiting = []
        while child in by_child and child not in done:
            waiting.append(by_child[child])
            done.add(child)
            child = by_child[child].parent
        yield from reversed(waiting)


def refuse_shared(joints: Sequence[Sequence[Joint]]) -> None:
    """Check that no joint moves two fingers.

    Raises:
        BadInputError: names one that does.
    """
    for first, second in itertools.combinations(joints, 2):
        shared = {joint.name for joint in first} & {joint.name for joint in second}
        if shared:
            raise BadInputError(f"joint {min(shared)} moves two fingers; make it the palm's")
