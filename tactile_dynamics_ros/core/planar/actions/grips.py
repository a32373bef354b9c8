"""Where two flat pads of a gripper hold an outline between opposite faces."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.planar.actions.candidate import Candidate
from tactile_dynamics_ros.core.planar.actions.information import Belief
from tactile_dynamics_ros.core.planar.linked.outlines import dense_outline, distance_outside
from tactile_dynamics_ros.core.planar.mechanics.outline import area_and_centroid
from tactile_dynamics_ros.core.planar.mechanics.simulation import GRAVITY

_OPPOSITE = np.cos(np.deg2rad(10.0))
"""Cosine of the angle up to which two faces count as opposite: flat pads then touch both along
their length with a wedge of 1 mm; at 20 deg the friction of pads alone, 0.35, would hold them."""
_ALONG, _ACROSS = 0.0075, 0.006
"""m, half the length of a pad's face and thickness of a pad: the room that an open gripper needs
where it comes down. Pads of small grippers are smaller, so that nothing is promised too much."""
_SLACK = 0.004
"""m between each open pad and the object: outlines are known to 2 mm and poses to 1 mm."""
_LEAST = 0.004
"""m, narrowest width that is gripped: a gripper that is closed to 2 mm counts as a single tip."""
_HOLDS = 0.7
"""Share of what two pads hold that a pull may ask for: friction of pads is known to a fifth."""


@dataclass(frozen=True, eq=False)
class Grasp:
    """A place where the object is held between two opposite faces; frame of the outline.

    Attributes:
        middle: (2,) m, between the pads. closing: (2,) unit, from the right pad to the left one.
        width: m, between the faces.
    """

    middle: Array
    closing: Array
    width: float


def grasps(outline: Array, opening: float, count: int, others: Sequence[Array] = ()) -> list[Grasp]:
    """Grasps (at most `count`, spread round the outline) that form closure allows.

    From each place the line along its inward normal is followed through the object; it holds where
    the face on the other side is opposite and no farther than the jaws open, and where both open
    pads come down beside the object and beside other parts.

    Args:
        outline: (V, 2) m, of any simple shape.
        opening: m, of the jaws.
        count: of grasps.
        others: (V, 2) m each, parts beside it.
    """
    points, inward = _faces(outline)
    found: list[Grasp] = []
    for place, normal in zip(points, inward, strict=True):
        grasp = _through(outline, place, normal)
        if grasp is None or not _LEAST < grasp.width < opening - 2.0 * _SLACK:
            continue
        if _is_free(grasp, opening, (outline, *others)) and not _is_known(grasp, found):
            found.append(grasp)
    picked = np.unique(np.linspace(0, len(found) - 1, min(count, len(found))).round().astype(int))
    return [found[k] for k in picked]


def _faces(outline: Array) -> tuple[Array, Array]:
    """Points (P, 2) along an outline and the unit normals (P, 2) into it."""
    turning = outline if area_and_centroid(outline)[0] > 0.0 else outline[::-1]
    points = dense_outline(turning)
    after = np.roll(points, -1, axis=0)
    way = after - points
    unit = way / np.linalg.norm(way, axis=1, keepdims=True)
    return 0.5 * (points + after), np.stack([-unit[:, 1], unit[:, 0]], axis=1)


def _through(outline: Array, place: Array, normal: Array) -> Grasp | None:
    """The grasp between a place (2,) and what lies opposite along its inward normal (2,)."""
    turning = outline if area_and_centroid(outline)[0] > 0.0 else outline[::-1]
    start, edge = turning, np.roll(turning, -1, axis=0) - turning
    across = edge[:, 0] * normal[1] - edge[:, 1] * normal[0]
    safe = np.where(np.abs(across) > 1e-12, across, np.inf)
    away = start - place
    depth = (edge[:, 0] * away[:, 1] - edge[:, 1] * away[:, 0]) / safe
    share = (normal[0] * away[:, 1] - normal[1] * away[:, 0]) / safe
    hit = (depth > 1e-4) & (share >= 0.0) & (share < 1.0)
    if not hit.any():
        return None
    k = int(np.where(hit, depth, np.inf).argmin())
    facing = np.array([-edge[k, 1], edge[k, 0]]) / np.linalg.norm(edge[k])
    if facing @ normal > -_OPPOSITE:
        return None
    return Grasp(place + 0.5 * depth[k] * normal, normal, float(depth[k]))


def _is_free(grasp: Grasp, opening: float, outlines: Sequence[Array]) -> bool:
    """Whether both pads of an open gripper come down beside all outlines."""
    along = np.array([grasp.closing[1], -grasp.closing[0]])
    apart = 0.5 * opening + 0.5 * _ACROSS
    corners = [
        grasp.middle + side * apart * grasp.closing + shift * _ALONG * along
        for side in (1.0, -1.0)
        for shift in (-1.0, 0.0, 1.0)
    ]
    places = np.array(corners)
    return all(distance_outside(each, places).min() > 0.5 * _ACROSS for each in outlines)


def _is_known(grasp: Grasp, found: Sequence[Grasp]) -> bool:
    """Whether a grasp is one of those found, or less than a pad's length from it."""
    return any(
        np.linalg.norm(grasp.middle - each.middle) < 2.0 * _ALONG
        and abs(grasp.closing @ each.closing) > _OPPOSITE
        for each in found
    )


def is_held(candidate: Candidate, belief: Belief, friction: float, force: float) -> bool:
    """Whether two pads should hold what a pull asks for, of an object a std heavier than believed.

    The load is the object's friction and what accelerates it, its torque that of the lever of the
    centre of mass. Along the pads both have to come from their friction; across, one face bears
    the load, and the torque is left to the friction of both and the length of the faces.

    Args:
        candidate: a pull.
        belief: what is known.
        friction: between pads and object.
        force: with which each pad grips, N.
    """
    resistance, mass = np.exp(belief.mean[:2] + belief.std[:2])
    swing = 0.5 * candidate.sway * (2.0 * np.pi * candidate.sway_hz) ** 2
    load = GRAVITY * resistance + mass * swing
    x, y = belief.mean[2:] - candidate.point
    torque = load * abs(candidate.direction[0] * y - candidate.direction[1] * x)
    most = _HOLDS * force
    if abs(candidate.direction @ candidate.normal) > 0.5:
        couple = most * (friction * candidate.width + 2.0 * _ALONG)
        return bool(load < 2.0 * most and torque < couple)
    return bool(0.5 * load + torque / candidate.width < friction * most)
