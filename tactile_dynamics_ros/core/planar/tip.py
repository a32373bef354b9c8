"""Contact of a tip of which only the path is known, without a force sensor."""

from __future__ import annotations

import numpy as np

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.planar.mechanics.linkage import turned
from tactile_dynamics_ros.core.planar.mechanics.outline import edge_normals, nearest_edge
from tactile_dynamics_ros.core.planar.streams import LinkStream, PushContact

_MOVES = 0.01
"""m/s from which an object counts as moved: poses of 0.5 mm over the tenth of a second that is
looked back make 7 mm/s of noise."""


def contact_of_tip(link: LinkStream, time: Array, place: Array) -> PushContact:
    """Where a tip meets an outline, by its middle's path: its radius is the usual gap in motion.

    Args:
        link: the object.
        time: (K,) s, of the tip.
        place: (K, 3) m, middle of the tip, frame S; z is the height of the push.
    """
    pose = np.stack([np.interp(time, link.time, part) for part in link.pose.T], axis=1)
    own = turned(place[:, :2] - pose[:, :2], -pose[:, 2])
    depth, normal = nearest_edge(link.footprint, edge_normals(link.footprint), own)
    before = np.stack([np.interp(time - 0.1, link.time, part) for part in link.pose.T[:2]], axis=1)
    moves = np.linalg.norm(pose[:, :2] - before, axis=1) > 0.1 * _MOVES
    radius = max(0.0, float(np.median(-depth[moves]))) if moves.any() else 0.0
    inward = turned(normal, pose[:, 2])
    point = place + np.pad(radius * inward, ((0, 0), (0, 1)))
    return PushContact(
        name="pusher",
        time=np.zeros(0),
        force=np.zeros((0, 3)),
        force_std=None,
        pose_time=time,
        point=point,
        normal=np.pad(inward, ((0, 0), (0, 1))),
    )
