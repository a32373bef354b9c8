"""Motion of many pushed or pulled objects at once: implicit steps with lagged Coulomb friction."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.planar.mechanics.linkage import (
    Link,
    Linkage,
    applied,
    cross,
    shifting,
    turned,
)
from tactile_dynamics_ros.core.planar.mechanics.pusher import Hold, Mask, Pusher
from tactile_dynamics_ros.core.planar.mechanics.support import tipping_shift

GRAVITY = 9.81
"""Acceleration of gravity along the support's normal, m/s^2; all normal forces scale with it."""
_SLIP = 1e-6
"""Speed below which friction falls, m/s: how fast an object creeps that should stick. At 1e-5 ten
seconds of rest under force cost 0.1 mm; below 1e-7 the lagged iteration needs more rounds."""
_RESTARTS = 3
"""Rounds after which friction still starts anew where a contact changed between stick and slip. At
1 forces of tips that slide along an edge are off by a third in a tenth of the steps of four rounds;
with any number, contacts that change in turn never settle."""


@dataclass(frozen=True)
class StepConfig:
    """How steps are solved.

    Attributes:
        step: s; 5 ms instead of 0.5 ms cost 0.01 mm after 15 mm at 20 mm/s, 0.12 mm at 100 mm/s
            because of the impact.
        rounds: solutions per step, each with friction, pressure and contact by the one before.
        quasi_static: whether inertia is left out.
    """

    step: float = 5e-3
    rounds: int = 4
    quasi_static: bool = False


@dataclass(frozen=True, eq=False)
class Motion:
    """What happened to B objects.

    Attributes:
        time: (T,) s. pose: (B, T, L, 3) of the links' frames.
        twist: (B, T, L, 3) of the centres of mass. wrench: (B, T, 3) of the pusher on the object,
            about the pusher's point, mean of the step that ends at the time.
        point: (B, T, 3) pose of the pusher.
    """

    time: Array
    pose: Array
    twist: Array
    wrench: Array
    point: Array


class PlanarSimulation:
    """State of B objects that a pusher moves.

    Args:
        linkage: links and joint.
        pusher: tip or grip.
        pose: (B, L, 3) of the links' frames at the start; the first decides where the joint is.
        config: steps.
        twist: (B, L, 3) of the centres of mass at the start; rest by default.
    """

    def __init__(
        self,
        linkage: Linkage,
        pusher: Pusher,
        pose: Array,
        config: StepConfig | None = None,
        twist: Array | None = None,
    ) -> None:
        self.linkage, self.pusher, self.config = linkage, pusher, config or StepConfig()
        self.coordinates = linkage.coordinates(pose)
        size, links = pose.shape[:2]
        self.twist = np.zeros((size, links, 3)) if twist is None else twist.copy()
        self.wrench = np.zeros((size, 3))
        self._friction = np.zeros((size, links, 3))

    def step(self, before: Array, after: Array) -> None:
        """Advance by one step while the pusher moves from one pose (B, 3) to the next."""
        step = self.config.step
        jacobians = self.linkage.jacobians(self.coordinates)
        frames = self.linkage.frames(self.coordinates)
        touched = self.linkage.links[self.pusher.link]
        hold = self.pusher.hold(frames[:, self.pusher.link], before, after, step)
        to_frame = shifting(turned(-touched.com, frames[:, self.pusher.link, 2]))
        contact_jacobian = to_frame @ jacobians[self.pusher.link]
        inertia, momentum = self._inertia(jacobians)
        start, lagged = (self.wrench, self._friction.copy()), self.twist
        for again in range(self.config.rounds):
            matrix, push = inertia.copy(), momentum.copy()
            self._add_friction(matrix, jacobians, frames, lagged, before)
            damping, drive = hold.linear()
            reach = contact_jacobian.swapaxes(1, 2)
            matrix += step * (reach @ damping @ contact_jacobian)
            push += step * applied(reach, drive)
            velocity = np.asarray(np.linalg.solve(matrix, push[..., None])[..., 0], dtype=float)
            twist = np.stack([applied(j, velocity) for j in jacobians], axis=1)
            at_frame = applied(contact_jacobian, velocity)
            changed = hold.settle(at_frame)
            wrench = _about_point(hold, at_frame, frames[:, self.pusher.link], before)
            lagged = self._lagged(changed if again < _RESTARTS else None, twist, wrench, start)
        hold.remember(at_frame)
        self.coordinates = self.linkage.moved(self.coordinates, velocity, step)
        self.twist, self.wrench = twist, wrench

    def _lagged(
        self, changed: Mask | None, twist: Array, wrench: Array, start: tuple[Array, Array]
    ) -> Array:
        """Twists (B, L, 3) by which friction follows next; wrenches and tipping along with them.

        Where a contact turned out to slide instead of sticking, what was solved for a sticking one
        misleads: friction follows from the step's start again.

        Args:
            changed: (B,) where contacts changed.
            twist: (B, L, 3) latest.
            wrench: (B, 3) latest.
            start: wrench (B, 3) and friction (B, L, 3) when the step began.
        """
        self.wrench = wrench
        if changed is None or not changed.any():
            return twist
        self.wrench = np.where(changed[:, None], start[0], wrench)
        self._friction[changed] = start[1][changed]
        return np.where(changed[:, None, None], self.twist, twist)

    def _inertia(self, jacobians: list[Array]) -> tuple[Array, Array]:
        """Mass matrix (B, D, D) and momentum (B, D) of the coordinates."""
        size = len(self.coordinates)
        matrix = np.zeros((size, self.linkage.freedoms, self.linkage.freedoms))
        momentum = np.zeros((size, self.linkage.freedoms))
        if self.config.quasi_static:
            return matrix, momentum
        for k, (link, jacobian) in enumerate(zip(self.linkage.links, jacobians, strict=True)):
            mass = np.stack([link.mass, link.mass, link.inertia], axis=1)
            back = jacobian.swapaxes(1, 2)
            matrix += back @ (mass[:, :, None] * jacobian)
            momentum += applied(back, mass * self.twist[:, k])
        return matrix, momentum

    def _add_friction(
        self, matrix: Array, jacobians: list[Array], frames: Array, twist: Array, point: Array
    ) -> None:
        """Add the resistance of support and joint to the matrix (B, D, D) of a step."""
        step = self.config.step
        for k, (link, jacobian) in enumerate(zip(self.linkage.links, jacobians, strict=True)):
            contact = self.wrench[:, :2] * (k == self.pusher.link)
            resistance = support_resistance(
                link, frames[:, k, 2], twist[:, k], self._friction[:, k], contact,
                self.pusher.height,
            )  # fmt: skip
            self._friction[:, k] = -applied(resistance, twist[:, k])
            matrix += step * (jacobian.swapaxes(1, 2) @ resistance @ jacobian)
        joint = self.linkage.joint
        if joint is not None and not joint.rigid:
            speed = np.abs(twist[:, 1, 2] - twist[:, 0, 2])
            share = step * joint.friction / (speed + 100.0 * _SLIP)
            relative = jacobians[1][:, 2] - jacobians[0][:, 2]
            matrix += share[:, None, None] * relative[:, :, None] * relative[:, None, :]


def support_resistance(
    link: Link, yaw: Array, twist: Array, friction: Array, contact: Array, contact_height: Array
) -> Array:
    """Matrices K (B, 3, 3): friction on the link is -K twist, about its centre of mass.

    Args:
        link: its properties.
        yaw: (B,) rad.
        twist: (B, 3) of the centre of mass, axes of the support.
        friction: (B, 3) wrench of the support, latest value, for the tipping moments.
        contact: (B, 2) N that the pusher applies on it.
        contact_height: (B,) m above the support.
    """
    patch, weight = link.patch, link.mass * GRAVITY
    shift = tipping_shift(weight, link.com_height, friction[:, :2], contact, contact_height)
    centre = link.com - patch.centroid + turned(shift, -yaw)
    load = patch.pressure(centre, link.scale) * (link.friction * weight)[:, None]
    if link.roughness is not None:
        load = load * link.roughness
    arm = turned(patch.centroid - link.com, yaw)
    motion = _rotation(-yaw) @ shifting(arm)
    own = applied(motion, twist)
    resistance = patch.resistance(load, link.scale, own, _SLIP)
    return np.asarray(motion.swapaxes(1, 2) @ resistance @ motion)


def simulate(
    linkage: Linkage,
    pusher: Pusher,
    pose: Array,
    path: Array,
    config: StepConfig | None = None,
    twist: Array | None = None,
) -> Motion:
    """Move objects along a path of the pusher.

    Args:
        linkage: links and joint, B variants.
        pusher: tip or grip.
        pose: (B, L, 3) of the links' frames at the start.
        path: (B, T, 3) poses of the pusher, one per step.
        config: steps.
        twist: (B, L, 3) of the centres of mass at the start; rest by default.
    """
    simulation = PlanarSimulation(linkage, pusher, pose, config, twist)
    count = path.shape[1]
    poses, twists, wrenches = [pose], [simulation.twist], [simulation.wrench]
    for k in range(1, count):
        simulation.step(path[:, k - 1], path[:, k])
        poses.append(linkage.frames(simulation.coordinates))
        twists.append(simulation.twist)
        wrenches.append(simulation.wrench)
    time = np.asarray(simulation.config.step * np.arange(count), dtype=float)
    pose_at, twist_at, wrench_at = (np.stack(part, axis=1) for part in (poses, twists, wrenches))
    return Motion(time, pose_at, twist_at, wrench_at, path)


def _rotation(angle: Array) -> Array:
    matrix = np.zeros((len(angle), 3, 3))
    matrix[:, 0, 0] = matrix[:, 1, 1] = np.cos(angle)
    matrix[:, 1, 0] = np.sin(angle)
    matrix[:, 0, 1] = -matrix[:, 1, 0]
    matrix[:, 2, 2] = 1.0
    return matrix


def _about_point(hold: Hold, twist: Array, frame: Array, point: Array) -> Array:
    wrench = hold.wrench(twist).copy()
    wrench[:, 2] -= cross(point[:, :2] - frame[:, :2], wrench[:, :2])
    return wrench
