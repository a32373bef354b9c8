"""Where pushes take two parts on a revolute joint: many candidates at once, quasi-static.

Points and directions of the plane are complex numbers here, x + i y: turning by an angle is a
product with exp(i angle), a right angle is i, and a . b + i a x b = conj(a) b.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.planar.control.prediction import PushedBody
from tactile_dynamics_ros.core.planar.linked.outlines import distance_outside
from tactile_dynamics_ros.core.planar.mechanics.linkage import in_frame, placed, turned
from tactile_dynamics_ros.core.planar.mechanics.outline import area_and_centroid

Plane = NDArray[np.complex128]

_ROUNDS, _FIRST_ROUNDS = 2, 4
"""Solutions per step, and of the first step, each with the friction of the one before: a push of
4 cm then ends within 1 mm of where twenty rounds take it, the ellipsoid itself is off by more."""
_REST = 0.02
"""Share of the tip's speed below which a part counts as resting: friction that resists a standing
part is unbounded per speed. Lower needs more rounds, higher lets parts creep that stand."""
_LOCKED = 1.0
"""Torque of a joint that does not turn over the parts' friction force, m: ten times their reach."""
_BENDS = 60
"""Bends at which it is found whether parts reach into each other: each 6 degrees, 5 mm of motion at
a corner; they cost 3 ms together."""
_REACHES = 0.003
"""m by which parts may seem to reach into each other: outlines and poses are right to 3 mm."""
_SLOW = 1e-9
"""m below which a way counts as none: it only keeps quotients finite where nothing moves."""


@dataclass(frozen=True)
class Hinge:
    """What holds two parts together.

    Attributes:
        first: (2,) m, its place in the first part's frame. second: (2,) m, in the second's.
        locked: whether they do not turn about it: both are one body, and any place will do.
    """

    first: Array
    second: Array
    locked: bool = False


@dataclass(frozen=True, eq=False)
class Rubbing:
    """Friction under both parts and in the joint, alike for all candidates or in N variants.

    Attributes:
        arms: (2, 1) or (2, N) m, from the joint to the centre of friction, axes of each part.
        radii: (2, 1) m, friction radius of each part.
        forces: (2, 1) or (2, N), friction force of each part over that of both.
        joint: (1,) or (N,) m, torque that resists turning over the friction force of both parts.
    """

    arms: Plane
    radii: Array
    forces: Array
    joint: Array

    @classmethod
    def presumed(cls, parts: tuple[PushedBody, PushedBody], hinge: Hinge) -> Rubbing:
        """Presume forces as the areas are, and a joint that turns freely unless it is locked."""
        areas = np.array([area_and_centroid(part.outline)[0] for part in parts])
        coms = np.stack([part.com for part in parts])
        return cls(
            _plane(coms - np.stack([hinge.first, hinge.second]))[:, None],
            np.array([[part.radius] for part in parts]),
            areas[:, None] / areas.sum(),
            np.array([_LOCKED if hinge.locked else 0.0]),
        )


@dataclass(frozen=True, eq=False)
class Tips:
    """Where tips touch, seen from the joint.

    Attributes:
        point: (N,) m. normal: (N,) into the part. way: (N,) m, of the tip.
        part: (N,) that is pushed, 0 or 1.
        friction: coefficient between tip and part.
    """

    point: Plane
    normal: Plane
    way: Plane
    part: NDArray[np.intp]
    friction: float


@dataclass(frozen=True, eq=False)
class Slip:
    """Motion under a tip; all is what one way of the tip brings.

    Attributes:
        joint: (N,) m. turns: (2, N) rad, of both parts.
        speeds: (2, N) m, of both parts on their limit surfaces. turning: (N,) rad, of the joint.
    """

    joint: Plane
    turns: Array
    speeds: Array
    turning: Array


def hinged_motion(rubbing: Rubbing, axes: Plane, tips: Tips, last: Slip | None = None) -> Slip:
    """How two parts on a joint move under tips.

    Least dissipation D = sum_k f_k s_k + t |w_1 - w_2|, s_k = sqrt(|v_k|^2 + l_k^2 w_k^2), while
    the point at the tip moves with it. D is replaced by sum_k f_k s_k^2 / s_k', s_k' of the round
    before (iteratively reweighted least squares). Where the force of a sticking tip lies outside
    the friction cone, it lies on the cone's edge and the tip slides.

    Args:
        rubbing: friction under the parts.
        axes: (2, N) unit, x axis of each part.
        tips: that push.
        last: motion of the step before, to begin with.

    Source: Goyal, Ruina and Papadopoulos 1991; Lynch and Mason 1996; the ellipsoid is that of Howe
    and Cutkosky 1996.
    """
    size = np.maximum(np.abs(tips.way), _SLOW)
    reach, arms = float(rubbing.radii.max()), axes * rubbing.arms
    rounds = _FIRST_ROUNDS
    speeds, turning = np.stack([size, size]), size / reach
    if last is not None:
        rounds, speeds, turning = _ROUNDS, last.speeds, last.turning
    for _ in range(rounds):
        drag = rubbing.forces / np.maximum(speeds, _REST * size)
        joint_drag = rubbing.joint / np.maximum(turning, _REST * size / reach)
        joint, turns = _under(_Mobility(rubbing.radii, arms, drag, joint_drag), tips)
        linear = np.abs(joint + 1j * turns * arms)
        speeds = np.sqrt(linear * linear + np.square(rubbing.radii * turns))
        turning = np.abs(turns[0] - turns[1])
    return Slip(joint, turns, speeds, turning)


class _Mobility:
    """Motion under a force where friction is linear in speed, by drags d_k and c of the joint.

    sum_k d_k (v + i w_k a_k) = F,  d_k (a_k x v) + d_k (|a_k|^2 + l_k^2) w_k ± c (w_1 - w_2) = T_k
    """

    def __init__(self, radii: Array, arms: Plane, drag: Array, joint: Array) -> None:
        self._sum = drag[0] + drag[1]
        self._share = drag / self._sum
        self._drag, self._arms = drag, arms
        squares = arms.real**2 + arms.imag**2
        self._own = drag * (squares * self._share[::-1] + np.square(radii)) + joint
        mixed = arms[0].real * arms[1].real + arms[0].imag * arms[1].imag
        self._mixed = -joint - drag[0] * self._share[1] * mixed
        self._det = self._own[0] * self._own[1] - self._mixed**2

    def of(self, force: Plane, torque: Array) -> tuple[Plane, Array]:
        """Motion of the joint (N,) and turns (2, N) under forces (N,) and torques (2, N) there."""
        left = torque - self._share * (np.conj(self._arms) * force).imag
        turns = (self._own[::-1] * left - self._mixed * left[::-1]) / self._det
        dragged = (self._drag * turns * self._arms).sum(axis=0)
        return (force - 1j * dragged) / self._sum, turns


def _under(mobility: _Mobility, tips: Tips) -> tuple[Plane, Array]:
    """Motion of the joint (N,) and turns (2, N) under tips that stick or slide."""
    pushed = np.stack([tips.part == 0, tips.part == 1])
    unit, moves = [], []
    for force in (tips.normal, 1j * tips.normal):
        joint, turns = mobility.of(force, pushed * (np.conj(tips.point) * force).imag)
        unit.append((joint, turns))
        turn = np.where(pushed[0], turns[0], turns[1])
        moves.append(np.conj(tips.normal) * (joint + 1j * turn * tips.point))
    ahead, beside, across = moves[0].real, moves[0].imag, moves[1].imag
    way = np.conj(tips.normal) * tips.way
    det = ahead * across - beside * beside
    press = (across * way.real - beside * way.imag) / det
    rub = (ahead * way.imag - beside * way.real) / det
    edge = tips.friction * np.sign(rub)
    yielding = ahead + edge * beside
    slides = np.abs(rub) > tips.friction * press
    sliding = np.maximum(way.real, 0.0) / np.where(yielding > _SLOW, yielding, np.inf)
    press = np.where(slides, sliding, press)
    rub = np.where(slides, edge * press, rub)
    (one, first), (two, second) = unit
    return press * one + rub * two, press * first + rub * second


@dataclass(frozen=True, eq=False)
class JointedBody:
    """Two parts on a joint, perhaps a locked one, either of which may be pushed.

    States are x, y, yaw, second yaw.

    Attributes:
        parts: each in its own frame.
        hinge: what holds them together.
        bend: rad, yaw of the second part against the first one's now.
        rubbing: friction under the parts.
    """

    parts: tuple[PushedBody, PushedBody]
    hinge: Hinge
    bend: float
    rubbing: Rubbing

    @property
    def tip_radius(self) -> float:
        """Radius of the pusher, m."""
        return self.parts[0].tip_radius

    @property
    def words(self) -> str:
        """What the object is taken for."""
        if self.hinge.locked:
            return "two parts as one body: they hardly turned against each other so far"
        x, y = 1e3 * self.hinge.first
        return f"two parts on a joint at {x:.0f}, {y:.0f} mm in the first one's frame"

    def states(self, pose: Array, count: int) -> Array:
        """States (N, 4) of an object with its first part at a pose (3,), bent as it is now."""
        return np.tile([*pose, pose[2] + self.bend], (count, 1))

    def poses(self, state: Array) -> tuple[Array, Array]:
        """Poses (N, 3) of both parts in states (N, 4)."""
        joint = placed(self.hinge.first[None], state[:, :3])
        origin = joint - turned(self.hinge.second[None], state[:, 3])
        return state[:, :3], np.column_stack([origin, state[:, 3]])

    def place(self, share: Array, state: Array) -> tuple[Array, Array]:
        """Point (N, 2) and inward normal (N, 2), world, at shares (N,) of both perimeters."""
        lengths = [float(part.edges[2].sum()) for part in self.parts]
        along = np.mod(share, 1.0) * sum(lengths)
        second = along >= lengths[0]
        own = np.where(second, (along - lengths[0]) / lengths[1], along / lengths[0])
        found = []
        for part, pose in zip(self.parts, self.poses(state), strict=True):
            point, inward = part.at(own)
            found.append((placed(point, pose), turned(inward, pose[:, 2])))
        return tuple(np.where(second[:, None], two, one) for one, two in zip(*found, strict=True))

    def touch(self, tip: Array, state: Array) -> tuple[Array, Array]:
        """Distance (N,) m of tips (N, 2) from the nearer part and normal (N, 2) into it, world."""
        pairs = zip(self.parts, self.poses(state), strict=True)
        (far, normal), (other, across) = [part.touch(tip, pose) for part, pose in pairs]
        nearer = (other < far)[:, None]
        return np.minimum(far, other), np.where(nearer, across, normal)

    def away(self, tip: Array, state: Array) -> Array:
        """Directions (N, 2) unit away from both parts, more from the nearer one."""
        left = np.zeros_like(tip)
        for part, pose in zip(self.parts, self.poses(state), strict=True):
            distance, normal = part.touch(tip, pose)
            left -= normal / np.maximum(distance, self.tip_radius)[:, None] ** 2
        return np.asarray(left / np.maximum(np.linalg.norm(left, axis=1, keepdims=True), _SLOW))

    def _outside(self, tip: Array, state: Array) -> Array:
        """Distances (2, N) m of tips (N, 2) from both outlines, negative inside."""
        pairs = zip(self.parts, self.poses(state), strict=True)
        return np.stack([distance_outside(p.coarse, in_frame(tip, pose)) for p, pose in pairs])

    def crowded(self, tip: Array, state: Array) -> Array:
        """By how much (N,) m tips (N, 2) are too near to a part when they come down."""
        return self.parts[0].lacking(self._outside(tip, state).min(axis=0))

    def struck(self, tip: Array, state: Array) -> Array:
        """By how much (N,) m tips (N, 2) are too near to the part that they do not push.

        Where parts reach into each other, their edges are one, and a tip pushes what it meets.
        """
        if self.hinge.locked:
            return np.zeros(len(tip))
        near = self.parts[0].lacking(self._outside(tip, state).max(axis=0))
        return np.where(self.folded(state) > 0.0, 0.0, near)

    def folded(self, state: Array) -> Array:
        """How far (N,) m parts have to turn back, at the larger radius, to lie side by side.

        Joints end where parts meet: what is predicted beyond does not come.
        """
        if self.hinge.locked:
            return np.zeros(len(state))
        bends, turns = self._turns_back
        turn = np.interp(state[:, 3] - state[:, 2], bends, turns, period=2.0 * np.pi)
        return np.asarray(float(self.rubbing.radii.max()) * turn)

    def pushed_along(self, state: Array, tip: Array, ways: Sequence[Array]) -> tuple[Array, Array]:
        """States and tips after a push along short ways (N, 2) each; it stays on one part."""
        first, second = self._outside(tip, state)
        part = (second < first).astype(np.intp)
        joint = _plane(placed(self.hinge.first[None], state[:, :3]))
        yaws, at, last = state[:, 2:].T.copy(), _plane(tip), None
        for way in ways:
            step = _plane(way)
            at = at + step
            joint, yaws, last = self._step(joint, yaws, part, at, step, last)
        place = joint - _plane(turned(self.hinge.first[None], yaws[0]))
        return np.column_stack([place.real, place.imag, *yaws]), np.stack([at.real, at.imag], 1)

    def _step(
        self,
        joint: Plane,
        yaws: Array,
        part: NDArray[np.intp],
        tip: Plane,
        way: Plane,
        last: Slip | None,
    ) -> tuple[Plane, Array, Slip | None]:
        """Joint (N,) and yaws (2, N) after tips have come to (N,) by ways (N,)."""
        axes = np.exp(1j * yaws)
        axis = np.where(part == 0, axes[0], axes[1])
        near, gap, normal = self._nearest(part, np.conj(axis) * (tip - joint))
        depth = self.tip_radius - gap
        touching = depth > 0.0
        if not touching.any():
            return joint, yaws, last
        inward = axis * normal
        along = (np.conj(inward) * way).imag
        wanted = inward * (np.maximum(depth, 0.0) + 1j * along)
        tips = Tips(axis * near, inward, wanted, part, self.parts[0].tip_friction)
        slip = hinged_motion(self.rubbing, axes, tips, last)
        moved = np.where(touching, slip.joint, 0.0)
        return joint + moved, yaws + touching * slip.turns, slip

    @cached_property
    def _turns_back(self) -> tuple[Array, Array]:
        """Bends (B,) rad and the turn (B,) from each to the nearest at which parts are apart."""
        bends = np.linspace(-np.pi, np.pi, _BENDS, endpoint=False)
        depth = np.zeros(_BENDS)
        hinges = self.hinge.first, self.hinge.second
        for k, sign in ((0, -1.0), (1, 1.0)):  # corners of the k-th part in the other one's frame
            corners = self.parts[k].coarse - hinges[k]
            angles = np.repeat(sign * bends, len(corners))
            moved = turned(np.tile(corners, (_BENDS, 1)), angles) + hinges[1 - k]
            inside = -distance_outside(self.parts[1 - k].coarse, moved)
            depth = np.maximum(depth, inside.reshape(_BENDS, -1).max(axis=1))
        free = bends[depth < _REACHES]
        if len(free) == 0:
            return bends, np.zeros(_BENDS)
        away = np.abs(bends[:, None] - free)
        return bends, np.minimum(away, 2.0 * np.pi - away).min(axis=1)

    @cached_property
    def _edges(self) -> tuple[Plane, Plane, Array]:
        """Start (2, V), way (2, V) and 1 / length^2 (2, V) of edges, from the joint, own axes."""
        most = max(len(part.coarse) for part in self.parts)
        rows = []
        for part, hinge in zip(self.parts, (self.hinge.first, self.hinge.second), strict=True):
            start = part.coarse
            way = np.roll(start, -1, axis=0) - start
            length = np.linalg.norm(way, axis=1)
            filled = np.minimum(np.arange(most), len(start) - 1)  # the last one once more
            rows.append((_plane(start - hinge)[filled], _plane(way)[filled], length[filled] ** -2))
        starts, ways, inverse = zip(*rows, strict=True)
        return np.stack(starts), np.stack(ways), np.stack(inverse)

    def _nearest(self, part: NDArray[np.intp], tip: Plane) -> tuple[Plane, Array, Plane]:
        """Nearest point (N,), distance (N,) and inward normal (N,) of parts, from the joint."""
        start, way, inverse = (each[part] for each in self._edges)
        arm = tip[:, None] - start
        share = np.clip((np.conj(way) * arm).real * inverse, 0.0, 1.0)
        gap = arm - share * way
        squared = gap.real**2 + gap.imag**2
        rows, k = np.arange(len(tip)), squared.argmin(axis=1)
        outward, distance = gap[rows, k], np.sqrt(squared[rows, k])
        flat = 1j * way[rows, k] * np.sqrt(inverse[rows, k])
        normal = np.where(distance > 1e-6, -outward / np.maximum(distance, 1e-6), flat)
        return tip - outward, distance, normal


def _plane(vectors: Array) -> Plane:
    """Vectors (..., 2) as complex numbers (...)."""
    return np.asarray(vectors[..., 0] + 1j * vectors[..., 1])
