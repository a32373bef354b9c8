"""Coordinates of a superquadric that a fit moves in, with the Jacobian of the distance."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.rigid_body.rotation import exp_so3
from tactile_dynamics_ros.core.shape.superquadric.gauge import Foot, Parameters
from tactile_dynamics_ros.core.shape.superquadric.superquadric import EXPONENT_RANGE, Superquadric

SHAPE_NAMES = ("ln_ax", "ln_ay", "ln_az", "e1", "e2", "k1", "k2")
"""Coordinates of the shape, in the order of vectors; the pose follows. Fixed by the order of the
Jacobian's columns; they are written in results."""
_LARGEST_STEP = 0.3
"""Longest step of a coordinate of the shape at once: a third of an axis. The distance is linear
in them only so far; more overshoots, less takes more steps."""
_LARGEST_TURN = 0.3
"""Longest turn of a step, rad, for the same reason. Larger overshoots and is refused, smaller takes
more steps."""
TAPER_RANGE = np.array([[-1.0, 1.0], [-0.9, 1.5]])
"""Range of k1 and k2: a triangle has k1 = ±1, a hexagon k2 = -0.5, a butterfly k2 = 1. Source:
paper B, which has k2 from 0 to 1; hexagons need less, and steep butterflies more. Wider lets the
section vanish within the body, narrower cuts the triangle off."""


@dataclass(frozen=True)
class Placed:
    """Superquadrics with any leading shape (...), each at its pose.

    Attributes:
        shape: axes, exponents and tapers.
        rotation: (..., 3, 3) of the body frame in the world.
        origin: (..., 3) of the body frame, m.
    """

    shape: Parameters
    rotation: Array
    origin: Array

    @classmethod
    def of(cls, shapes: Sequence[Sequence[Superquadric]]) -> Placed:
        """Stack rows of shapes, equally many in each."""
        axes = np.array([[shape.semi_axes for shape in row] for row in shapes])
        exponents = np.array([[shape.exponents for shape in row] for row in shapes])
        taper = np.array([[shape.taper for shape in row] for row in shapes])
        pose = np.array([[shape.pose for shape in row] for row in shapes])
        return cls(Parameters(axes, exponents, taper), pose[..., :3, :3], pose[..., :3, 3])

    def __getitem__(self, index: Any) -> Placed:
        """Return some of them."""
        shape = self.shape
        return Placed(
            Parameters(shape.semi_axes[index], shape.exponents[index], shape.taper[index]),
            self.rotation[index],
            self.origin[index],
        )

    def where(self, chosen: NDArray[np.bool_], other: Placed) -> Placed:
        """Return these where `chosen` (...), and others elsewhere."""

        def either(a: Array, b: Array) -> Array:
            return np.where(chosen.reshape(chosen.shape + (1,) * (a.ndim - chosen.ndim)), a, b)

        mine, its = self.shape, other.shape
        shape = Parameters(
            either(mine.semi_axes, its.semi_axes),
            either(mine.exponents, its.exponents),
            either(mine.taper, its.taper),
        )
        rotation = either(self.rotation, other.rotation)
        return Placed(shape, rotation, either(self.origin, other.origin))

    def unstacked(self) -> tuple[Superquadric, ...]:
        """Return the shapes of one row."""
        found = []
        for k in range(len(self.origin)):
            pose = np.eye(4)
            pose[:3, :3], pose[:3, 3] = self.rotation[k], self.origin[k]
            one = self.shape
            found.append(Superquadric(one.semi_axes[k], one.exponents[k], one.taper[k], pose))
        return tuple(found)


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

    def linearise(self, shapes: Placed, points: Array) -> tuple[Array, Array]:
        """Return distances to surfaces and their Jacobians.

        The distance is that along the normal where the ray from the axis meets the surface.

        Args:
            shapes: (...) at which it is linearised.
            points: (..., 3, N) world, m.

        Returns:
            (..., N) m, positive outside, and (..., P, N) by the coordinates.
        """
        turned = np.swapaxes(shapes.rotation, -1, -2)
        local = turned @ (points - shapes.origin[..., None])
        foot = Foot.of(shapes.shape, local)
        at, normal = foot.gauge, foot.normal
        jacobian = np.empty((*local.shape[:-2], len(self.names), local.shape[-1]))
        by_shape = (
            *(-at.by_u, -foot.by_y, -at.by_w, at.by_e1, at.by_e2),
            *(-foot.by_width * foot.inside, -foot.by_width * foot.inside**2),
        )
        for k, row in enumerate(by_shape):
            np.divide(row, foot.steepness, out=jacobian[..., k, :])
        world = -(shapes.rotation @ normal)
        if self.support is None:
            jacobian[..., 7:10, :] = world
            jacobian[..., 10:, :] = np.cross(normal, foot.point, axis=-2)
            return foot.distance, jacobian
        jacobian[..., 2, :] += world[..., 2, :] * shapes.shape.semi_axes[..., 2, None]
        jacobian[..., 7:9, :] = world[..., :2, :]
        jacobian[..., 9, :] = (
            normal[..., 0, :] * foot.point[..., 1, :] - normal[..., 1, :] * foot.point[..., 0, :]
        )
        return foot.distance, jacobian

    def distance(self, shape: Superquadric, points: Array) -> Array:
        """Return the distances (N,), m, of points (N, 3) of the world that a fit lowers."""
        return self.linearise(Placed.of([[shape]])[0, 0], points.T)[0]

    def held(self, shapes: Parameters, slope: Array) -> NDArray[np.bool_]:
        """Return which coordinates (..., P) stay: at a bound that a cost's slope pushes at."""
        low = np.array([EXPONENT_RANGE[0]] * 2 + [*TAPER_RANGE[:, 0]])
        high = np.array([EXPONENT_RANGE[1]] * 2 + [*TAPER_RANGE[:, 1]])
        here = np.concatenate([shapes.exponents, shapes.taper], axis=-1)
        held = np.zeros(slope.shape, dtype=bool)
        by = slope[..., 3:7]
        held[..., 3:7] = ((here <= low) & (by > 0.0)) | ((here >= high) & (by < 0.0))
        held[..., 5:7] |= self.plain
        return held

    def moved(self, shapes: Placed, step: Array) -> Placed:
        """Return shapes (...) further by steps (..., P), kept within the ranges."""
        count, old = len(SHAPE_NAMES), shapes.shape
        step = _shortened(step, step[..., :count], _LARGEST_STEP)
        axes = old.semi_axes * np.exp(step[..., :3])
        exponents = np.clip(old.exponents + step[..., 3:5], *EXPONENT_RANGE)
        taper = np.clip(old.taper + step[..., 5:7], TAPER_RANGE[:, 0], TAPER_RANGE[:, 1])
        origin, turn = shapes.origin.copy(), np.zeros_like(shapes.origin)
        if self.support is None:
            origin += step[..., count : count + 3]
            turn = step[..., count + 3 :]
        else:
            origin[..., :2] += step[..., count : count + 2]
            origin[..., 2] = self.support + axes[..., 2]
            turn[..., 2] = step[..., count + 2]
        turn = _shortened(turn, turn, _LARGEST_TURN)
        rotation = shapes.rotation @ exp_so3(turn)
        return Placed(Parameters(axes, exponents, taper), rotation, origin)


def _shortened(step: Array, measured: Array, most: float) -> Array:
    """Return steps (..., P) scaled down where the largest of what is measured exceeds `most`."""
    largest = np.max(np.abs(measured), axis=-1, keepdims=True)
    return np.asarray(step * np.minimum(1.0, most / np.maximum(largest, 1e-9)))
