"""What is expected of two parts before their relative motion is looked at.

Two parts that do not move beside each other need not be one body: friction of a joint may hold, and
a part that is pushed ahead of another keeps its place. How likely that is follows from the pushes.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.planar.linked.outlines import (
    in_second,
    meeting_points,
    room_to_turn,
    touched_part,
)
from tactile_dynamics_ros.core.planar.mechanics.linkage import cross, turned
from tactile_dynamics_ros.core.planar.mechanics.support import SupportPatch

JOINT_TORQUE, JOINT_SPREAD = 0.05, 1.0
"""Median friction torque of joints, N m, and standard deviation of its logarithm: 68 % between 0.02
(a bearing, scissors) and 0.14 (a laptop's hinge). A smaller median calls parts rigid sooner."""
_LOCKED = 0.06
"""Weight of a joint beside a rigid pair where outlines leave no room to turn: hinges may sit above
the table. At 1 no number of pushes would tell two boxes that are glued together."""
_SHARES = (0.5, 1.0, 1.5)
"""Friction of a part over its share by area, each as likely: mass and material are not known. Wider
calls fewer pairs rigid."""
_COEFFICIENT = 0.3
"""Friction coefficient by which masses are guessed from forces; inertia adds to the torque of a
joint in hard starts only, so that half or double moves the chance of a stuck joint by 0.1."""
SEEN_TURN = np.radians(0.5)
"""Turn of a joint that shows beyond the noise, rad: five standard deviations of means of 0.2 s."""
_TORQUES = np.geomspace(2e-3, 2.0, 60)
"""Friction torques of joints that are tried, N m, in steps of an eighth."""
_AHEAD = np.cos(np.radians(50.0))
"""Cosine of the angle between motion and line of centres up to which one part may push the other
ahead of it, by its normal force and friction of 0.7 at the side of it."""
_ASTRAY = 0.2
"""Share of motion in other directions from which a part was not pushed ahead."""
_CARRIED, _ATTACHED = 0.3, 1e-3
"""Chances that separate parts keep their places: where one is pushed ahead of the other, and where
nothing but a bond could do that. At 0.01 ten pushes of glued boxes might not be enough."""
_MOVES, _TURNS = 5e-3, 0.1
"""Speed, m/s and rad/s, from which a part moves: above what noise makes of a resting one."""


@dataclass(frozen=True, eq=False)
class Chances:
    """Before the motion.

    Attributes:
        prior: (3,) weight of rigid, jointed, separate.
        stuck: chance that the friction of a joint held all the time.
        carried: chance that separate parts kept their places.
    """

    prior: Array
    stuck: float
    carried: float


@dataclass(frozen=True, eq=False)
class SeenParts:
    """What the chances follow from.

    Attributes:
        step: s between samples. outlines: (V, 2) m of both.
        poses, velocities, accelerations: (N, 3) of both.
        offset: (3,) of the second part in the first one's frame.
        point: (N, 2) m that is touched. touching: (N,) whether.
        force: N, horizontal, while something is touched.
    """

    step: float
    outlines: tuple[Array, Array]
    poses: tuple[Array, Array]
    velocities: tuple[Array, Array]
    accelerations: tuple[Array, Array]
    offset: Array
    point: Array
    touching: NDArray[np.bool_]
    force: float

    @property
    def touched(self) -> Array:
        """(N,) 0 or 1, the part that is touched."""
        return touched_part(self.outlines, self.poses, self.point)

    @property
    def moving(self) -> NDArray[np.bool_]:
        """(N,) whether something is touched and moves."""
        fast = [
            (np.linalg.norm(v[:, :2], axis=1) > _MOVES) | (np.abs(v[:, 2]) > _TURNS)
            for v in self.velocities
        ]
        return np.asarray(self.touching & (fast[0] | fast[1]))


def weigh_chances(parts: SeenParts) -> Chances:
    """Return what these pushes let expect of each structure."""
    free = room_to_turn(*parts.outlines, parts.offset)
    prior = np.array([1.0, max(_LOCKED, free), 1.0])
    return Chances(prior / prior.sum(), _stuck(parts), _carried(parts))


def _stuck(parts: SeenParts) -> float:
    """Chance that the friction of a joint held so well that no turn would have been seen."""
    if not parts.moving.any():
        return 0.999
    held = [holding_torque(parts, share) for share in _SHARES]
    sizes = np.log(np.maximum(held, 1e-6) / JOINT_TORQUE) / JOINT_SPREAD
    return float(np.clip(np.mean(ndtr(-sizes)), 1e-6, 0.999))


def holding_torque(parts: SeenParts, share: float = 1.0) -> float:
    """Friction torque, N m, from which a joint would hardly have turned under these pushes.

    The torque that kept the parts in line is compared with that of friction; what it exceeds turns
    them: I_relative d(rate)/dt = torque - friction.

    Args:
        parts: what was seen.
        share: friction and mass of the untouched part over their share by area.
    """
    torque, inertia = joint_torque(parts, share)
    rate, angle = np.zeros(len(_TORQUES)), np.zeros(len(_TORQUES))
    furthest = np.zeros(len(_TORQUES))
    for load in np.where(parts.moving, torque, 0.0):
        slide = _TORQUES * parts.step / inertia
        wanted = rate + load * parts.step / inertia
        rate = np.sign(wanted) * np.maximum(np.abs(wanted) - slide, 0.0)
        angle = angle + rate * parts.step
        furthest = np.maximum(furthest, np.abs(angle))
    turned_far = furthest >= SEEN_TURN
    return float(_TORQUES[turned_far].max()) if turned_far.any() else 0.0


def joint_torque(parts: SeenParts, share: float = 1.0) -> tuple[Array, float]:
    """Torque (N,) N m that a joint passes on while both parts move as one, and relative inertia.

    It moves the untouched part against its inertia and the friction of its footprint.
    """
    patches = [SupportPatch(outline) for outline in parts.outlines]
    area = np.array([float(np.ptp(o[:, 0]) * np.ptp(o[:, 1])) for o in parts.outlines])
    weight = share * parts.force * area / area.sum()
    mass = weight / (9.81 * _COEFFICIENT)
    place = meeting_points(*parts.outlines, parts.offset).mean(axis=0)
    places = (place, in_second(place, parts.offset))
    torque, turning = np.zeros(len(parts.point)), []
    for k, patch in enumerate(patches):
        yaw, change = parts.poses[k][:, 2], parts.accelerations[k]
        arm = np.broadcast_to(patch.centroid - places[k], (len(yaw), 2))
        wrench = weight[k] * _friction(patch, yaw, parts.velocities[k])
        about = wrench[:, 2] + cross(arm, wrench[:, :2])
        middle = turned(np.broadcast_to(patch.centroid, arm.shape), yaw)
        across = np.stack([-middle[:, 1], middle[:, 0]], axis=1)
        pull = mass[k] * (change[:, :2] + change[:, 2:] * across)
        needed = mass[k] * patch.gyration * change[:, 2] + cross(turned(arm, yaw), pull) - about
        other = parts.touched != k
        torque[other] = needed[other] * (1.0 if k == 1 else -1.0)
        turning.append(mass[k] * (patch.gyration + float(arm[0] @ arm[0])))
    return torque, float(1.0 / np.sum(1.0 / np.array(turning)))


def _friction(patch: SupportPatch, yaw: Array, velocity: Array) -> Array:
    """Wrench (N, 3) per newton of friction, about the centroid, link axes."""
    linear = turned(velocity[:, :2], -yaw)
    rate = velocity[:, 2:]
    linear = linear + rate * np.array([-patch.centroid[1], patch.centroid[0]])
    twist = np.concatenate([linear, rate], axis=1)
    load = np.broadcast_to(patch.share, (len(yaw), len(patch.share)))
    matrix = patch.resistance(load, np.ones(len(yaw)), twist, _MOVES)
    return -np.asarray((matrix @ twist[..., None])[..., 0])


def _carried(parts: SeenParts) -> float:
    """Chance that separate parts kept their places."""
    touched, moving = parts.touched, parts.moving
    centres = [
        pose[:, :2] + turned(np.broadcast_to(outline.mean(axis=0), (len(pose), 2)), pose[:, 2])
        for outline, pose in zip(parts.outlines, parts.poses, strict=True)
    ]
    line = centres[1] - centres[0]
    ahead = np.where(touched[:, None] == 0.0, line, -line)
    speed = np.where(
        touched[:, None] == 0.0, parts.velocities[1][:, :2], parts.velocities[0][:, :2]
    )
    size = np.linalg.norm(speed, axis=1)
    along = np.sum(ahead * speed, axis=1) / np.maximum(np.linalg.norm(ahead, axis=1) * size, 1e-12)
    counted = moving & (size > _MOVES)
    if not counted.any():
        return _CARRIED
    return _ATTACHED if float(np.mean(along[counted] < _AHEAD)) > _ASTRAY else _CARRIED
