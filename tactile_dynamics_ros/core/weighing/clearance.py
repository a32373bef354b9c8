"""How near the links of an arm come to each other and to planes that they must not pass."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.weighing.arm import Hull, SerialArm

Array = NDArray[np.float64]


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
