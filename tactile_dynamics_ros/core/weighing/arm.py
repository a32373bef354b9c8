"""A serial arm from its URDF: joints, links, hulls, and how near these come to each other."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.rigid_body.rotation import exp_so3, inverse_pose, pose_of
from tactile_dynamics_ros.core.robot.kinematic_tree import carried, chain, parse_urdf, read_tree
from tactile_dynamics_ros.core.robot.robot import Joint, column
from tactile_dynamics_ros.share import find_package_file

_HULL_DIRECTIONS = 300
"""Directions in which the outermost points of a mesh are kept. They are 12 deg apart, so that a
round link of 0.1 m is drawn 0.5 mm too small; margins are 20 mm. More makes plans slower."""
_AROUND = 1.006
"""Factor on a sphere's radius so that its corners, 12 deg apart, lie around it."""
_ROUND = 24
"""Corners of a circle that stands for a cylinder, drawn around it (a hundredth of its radius too
large). Fewer make it larger still."""


@dataclass(frozen=True, eq=False)
class Hull:
    """A convex shape that moves with one body of an arm.

    Attributes:
        link: of the URDF, for messages.
        body: 0 for what stands still, k for what joint k of the arm moves.
        points: (P, 3) corners in the frame of the body, m.
    """

    link: str
    body: int
    points: Array


@dataclass(frozen=True, eq=False)
class SerialArm:
    """Joints from a base to a tip, and what moves with them.

    Body 0 is the base, body k what joint k moves; its frame is that of the joint's child link.

    Attributes:
        base: link that stands still.
        joints: (J) that move, base first.
        fixed: (J, 4, 4) pose of the frame of each joint at zero in the body before it.
        tip: (4, 4) pose of the tip in the last body.
        hulls: what may collide.
        unknown: links whose shape cannot be read, with the file that is missing.
    """

    base: str
    joints: tuple[Joint, ...]
    fixed: Array
    tip: Array
    hulls: tuple[Hull, ...]
    unknown: tuple[str, ...] = ()

    @classmethod
    def of_urdf(
        cls,
        urdf: str,
        base: str,
        tip: str,
        folder: str = "",
        what: str = "URDF",
        drawn: bool = False,
    ) -> SerialArm:
        """Read an arm.

        Args:
            urdf: text.
            base: link that stands still; the one that no joint carries if empty.
            tip: link that carries the sensor.
            folder: where relative files of meshes lie.
            what: named in errors: file or topic.
            drawn: whether links without a shape to collide with have that with which they are
                drawn.

        Raises:
            BadInputError: no joints lead from base to tip, or one of them mimics another.
        """
        tree = read_tree(urdf, what)
        base = base or next((joint.parent for joint in tree), "")
        steps = chain(tree, base, tip)
        joints = tuple(step for step in steps if step.axis is not None)
        coupled = [joint.name for joint in joints if joint.follows is not None]
        if not joints or coupled:
            reason = f"joint {coupled[0]} mimics another one" if coupled else "none of them moves"
            raise BadInputError(f"{what}: joints from '{base}' to '{tip}': {reason}")
        places = _places(tree, joints, base)
        fixed = [places[joint.parent][1] @ joint.origin for joint in joints]
        hulls, unknown = _read_hulls(urdf, places, folder, drawn)
        return cls(base, joints, np.array(fixed), places[tip][1], tuple(hulls), tuple(unknown))

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the joints, base first."""
        return tuple(joint.name for joint in self.joints)

    def limits(self, name: str) -> Array:
        """Return a number of each joint (J,): "lower", "upper", "velocity" or "effort"."""
        return column(self.joints, name)

    def poses(self, positions: Array) -> Array:
        """Return the poses of all bodies in the base, (N, J + 1, 4, 4).

        Args:
            positions: (N, J) rad, or m of joints that slide.
        """
        found = np.empty((len(positions), len(self.joints) + 1, 4, 4))
        found[:, 0] = np.eye(4)
        for k, joint in enumerate(self.joints):
            before = found[:, k] @ self.fixed[k]
            found[:, k + 1] = before
            assert joint.axis is not None  # they move
            moved = positions[:, k, None] * joint.axis
            if joint.slides:
                found[:, k + 1, :3, 3] += np.einsum("nij,nj->ni", before[:, :3, :3], moved)
            else:
                found[:, k + 1, :3, :3] = before[:, :3, :3] @ exp_so3(moved)
        return found

    def tip_poses(self, positions: Array) -> Array:
        """Return the pose of the tip in the base, (N, 4, 4), at joint positions (N, J)."""
        return np.asarray(self.poses(positions)[:, -1] @ self.tip)

    @cached_property
    def by_bodies(self) -> SerialArm | None:
        """The arm with one convex hull around each body, or None where a shape is not known."""
        if self.unknown or len({hull.body for hull in self.hulls}) <= len(self.joints) // 2:
            return None
        hulls = []
        for body in sorted({hull.body for hull in self.hulls}):
            own = [hull for hull in self.hulls if hull.body == body]
            points = np.concatenate([hull.points for hull in own])
            hulls.append(Hull(own[0].link, body, _outermost(points)))
        return replace(self, hulls=tuple(hulls))

    def carrying(self, reach: float, radius: float) -> SerialArm:
        """Return the arm with a cylinder on its tip for what it carries.

        Args:
            reach: length along z of the tip, m; 0 for nothing.
            radius: m.
        """
        if reach <= 0.0 or radius <= 0.0:
            return self
        points = _apply(self.tip, _cylinder(radius, 0.0, reach))
        load = Hull("what it carries", len(self.joints), points)
        return replace(self, hulls=(*self.hulls, load))


def _places(
    tree: Sequence[Joint], joints: Sequence[Joint], base: str
) -> dict[str, tuple[int, Array]]:
    """Return body and pose in it of every link; joints beside the arm stay as near zero as may be.

    Args:
        tree: all joints, parents first.
        joints: of the arm.
        base: link whose frame is that of body 0.
    """
    found = carried(tree, joints, lambda joint: min(max(0.0, joint.lower), joint.upper))
    to_base = inverse_pose(found[base][1])
    return {link: (b, pose if b else to_base @ pose) for link, (b, pose) in found.items()}


def _read_hulls(
    urdf: str, places: dict[str, tuple[int, Array]], folder: str, drawn: bool
) -> tuple[list[Hull], list[str]]:
    """Return the hulls of all links, and the links whose mesh is missing."""
    hulls: list[Hull] = []
    unknown: list[str] = []
    for link in parse_urdf(urdf).links:
        if link.name not in places:
            continue
        body, pose = places[link.name]
        for collision in link.collisions or (link.visuals if drawn else ()):
            points = _points(collision.geometry, folder)
            if points is None:
                unknown.append(f"{link.name} ({collision.geometry.filename})")
                continue
            at = collision.origin
            own = np.eye(4) if at is None else pose_of(at.xyz or (0, 0, 0), at.rpy or (0, 0, 0))
            hulls.append(Hull(link.name, body, _apply(pose @ own, points)))
    return hulls, unknown


def _points(geometry: Any, folder: str) -> Array | None:
    """Return corners (P, 3) of a URDF's shape, m; None if its mesh cannot be found."""
    if hasattr(geometry, "filename"):
        file = find_package_file(geometry.filename, Path(folder))
        scale = np.ones(3) if geometry.scale is None else np.array(geometry.scale, dtype=float)
        return None if file is None else _outermost(_vertices(file)) * scale
    if hasattr(geometry, "size"):
        corners = np.array(np.meshgrid(*[(-0.5, 0.5)] * 3)).reshape(3, -1).T
        return np.asarray(corners * np.array(geometry.size, dtype=float))
    if hasattr(geometry, "length"):
        half = 0.5 * float(geometry.length)
        return _cylinder(float(geometry.radius), -half, half)
    return np.asarray(float(geometry.radius) * _AROUND * _directions(_HULL_DIRECTIONS))


def _vertices(file: Path) -> Array:
    """Return the vertices (P, 3) of a mesh.

    Raises:
        BadInputError: the file is no mesh.
    """
    import trimesh

    try:
        mesh: Any = trimesh.load(file, force="mesh")
        return np.array(mesh.vertices, dtype=float)
    except Exception as error:  # loaders raise whatever their formats do
        raise BadInputError(f"{file}: no mesh that can be read ({error})") from error


def _outermost(points: Array) -> Array:
    """Return the corners of the hull that are farthest in some direction."""
    try:
        corners = points[ConvexHull(points).vertices]
    except (QhullError, ValueError):  # flat
        corners = points
    farthest = np.argmax(_directions(_HULL_DIRECTIONS) @ corners.T, axis=1)
    return np.asarray(corners[np.unique(farthest)])


def _directions(count: int) -> Array:
    """Return unit vectors (N, 3) that cover the sphere evenly (a Fibonacci spiral)."""
    k = np.arange(count) + 0.5
    height, turn = 1.0 - 2.0 * k / count, np.pi * (1.0 + math.sqrt(5.0)) * k
    ring = np.sqrt(1.0 - height**2)
    return np.stack([ring * np.cos(turn), ring * np.sin(turn), height], axis=1)


def _cylinder(radius: float, low: float, high: float) -> Array:
    """Return corners (P, 3) of a prism around a cylinder along z, m."""
    return np.array(list(_rims(radius / np.cos(np.pi / _ROUND), low, high)))


def _rims(radius: float, low: float, high: float) -> Iterator[tuple[float, float, float]]:
    for k in range(_ROUND):
        angle = 2.0 * np.pi * k / _ROUND
        for z in (low, high):
            yield radius * np.cos(angle), radius * np.sin(angle), z


def _apply(pose: Array, points: Array) -> Array:
    return np.asarray(points @ pose[:3, :3].T + pose[:3, 3])


def _cube_directions() -> Array:
    """Return unit vectors (26, 3) to the faces, edges and corners of a cube."""
    cells = np.array([cell for cell in np.ndindex(3, 3, 3) if cell != (1, 1, 1)], dtype=float)
    return np.asarray((cells - 1.0) / np.linalg.norm(cells - 1.0, axis=1)[:, None])


DIRECTIONS = _cube_directions()
"""Directions (26, 3) that are tried as separating ones. Fewer call links near that are not; more
cost time."""
_APPROACH = 5e-3
"""How much nearer than at the start a pair of links may come whose shapes are closer than the
margin there already, m: bounds of neighbours in a chain overlap though the links do not touch."""


@dataclass(frozen=True)
class Plane:
    """What an arm must stay above: n . p >= offset.

    Attributes:
        normal: (3,) unit vector, frame of the base.
        offset: m.
    """

    normal: Array
    offset: float

    @property
    def text(self) -> str:
        """Name for messages."""
        return f"plane ({', '.join(f'{v:g}' for v in self.normal)}) at {self.offset:g} m"


@dataclass(frozen=True)
class Nearest:
    """Where an arm comes nearest to what it must not touch.

    Attributes:
        room: distance beyond what is demanded, m; negative if it comes too near.
        what: names of both.
    """

    room: float
    what: str


def nearest(
    arm: SerialArm, planes: tuple[Plane, ...], positions: Array, start: Array, margin: float
) -> Nearest:
    """Return the tightest place of a motion.

    Distances are lower bounds: if any direction separates two hulls by d, they are d apart at
    least. Links of which one moves the other are not compared. What is nearer than the margin at
    the start may stay as near as it is.

    Args:
        arm: with its hulls.
        planes: that it must stay above.
        positions: (N, J) joint positions along the motion.
        start: (J,) at which it stands now.
        margin: distance that is demanded, m.
    """
    poses = arm.poses(np.vstack([start, positions]))
    tightest = Nearest(np.inf, "nothing")
    gaps = [
        (hull.link + " and " + plane.text, _above(plane, hull, poses[:, hull.body]))
        for hull in arm.hulls
        if hull.body > 0
        for plane in planes
    ]
    gaps += [
        (f"{one.link} and {other.link}", _apart(one, other, poses, margin))
        for k, one in enumerate(arm.hulls)
        for other in arm.hulls[k + 1 :]
        if abs(one.body - other.body) > 1
    ]
    for what, gap in gaps:
        demanded = min(margin, gap[0] - _APPROACH)
        room = float(gap.min() - demanded)
        if room < tightest.room:
            tightest = Nearest(room, what)
    return tightest


def _above(plane: Plane, hull: Hull, poses: Array) -> Array:
    """Return the distance (N,) of a hull from a plane, m."""
    height = hull.points @ np.swapaxes(poses[:, :3, :3], 1, 2) @ plane.normal
    return np.asarray(height.min(axis=1) + poses[:, :3, 3] @ plane.normal - plane.offset)


def _apart(one: Hull, other: Hull, poses: Array, margin: float) -> Array:
    """Return a lower bound (N,) of the distance between two hulls, m."""
    between = np.linalg.inv(poses[:, one.body]) @ poses[:, other.body]
    bound = _spheres_apart(one, other, between)
    near = bound < margin
    if near.any():
        at = between[near]
        back = np.array(np.linalg.inv(at), dtype=float)
        sharper = np.maximum(_separation(one, other, at), _separation(other, one, back))
        bound[near] = np.maximum(bound[near], sharper)
    return bound


def _spheres_apart(one: Hull, other: Hull, between: Array) -> Array:
    centres = one.points.mean(axis=0), other.points.mean(axis=0)
    radii = [
        np.linalg.norm(hull.points - centre, axis=1).max()
        for hull, centre in zip((one, other), centres, strict=True)
    ]
    apart = between[:, :3, :3] @ centres[1] + between[:, :3, 3] - centres[0]
    return np.asarray(np.linalg.norm(apart, axis=1) - sum(radii))


def _separation(one: Hull, other: Hull, between: Array) -> Array:
    """Largest distance (N,) along the directions of one hull's frame, m."""
    reach = (one.points @ DIRECTIONS.T).max(axis=0)
    turned = DIRECTIONS @ between[:, :3, :3]
    nearest_point = (turned @ other.points.T).min(axis=2) + between[:, :3, 3] @ DIRECTIONS.T
    return np.asarray((nearest_point - reach).max(axis=1))
