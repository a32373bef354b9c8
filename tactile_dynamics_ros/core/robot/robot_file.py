"""A robot from its yaml file and its URDF."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.reading import read_text, read_yaml
from tactile_dynamics_ros.core.rigid_body.rotation import rpy_to_matrix
from tactile_dynamics_ros.core.robot.kinematic_tree import chain, coupling, read_tree, refuse_shared
from tactile_dynamics_ros.core.robot.robot import Finger, Fingertips, GraspHabit, Joint, Robot
from tactile_dynamics_ros.share import find_package_file, share_file

DEFAULT_ROBOT = "allegro_iiwa"
"""Robot of those who name none: KUKA LBR iiwa 14 with a right Allegro hand and four BioTacs, for
which the nodes' defaults, the demos and the shipped calibration are. With another default those
would not fit each other."""
DESCRIPTION_TOPICS = ("robot_description", "/robot_description")
"""Written as `urdf` in a robot's file where the robot publishes its URDF (std_msgs/String): the
first is relative to the node's namespace, as all topics of a hand, the second is not."""

_KINDS = ("biotac", "pad")
"""Kinds of fingertips whose contacts are placed: round skins that tell raw counts, and flat faces
that measure force and torque. A kind that is missing here is refused; its contacts have no
place."""
_NEEDED, _OPTIONAL = (
    {"urdf", "base", "palm", "fingertips", "fingers", "reference", "arm", "hand", "grasp"},
    {"description", "source", "flange"},
)
"""Keys of a robot's file that must, and that may, be there; another one is a slip of the pen and is
refused."""
_FINGER_NEEDED, _FINGER_OPTIONAL = (
    {"name", "sensor", "side", "seed"},
    {"link", "xyz", "rpy_deg", "lateral", "stagger", "pad", "damping"},
)
"""Keys of a finger in a robot's file that must, and that may, be there; another one is refused."""


def robot_file(name: str) -> Path:
    """Return the yaml file of a robot by its name in config/robots, or by the path of one.

    Raises:
        BadInputError: there is no such file; lists the names.
    """
    if name.endswith((".yaml", ".yml")):
        return share_file(name)
    folder = share_file(f"config/robots/{DEFAULT_ROBOT}.yaml").parent
    known = sorted(path.stem for path in folder.glob("*.yaml"))
    if name not in known:
        raise BadInputError(f"robot '{name}' is unknown: expected one of {', '.join(known)}")
    return folder / f"{name}.yaml"


def load_robot(name: str = DEFAULT_ROBOT, urdf: str | None = None) -> Robot:
    """Return a robot.

    Args:
        name: of a file in config/robots, or the path of a yaml file.
        urdf: text of its URDF where the file says that the robot publishes it.

    Raises:
        BadInputError: a file is missing or says something else than a robot; tells which key.
    """
    return _load(robot_file(name), urdf)


def description_topic(name: str) -> str | None:
    """Return the topic on which a robot's URDF is to be heard; None if its file names a file."""
    topic = str(_read_yaml(robot_file(name))["urdf"])
    return topic if topic in DESCRIPTION_TOPICS else None


@lru_cache(maxsize=16)
def _load(path: Path, urdf: str | None) -> Robot:
    values = _read_yaml(path)
    text, folder = _urdf_of(path, str(values["urdf"]), urdf)
    try:
        return _build(path, values, text, folder)
    except BadInputError as error:
        raise BadInputError(f"{path}: {error}") from error
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise BadInputError(f"{path}: {error!r}; compare with a file of config/robots") from error


def _read_yaml(path: Path) -> dict[str, Any]:
    values = read_yaml(path, "a yaml file of a robot")
    if not isinstance(values, dict):
        raise BadInputError(f"{path}: expected the keys of a robot: {', '.join(sorted(_NEEDED))}")
    _check_keys(str(path), values, _NEEDED, _OPTIONAL)
    return values


def _check_keys(
    what: str, found: Mapping[str, Any], needed: set[str], optional: set[str] | None = None
) -> None:
    missing = sorted(needed - set(found))
    unknown = sorted(set(found) - needed - (optional or set()))
    if missing or unknown:
        raise BadInputError(f"{what}: missing keys {missing}, unknown keys {unknown}")


def _urdf_of(path: Path, name: str, given: str | None) -> tuple[str, str]:
    """Return the text of the URDF and the folder of its relative files."""
    if given is not None:
        return given, ""
    if name in DESCRIPTION_TOPICS:
        raise BadInputError(
            f"{path}: the URDF is published on {name}, which only nodes hear; "
            "name a file under urdf"
        )
    file = find_package_file(name, path.parent)
    if file is None:
        raise BadInputError(f"{path}: urdf: there is no file '{name}'")
    return read_text(file, "a URDF"), str(file.parent)


def _build(path: Path, values: Mapping[str, Any], urdf: str, folder: str) -> Robot:
    for entry in values["fingers"]:
        _check_keys(f"finger {entry.get('name')}", entry, _FINGER_NEEDED, _FINGER_OPTIONAL)
    urdf = _with_sensors(urdf, values["fingers"])
    tree = read_tree(urdf, str(values["urdf"]))
    base, palm = str(values["base"]), str(values["palm"])
    arm = tuple(joint for joint in chain(tree, base, palm) if joint.axis is not None)
    coupled = [joint.name for joint in arm if joint.follows is not None]
    if coupled:
        raise BadInputError(
            f"joint {coupled[0]} of the arm mimics another one: only joints of the hand may"
        )
    hand = tuple(_finger(entry, tree, palm, values["hand"]) for entry in values["fingers"])
    refuse_shared([finger.joints for finger in hand])
    names = [finger.name for finger in hand]
    if values["reference"] not in names or len(set(names)) != len(names):
        raise BadInputError(
            f"reference '{values['reference']}': expected one of {names}, once each"
        )
    opposed = hand[names.index(values["reference"])]
    if opposed.side != 1 or all(finger.side == 1 for finger in hand):
        raise BadInputError(f"finger {opposed.name}: side 1 is that of the reference, -1 the other")
    flange = str(values.get("flange", palm))
    chain(tree, base, flange)
    return Robot(
        name=path.stem,
        urdf=urdf,
        folder=folder,
        tree=tree,
        base=base,
        flange=flange,
        palm=palm,
        arm=arm,
        hand=hand,
        reference=str(values["reference"]),
        tips=_fingertips(values["fingertips"]),
        home=_numbers("arm: home", values["arm"]["home"], len(arm)),
        carry=_numbers("arm: carry", values["arm"]["carry"], len(arm)),
        arm_radius=float(values["arm"]["radius"]),
        arm_resolution=float(values["arm"]["resolution"]),
        hand_resolution=float(values["hand"]["resolution"]),
        grasp=_habit(values["grasp"]),
    )


def _numbers(what: str, given: Sequence[float] | float, count: int) -> Array:
    values = np.array(given, dtype=float)
    if values.shape == ():
        values = np.full(count, float(values))
    if values.shape != (count,):
        raise BadInputError(f"{what}: {values.size} numbers, expected {count}, one for each joint")
    return values


def _fingertips(values: Mapping[str, Any]) -> Fingertips:
    _check_keys("fingertips", values, {"kind", "radius"})
    if values["kind"] not in _KINDS:
        raise BadInputError(f"fingertips: kind '{values['kind']}', expected {' or '.join(_KINDS)}")
    return Fingertips(str(values["kind"]), float(values["radius"]))


def _habit(values: Mapping[str, Any]) -> GraspHabit:
    _check_keys("grasp", values, {"palm_rpy_deg", "depth", "pivot"}, {"thumb"})
    thumb = values.get("thumb")
    return GraspHabit(
        rpy_to_matrix(np.deg2rad(_numbers("grasp: palm_rpy_deg", values["palm_rpy_deg"], 3))),
        float(values["depth"]),
        None if thumb is None else float(thumb),
        _numbers("grasp: pivot", values["pivot"], 3),
    )


def _finger(
    entry: Mapping[str, Any], tree: Sequence[Joint], palm: str, drives: Mapping[str, Any]
) -> Finger:
    name, sensor = str(entry["name"]), str(entry["sensor"])
    moving = [joint for joint in chain(tree, palm, sensor) if joint.axis is not None]
    count = len(moving)
    stiffness = _numbers("hand: stiffness", drives["stiffness"], count)
    given = entry.get("damping", drives.get("damping"))
    if given is None:
        raise BadInputError(f"finger {name}: no damping, neither here nor under hand")
    damping = _numbers(f"finger {name}: damping", given, count)
    matrix, offset = coupling(moving)
    if entry["side"] not in (-1, 1):
        raise BadInputError(f"finger {name}: side {entry['side']}, expected -1 or 1")
    return Finger(
        name=name,
        sensor=sensor,
        touches=str(entry.get("link", sensor)),
        joints=tuple(
            _driven(joint, float(kp), float(kd))
            for joint, kp, kd in zip(moving, stiffness, damping, strict=True)
        ),
        seed=matrix @ _numbers(f"finger {name}: seed", entry["seed"], count) + offset,
        side=int(entry["side"]),
        lateral=float(entry.get("lateral", 0.0)),
        stagger=float(entry.get("stagger", 0.0)),
        pad=_numbers(f"finger {name}: pad", entry.get("pad", (0.0, 0.0, 1.0)), 3),
    )


def _driven(joint: Joint, kp: float, kd: float) -> Joint:
    return replace(joint, kp=kp, kd=kd)


def _with_sensors(urdf: str, fingers: Sequence[Mapping[str, Any]]) -> str:
    """Return a URDF with the sensor frames that the fingers' entries place on links."""
    added = []
    for entry in fingers:
        if "link" not in entry or f'<link name="{entry["sensor"]}"' in urdf:
            continue
        xyz = " ".join(map(repr, map(float, entry.get("xyz", (0, 0, 0)))))
        rpy = " ".join(map(repr, np.deg2rad(entry.get("rpy_deg", (0, 0, 0))).tolist()))
        name = entry["sensor"]
        added.append(_SENSOR.format(name=name, link=entry["link"], xyz=xyz, rpy=rpy))
    head, end, tail = urdf.rpartition("</robot>")
    return head + "".join(added) + end + tail


_SENSOR = """<link name="{name}"><inertial><mass value="1e-3"/>
<inertia ixx="1e-6" iyy="1e-6" izz="1e-6" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="{name}_mount" type="fixed"><parent link="{link}"/><child link="{name}"/>
<origin xyz="{xyz}" rpy="{rpy}"/></joint>
"""
"""A sensor frame on a link. The gram that it weighs is there because Bullet gives a link without
inertia a kilogram; a hundredth of a finger's mass moves nothing. Without it the finger would droop
in simulation under a kilogram."""
