"""Tool and load that an arm carries, as links that are bolted to its wrist sensor in the URDF."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from dataclasses import dataclass
from typing import Any

import numpy as np
import pybullet

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.sim.bodies import to_matrix

SENSOR = "wrist_sensor"
"""Link of the sensor: it is bolted to the flange, and the tool to it."""


@dataclass(frozen=True)
class Carried:
    """A rigid body on the sensor.

    Attributes:
        mass: kg. com: (3,) m, sensor's frame. moments: (3,) kg m^2, principal, about the centre.
        rpy: turn of the principal axes, rad.
    """

    mass: float
    com: Array
    moments: Array
    rpy: Array

    @classmethod
    def draw(cls, rng: np.random.Generator, mass: tuple[float, float], reach: float) -> Carried:
        """Draw a box of even density whose centre lies before the sensor.

        Args:
            rng: of the draws.
            mass: least and largest, kg.
            reach: distance of the centre along the sensor's z, m.
        """
        size = rng.uniform(0.06, 0.14, 3)
        weight = rng.uniform(*mass)
        moments = weight / 12.0 * (np.sum(size**2) - size**2)
        com = np.array([*rng.uniform(-0.02, 0.02, 2), reach + rng.uniform(-0.01, 0.01)])
        return cls(float(weight), com, moments, rng.uniform(-0.5, 0.5, 3))

    def inertia_com(self) -> Array:
        """Return the inertia (3, 3) about the centre of mass, axes of the sensor, kg m^2."""
        quaternion = pybullet.getQuaternionFromEuler(self.rpy.tolist())
        turn = to_matrix((0.0, 0.0, 0.0), quaternion)[:3, :3]
        return np.asarray(turn @ np.diag(self.moments) @ turn.T)

    def to_json(self) -> dict[str, Any]:
        """Return plain numbers."""
        inertia = self.inertia_com()
        return {"mass": self.mass, "com": self.com.tolist(), "inertia_com": inertia.tolist()}


def with_carried(urdf: str, bodies: list[Carried]) -> str:
    """Return the URDF with tool and load bolted to the sensor."""
    root = ElementTree.fromstring(urdf)
    parent = SENSOR
    for name, body in zip(("tool", "load"), bodies, strict=True):
        inertia = (body.mass, body.com, np.diag(body.moments), body.rpy)
        root.extend(bolted_link(name, parent, (0.0, 0.0, 0.0), inertia))
        parent = name
    return ElementTree.tostring(root, encoding="unicode")


def bolted_link(
    name: str,
    parent: str,
    place: tuple[float, float, float],
    inertia: tuple[float, Array, Array, Array] | None,
) -> list[ElementTree.Element]:
    """Return a link and the fixed joint that bolts it to another one.

    Args:
        name: of the link.
        parent: of the other.
        place: in the other, m.
        inertia: mass (kg), centre (m), inertia about it (kg m^2) and turn of its axes (rad); a gram
            if None, as Bullet gives links without inertia a kilogram.
    """
    mass, com, tensor, rpy = inertia or (1e-3, np.zeros(3), 1e-7 * np.eye(3), np.zeros(3))
    link = ElementTree.Element("link", name=name)
    own = ElementTree.SubElement(link, "inertial")
    ElementTree.SubElement(own, "origin", xyz=_text(com), rpy=_text(rpy))
    ElementTree.SubElement(own, "mass", value=repr(float(mass)))
    rows = {f"i{a}{b}": repr(float(tensor["xyz".index(a), "xyz".index(b)]))
            for a, b in ("xx", "xy", "xz", "yy", "yz", "zz")}  # fmt: skip
    ElementTree.SubElement(own, "inertia", rows)
    joint = ElementTree.Element("joint", name=f"{name}_mount", type="fixed")
    ElementTree.SubElement(joint, "parent", link=parent)
    ElementTree.SubElement(joint, "child", link=name)
    ElementTree.SubElement(joint, "origin", xyz=_text(np.array(place)), rpy="0 0 0")
    return [link, joint]


def _text(values: Array) -> str:
    return " ".join(repr(float(value)) for value in values)
