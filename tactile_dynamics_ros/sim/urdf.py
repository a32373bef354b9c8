"""The URDF of a robot as Bullet reads it: meshes by their files, bare or drawn."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from pathlib import Path

from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.robot.robot import Robot
from tactile_dynamics_ros.share import find_package_file


def bullet_urdf(robot: Robot, meshes: bool = False) -> str:
    """Return the text of a robot's URDF with the paths of its meshes.

    Args:
        robot: arm and hand.
        meshes: draw links that are drawn as meshes (cameras see them); what collides always does.

    Raises:
        BadInputError: there is no file of a mesh.
    """
    root = ElementTree.fromstring(robot.urdf)
    for link in root.iter("link"):
        for visual in [each for each in link.findall("visual") if each.find(".//mesh") is not None]:
            if not meshes:
                link.remove(visual)
    for mesh in root.iter("mesh"):
        path = find_package_file(mesh.attrib["filename"], Path(robot.folder))
        if path is None:
            raise BadInputError(f"{robot.name}: no file of mesh {mesh.attrib['filename']}")
        mesh.attrib["filename"] = str(path)
    return ElementTree.tostring(root, encoding="unicode")
