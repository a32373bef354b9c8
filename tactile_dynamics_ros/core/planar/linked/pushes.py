"""How two parts on a joint begin to move, and the push that tells most of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.planar.linked.chances import JOINT_TORQUE, SeenParts
from tactile_dynamics_ros.core.planar.linked.outlines import (
    distance_outside,
    in_second,
    meeting_points,
)
from tactile_dynamics_ros.core.planar.linked.rows import across
from tactile_dynamics_ros.core.planar.mechanics.linkage import cross, turned
from tactile_dynamics_ros.core.planar.mechanics.outline import area_and_centroid
from tactile_dynamics_ros.core.planar.mechanics.support import SupportPatch

_PLACES = 16
"""Points of each outline that are compared: every 2 cm of a usual part; twice as many name other
pushes and change what they tell by a tenth."""
_CLEAR = 0.015
"""Distance to the other part from which a tip has room, m: twice the radius of usual tips."""
_ROUNDS = 60
"""Rounds of the lagged resistance; after 30 velocities change by less than 1 %, but for parts that
nearly stand still."""
_SLIP = 1e-3
"""Speed below which friction falls, m/s, a thirtieth of the slowest push that is compared."""
_ARM = 0.05
"""Distance at which a turn of the joint is compared with that speed, m: a usual part's radius."""


@dataclass(frozen=True, eq=False)
class KnownPair:
    """What the motion follows from.

    Attributes:
        patches: footprints. forces: (2,) N, friction force of each part.
        joint: (2, 2) m, its place in each part's frame.
        torque: N m, its friction; or (K,) for each push.
    """

    patches: tuple[SupportPatch, SupportPatch]
    forces: Array
    joint: Array
    torque: float | Array


@dataclass(frozen=True, eq=False)
class PairPushes:
    """K pushes of two parts with a tip, each where the parts lie.

    Attributes:
        part: (K,) 0 or 1. point: (K, 2) m on its outline and normal: (K, 2) inwards, its frame.
        speed: (K,) m/s, along the normal.
        pose: (K, 4) x, y and yaw of the first part's frame, and yaw of the second one's.
    """

    part: NDArray[np.intp]
    point: Array
    normal: Array
    speed: Array
    pose: Array

    def __len__(self) -> int:
        return len(self.part)

    def taken(self, index: NDArray[np.intp] | NDArray[np.bool_]) -> PairPushes:
        """Some of them."""
        return PairPushes(*(getattr(self, name)[index] for name in self.__dataclass_fields__))

    @property
    def way(self) -> Array:
        """(K, 2) unit vectors along the pushes, axes of the support."""
        yaw = np.where(self.part == 0, self.pose[:, 2], self.pose[:, 3])
        return turned(self.normal, yaw)

    def place(self, pair: KnownPair) -> Array:
        """(K, 2) m that is touched, on the support."""
        first = self.pose[:, :2] + turned(self.point, self.pose[:, 2])
        second = self._joint(pair) + turned(self.point - pair.joint[1], self.pose[:, 3])
        return np.where(self.part[:, None] == 0, first, second)

    def _joint(self, pair: KnownPair) -> Array:
        arm = np.broadcast_to(pair.joint[0], (len(self), 2))
        return np.asarray(self.pose[:, :2] + turned(arm, self.pose[:, 2]))


@dataclass(frozen=True, eq=False)
class BegunMotion:
    """How K pushes begin.

    Attributes:
        velocity: (K, 4) of the coordinates.
        force: (K, 2) N of the tip, axes of the support.
        torque: (K,) N m that the joint passes on to the second part.
    """

    velocity: Array
    force: Array
    torque: Array

    @property
    def turning(self) -> Array:
        """(K,) rad/s of the second part beside the first."""
        return np.asarray(self.velocity[:, 3] - self.velocity[:, 2])

    def holds(self, pushes: PairPushes, friction: float) -> NDArray[np.bool_]:
        """Which tips do not slip along the outline at a coefficient of friction."""
        along = np.sum(self.force * pushes.way, axis=1)
        return np.asarray(np.abs(cross(pushes.way, self.force)) < friction * along)


def possible_pushes(
    outlines: tuple[Array, Array], joint: Array, poses: Array, speeds: Sequence[float]
) -> PairPushes:
    """Pushes along the inward normal, all around both parts where the other leaves room.

    Args:
        outlines: (V, 2) m, each in its own frame, counter-clockwise.
        joint: (2, 2) m in each frame.
        poses: (P, 4) coordinates, all with the same angle of the joint.
        speeds: m/s.
    """
    bend = float(poses[0, 3] - poses[0, 2])
    rows = []
    for part in (0, 1):
        points, normals = _edge_points(outlines[part])
        sense = np.full(len(points), bend if part == 1 else -bend)
        there = joint[1 - part] + turned(points - joint[part], sense)
        free = distance_outside(outlines[1 - part], there) > _CLEAR
        rows.append((np.full(int(free.sum()), part), points[free], normals[free]))
    touched, point, normal = (np.concatenate(columns) for columns in zip(*rows, strict=True))
    count, repeated = len(touched), len(poses) * len(speeds)
    at = np.repeat(np.arange(count), repeated)
    where = np.tile(np.repeat(np.arange(len(poses)), len(speeds)), count)
    speed = np.tile(np.asarray(speeds, dtype=float), count * len(poses))
    return PairPushes(touched[at], point[at], normal[at], speed, poses[where])


def _edge_points(outline: Array) -> tuple[Array, Array]:
    """Points (n, 2) evenly around an outline, off its corners, and normals inwards."""
    edge = np.roll(outline, -1, axis=0) - outline
    length = np.linalg.norm(edge, axis=1)
    at = (np.arange(_PLACES) + 0.5) / _PLACES * length.sum()
    ends = np.cumsum(length)
    index = np.minimum(np.searchsorted(ends, at), len(outline) - 1)
    share = (at - (ends - length)[index]) / np.maximum(length[index], 1e-12)
    points = outline[index] + np.clip(share, 0.1, 0.9)[:, None] * edge[index]
    return points, across(edge[index]) / np.maximum(length[index], 1e-12)[:, None]


def begun_motion(pushes: PairPushes, pair: KnownPair) -> BegunMotion:
    """Velocities at which friction of both parts and of the joint balance a tip that sticks.

    Friction resists as -K(v) v with K of the velocities before, again and again: each round lowers
    the power that is lost, whose least value the motion has.
    """
    arms = _arms(pushes, pair)
    touching = _contact_rows(pushes, pair)
    count = len(pushes)
    system, wanted = np.zeros((count, 6, 6)), np.zeros((count, 6))
    system[:, :4, 4:] = -np.swapaxes(touching, 1, 2)
    system[:, 4:, :4] = touching
    wanted[:, 4:] = pushes.speed[:, None] * pushes.way
    velocity = np.zeros((count, 4))
    velocity[:, :2] = wanted[:, 4:]
    joint = np.outer([0.0, 0.0, -1.0, 1.0], [0.0, 0.0, -1.0, 1.0])
    for _ in range(_ROUNDS):
        matrices = [_resistance(pushes, pair, k, arms[k], velocity) for k in (0, 1)]
        total = sum(np.swapaxes(arms[k], 1, 2) @ matrices[k] @ arms[k] for k in (0, 1))
        slow = np.sqrt((velocity[:, 3] - velocity[:, 2]) ** 2 + (_SLIP / _ARM) ** 2)
        system[:, :4, :4] = total + (pair.torque / slow)[:, None, None] * joint
        found = np.linalg.solve(system, wanted[..., None])[..., 0]
        solved = np.asarray(found, dtype=np.float64)
        velocity = solved[:, :4]
    rubbing = pair.torque / slow * (velocity[:, 3] - velocity[:, 2])
    return BegunMotion(velocity, solved[:, 4:], -rubbing)


def locked(pair: KnownPair) -> KnownPair:
    """The pair with a joint that no push turns: what its torque would have to hold is reported."""
    return replace(pair, torque=1e3)


def _arms(pushes: PairPushes, pair: KnownPair) -> tuple[Array, Array]:
    """Twists (K, 3, 4) of both centroids by the velocities, axes of the support."""
    count, yaw = len(pushes), pushes.pose[:, 2:]
    rows = [np.zeros((count, 3, 4)) for _ in (0, 1)]
    for row in rows:
        row[:, [0, 1], [0, 1]] = 1.0
    even = np.ones((count, 1))
    rows[0][:, 2, 2] = rows[1][:, 2, 3] = 1.0
    rows[0][:, :2, 2] = across(turned(even * pair.patches[0].centroid, yaw[:, 0]))
    rows[1][:, :2, 2] = across(turned(even * pair.joint[0], yaw[:, 0]))
    rows[1][:, :2, 3] = across(turned(even * (pair.patches[1].centroid - pair.joint[1]), yaw[:, 1]))
    return rows[0], rows[1]


def _contact_rows(pushes: PairPushes, pair: KnownPair) -> Array:
    """Velocity (K, 2, 4) of the touched point by the velocities."""
    rows = np.zeros((len(pushes), 2, 4))
    rows[:, [0, 1], [0, 1]] = 1.0
    second = pushes.part == 1
    even = np.ones((len(pushes), 1))
    near = np.where(second[:, None], even * pair.joint[0], pushes.point)
    rows[:, :, 2] = across(turned(near, pushes.pose[:, 2]))
    far = across(turned(pushes.point - pair.joint[1], pushes.pose[:, 3]))
    rows[:, :, 3] = np.where(second[:, None], far, 0.0)
    return rows


def _resistance(pushes: PairPushes, pair: KnownPair, k: int, arm: Array, velocity: Array) -> Array:
    """Matrices (K, 3, 3) of the support under a part, axes of the support."""
    patch, yaw = pair.patches[k], pushes.pose[:, 2 + k]
    twist = np.asarray((arm @ velocity[..., None])[..., 0])
    local = np.column_stack([turned(twist[:, :2], -yaw), twist[:, 2]])
    load = np.broadcast_to(pair.forces[k] * patch.share, (len(yaw), len(patch.share)))
    matrix = patch.resistance(load, np.ones(len(yaw)), local, _SLIP)
    turn = np.zeros((len(yaw), 3, 3))
    cos, sin = np.cos(yaw), np.sin(yaw)
    turn[:, 0, 0], turn[:, 0, 1], turn[:, 1, 0], turn[:, 1, 1] = cos, -sin, sin, cos
    turn[:, 2, 2] = 1.0
    return np.asarray(turn @ matrix @ np.swapaxes(turn, 1, 2))


TIP_FRICTION = 0.2
"""Coefficient up to which a tip is trusted to stick, below that of rubber and plastic: pushes are
named that work with smooth tips too."""
_SPEED = 0.2
"""m/s at which it is proposed: fast enough for inertia to help, slow enough for arms that push."""
ENOUGH_TURN = np.radians(10.0)
"""Turn of the joint for which the way is reported, rad: twice what shares and joint friction
need."""
_LOOSER = 0.5
"""Friction of the joint for which the way is reported, over the one that would hold: one that turns
readily. At 0.9 ways become twice as long."""
_WAYS = (0.03, 0.15)
"""Shortest and longest way that is proposed, m: what tells at all, and what tables leave."""


@dataclass(frozen=True)
class TellingPush:
    """A push of one part.

    Attributes:
        part: 0 or 1.
        point: (2,) m on its outline and normal: (2,) inwards, along which it goes, in its frame.
        heading: rad, axes of the support, where the parts lie now. way: m. speed: m/s.
        torque: N m, friction of a joint up to which the push turns it.
    """

    part: int
    point: Array
    normal: Array
    heading: float
    way: float
    speed: float
    torque: float

    @property
    def words(self) -> str:
        """What to do."""
        x, y = 1e3 * self.point
        return (
            f"push link_{self.part + 1} at ({x:.0f}, {y:.0f}) mm in its frame towards "
            f"{np.degrees(self.heading):.0f} deg (axes of the table) by {1e3 * self.way:.0f} mm at "
            f"{self.speed:g} m/s: that turns a joint whose friction is below {self.torque:.2g} "
            "N m, and a hard start stiffer ones"
        )


def telling_push(parts: SeenParts, joint: Array | None = None) -> TellingPush | None:
    """Choose the push in which a joint would have to hold most, where the parts lie now.

    Args:
        parts: as they were seen.
        joint: (2, 2) m, its place in each part's frame; by default where the outlines meet.

    Returns:
        None where the tip slips in every push, as on parts that lie in a corner.
    """
    pair = _guessed(parts, _meeting(parts) if joint is None else joint)
    pose = np.append(parts.poses[0][-1], parts.poses[1][-1, 2])
    pushes = possible_pushes(parts.outlines, pair.joint, pose[None], (_SPEED,))
    held = begun_motion(pushes, locked(pair))
    torque = np.abs(held.torque)
    turns = begun_motion(pushes, replace(pair, torque=_LOOSER * torque))
    holds = held.holds(pushes, TIP_FRICTION)
    if not holds.any():
        return None
    best = int(np.argmax(np.where(holds, torque, 0.0)))
    way = np.clip(ENOUGH_TURN * _SPEED / max(abs(turns.turning[best]), 1e-3), *_WAYS)
    x, y = pushes.way[best]
    return TellingPush(
        part=int(pushes.part[best]),
        point=pushes.point[best],
        normal=pushes.normal[best],
        heading=float(np.arctan2(y, x)),
        way=float(way),
        speed=_SPEED,
        torque=float(torque[best]),
    )


def _meeting(parts: SeenParts) -> Array:
    """(2, 2) m, the place between the outlines in each part's frame."""
    place = meeting_points(*parts.outlines, parts.offset).mean(axis=0)
    return np.stack([place, in_second(place, parts.offset)])


def _guessed(parts: SeenParts, joint: Array) -> KnownPair:
    """Friction of both parts by their areas, and a joint that resists as usual ones do."""
    areas = np.array([abs(area_and_centroid(outline)[0]) for outline in parts.outlines])
    first, second = (SupportPatch(outline) for outline in parts.outlines)
    forces = parts.force * areas / areas.sum()
    return KnownPair((first, second), forces, joint, JOINT_TORQUE)
