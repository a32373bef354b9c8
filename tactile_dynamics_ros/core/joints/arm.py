"""An arm as a chain of rigid bodies: torques of its joints, linear in the bodies' parameters."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.rigid_body.inertial_parameters import (
    dynamic_parameters_from_pseudo_inertia,
    pseudo_inertia,
)
from tactile_dynamics_ros.core.rigid_body.newton_euler import regressor
from tactile_dynamics_ros.core.rigid_body.rotation import cross, exp_so3, pose_of
from tactile_dynamics_ros.core.robot.kinematic_tree import carried, chain, parse_urdf, read_tree
from tactile_dynamics_ros.core.robot.robot import Joint

GRAVITY = np.array([0.0, 0.0, -9.81])
"""Gravity in the arm's base, m/s^2: z up, as everywhere here. An arm on a wall or a ceiling needs a
URDF whose root says so; `base_tilt` finds small leans."""
_FLANGES = ("flange", "tool0", "link8", "link_8", "ee_link", "link_ee", "end_effector")
"""Ends of the names of links that makers give the flange, in the order in which they are looked
for: ROS-Industrial's `flange` and `tool0`, Franka's `link8`, KUKA's `link_ee`. Without any the
payload is told in the frame of the last moving link."""


def moved_parameters(pose: Array) -> Array:
    """Matrix X (10, 10): dynamic parameters in a frame are X times those in another, placed there.

    P' = H P H^T with H the pose.

    Args:
        pose: (4, 4) of the frame that the given parameters are in.
    """
    moved = pose @ pseudo_inertia(np.eye(10)) @ pose.T
    return dynamic_parameters_from_pseudo_inertia(moved).T


@dataclass(frozen=True, eq=False)
class Motion:
    """Motion of all links of an arm at N instants, each in the link's own axes.

    Attributes:
        twists: (n, N, 6, n) how each link moves, [w, v], per speed of each joint.
        wrenches: (n, N, 6, 10) regressor of the wrench that each link needs.
        turns: (n, N, 3, 3) each link's axes in the base.
        places: (n, N, 3) each link's origin in the base, m.
    """

    twists: list[Array]
    wrenches: list[Array]
    turns: list[Array]
    places: list[Array]


@dataclass(frozen=True, eq=False)
class Arm:
    """Moving joints of an arm, base first, and the bodies that they carry.

    Attributes:
        joints: n that move and whose torques are known.
        origins: (n, 4, 4) pose of each joint's link in the one before, at zero.
        inertia: (n, 10) dynamic parameters of each link, by the URDF, with all that is fixed to it.
        flange: name of the link in whose frame a payload is told.
        flange_pose: (4, 4) of the flange in the last link.
    """

    joints: tuple[Joint, ...]
    origins: Array
    inertia: Array
    flange: str
    flange_pose: Array

    @classmethod
    def from_urdf(cls, urdf: str, names: Sequence[str], what: str, flange: str = "") -> Arm:
        """Read the arm whose joints have these names; others stay at zero.

        Args:
            urdf: text.
            names: of joints with torques, in any order; those that the URDF lacks are passed over.
            what: the URDF, in messages.
            flange: link whose frame a payload is told in; found by its name if empty.

        Raises:
            BadInputError: it is no URDF, has none of the joints, or they are no chain.
        """
        tree = read_tree(urdf, what)
        children = {joint.child for joint in tree}
        root = next(joint.parent for joint in tree if joint.parent not in children)
        wanted = {j.name for j in tree if j.axis is not None} & set(names)
        if not wanted:
            moving = ", ".join(j.name for j in tree if j.axis is not None)
            raise BadInputError(
                f"{what}: no joint of {', '.join(names)}; it moves {moving}: give the URDF of this "
                "arm"
            )
        joints = _arm_joints(tree, root, wanted)
        places = carried(tree, joints, lambda joint: 0.0)
        origins = np.array([places[joint.parent][1] @ joint.origin for joint in joints])
        last = [link for link, (body, _) in places.items() if body == len(joints)]
        end = _flange(last, flange, joints[-1].child, what)
        return cls(joints, origins, _lumped(urdf, places, len(joints)), end, places[end][1])

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the joints."""
        return tuple(joint.name for joint in self.joints)

    @property
    def units(self) -> tuple[str, ...]:
        """Unit of each joint's torque: N of those that slide."""
        return tuple("N" if joint.slides else "N m" for joint in self.joints)

    @cached_property
    def to_last_link(self) -> Array:
        """Matrix (10, 10) that takes parameters in the flange's frame to the last link's."""
        return moved_parameters(self.flange_pose)

    def motion(self, q: Array, dq: Array, ddq: Array, gravity: Array = GRAVITY) -> Motion:
        """Move all links.

        Args:
            q: (N, n) rad or m.
            dq: (N, n) per s.
            ddq: (N, n) per s^2.
            gravity: (3,) or (N, 3) in the base, m/s^2.
        """
        count = len(q)
        turn, place = np.tile(np.eye(3), (count, 1, 1)), np.zeros((count, 3))
        w, dw = np.zeros((count, 3)), np.zeros((count, 3))
        a = -np.broadcast_to(gravity, (count, 3))
        axes, places, twists, wrenches, turns = [], [], [], [], []
        for k, joint in enumerate(self.joints):
            axis, origin = joint.axis, self.origins[k]
            assert axis is not None
            slide = float(joint.slides)
            step = origin[:3, 3] + slide * q[:, k : k + 1] * (origin[:3, :3] @ axis)
            a = a + cross(dw, step) + cross(w, cross(w, step))
            place = place + np.einsum("nij,nj->ni", turn, step)
            relative = origin[:3, :3] @ exp_so3((1.0 - slide) * q[:, k : k + 1] * axis)
            turn = turn @ relative
            w, dw, a = (np.einsum("nji,nj->ni", relative, v) for v in (w, dw, a))
            speed, rate = dq[:, k : k + 1] * axis, ddq[:, k : k + 1] * axis
            a = a + slide * (rate + 2.0 * cross(w, speed))
            dw = dw + (1.0 - slide) * (rate + cross(w, speed))
            w = w + (1.0 - slide) * speed
            axes.append(turn @ axis)
            places.append(place)
            twists.append(self._twist(k, axes, places, turn, place))
            wrenches.append(regressor(a, w, dw))
            turns.append(turn)
        return Motion(twists, wrenches, turns, places)

    def _twist(
        self, link: int, axes: Sequence[Array], places: Sequence[Array], turn: Array, place: Array
    ) -> Array:
        """(N, 6, n) motion of a link per speed of each joint, in its own axes."""
        found = np.zeros((len(place), 6, len(self.joints)))
        for j in range(link + 1):
            if self.joints[j].slides:
                found[:, 3:, j] = np.einsum("nji,nj->ni", turn, axes[j])
            else:
                found[:, :3, j] = np.einsum("nji,nj->ni", turn, axes[j])
                arm = cross(axes[j], place - places[j])
                found[:, 3:, j] = np.einsum("nji,nj->ni", turn, arm)
        return found

    def regressor(self, motion: Motion) -> Array:
        """Y (N, n, 10 n) with joint torques tau = Y [phi_1 ... phi_n].

        Source: Atkeson, An, Hollerbach 1986; Khosla 1989.
        """
        blocks = [
            np.einsum("naj,nak->njk", t, w)
            for t, w in zip(motion.twists, motion.wrenches, strict=True)
        ]
        return np.concatenate(blocks, axis=2)

    def torque(self, motion: Motion, parameters: Array) -> Array:
        """Torques (N, n) of dynamic parameters (n, 10): inverse dynamics, without friction."""
        found = np.zeros((len(motion.twists[0]), len(self.joints)))
        for twist, wrench, phi in zip(motion.twists, motion.wrenches, parameters, strict=True):
            found += np.einsum("naj,na->nj", twist, wrench @ phi)
        return found

    def mass_matrix(self, motion: Motion, parameters: Array) -> Array:
        """(N, n, n) of dynamic parameters (n, 10): torque per acceleration of each joint."""
        zero = np.zeros((1, 3))
        found = np.zeros((len(motion.twists[0]), len(self.joints), len(self.joints)))
        for twist, phi in zip(motion.twists, parameters, strict=True):
            units = np.eye(3)
            spatial = np.zeros((6, 6))
            for k in range(3):
                spatial[:, k] = (regressor(zero, zero, units[k : k + 1]) @ phi)[0]
                spatial[:, 3 + k] = (regressor(units[k : k + 1], zero, zero) @ phi)[0]
            found += np.einsum("nai,ab,nbj->nij", twist, spatial, twist)
        return found

    def flange_jacobian(self, motion: Motion) -> Array:
        """(N, 6, n) motion [w, v] of the flange per speed of each joint, in the flange's axes."""
        rotation, place = self.flange_pose[:3, :3], self.flange_pose[:3, 3]
        last = motion.twists[-1]
        shifted = last[:, 3:] + cross(np.swapaxes(last[:, :3], 1, 2), place).swapaxes(1, 2)
        return np.concatenate([rotation.T @ last[:, :3], rotation.T @ shifted], axis=1)


def _arm_joints(tree: Sequence[Joint], root: str, wanted: set[str]) -> tuple[Joint, ...]:
    """Wanted joints of the longest chain, up to where several of them branch off: a hand."""
    chains = [
        tuple(step for step in chain(tree, root, joint.child) if step.name in wanted)
        for joint in tree
        if joint.name in wanted
    ]
    longest = max(chains, key=len)
    for count in range(1, len(longest)):
        next_ones = {c[count].name for c in chains if c[:count] == longest[:count] and c[count:]}
        if len(next_ones) > 1:
            return longest[:count]
    return longest


def _lumped(urdf: str, places: Mapping[str, tuple[int, Array]], count: int) -> Array:
    """Dynamic parameters (n, 10) of each moving link with all links that are fixed to it."""
    found = np.zeros((count, 10))
    for link in parse_urdf(urdf).links:
        body, pose = places.get(link.name, (0, np.eye(4)))
        if link.inertial is not None and body > 0:
            found[body - 1] += moved_parameters(pose) @ _of_link(link.inertial)
    return found


def _of_link(inertial: Any) -> Array:
    """Dynamic parameters (10,) of an element `inertial`, about the link's origin."""
    i, origin = inertial.inertia, inertial.origin
    about_centre = [i.ixx, i.ixy, i.iyy, i.ixz, i.iyz, i.izz] if i is not None else [0.0] * 6
    local = np.array([inertial.mass or 0.0, 0.0, 0.0, 0.0, *about_centre])
    pose = np.eye(4)
    if origin is not None:
        pose = pose_of(origin.xyz or (0, 0, 0), origin.rpy or (0, 0, 0))
    return np.asarray(moved_parameters(pose) @ local)


def _flange(links: Sequence[str], wanted: str, default: str, what: str) -> str:
    """Name of the flange among the links that the last joint carries.

    Raises:
        BadInputError: the wanted one is none of them.
    """
    if wanted:
        if wanted not in links:
            raise BadInputError(f"{what}: flange '{wanted}'; expected one of {', '.join(links)}")
        return wanted
    ends: Iterator[str] = (link for end in _FLANGES for link in links if link.endswith(end))
    return next(ends, default)
