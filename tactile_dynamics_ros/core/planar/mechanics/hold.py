"""A contact without memory: the touched point moves as the pusher does, with stick and slip."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.planar.mechanics.linkage import applied, cross, shifting, turned
from tactile_dynamics_ros.core.planar.mechanics.outline import edge_normals, nearest_edge
from tactile_dynamics_ros.core.planar.mechanics.pusher import LinearHold

Mask = NDArray[np.bool_]

_GAIN = 1e5
"""Force per slip velocity that holds the contact, N s/m: 3 N let it creep by 0.03 mm/s. The tip's
own spring is left out: a depth of micrometres cannot be distinguished from poses of 0.5 mm, and its
force would be the poses' noise. Ten times less would change velocities by 1 % of a slow push."""
_TURNING_GAIN = 100.0
"""Torque per turning rate that holds a grip, N m s/rad: 0.1 N m let it creep by 0.06 deg/s."""
_CLOSING = 0.1
"""Time in which a tip that lies inside the outline leaves it where only the outline tells of
contact, s. Shorter ones push the object with the pose's error."""


@dataclass(frozen=True, eq=False)
class Tip:
    """A tip whose contact is measured, or follows from a convex outline.

    f_n = max(0, c (p - v) . n), |f_t| <= friction f_n

    Attributes:
        outline: (V, 2) m, convex, link frame. height: (B,) m. friction: (B,) against the object.
        touching: whether it touches; None where the outline decides.
        normal: (2,) into the object, axes of S, or None where the outline decides.
        link: index of the touched link.
    """

    outline: Array
    height: Array
    friction: Array
    touching: bool | None = None
    normal: Array | None = None
    link: int = 0

    def hold(self, frame: Array, before: Array, after: Array, step: float) -> TipHold:
        """Contact during a step."""
        arm = before[:, :2] - frame[:, :2]
        velocity = (after[:, :2] - before[:, :2]) / step
        if self.normal is not None and self.touching is not None:
            normal, depth = np.broadcast_to(self.normal, arm.shape), np.zeros(len(arm))
        else:
            own = turned(arm, -frame[:, 2])
            depth, normal = nearest_edge(self.outline, edge_normals(self.outline), own)
            normal = turned(normal, frame[:, 2])
        in_contact = np.full(len(arm), bool(self.touching))
        if self.touching is None:
            in_contact = depth + step * np.maximum(np.sum(velocity * normal, axis=1), 0.0) > 0.0
            velocity = velocity + normal * (np.maximum(depth, 0.0) / _CLOSING)[:, None]
        return TipHold(self.friction, arm, normal, velocity, in_contact)


class TipHold:
    """Contact of a tip during one step."""

    def __init__(
        self, friction: Array, arm: Array, normal: Array, velocity: Array, in_contact: Mask
    ) -> None:
        tangent = np.stack([-normal[:, 1], normal[:, 0]], axis=1)
        self.friction, self.in_contact = friction, in_contact
        self.along = [np.column_stack([d, cross(arm, d)]) for d in (normal, tangent)]
        self.drive = [np.sum(velocity * d, axis=1) for d in (normal, tangent)]
        self.touches = in_contact
        self.slides = np.zeros(len(arm), dtype=bool)
        self.way = np.ones(len(arm))

    def linear(self) -> tuple[Array, Array]:
        """Damping and push of the present state; what slides is dragged along as it is pressed."""
        sticks = self.touches & ~self.slides
        normal, tangent = self.along
        pressing, holding = _GAIN * self.touches, _GAIN * sticks
        acting = normal + (self.friction * self.way * self.slides)[:, None] * tangent
        damping = pressing[:, None, None] * acting[:, :, None] * normal[:, None, :]
        damping += holding[:, None, None] * tangent[:, :, None] * tangent[:, None, :]
        push = (pressing * self.drive[0])[:, None] * acting
        push += (holding * self.drive[1])[:, None] * tangent
        return np.asarray(damping), np.asarray(push)

    def settle(self, twist: Array) -> Mask:
        """Touch while the normal force presses; slide where the tangential one is too large.

        Without a memory each step begins with a tip that sticks, and a tip that slides along an
        edge would drag the object sideways at several times the force.
        """
        before = self.touches, self.slides, self.way * self.slides
        normal, tangential = self._forces(twist)
        self.touches = self.in_contact & (normal > 0.0)
        most = self.friction * np.maximum(normal, 0.0)
        self.slides = self.touches & (np.abs(tangential) > most)
        self.way = np.sign(tangential)
        after = self.touches, self.slides, self.way * self.slides
        return np.asarray(np.any([a != b for a, b in zip(before, after, strict=True)], axis=0))

    def wrench(self, twist: Array) -> Array:
        """Wrench of the tip on the object."""
        normal, tangential = self._forces(twist)
        normal = np.maximum(normal, 0.0) * self.in_contact
        most = self.friction * normal
        force = (normal, np.clip(tangential, -most, most))
        return np.asarray(sum(f[:, None] * a for f, a in zip(force, self.along, strict=True)))

    def remember(self, twist: Array) -> None:
        """Nothing to keep."""

    def _forces(self, twist: Array) -> tuple[Array, Array]:
        """Normal and tangential force if it touches and sticks."""
        normal, tangential = (
            _GAIN * (drive - np.sum(along * twist, axis=1))
            for drive, along in zip(self.drive, self.along, strict=True)
        )
        return normal, tangential


@dataclass(frozen=True, eq=False)
class Grip:
    """A grip that the link moves and turns with.

    Attributes:
        height: (B,) m. link: index of the gripped link.
    """

    height: Array
    link: int = 0

    def hold(self, frame: Array, before: Array, after: Array, step: float) -> GripHold:
        """Hold during a step."""
        return GripHold(before[:, :2] - frame[:, :2], (after - before) / step)


class GripHold(LinearHold):
    """A grip during one step; it needs no settling."""

    def __init__(self, arm: Array, velocity: Array) -> None:
        gains = np.array([_GAIN, _GAIN, _TURNING_GAIN])
        motion = shifting(arm)
        back = motion.swapaxes(1, 2)
        super().__init__(back @ (gains[:, None] * motion), applied(back, gains * velocity))
