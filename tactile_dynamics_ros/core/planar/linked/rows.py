"""Friction, pressure and acceleration of one part of a pair, per interval."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.planar.mechanics.linkage import applied, cross, turned
from tactile_dynamics_ros.core.planar.mechanics.outline import load_points
from tactile_dynamics_ros.core.planar.mechanics.support import SupportPatch


def across(arm: Array) -> Array:
    """Vectors (N, 2) a quarter turn further: what a unit turn makes of an arm."""
    return np.stack([-arm[:, 1], arm[:, 0]], axis=1)


@dataclass(frozen=True)
class PartMotion:
    """Pose, velocity and acceleration (N, 3) of a part's frame."""

    pose: Array
    velocity: Array
    acceleration: Array

    def place(self, point: Array) -> Array:
        """(N, 2) m of a point (2,) of the part, relative to its frame's origin."""
        return turned(np.broadcast_to(point, (len(self.pose), 2)), self.pose[:, 2])

    def acceleration_of(self, point: Array) -> Array:
        """(N, 2) m/s^2 of a point (2,) of the part."""
        return self.acceleration_at(self.place(point))

    def acceleration_at(self, arm: Array) -> Array:
        """(N, 2) m/s^2 at arms (N, 2) from the frame's origin, m, axes of the support."""
        rate = self.velocity[:, 2:]
        turning = self.acceleration[:, 2:] * across(arm) - rate**2 * arm
        return np.asarray(self.acceleration[:, :2] + turning)

    def velocity_of(self, point: Array) -> Array:
        """(N, 2) m/s of a point (2,) of the part."""
        return np.asarray(self.velocity[:, :2] + self.velocity[:, 2:] * across(self.place(point)))

    def twist_of(self, point: Array) -> Array:
        """(N, 3) of a point (2,), axes of the part."""
        linear = turned(self.velocity_of(point), -self.pose[:, 2])
        return np.concatenate([linear, self.velocity[:, 2:]], axis=1)


@dataclass(frozen=True, eq=False)
class PairPatch(SupportPatch):
    """Footprint of two outlines that carry together.

    Attributes:
        other: (V, 2) m, the second outline, in the frame of the first.
    """

    other: Array | None = None

    @cached_property
    def _points(self) -> tuple[Array, Array]:
        assert self.other is not None
        areas = [_area(self.outline), _area(self.other)]
        both = [load_points(o, self.count) for o in (self.outline, self.other)]
        shares = [share * area / self._area for (_, share), area in zip(both, areas, strict=True)]
        return np.concatenate([points for points, _ in both]), np.concatenate(shares)

    @cached_property
    def _area(self) -> float:
        assert self.other is not None
        return _area(self.outline) + _area(self.other)

    @cached_property
    def centroid(self) -> Array:
        """(2,) m, frame of the first outline: of both areas together."""
        points, share = self._points
        return np.asarray(share @ points)

    @cached_property
    def second(self) -> NDArray[np.bool_]:
        """(n,) which points belong to the second outline."""
        count = len(load_points(self.outline, self.count)[0])
        return np.arange(len(self.share)) >= count

    def contrast(self, ratio: Array) -> Array:
        """(R, n) factors of friction, by ln (R, 1) of the second outline's over the first's."""
        return np.asarray(np.exp(np.where(self.second, 0.5, -0.5) * ratio))


def _area(outline: Array) -> float:
    after = np.roll(outline, -1, axis=0)
    return abs(0.5 * float(np.sum(cross(outline, after))))


_CHANGES = (1e-6, 1e-6, 1e-5, 1e-6, 1e-6, 1e-5, 1e-5)
"""Changes of twist, centre, scale and ratio for difference quotients, m/s, rad/s, m and 1."""


@dataclass(frozen=True, eq=False)
class LinearFriction:
    """Wrench per newton of load times coefficient, to first order around a state.

    The wrench (N, 3) is about the footprint's centroid, axes of the part. The state (N, 7) is the
    twist of the centroid, the centre of pressure from it, the size of what carries, and the
    logarithm of the second outline's coefficient over the first one's.
    """

    around: Array
    base: Array
    slope: Array

    @classmethod
    def of_state(cls, patch: SupportPatch, state: Array, slip: float) -> LinearFriction:
        """Evaluate friction and its derivatives at a state."""
        paired = isinstance(patch, PairPatch)

        def wrench(values: Array, load: Array) -> Array:
            if isinstance(patch, PairPatch):
                load = load * patch.contrast(values[:, 6:])
            matrix = patch.resistance(load, values[:, 5], values[:, :3], slip)
            return -applied(matrix, values[:, :3])

        load = patch.pressure(state[:, 3:5], state[:, 5])
        base = wrench(state, load)
        slopes = []
        for k, h in enumerate(_CHANGES[: 7 if paired else 6]):
            moved = state + h * np.eye(7)[k]
            pressed = patch.pressure(moved[:, 3:5], moved[:, 5]) if k in (3, 4, 5) else load
            slopes.append((wrench(moved, pressed) - base) / h)
        if not paired:
            slopes.append(np.zeros_like(base))
        return cls(state, base, np.stack(slopes, axis=2))

    def at(self, state: Array) -> Array:
        """Wrench (N, 3) at a nearby state."""
        return np.asarray(self.base + applied(self.slope, state - self.around))


@dataclass(frozen=True, eq=False)
class PairFriction:
    """Friction of all bodies to first order, and the slip speed, m/s, below which it falls."""

    bodies: tuple[LinearFriction, ...]
    slip: float


@dataclass(frozen=True, eq=False)
class Loaded:
    """Pull (R, 2) N, friction coefficient times load (R,) N, and centre of pressure (R, 2) m.

    The pull is mass times acceleration less gravity.
    """

    pull: Array
    load: Array
    centre: Array


@dataclass(frozen=True, eq=False)
class Pressed:
    """How a body rests and slides.

    Attributes:
        patch: its footprint. part: its motion.
        state: (R, 7), see `LinearFriction`. load: (R,) N, friction coefficient times load.
    """

    patch: SupportPatch
    part: PartMotion
    state: Array
    load: Array

    @property
    def feet(self) -> Array:
        """Places (R, n, 2) of the points that carry, m, axes of the support."""
        places = [self.part.place(point) for point in self.patch.centroid + self.patch.offset]
        return self.part.pose[:, None, :2] + np.stack(places, axis=1)

    def support_by(self, share: Array, slip: float) -> tuple[Array, Array]:
        """Change of force (R, 2) and torque (R,) by relative changes (R, n) under the points.

        In axes of the support, the torque about the centroid.
        """
        values, patch = self.state, self.patch
        pressure = patch.pressure(values[:, 3:5], values[:, 5]) * self.load[:, None]
        if isinstance(patch, PairPatch):
            pressure = pressure * patch.contrast(values[:, 6:])
        matrix = patch.resistance(pressure * share, values[:, 5], values[:, :3], slip)
        wrench = -applied(matrix, values[:, :3])
        return turned(wrench[:, :2], self.part.pose[:, 2]), wrench[:, 2]
