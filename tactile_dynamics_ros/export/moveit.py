"""An estimate as an object that MoveIt attaches to a link of the robot."""

from __future__ import annotations

from typing import Any

import numpy as np
import yaml

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.rigid_body.inertial_parameters import InertialParameters
from tactile_dynamics_ros.core.rigid_body.rotation import matrix_to_quaternion
from tactile_dynamics_ros.core.shape.object_shape import (
    BoxSurface,
    CylinderSurface,
    ObjectShape,
    SphereSurface,
    Surface,
)

BOX, SPHERE, CYLINDER = 1, 2, 3
"""Types of shape_msgs/SolidPrimitive."""
_DIGITS = 9
"""Significant digits of a size or place: collision checks use single micrometres at most."""


def attached_object(
    body: InertialParameters, name: str, remarks: list[str], shape: ObjectShape | None
) -> str:
    """Return a moveit_msgs/AttachedCollisionObject as yaml: shape, and mass as weight, kg.

    `operation` is left out, since its default is ADD.

    Args:
        body: its mass; its inertia where there is no shape.
        name: id of the object.
        remarks: lines of the comment.
        shape: in the axes of the object's pose; None takes the equivalent box.
    """
    surfaces = [equivalent_box(body)] if shape is None else shape.surfaces
    solid = "the box with the same mass and inertia, for want of a shape"
    remarks = [
        *remarks,
        f"geometry: {solid if shape is None else 'the shape that was given'}; weight in kg",
        "FILL_IN: the link that carries it; object.pose: where the object's pose is in that link",
    ]
    geometry: dict[str, Any] = {}
    for surface in surfaces:
        for key, value in _geometry(surface).items():
            geometry.setdefault(key, []).append(value)
    message = {
        "link_name": "FILL_IN",
        "object": {
            "header": {"frame_id": "FILL_IN"},
            "pose": _pose(np.eye(4)),
            "id": name,
            **geometry,
        },
        "weight": _round(body.mass),
    }
    text = yaml.safe_dump(message, sort_keys=False, default_flow_style=None, width=120)
    return "\n".join([*(f"# {remark}" for remark in remarks), text.rstrip()])


def equivalent_box(body: InertialParameters) -> BoxSurface:
    """Return the homogeneous box of a body's mass and inertia, about its centre of mass.

    I_1 = m (b^2 + c^2) / 12, so that a^2 = 6 (I_2 + I_3 - I_1) / m.

    Args:
        body: with a known inertia.
    """
    moments, axes = np.linalg.eigh(body.inertia_com)
    edges = np.sqrt(np.maximum(6.0 * (moments.sum() - 2.0 * moments) / body.mass, 0.0))
    pose = np.eye(4)
    pose[:3, :3] = axes * np.sign(np.linalg.det(axes))
    pose[:3, 3] = body.com
    return BoxSurface(0.5 * edges, pose)


def _geometry(surface: Surface) -> dict[str, Any]:
    """Return a primitive or a mesh and its pose."""
    if isinstance(surface, BoxSurface):
        return _primitive(BOX, 2.0 * surface.half, surface.pose)
    if isinstance(surface, CylinderSurface):
        return _primitive(CYLINDER, [2.0 * surface.half, surface.radius], surface.pose)
    if isinstance(surface, SphereSurface):
        pose = np.eye(4)
        pose[:3, 3] = surface.centre
        return _primitive(SPHERE, [surface.radius], pose)
    mesh = surface.mesh()
    corners = [dict(zip("xyz", map(_round, corner), strict=True)) for corner in mesh.vertices]
    triangles = [{"vertex_indices": [int(index) for index in face]} for face in mesh.faces]
    whole = {"triangles": triangles, "vertices": corners}
    return {"meshes": whole, "mesh_poses": _pose(np.eye(4))}


def _primitive(kind: int, dimensions: Any, pose: Array) -> dict[str, Any]:
    solid = {"type": kind, "dimensions": [_round(value) for value in dimensions]}
    return {"primitives": solid, "primitive_poses": _pose(pose)}


def _pose(pose: Array) -> dict[str, Any]:
    turn = matrix_to_quaternion(pose[:3, :3])
    return {
        "position": dict(zip("xyz", map(_round, pose[:3, 3]), strict=True)),
        "orientation": dict(zip("xyzw", map(_round, turn), strict=True)),
    }


def _round(value: float) -> float:
    return float(f"{value:.{_DIGITS}g}")
