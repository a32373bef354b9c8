"""Coulomb friction of footprints, of one part or two, under a balancing pressure.

Planar twists and wrenches are (x, y, rotation) and (force x, force y, torque), batch axis first.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.planar.mechanics.outline import area_and_centroid, load_points

_LIFTED_STEPS = 12
"""Newton steps for the pressure where part of the footprint lifts off. The equations are piecewise
linear, so that it ends after as many changes of the lifted part. With too few the centre of
pressure of such postures is off."""
_LIFTED_LACK = 1e-10
"""What may be lacking, before the last step, of the load over the load and of its centre, m: a
thousandth of a millimetre is 1e-6. At 1e-13 rounding keeps the iteration going to its end."""

_REGULAR = 1e-9
"""Share of the load by which moments of the points that carry are widened: where an object stands
on one or two points they are singular. Centres of pressure move by less than a nanometre."""


@dataclass(frozen=True, eq=False)
class SupportPatch:
    """Points of a footprint that carry load.

    Attributes:
        outline: (V, 2) m, link frame.
        count: points, roughly; 64 instead of 400 change the friction torque by 0.7 %.
        corners_only: whether the object stands on the vertices alone, as on feet.
    """

    outline: Array
    count: int = 64
    corners_only: bool = False

    @cached_property
    def _points(self) -> tuple[Array, Array]:
        if self.corners_only:
            return self.outline, np.full(len(self.outline), 1.0 / len(self.outline))
        return load_points(self.outline, self.count)

    @cached_property
    def centroid(self) -> Array:
        """(2,) m, link frame: of the area, or of the vertices where they alone carry."""
        if self.corners_only:
            return np.asarray(self.outline.mean(axis=0))
        return area_and_centroid(self.outline)[1]

    @cached_property
    def offset(self) -> Array:
        """(n, 2) points relative to the centroid, m."""
        points, share = self._points
        return np.asarray(points - share @ points)

    @cached_property
    def share(self) -> Array:
        """(n,) shares of the area."""
        return self._points[1]

    @cached_property
    def spacing(self) -> float:
        """Distance of the points, m: root of their mean area; 0 for feet."""
        if self.corners_only:
            return 0.0
        return float(np.sqrt(self._area / len(self.offset)))

    @cached_property
    def _area(self) -> float:
        return abs(area_and_centroid(self.outline)[0])

    @cached_property
    def gyration(self) -> float:
        """Squared radius of gyration of the even footprint about its centroid, m^2."""
        return float(self.share @ np.sum(self.offset**2, axis=1))

    @cached_property
    def _features(self) -> Array:
        """(n, 4) of 1, x, y, x^2 + y^2."""
        x, y = self.offset.T
        return np.stack([np.ones_like(x), x, y, x * x + y * y], axis=1)

    @cached_property
    def second_moments(self) -> Array:
        """(2, 2) of the even pressure about the centroid, m^2."""
        return np.asarray((self.offset * self.share[:, None]).T @ self.offset)

    def pressure(self, centre: Array, scale: Array) -> Array:
        """Shares (B, n) of the load: linear over the footprint, nowhere below zero.

        p_i = w_i max(0, a + g . d_i), sum p_i = 1, scale sum p_i d_i = centre

        Args:
            centre: (B, 2) centre of pressure relative to the centroid, m, link axes.
            scale: (B,) size of the part that carries over that of the footprint.
        """
        return np.asarray(self.share * self._level(centre / scale[:, None]))

    def pressure_and_slope(self, centre: Array, scale: Array) -> tuple[Array, Array]:
        """`pressure` and its derivative (B, n, 2) by the centre, while the same points carry."""
        linear = self._features[:, :3]
        level = self._level(centre / scale[:, None])
        borne = self.share * (level > 0.0)
        moments = self._moments(borne)
        by_slope = np.linalg.solve(moments, np.eye(3)[1:].T[None])
        slope = (borne / scale[:, None])[:, :, None] * (linear @ by_slope)
        return np.asarray(self.share * level), np.asarray(slope)

    def _level(self, wanted: Array) -> Array:
        """max(0, a + g . d) (B, n) for centres of pressure (B, 2) of the part that carries."""
        linear = self._features[:, :3]
        slope = np.concatenate(
            [np.ones((len(wanted), 1)), np.linalg.solve(self.second_moments, wanted.T).T], axis=1
        )
        level = slope @ linear.T
        lifted = np.flatnonzero(level.min(axis=1) < 0.0)
        if len(lifted):
            level[lifted] = self._with_lift(slope[lifted], wanted[lifted])
        return np.maximum(level, 0.0)

    def _moments(self, borne: Array) -> Array:
        """Moments (B, 3, 3) of 1, x, y over points of weights (B, n)."""
        linear = self._features[:, :3]
        products = (linear[:, :, None] * linear[:, None, :]).reshape(-1, 9)
        moments = (borne @ products).reshape(-1, 3, 3)
        moments += _REGULAR * np.eye(3) * moments[:, :1, :1]
        return np.asarray(moments)

    def _with_lift(self, slope: Array, wanted: Array) -> Array:
        linear = self._features[:, :3]
        target = np.concatenate([np.ones((len(wanted), 1)), wanted], axis=1)
        left = np.arange(len(slope))
        for _ in range(_LIFTED_STEPS):
            level = slope[left] @ linear.T
            borne = self.share * (level > 0.0)
            lack = target[left] - (borne * level) @ linear
            slope[left] += np.linalg.solve(self._moments(borne), lack[..., None])[..., 0]
            left = left[np.max(np.abs(lack), axis=1) >= _LIFTED_LACK]
            if len(left) == 0:
                break
        level = np.maximum(slope @ linear.T, 0.0)
        return np.asarray(level / np.maximum(level @ self.share, 1e-12)[:, None])

    def resistance(self, load: Array, scale: Array, twist: Array, slip: float | Array) -> Array:
        """Matrices K (B, 3, 3) with which friction is -K twist, about the centroid, link axes.

        f_i = -load_i v_i / sqrt(|v_i|^2 + slip^2), v_i = v + omega x scale d_i

        Args:
            load: (B, n) friction coefficient times normal force of each point, N.
            scale: (B,) of the points' distances.
            twist: (B, 3) of the centroid, link axes, m/s and rad/s.
            slip: speed below which friction falls, m/s; a number, or (B, 1).
        """
        u, v, w = twist[:, 0], twist[:, 1], twist[:, 2] * scale
        terms = np.stack([u * u + v * v, 2.0 * w * v, -2.0 * w * u, w * w], axis=1)
        squares = terms @ self._features.T
        weight = load / np.sqrt(np.maximum(squares, 0.0) + np.square(slip))
        even, x, y, polar = (weight @ self._features).T
        x, y, polar = scale * x, scale * y, scale * scale * polar
        none = np.zeros_like(even)
        rows = [even, none, -y, none, even, x, -y, x, polar]
        return np.stack(rows, axis=1).reshape(-1, 3, 3)

    def balanced(self, pressure: Array, changes: Array) -> Iterator[Array]:
        """Relative changes (B, n) of pressures that keep load and centre, one by one.

        Args:
            pressure: (B, n) shares of the load.
            changes: (K, n) relative; of each the part that is linear over the footprint is taken
                away that load and centre rule out.
        """
        linear = self._features[:, :3]
        moments = self._moments(pressure)
        for change in changes:
            moved = (pressure * change) @ linear
            yield change - np.linalg.solve(moments, moved[..., None])[..., 0] @ linear.T

    def friction_radius(self, centre: Array, scale: Array) -> Array:
        """Largest friction torque about the centre of pressure over the largest force, (B,) m."""
        distance = np.linalg.norm(scale[:, None, None] * self.offset - centre[:, None, :], axis=2)
        return np.asarray(np.sum(self.pressure(centre, scale) * distance, axis=1))


def tipping_shift(
    weight: Array, height: Array, support: Array, contact: Array, contact_height: Array
) -> Array:
    """How far the centre of pressure lies from below the centre of mass, (B, 2) m.

    shift = ((z_c - h) F_c - h F_s) / N; roll and pitch stay zero.

    Args:
        weight: (B,) normal force N on the support, N.
        height: (B,) of the centre of mass above the support, m.
        support: (B, 2) friction force on the object, N.
        contact: (B, 2) horizontal force of the contact on the object, N.
        contact_height: (B,) m.
    """
    moment = (contact_height - height)[:, None] * contact - height[:, None] * support
    return np.asarray(moment / weight[:, None])


@dataclass(frozen=True, eq=False, kw_only=True)
class PairPatch(SupportPatch):
    """Points of two footprints that one plane presses on the support.

    Attributes:
        points: (n, 2) m, frame of the first part. shares: (n,) of the area.
    """

    points: Array
    shares: Array

    @cached_property
    def _points(self) -> tuple[Array, Array]:
        return self.points, self.shares

    @cached_property
    def centroid(self) -> Array:
        """(2,) m, of both."""
        return np.asarray(self.shares @ self.points)
