"""The joints of a URDF."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any
from xml.etree import ElementTree

import numpy as np
from urdf_parser_py import urdf as parser
from urdf_parser_py.xml_reflection import core as reflection

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.rigid_body.rotation import exp_so3, pose_of
from tactile_dynamics_ros.core.robot.robot import Following, Joint

_TURNING, _SLIDING = ("revolute", "continuous"), ("prismatic",)
"""Types of joints in a URDF that move along or about one axis; one that moves otherwise (planar,
floating) has no single position and is refused."""
_NEEDED = {
    "link": ("inertial", "visual", "collision"),
    "joint": ("parent", "child", "origin", "axis", "limit", "mimic"),
    "material": ("color", "texture"),
}
"""Elements of a URDF that say how a robot is built, and what is read in them. Others (transmission,
gazebo, ros2_control, safety_controller) are for drives and simulators, which read them; a robot
would be refused for a slip in them."""
_FULL_TURN = 2.0 * np.pi
"""Limit of a joint without end, rad, either way: encoders that count turns begin within one. A
smaller one would keep such a joint from places that it can reach."""


def parse_urdf(urdf: str) -> Any:
    """Return links and joints of a URDF's text; what drives or simulates them is not looked at."""
    root = ElementTree.fromstring(urdf)
    for element in list(root):
        if element.tag not in _NEEDED:
            root.remove(element)
            continue
        for part in [one for one in element if one.tag not in _NEEDED[element.tag]]:
            element.remove(part)
    reflection.on_error = lambda message: None  # told of unknown tags
    return parser.URDF.from_xml_string(ElementTree.tostring(root))


def read_tree(urdf: str, what: str) -> tuple[Joint, ...]:
    """Return the joints of a URDF, parents first.

    Args:
        urdf: text of a URDF.
        what: named in errors: file or topic.

    Raises:
        BadInputError: it is no URDF, has a joint of another kind, or one that mimics none.
    """
    try:
        given = {joint.name: joint for joint in parse_urdf(urdf).joints}
        by_name = {name: _joint(joint) for name, joint in given.items()}
        joints = {j.child: _with_leader(j, given, by_name) for j in by_name.values()}
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


def carried(
    tree: Sequence[Joint], joints: Sequence[Joint], rest: Callable[[Joint], float]
) -> dict[str, tuple[int, Array]]:
    """Return for every link the body that it moves with, and its pose (4, 4) in that.

    Body 0 is what stands still, in the frame of the root; body k is what the kth of the joints
    moves, in the frame of that joint's child.

    Args:
        tree: all joints, parents first.
        joints: that move; the others rest.
        rest: position of a joint that rests, rad or m.
    """
    bodies = {joint.name: k for k, joint in enumerate(joints, start=1)}
    children = {joint.child for joint in tree}
    found: dict[str, tuple[int, Array]] = {
        joint.parent: (0, np.eye(4)) for joint in tree if joint.parent not in children
    }
    for joint in tree:
        body, pose = found[joint.parent]
        if joint.name in bodies:
            found[joint.child] = bodies[joint.name], np.eye(4)
        else:
            found[joint.child] = body, pose @ placed(joint, rest(joint))
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


def position_of(joint: Joint, positions: Mapping[str, Any]) -> Any:
    """Return the position of a joint; that of one that follows another may be left out.

    Args:
        joint: that moves.
        positions: of joints by their names, rad or m, each a number or an array.

    Raises:
        KeyError: neither it nor the joint that it follows has a position.
    """
    if joint.follows is None or joint.name in positions:
        return positions[joint.name]
    return joint.follows.factor * positions[joint.follows.leader] + joint.follows.offset


def independent(joints: Sequence[Joint]) -> list[Joint]:
    """Return the joints that move and whose position does not follow from another one of them."""
    moving = [joint for joint in joints if joint.axis is not None]
    names = {joint.name for joint in moving}
    return [joint for joint in moving if joint.follows is None or joint.follows.leader not in names]


def coupling(joints: Sequence[Joint]) -> tuple[Array, Array]:
    """Return how positions of joints (K,) follow from those of them that are free.

    q = C q_free + b. Of joints that follow the same one, the first is free. Columns of C that
    belong to other joints are zero.

    Returns:
        C (K, K) and b (K,).
    """
    matrix, offset = np.zeros((len(joints), len(joints))), np.zeros(len(joints))
    follows = [joint.follows or Following(joint.name) for joint in joints]
    for k, own in enumerate(follows):
        first = next(i for i, other in enumerate(follows) if other.leader == own.leader)
        matrix[k, first] = own.factor / follows[first].factor
        offset[k] = own.offset - matrix[k, first] * follows[first].offset
    return matrix, offset


def _with_leader(joint: Joint, given: Mapping[str, Any], by_name: Mapping[str, Joint]) -> Joint:
    """Return a joint; one that mimics another has the limits that this one gives it.

    Args:
        joint: without what it follows.
        given: joints of the URDF by name.
        by_name: the same joints as they were read.
    """
    follows = _leader(joint.name, given)
    leader = by_name[follows.leader]
    if leader is joint or joint.axis is None:
        return joint
    ends = sorted(follows.factor * end + follows.offset for end in (leader.lower, leader.upper))
    return replace(
        joint,
        follows=follows,
        lower=ends[0],
        upper=ends[1],
        effort=joint.effort or leader.effort,
        velocity=joint.velocity or abs(follows.factor) * leader.velocity,
    )


def _leader(name: str, given: Mapping[str, Any]) -> Following:
    """Return the joint, moving by itself, that one follows in the end: itself if it follows none.

    Raises:
        BadInputError: what is to be followed is not there, or follows this one.
    """
    found, met = Following(name), {name}
    while (mimic := given[found.leader].mimic) is not None:
        factor = 1.0 if mimic.multiplier is None else float(mimic.multiplier)
        if mimic.joint not in given or mimic.joint in met or factor == 0.0:
            raise BadInputError(
                f"joint {found.leader}: mimic of '{mimic.joint}' with multiplier {factor:g}, "
                "expected another joint that moves by itself, and a multiplier unlike 0"
            )
        met.add(mimic.joint)
        offset = found.factor * float(mimic.offset or 0.0) + found.offset
        found = Following(mimic.joint, found.factor * factor, offset)
    return found


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
    if limit is None and not endless and given.mimic is None:
        raise BadInputError(f"joint {given.name}: no limit, expected one as it is {given.type}")
    lower, upper = (0.0, 0.0) if limit is None else (limit.lower or 0.0, limit.upper or 0.0)
    return Joint(
        given.name,
        given.parent,
        given.child,
        origin,
        axis / np.linalg.norm(axis),
        sliding,
        -_FULL_TURN if endless else float(lower),
        _FULL_TURN if endless else float(upper),
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
