"""One link, or two that a joint holds together, in as few coordinates as they have freedoms."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.planar.mechanics.support import SupportPatch


@dataclass(frozen=True, eq=False)
class Link:
    """A rigid part on the support, in B variants.

    Attributes:
        patch: its footprint.
        mass: (B,) kg. friction: (B,) coefficient of the support.
        com: (B, 2) m, link frame. com_height: (B,) m above the support.
        inertia: (B,) kg m^2 about the vertical through the centre of mass.
        scale: (B,) size of the part of the footprint that carries, 1 for all of it.
        roughness: (B, n) friction of each point over the link's, or None where all are alike.
    """

    patch: SupportPatch
    mass: Array
    friction: Array
    com: Array
    com_height: Array
    inertia: Array
    scale: Array
    roughness: Array | None = None


@dataclass(frozen=True, eq=False)
class Joint:
    """What holds two links together.

    Attributes:
        first, second: (B, 2) m, its place in the frame of each link.
        friction: (B,) N m that resists turning.
        rigid: whether it does not turn at all.
    """

    first: Array
    second: Array
    friction: Array
    rigid: bool = False


@dataclass(frozen=True, eq=False)
class Linkage:
    """Links and their joint; coordinates are (x, y) of the first centre of mass, then yaws.

    A rigid pair keeps the difference of yaws with which it starts.
    """

    links: tuple[Link, ...]
    joint: Joint | None = None

    @property
    def freedoms(self) -> int:
        """Number of coordinates that move."""
        return 4 if self.joint is not None and not self.joint.rigid else 3

    def coordinates(self, pose: Array) -> Array:
        """Coordinates (B, 2 + L) from poses (B, L, 3) of the links' frames."""
        first = pose[:, 0, :2] + turned(self.links[0].com, pose[:, 0, 2])
        return np.concatenate([first, pose[:, :, 2]], axis=1)

    def centres(self, coordinates: Array) -> Array:
        """Poses (B, L, 3) of the centres of mass."""
        first = coordinates[:, :3]
        if self.joint is None:
            return first[:, None]
        arms = self._arms(coordinates)
        second = np.column_stack([first[:, :2] + arms[0] - arms[1], coordinates[:, 3]])
        return np.stack([first, second], axis=1)

    def _arms(self, coordinates: Array) -> tuple[Array, Array]:
        """Joint relative to each centre of mass, (B, 2) m, axes of the support."""
        assert self.joint is not None
        first = turned(self.joint.first - self.links[0].com, coordinates[:, 2])
        second = turned(self.joint.second - self.links[1].com, coordinates[:, 3])
        return first, second

    def frames(self, coordinates: Array) -> Array:
        """Poses (B, L, 3) of the links' frames."""
        pose = self.centres(coordinates).copy()
        for k, link in enumerate(self.links):
            pose[:, k, :2] -= turned(link.com, pose[:, k, 2])
        return pose

    def jacobians(self, coordinates: Array) -> list[Array]:
        """J (B, 3, D) of each link: twist of its centre of mass = J velocities."""
        size = len(coordinates)
        first = np.zeros((size, 3, self.freedoms))
        first[:, [0, 1, 2], [0, 1, 2]] = 1.0
        if self.joint is None:
            return [first]
        before, after = self._arms(coordinates)
        second = first.copy()
        turning = self.freedoms - 1
        second[:, 2, 2], second[:, 2, turning] = 0.0, 1.0
        second[:, :2, 2] += np.stack([-before[:, 1], before[:, 0]], axis=1)
        second[:, :2, turning] -= np.stack([-after[:, 1], after[:, 0]], axis=1)
        return [first, second]

    def moved(self, coordinates: Array, velocity: Array, step: float) -> Array:
        """Coordinates after a step, s, at velocities (B, D)."""
        rates = velocity
        if self.joint is not None and self.joint.rigid:
            rates = np.concatenate([velocity, velocity[:, 2:]], axis=1)
        return np.asarray(coordinates + step * rates)


def turned(vector: Array, angle: Array) -> Array:
    """Vectors (B, 2) turned by angles (B,) rad."""
    cos, sin = np.cos(angle), np.sin(angle)
    x, y = vector[:, 0], vector[:, 1]
    return np.stack([cos * x - sin * y, sin * x + cos * y], axis=1)


def placed(points: Array, pose: Array) -> Array:
    """Points (B, 2), m, of frames at poses (3,) or (B, 3) in the frame of these poses."""
    return np.asarray(pose[..., :2] + turned(points, pose[..., 2]))


def in_frame(points: Array, pose: Array) -> Array:
    """Points (B, 2), m, in frames at poses (3,) or (B, 3); undoes `placed`."""
    return turned(points - pose[..., :2], -pose[..., 2])


def cross(arm: Array, force: Array) -> Array:
    """Torque (B,) of forces (B, 2) at arms (B, 2)."""
    return np.asarray(arm[:, 0] * force[:, 1] - arm[:, 1] * force[:, 0])


def applied(matrix: Array, vector: Array) -> Array:
    """Products (..., n) of matrices (..., n, m) and vectors (..., m)."""
    return np.asarray((matrix @ vector[..., None])[..., 0])


def shifting(arm: Array) -> Array:
    """Matrices (B, 3, 3) from twists of a point to those of a point at (B, 2) m from it."""
    motion = np.zeros((len(arm), 3, 3))
    motion[:, [0, 1, 2], [0, 1, 2]] = 1.0
    motion[:, 0, 2], motion[:, 1, 2] = -arm[:, 1], arm[:, 0]
    return motion


def shifted_twist(twist: Array, arm: Array) -> Array:
    """Twist (B, 3) of the point at an arm (B, 2) from that of a twist; axes of the support."""
    rate = twist[:, 2:]
    across = np.stack([-arm[:, 1], arm[:, 0]], axis=1)
    return np.concatenate([twist[:, :2] + rate * across, rate], axis=1)
