"""Coordinates of a superquadric that a fit moves in, with the Jacobian of the distance."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.rigid_body.rotation import cross, exp_so3
from tactile_dynamics_ros.core.shape.superquadric.superquadric import EXPONENT_RANGE, Superquadric

Array = NDArray[np.float64]

SHAPE_NAMES = ("ln_ax", "ln_ay", "ln_az", "e1", "e2", "k1", "k2")
"""Coordinates of the shape, in the order of vectors; the pose follows."""
_LARGEST_STEP = 0.3
"""Longest step of a coordinate of the shape at once: a third of an axis. The distance is linear
in them only so far; more overshoots, less takes more steps."""
_LARGEST_TURN = 0.3
"""Longest turn of a step, rad, for the same reason."""
TAPER_RANGE = np.array([[-1.0, 1.0], [-0.9, 1.5]])
"""Range of k1 and k2: a triangle has k1 = +-1, a hexagon k2 = -0.5, a butterfly k2 = 1. Source:
paper B, which has k2 from 0 to 1; hexagons need less, and steep butterflies more."""


@dataclass(frozen=True)
class Chart:
    """Which poses are admitted.

    Attributes:
        support: height of the table on which the base stands, m; None where nothing is known, and
            the body may lie in any orientation.
        plain: whether tapers are held at zero.
    """

    support: float | None
    plain: bool = False

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the coordinates."""
        if self.support is None:
            return (*SHAPE_NAMES, "x", "y", "z", "turn_x", "turn_y", "turn_z")
        return (*SHAPE_NAMES, "x", "y", "yaw")

    def settled(self, shape: Superquadric) -> Superquadric:
        """The same shape, standing on the support."""
        if self.support is None:
            return shape
        pose = shape.pose.copy()
        yaw = np.arctan2(pose[1, 0], pose[0, 0])
        pose[:3, :3] = exp_so3(np.array([0.0, 0.0, yaw]))
        pose[2, 3] = self.support + shape.semi_axes[2]
        return replace(shape, pose=pose)

    def linearise(self, shape: Superquadric, points: Array) -> tuple[Array, Array]:
        """Return the distance to the surface and its Jacobian.

        The distance is that along the normal where the ray from the axis meets the surface.

        Args:
            shape: at which it is linearised.
            points: (N, 3) world, m.

        Returns:
            (N,) m, positive outside, and (N, P) by the coordinates.
        """
        local = shape.to_body(points)
        foot = shape.project(local)
        found = shape.differentiate(foot)
        length = np.maximum(np.linalg.norm(found.point, axis=1, keepdims=True), 1e-9)
        normal = found.point / length
        distance = np.einsum("ij,ij->i", local - foot, normal)
        by_axes = found.axes * shape.semi_axes / length
        by_shape = [by_axes, found.exponents / length, found.taper / length]
        world = -normal @ shape.pose[:3, :3].T
        turn = -cross(foot, normal)
        if self.support is None:
            return distance, np.hstack([*by_shape, world, turn])
        by_axes[:, 2] += world[:, 2] * shape.semi_axes[2]
        return distance, np.hstack([*by_shape, world[:, :2], turn[:, 2:]])

    def held(self, shape: Superquadric, slope: Array) -> NDArray[np.bool_]:
        """Return which coordinates (P,) stay: at a bound that a cost's slope (P,) pushes at."""
        low = np.array([EXPONENT_RANGE[0]] * 2 + [*TAPER_RANGE[:, 0]])
        high = np.array([EXPONENT_RANGE[1]] * 2 + [*TAPER_RANGE[:, 1]])
        here = np.concatenate([shape.exponents, shape.taper])
        held = np.zeros(len(slope), dtype=bool)
        held[3:7] = ((here <= low) & (slope[3:7] > 0.0)) | ((here >= high) & (slope[3:7] < 0.0))
        held[5:7] |= self.plain
        return held

    def moved(self, shape: Superquadric, step: Array) -> Superquadric:
        """Return a shape further by a step (P,), kept within the ranges."""
        count = len(SHAPE_NAMES)
        step = step * min(1.0, _LARGEST_STEP / np.max(np.abs(step[:count]), initial=1e-9))
        axes = shape.semi_axes * np.exp(step[:3])
        exponents = np.clip(shape.exponents + step[3:5], *EXPONENT_RANGE)
        taper = np.clip(shape.taper + step[5:7], TAPER_RANGE[:, 0], TAPER_RANGE[:, 1])
        pose = shape.pose.copy()
        shift, turn = step[count:], np.zeros(3)
        if self.support is None:
            pose[:3, 3] += shift[:3]
            turn = shift[3:]
        else:
            pose[:2, 3] += shift[:2]
            turn[2] = shift[2]
            pose[2, 3] = self.support + axes[2]
        turn *= min(1.0, _LARGEST_TURN / max(float(np.abs(turn).max()), 1e-9))
        pose[:3, :3] = pose[:3, :3] @ exp_so3(turn)
        return Superquadric(axes, exponents, taper, pose)
