"""The push that would tell what two parts are to each other, or would turn their joint."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.planar.linked.chances import JOINT_TORQUE, SeenParts
from tactile_dynamics_ros.core.planar.linked.outlines import in_second, meeting_points
from tactile_dynamics_ros.core.planar.linked.pushes import (
    KnownPair,
    begun_motion,
    locked,
    possible_pushes,
)
from tactile_dynamics_ros.core.planar.mechanics.outline import area_and_centroid
from tactile_dynamics_ros.core.planar.mechanics.support import SupportPatch

Array = NDArray[np.float64]

TIP_FRICTION = 0.2
"""Coefficient up to which a tip is trusted to stick, below that of rubber and plastic: pushes are
named that work with smooth tips too."""
_SPEED = 0.2
"""m/s at which it is proposed: fast enough for inertia to help, slow enough for arms that push."""
_ENOUGH = np.radians(10.0)
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
    way = np.clip(_ENOUGH * _SPEED / max(abs(turns.turning[best]), 1e-3), *_WAYS)
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
