"""Bodies of many scenes as arrays: one rigid body each, or two on a hinge."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tactile_dynamics_ros.synthetic.pushed.friction_field import spread_weight
from tactile_dynamics_ros.synthetic.pushed.objects import Link, PushedObject

_HINGE_ARM = 0.05
"""m at which friction of the hinge is counted as a force, so that it creeps as slowly as a foot."""
_PIN = 2e5
"""N/m of a pin against the wall of its hole; forces of a newton move it by 5 um."""


def perpendicular(vector: np.ndarray) -> np.ndarray:
    """Return vectors (..., 2) a quarter turn further: what a unit turn makes of an arm."""
    turned = np.empty_like(vector)
    turned[..., 0], turned[..., 1] = -vector[..., 1], vector[..., 0]
    return turned


def cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return the moment (...) of forces b (..., 2) at arms a (..., 2)."""
    return np.asarray(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0])


def rotation(angle: np.ndarray) -> np.ndarray:
    """Return rotations (..., 2, 2) by angles (...)."""
    turn = np.empty((*np.shape(angle), 2, 2))
    turn[..., 0, 0] = turn[..., 1, 1] = np.cos(angle)
    turn[..., 1, 0] = np.sin(angle)
    turn[..., 0, 1] = -turn[..., 1, 0]
    return turn


def merged(thing: PushedObject) -> tuple[list[Link], list[np.ndarray]]:
    """Return the bodies that move and the friction of each of their feet; a rigid pair is one."""
    frictions = [np.full(len(link.feet), link.friction) for link in thing.links]
    if thing.kind != "rigid_pair":
        return list(thing.links), frictions
    first, second = thing.links
    mass = first.mass + second.mass
    coms = [first.com, second.com + thing.offset]
    com = (first.mass * coms[0] + second.mass * coms[1]) / mass
    inertia = sum(
        link.inertia + link.mass * float(np.sum((place - com) ** 2))
        for link, place in zip(thing.links, coms, strict=True)
    )
    height = (first.mass * first.height + second.mass * second.height) / mass
    feet = np.concatenate([first.feet, second.feet + thing.offset])
    stiffness = np.concatenate([first.stiffness, second.stiffness])
    body = Link(first.corners, height, mass, com, inertia, first.friction, feet, stiffness)
    return [body], [np.concatenate(frictions)]


class Bodies:
    """Shape, mass and motion of B scenes with L bodies each; velocities are (v, turn rates).

    Attributes:
        links: L. feet_count: L N. rubbing: feet, and the hinge where there is one.
        feet: (B, L, N, 2) m. stiffness, friction: (B, L, N).
        mass, inertia, com_height: (B, L). com: (B, L, 2) m.
        position: (B, 2) m of link_1's frame. angle: (B, L) rad.
        com_velocity: (B, L, 2) m/s. turn_rate: (B, L) rad/s.
        freedoms: D; with two more where a pin has play, by which link_2 moves beside the hinge.
        slack: (B, 2) m, that it has moved, axes of the table.
    """

    def __init__(self, things: Sequence[PushedObject]) -> None:
        parts = [merged(thing) for thing in things]
        self.links = len(parts[0][0])
        count = max(len(link.feet) for links, _ in parts for link in links)
        shape = (len(things), self.links)
        self.feet, self.com = np.zeros((*shape, count, 2)), np.zeros((*shape, 2))
        self.stiffness, self.friction = np.zeros((*shape, count)), np.zeros((*shape, count))
        self.mass, self.inertia, self.com_height = (np.zeros(shape) for _ in range(3))
        for b, (links, frictions) in enumerate(parts):
            for k, (link, friction) in enumerate(zip(links, frictions, strict=True)):
                n = len(link.feet)
                self.feet[b, k, :n], self.stiffness[b, k, :n] = link.feet, link.stiffness
                self.friction[b, k, :n], self.com[b, k] = friction, link.com
                self.mass[b, k], self.inertia[b, k] = link.mass, link.inertia
                self.com_height[b, k] = 0.5 * link.height
        hinged = self.links == 2
        self.joint = np.array([t.joint if hinged else np.zeros(2) for t in things])
        self._joint_2 = self.joint - np.array([t.offset for t in things])
        self._joint_limit = np.array([t.joint_friction for t in things]) / _HINGE_ARM
        self._play = np.array([t.play for t in things])
        self.slack = np.zeros((len(things), 2))
        self.freedoms = 2 + self.links + 2 * int(self._play.any())
        self._touching = self.stiffness > 0.0
        self.feet_count = self.links * count
        self.rubbing = self.feet_count + int(hinged)
        self.position, self.angle = np.zeros((len(things), 2)), np.zeros(shape)
        self.com_velocity, self.turn_rate = np.zeros((*shape, 2)), np.zeros(shape)

    def velocities(self, points: np.ndarray) -> np.ndarray:
        """Return (B, L, N, 2, D): velocities of points (B, L, N, 2) of the bodies by those of D."""
        turn = rotation(self.angle)
        arm = np.einsum("blij,blnj->blni", turn, points)
        G = np.zeros((*points.shape, self.freedoms))
        G[..., 0, 0] = G[..., 1, 1] = 1.0
        G[:, 0, ..., 2] = perpendicular(arm[:, 0])
        if self.links == 2:
            to_joint = np.einsum("bij,bj->bi", turn[:, 0], self.joint)
            from_joint = arm[:, 1] - np.einsum("bij,bj->bi", turn[:, 1], self._joint_2)[:, None]
            G[:, 1, ..., 2] = perpendicular(to_joint)[:, None]
            G[:, 1, ..., 3] = perpendicular(from_joint)
        if self.freedoms > 4:
            G[:, 1, ..., 0, 4] = G[:, 1, ..., 1, 5] = 1.0
        return G

    def origins(self) -> np.ndarray:
        """Return the origins (B, L, 2) of the bodies' frames."""
        if self.links == 1:
            return self.position[:, None].copy()
        turn = rotation(self.angle)
        hinge = self.position + self.slack + np.einsum("bij,bj->bi", turn[:, 0], self.joint)
        second = hinge - np.einsum("bij,bj->bi", turn[:, 1], self._joint_2)
        return np.stack([self.position, second], axis=1)

    def places(self, points: np.ndarray) -> np.ndarray:
        """Return points (B, L, N, 2) of the bodies on the table."""
        arm = np.einsum("blij,blnj->blni", rotation(self.angle), points)
        return np.asarray(self.origins()[:, :, None] + arm)

    def turning(self) -> np.ndarray:
        """Return the inertia of turning as (B, D, D)."""
        diagonal = self._among_freedoms(self.inertia)
        return np.asarray(diagonal[:, :, None] * np.eye(diagonal.shape[1]))

    def turning_momentum(self) -> np.ndarray:
        """Return the angular momentum about the centres of mass as (B, D)."""
        return self._among_freedoms(self.inertia * self.turn_rate)

    def _among_freedoms(self, values: np.ndarray) -> np.ndarray:
        """Return values (B, L) of turning as (B, D)."""
        return np.pad(values, ((0, 0), (2, self.freedoms - 2 - self.links)))

    def pin(self, u: np.ndarray, h: float) -> tuple[np.ndarray, np.ndarray]:
        """Return what pins add to mass (B, D, D) and momentum (B, D) in a step from velocities.

        The wall of the hole is a stiff spring, implicit in time; without play it holds both ways.
        """
        size = np.linalg.norm(self.slack, axis=1)
        way = self.slack / np.maximum(size, 1e-12)[:, None]
        ahead = size + h * np.sum(way * u[:, 4:], axis=1)
        held = (self._play > 0.0) & (ahead > self._play)
        stiffness = np.where(held[:, None, None], way[:, :, None] * way[:, None, :], 0.0)
        stiffness += np.where((self._play == 0.0)[:, None, None], np.eye(2), 0.0)
        beyond = self.slack - self._play[:, None] * way
        mass = np.zeros((len(u), self.freedoms, self.freedoms))
        mass[:, 4:, 4:] = h * h * _PIN * stiffness
        momentum = np.zeros(u.shape)
        momentum[:, 4:] = -h * _PIN * np.einsum("bij,bj->bi", stiffness, beyond)
        return mass, momentum

    def press(
        self, gravity: np.ndarray, tipping: np.ndarray, load: np.ndarray, place: np.ndarray
    ) -> np.ndarray:
        """Return the forces (B, L, N) of the feet.

        Args:
            gravity: (B,) m/s^2 into the table.
            tipping: (B, L, 2) N m, horizontal forces times their heights, table axes.
            load: (B,) N on link_1 besides its weight.
            place: (B, 2) N m, load times its place.
        """
        weight = self.mass * gravity[:, None]
        moment = weight[..., None] * self.com
        moment += np.einsum("blji,blj->bli", rotation(self.angle), tipping)
        moment[:, 0] += place
        weight[:, 0] += load
        force, self._touching = spread_weight(
            self.feet, self.stiffness, weight, moment, self._touching
        )
        return force

    def rub(self, G: np.ndarray) -> np.ndarray:
        """Return velocities (B, P, 2, D) of feet and, where there is one, of the hinge."""
        flat = G.reshape(len(G), self.feet_count, 2, -1)
        if self.links == 1:
            return np.asarray(flat)
        hinge = np.zeros((len(G), 1, 2, self.freedoms))
        hinge[..., 0, 2:4] = -_HINGE_ARM, _HINGE_ARM
        return np.concatenate([flat, hinge], axis=1)

    def rub_limits(self, feet: np.ndarray) -> np.ndarray:
        """Return the largest friction (B, P) of feet (B, L N) and hinge."""
        if self.links == 1:
            return feet
        return np.concatenate([feet, self._joint_limit[:, None]], axis=1)

    def move(self, u: np.ndarray, com_velocity: np.ndarray, h: float) -> None:
        """Go on with velocities (B, D) for a time."""
        self.position = self.position + h * u[:, :2]
        turning = u[:, 2 : 2 + self.links]
        self.angle = self.angle + h * turning
        if self.freedoms > 4:
            self.slack = self.slack + h * u[:, 4:]
        self.com_velocity, self.turn_rate = com_velocity, turning.copy()

    def kinetic_energy(self) -> np.ndarray:
        """Return (B,) J."""
        moving = np.sum(self.mass * np.sum(self.com_velocity**2, axis=-1), axis=1)
        return np.asarray(0.5 * (moving + np.sum(self.inertia * self.turn_rate**2, axis=1)))

    def add_mass(self, b: int, mass: float, place: np.ndarray) -> None:
        """Put a point mass on link_1 of one scene; it moves along from then on."""
        if mass == 0.0:
            return
        total = self.mass[b, 0] + mass
        com = (self.mass[b, 0] * self.com[b, 0] + mass * place) / total
        reduced = self.mass[b, 0] * mass / total
        self.inertia[b, 0] += reduced * np.sum((place - self.com[b, 0]) ** 2)
        shift = rotation(self.angle[b, 0]) @ (com - self.com[b, 0])
        self.com_velocity[b, 0] += self.turn_rate[b, 0] * perpendicular(shift)
        self.mass[b, 0], self.com[b, 0] = total, com
