"""Inverse dynamics in the axes of the world, link by link; shares no code with the estimation."""

from __future__ import annotations

from dataclasses import dataclass, replace
from xml.etree import ElementTree

import numpy as np
from scipy.spatial.transform import Rotation

from tactile_dynamics_ros.core.array import Array


@dataclass(frozen=True, eq=False)
class SimulatedLink:
    """A moving link: its joint and the body that it carries.

    Attributes:
        name: of the joint.
        place, turn: (3,) and (3, 3) of the joint in the link before, at zero.
        axis: (3,) in the link's axes.
        mass: kg. com: (3,) m in the link's axes. inertia: (3, 3) kg m^2 about it.
        lower, upper: rad. velocity: rad/s. effort: N m.
    """

    name: str
    place: Array
    turn: Array
    axis: Array
    mass: float
    com: Array
    inertia: Array
    lower: float
    upper: float
    velocity: float
    effort: float

    def with_body(self, mass: float, com: Array, inertia: Array) -> SimulatedLink:
        """The link with one more body fixed to it (about its own centre of mass)."""
        total = self.mass + mass
        centre = (self.mass * self.com + mass * com) / max(total, 1e-12)
        about = np.zeros((3, 3))
        bodies = [(self.mass, self.com, self.inertia), (mass, com, inertia)]
        for part, where, own in bodies:
            d = where - centre
            about += own + part * (d @ d * np.eye(3) - np.outer(d, d))
        return replace(self, mass=total, com=centre, inertia=about)


def _numbers(element: ElementTree.Element | None, key: str, default: str = "0 0 0") -> Array:
    text = default if element is None else element.get(key, default)
    return np.array([float(part) for part in text.split()])


def _pose(element: ElementTree.Element | None) -> tuple[Array, Array]:
    turn = Rotation.from_euler("xyz", _numbers(element, "rpy")).as_matrix()
    return _numbers(element, "xyz"), turn


_FLANGES = ("flange", "tool0", "link8")
"""Ends of the names of links in whose frame makers tell payloads."""


def read_links(urdf: str, count: int) -> tuple[list[SimulatedLink], tuple[Array, Array]]:
    """Return the first joints that move, and the pose of the flange in the last of them.

    All that comes behind, such as a hand, is fixed to the last one, its joints at zero.

    Args:
        urdf: text.
        count: of joints.
    """
    root = ElementTree.fromstring(urdf)
    bodies = {str(link.get("name")): link.find("inertial") for link in root.findall("link")}
    below: dict[str, list[tuple[str, ElementTree.Element]]] = {}
    for joint in root.findall("joint"):
        parent, child = joint.find("parent"), joint.find("child")
        assert parent is not None and child is not None
        entry = (str(child.get("link")), joint)
        below.setdefault(str(parent.get("link")), []).append(entry)
    children = {name for entries in below.values() for name, _ in entries}
    links: list[SimulatedLink] = []
    end = (np.zeros(3), np.eye(3))
    waiting = [(next(n for n in bodies if n not in children), np.zeros(3), np.eye(3))]
    while waiting:
        at, place, turn = waiting.pop()
        if at.endswith(_FLANGES):
            end = (place, turn)
        for name, joint in reversed(below.get(at, [])):
            shift, rotation = _pose(joint.find("origin"))
            where, way = place + turn @ shift, turn @ rotation
            if joint.get("type") != "fixed" and len(links) < count:
                links.append(_link(joint, bodies[name], where, way))
                waiting.append((name, np.zeros(3), np.eye(3)))
                continue
            if links and bodies[name] is not None:
                links[-1] = _with_fixed(links[-1], bodies[name], where, way)
            waiting.append((name, where, way))
    return links, end


def _body(inertial: ElementTree.Element | None) -> tuple[float, Array, Array]:
    if inertial is None:
        return 0.0, np.zeros(3), np.zeros((3, 3))
    com, rotation = _pose(inertial.find("origin"))
    mass = float(inertial.find("mass").get("value"))  # type: ignore[union-attr,arg-type]
    given = inertial.find("inertia")
    get = {} if given is None else given.attrib
    entry = {key: float(get.get(key, 0.0)) for key in ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")}
    about = np.array(
        [
            [entry["ixx"], entry["ixy"], entry["ixz"]],
            [entry["ixy"], entry["iyy"], entry["iyz"]],
            [entry["ixz"], entry["iyz"], entry["izz"]],
        ]
    )
    return mass, com, rotation @ about @ rotation.T


def _with_fixed(
    link: SimulatedLink, inertial: ElementTree.Element | None, place: Array, turn: Array
) -> SimulatedLink:
    mass, com, about = _body(inertial)
    return link.with_body(mass, place + turn @ com, turn @ about @ turn.T)


def _link(
    joint: ElementTree.Element, inertial: ElementTree.Element | None, place: Array, turn: Array
) -> SimulatedLink:
    axis = _numbers(joint.find("axis"), "xyz", "1 0 0")
    limit = joint.find("limit")
    get = {} if limit is None else limit.attrib
    return SimulatedLink(
        str(joint.get("name")),
        place,
        turn,
        axis / np.linalg.norm(axis),
        *_body(inertial),
        lower=float(get.get("lower", -np.pi)),
        upper=float(get.get("upper", np.pi)),
        velocity=float(get.get("velocity", 1.0)) or 1.0,
        effort=float(get.get("effort", 50.0)) or 50.0,
    )


@dataclass(frozen=True, eq=False)
class Dynamics:
    """Torques and places of one motion.

    Attributes:
        torque: (N, n) of rigid bodies alone, N m.
        axes: (n, N, 3) of the joints, world. places: (n, N, 3) of the joints, world.
    """

    torque: Array
    axes: Array
    places: Array


def inverse_dynamics(
    links: list[SimulatedLink], q: Array, dq: Array, ddq: Array, gravity: Array
) -> Dynamics:
    """Torques that a motion needs, from forces and moments about joints in world axes.

    Args:
        links: base first.
        q: (N, n) rad.
        dq: (N, n) rad/s.
        ddq: (N, n) rad/s^2.
        gravity: (3,) m/s^2.
    """
    count, n = q.shape
    turn, place = np.tile(np.eye(3), (count, 1, 1)), np.zeros((count, 3))
    spin, spin_rate, acceleration = np.zeros((3, count, 3))
    axes, places = np.zeros((n, count, 3)), np.zeros((n, count, 3))
    forces, moments = np.zeros((n, count, 3)), np.zeros((n, count, 3))
    for k, link in enumerate(links):
        arm = turn @ link.place
        acceleration = acceleration + _rigid(arm, spin, spin_rate)
        place = place + arm
        turn = turn @ link.turn @ Rotation.from_rotvec(q[:, k : k + 1] * link.axis).as_matrix()
        axis = turn @ link.axis
        spin_rate = spin_rate + ddq[:, k : k + 1] * axis + np.cross(spin, dq[:, k : k + 1] * axis)
        spin = spin + dq[:, k : k + 1] * axis
        axes[k], places[k] = axis, place
        centre = turn @ link.com
        inertia = turn @ link.inertia @ np.swapaxes(turn, 1, 2)
        momentum = np.einsum("nij,nj->ni", inertia, spin)
        forces[k] = link.mass * (acceleration + _rigid(centre, spin, spin_rate) - gravity)
        moments[k] = np.einsum("nij,nj->ni", inertia, spin_rate) + np.cross(spin, momentum)
        moments[k] += np.cross(place + centre, forces[k])
    total_force, total_moment = np.zeros((count, 3)), np.zeros((count, 3))
    torque = np.zeros((count, n))
    for k in reversed(range(n)):
        total_force, total_moment = total_force + forces[k], total_moment + moments[k]
        about = total_moment - np.cross(places[k], total_force)
        torque[:, k] = np.sum(axes[k] * about, axis=1)
    return Dynamics(torque, axes, places)


def _rigid(arm: Array, spin: Array, spin_rate: Array) -> Array:
    """Acceleration of a point of a body relative to another one of it."""
    return np.cross(spin_rate, arm) + np.cross(spin, np.cross(spin, arm))
