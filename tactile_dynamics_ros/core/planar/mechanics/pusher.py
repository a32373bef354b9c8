"""What moves the object: a tip that touches its outline, or a grip that encloses a part of it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.planar.mechanics.linkage import applied, cross, shifting, turned
from tactile_dynamics_ros.core.planar.mechanics.outline import edge_normals, nearest_edge

Mask = NDArray[np.bool_]


class Hold(Protocol):
    """The contact during one step, linear in the twist of the touched link's frame.

    The wrench on the object about the origin of that frame is ``push - damping twist``.
    """

    def linear(self) -> tuple[Array, Array]:
        """Damping (B, 3, 3) and push (B, 3), axes of the support."""

    def settle(self, twist: Array) -> Mask | None:
        """Choose between touch and none, stick and slip, by the twist (B, 3) at the step's end.

        Returns:
            Which objects (B,) changed so much that this twist misleads; None for none.
        """

    def wrench(self, twist: Array) -> Array:
        """(B, 3) on the object about the origin of the link's frame."""

    def remember(self, twist: Array) -> None:
        """Keep what the next step needs."""


class Pusher(Protocol):
    """A tip or a grip."""

    @property
    def link(self) -> int:
        """Index of the link that it touches."""

    @property
    def height(self) -> Array:
        """(B,) m above the support."""

    def hold(self, frame: Array, before: Array, after: Array, step: float) -> Hold:
        """Contact during a step.

        Args:
            frame: (B, 3) pose of the link's frame.
            before: (B, 3) pose of the pusher at the start of the step.
            after: (B, 3) at its end.
            step: s.
        """


@dataclass(eq=False)
class Tip:
    """A point that pushes a convex outline, with compliance, stick and slip.

    f_n = max(0, k depth + c d depth/dt), |f_t| <= friction f_n, f_t = k stretch while it sticks.

    Attributes:
        outline: (V, 2) m, link frame, convex.
        height: (B,) m.
        friction: (B,) coefficient between tip and object.
        stiffness: N/m of tip and arm along each direction, or (B,).
        damping: N s/m along the normal.
        link: index of the link that it touches.
    """

    outline: Array
    height: Array
    friction: Array
    stiffness: float | Array = 2e4
    damping: float = 20.0
    link: int = 0

    def __post_init__(self) -> None:
        self._normals = edge_normals(self.outline)
        self.stretch = np.zeros(len(self.height))

    def hold(self, frame: Array, before: Array, after: Array, step: float) -> TipHold:
        """Contact of the tip during a step."""
        own = turned(before[:, :2] - frame[:, :2], -frame[:, 2])
        depth, normal = nearest_edge(self.outline, self._normals, own)
        return TipHold(
            self,
            before[:, :2] - frame[:, :2],
            depth,
            turned(normal, frame[:, 2]),
            (after[:, :2] - before[:, :2]) / step,
            step,
        )


class TipHold:
    """Contact of a tip during one step."""

    def __init__(
        self, tip: Tip, arm: Array, depth: Array, normal: Array, velocity: Array, step: float
    ) -> None:
        self.tip, self.step, self.depth = tip, step, depth
        tangent = np.stack([-normal[:, 1], normal[:, 0]], axis=1)
        self.along = [np.column_stack([d, cross(arm, d)]) for d in (normal, tangent)]
        self.drive = [np.sum(velocity * d, axis=1) for d in (normal, tangent)]
        self.touches = depth + step * np.maximum(self.drive[0], 0.0) > 0.0
        self.slides = np.zeros(len(depth), dtype=bool)
        self.limit = np.zeros(len(depth))

    @property
    def _gains(self) -> tuple[float | Array, float | Array]:
        return self.step * self.tip.stiffness + self.tip.damping, self.step * self.tip.stiffness

    def _forces(self, twist: Array) -> tuple[Array, Array]:
        """Normal and tangential force if it touches and sticks."""
        speed = [
            drive - np.sum(along * twist, axis=1)
            for drive, along in zip(self.drive, self.along, strict=True)
        ]
        normal = self.tip.stiffness * self.depth + self._gains[0] * speed[0]
        return normal, self.tip.stiffness * self.tip.stretch + self._gains[1] * speed[1]

    def linear(self) -> tuple[Array, Array]:
        """Damping and push of the present state of contact."""
        sticks = self.touches & ~self.slides
        gains = self._gains[0] * self.touches, self._gains[1] * sticks
        at_rest = self._forces(np.zeros((len(self.depth), 3)))
        push = [self.touches * at_rest[0], np.where(sticks, at_rest[1], self.limit * self.slides)]
        damping = sum(
            g[:, None, None] * a[:, :, None] * a[:, None, :]
            for g, a in zip(gains, self.along, strict=True)
        )
        total = sum(p[:, None] * a for p, a in zip(push, self.along, strict=True))
        return np.asarray(damping), np.asarray(total)

    def settle(self, twist: Array) -> None:
        """Touch while the normal force presses; slide where the tangential one is too large.

        The stretch that is remembered keeps what changes small.
        """
        normal, tangential = self._forces(twist)
        self.touches = normal > 0.0
        most = self.tip.friction * np.maximum(normal, 0.0)
        self.slides = self.touches & (np.abs(tangential) > most)
        self.limit = np.sign(tangential) * most

    def _components(self, twist: Array) -> tuple[Array, Array]:
        normal, tangential = self._forces(twist)
        normal = np.maximum(normal, 0.0)
        most = self.tip.friction * normal
        return normal, np.clip(tangential, -most, most)

    def wrench(self, twist: Array) -> Array:
        """Wrench of the tip on the object."""
        parts = zip(self._components(twist), self.along, strict=True)
        return np.asarray(sum(f[:, None] * a for f, a in parts))

    def remember(self, twist: Array) -> None:
        """Keep the tangential stretch of the tip."""
        self.tip.stretch = self._components(twist)[1] / self.tip.stiffness


@dataclass(eq=False)
class Grip:
    """A form-closed grip: a spring between the gripper and a point of the link, and their yaws.

    Attributes:
        point: (B, 2) m, of the link, where the gripper's pose lies at rest.
        angle: (B,) rad, yaw of the gripper relative to the link at rest.
        height: (B,) m. link: index of the gripped link.
        stiffness: N/m, or (B,). turning: N m/rad. time_constant: s, damping over stiffness.
    """

    point: Array
    angle: Array
    height: Array
    link: int = 0
    stiffness: float | Array = 5e3
    turning: float = 5.0
    time_constant: float = 2e-3

    def hold(self, frame: Array, before: Array, after: Array, step: float) -> GripHold:
        """Spring during a step."""
        return GripHold(self, frame, before, after, step)


class LinearHold:
    """A hold whose wrench is linear in the twist, push - damping twist; it needs no settling.

    Args:
        damping: (B, 3, 3). push: (B, 3).
    """

    def __init__(self, damping: Array, push: Array) -> None:
        self._damping, self._push = damping, push

    def linear(self) -> tuple[Array, Array]:
        """Damping and push of the hold."""
        return self._damping, self._push

    def settle(self, twist: Array) -> None:
        """Nothing to choose."""

    def wrench(self, twist: Array) -> Array:
        """Wrench of the hold."""
        return np.asarray(self._push - applied(self._damping, twist))

    def remember(self, twist: Array) -> None:
        """Nothing to keep."""


class GripHold(LinearHold):
    """Spring of a grip during one step; it needs no settling."""

    def __init__(self, grip: Grip, frame: Array, before: Array, after: Array, step: float) -> None:
        arm = turned(grip.point, frame[:, 2])
        stiffness = np.broadcast_to(grip.stiffness, len(frame))
        gains = np.stack([stiffness, stiffness, np.full(len(frame), grip.turning)], axis=1)
        place = np.column_stack([frame[:, :2] + arm, frame[:, 2] + grip.angle])
        motion = shifting(arm)
        rate = step + grip.time_constant
        pull = gains * (before - place + rate * (after - before) / step)
        turned_back = motion.swapaxes(1, 2)
        damping = turned_back @ ((gains * rate)[:, :, None] * motion)
        super().__init__(damping, applied(turned_back, pull))
