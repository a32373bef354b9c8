"""URDF text of arm, hand and fingertips, generated from the robot table."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pybullet_data

from tactile_dynamics_ros.core.robot.robot_description import (
    CORE_LENGTH,
    CORE_RADIUS,
    JOINTS,
    LINKS,
    SKIN_RADIUS,
    Joint,
    Link,
)

ARM_MESHES = Path(pybullet_data.getDataPath()) / "kuka_iiwa" / "meshes"


def write_robot_urdf(arm_meshes: bool = False) -> str:
    """Return the URDF of the whole robot.

    Args:
        arm_meshes: draw the arm with the meshes that pybullet_data carries (cameras see them).
    """
    parts = ['<?xml version="1.0"?>', '<robot name="allegro_iiwa">']
    for link in LINKS:
        parts += _link_lines(link, arm_meshes)
    for joint in JOINTS:
        parts += _joint_lines(joint)
    return "\n".join([*parts, "</robot>"])


def _text(values: tuple[float, ...]) -> str:
    return " ".join(f"{value:.10g}" for value in values)


def _link_lines(link: Link, arm_meshes: bool) -> Iterator[str]:
    xx, yy, zz = link.inertia
    yield f'<link name="{link.name}">'
    yield f'<inertial><origin xyz="{_text(link.com)}"/><mass value="{link.mass:.10g}"/>'
    yield f'<inertia ixx="{xx:.10g}" iyy="{yy:.10g}" izz="{zz:.10g}" ixy="0" ixz="0" iyz="0"/>'
    yield "</inertial>"
    for size, centre in link.boxes:
        yield from _shape_lines(f'<box size="{_text(size)}"/>', centre, "0.15 0.15 0.15 1")
    if link.name.startswith("biotac_"):
        yield from _fingertip_lines()
    if arm_meshes and link.name.startswith("lbr_"):
        mesh = ARM_MESHES / f"link_{link.name[-1]}.obj"
        yield f'<visual><geometry><mesh filename="{mesh}"/></geometry></visual>'
    yield "</link>"


def _shape_lines(geometry: str, centre: tuple[float, ...], colour: str) -> Iterator[str]:
    origin = f'<origin xyz="{_text(centre)}"/>'
    yield f"<collision>{origin}<geometry>{geometry}</geometry></collision>"
    yield f"<visual>{origin}<geometry>{geometry}</geometry>"
    yield f'<material name="{colour}"><color rgba="{colour}"/></material></visual>'


def _fingertip_lines() -> Iterator[str]:
    """A skin sphere at the sensor's origin and the thinner core behind it."""
    skin = f'<sphere radius="{SKIN_RADIUS}"/>'
    yield from _shape_lines(skin, (0.0, 0.0, 0.0), "0.2 0.6 0.3 1")
    origin = f'<origin xyz="{-0.5 * CORE_LENGTH} 0 0" rpy="0 1.5707963 0"/>'
    core = f'<cylinder radius="{CORE_RADIUS}" length="{CORE_LENGTH}"/>'
    yield f"<collision>{origin}<geometry>{core}</geometry></collision>"
    yield f"<visual>{origin}<geometry>{core}</geometry></visual>"


def _joint_lines(joint: Joint) -> Iterator[str]:
    kind = "fixed" if joint.axis is None else "revolute"
    yield f'<joint name="{joint.name}" type="{kind}">'
    yield f'<parent link="{joint.parent}"/><child link="{joint.child}"/>'
    yield f'<origin xyz="{_text(joint.xyz)}" rpy="{_text(joint.rpy)}"/>'
    if joint.axis is not None:
        limits = f'lower="{joint.lower}" upper="{joint.upper}"'
        yield f'<axis xyz="{_text(joint.axis)}"/>'
        yield f'<limit {limits} effort="{joint.effort}" velocity="{joint.velocity}"/>'
    yield "</joint>"
