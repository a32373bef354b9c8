"""The robot on the page: links of its URDF, placed by its joints."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from viser import SceneApi

from tactile_dynamics_ros.core.rigid_body.rotation import matrix_to_quaternion, pose_of
from tactile_dynamics_ros.core.robot.kinematic_tree import (
    parse_urdf,
    placed,
    read_tree,
)
from tactile_dynamics_ros.core.robot.robot import Following
from tactile_dynamics_ros.share import find_package_file

_MATERIAL = (150, 158, 168)
"""Colour of links; grey, so that forces and object stand out."""


class RobotFigure:
    """Links of a URDF in the scene under `/robot`; parents first, each in its parent's frame.

    Args:
        scene: to draw in.
        urdf: text of the URDF.
    """

    def __init__(self, scene: SceneApi, urdf: str) -> None:
        self._tree = read_tree(urdf, "robot_description")
        self._frames: dict[str, Any] = {}
        self._shown: dict[str, float] = {}
        links = {link.name: link for link in parse_urdf(urdf).links}
        paths: dict[str, str] = {}
        for name in links.keys() - {joint.child for joint in self._tree}:
            paths[name] = f"/robot/{name}"
        for joint in self._tree:
            paths[joint.child] = f"{paths[joint.parent]}/{joint.child}"
            self._frames[joint.name] = scene.add_frame(paths[joint.child], show_axes=False)
        for name, link in links.items():
            for k, mesh in enumerate(_meshes(link)):
                scene.add_mesh_simple(
                    f"{paths[name]}/visual_{k}", mesh.vertices, mesh.faces, color=_MATERIAL
                )
        self.move({})

    def move(self, joints: Mapping[str, float]) -> None:
        """Place the links whose joint has moved.

        Args:
            joints: position by name, rad or m; zero where none is given.
        """
        for joint in self._tree:
            follows = joint.follows or Following(joint.name)
            position = follows.factor * joints.get(follows.leader, 0.0) + follows.offset
            if self._shown.get(joint.name) == position:
                continue
            self._shown[joint.name] = position
            pose = placed(joint, position)
            frame = self._frames[joint.name]
            frame.position = pose[:3, 3]
            frame.wxyz = np.roll(matrix_to_quaternion(pose[:3, :3]), 1)


def _meshes(link: Any) -> Iterator[Any]:
    """Yield what a link looks like, in its frame; a mesh whose file is not here is left out."""
    for visual in link.visuals:
        mesh = _mesh(visual.geometry)
        if mesh is None:
            continue
        if visual.origin is not None:
            origin = visual.origin
            mesh.apply_transform(pose_of(origin.xyz or (0, 0, 0), origin.rpy or (0, 0, 0)))
        yield mesh


def _mesh(geometry: Any) -> Any:
    """Return a shape of a URDF as triangles; None if its file is not here."""
    if hasattr(geometry, "filename"):
        path = find_package_file(geometry.filename, Path())
        if path is None:
            return None
        mesh = trimesh.load(path, force="mesh")
        mesh.apply_scale(geometry.scale or (1.0, 1.0, 1.0))
        return mesh
    if hasattr(geometry, "size"):
        return trimesh.creation.box(geometry.size)
    if hasattr(geometry, "length"):
        return trimesh.creation.cylinder(geometry.radius, geometry.length, sections=24)
    return trimesh.creation.icosphere(2, geometry.radius)
