"""Other ways to follow: leave the pose as it is, or plain ICP of a surface with what is seen."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import small_gicp

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.tracking.depth_image import PinholeCamera, cut_window
from tactile_dynamics_ros.core.tracking.links.link_tracker import Link
from tactile_dynamics_ros.core.tracking.watch import Sighting

Follower = Callable[[Array, PinholeCamera, float, Array], dict[str, Sighting]]

REACH, HEIGHT = 0.02, 0.006
"""Distance within which points are matched, and above the table from which they count, m."""
CLAIMED = np.diag([np.deg2rad(1.0) ** 2] * 3 + [2e-3**2] * 3)
"""Covariance of poses of methods that state none."""


def leave(links: list[Link]) -> Follower:
    """Return a follower that says where links were at first."""
    told = {link.name: Sighting(link.pose, CLAIMED, 1.0, 1.0) for link in links}
    return lambda *_: told


def plain_icp(links: list[Link]) -> Follower:
    """Return point-to-plane ICP of each surface with all points above the table."""
    poses = {link.name: link.pose.copy() for link in links}
    models = {link.name: _model(link) for link in links}

    def follow(depth: Array, camera: PinholeCamera, _: float, __: Array) -> dict[str, Sighting]:
        whole = slice(0, camera.height), slice(0, camera.width)
        points = cut_window(camera, depth, *whole).points
        points = points @ camera.pose[:3, :3].T + camera.pose[:3, 3]
        points = points[points[:, 2] > HEIGHT]
        for name, (target, tree) in models.items():
            start = poses[name]
            near = points[np.linalg.norm(points - start[:3, 3], axis=1) < 0.15]
            if len(near) < 30:
                continue
            source = small_gicp.PointCloud(near)
            result = small_gicp.align(
                target, source, tree, np.linalg.inv(start), registration_type="PLANE_ICP",
                max_correspondence_distance=REACH, num_threads=1,
            )  # fmt: skip
            poses[name] = np.linalg.inv(np.asarray(result.T_target_source))
        return {name: Sighting(pose, CLAIMED, 1.0, 1.0) for name, pose in poses.items()}

    return follow


def _model(link: Link) -> tuple[small_gicp.PointCloud, small_gicp.KdTree]:
    """Return points of a surface with normals, and their tree."""
    cloud = small_gicp.PointCloud(link.shape.points)
    tree = small_gicp.KdTree(cloud)
    small_gicp.estimate_normals(cloud, tree, num_neighbors=10, num_threads=1)
    return cloud, tree


PEERS: dict[str, Callable[[list[Link]], Follower]] = {"none": leave, "plain_icp": plain_icp}
