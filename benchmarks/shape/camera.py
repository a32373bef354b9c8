"""A stereo camera that looks at objects on a table: Bullet renders, noise grows with distance."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pybullet

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.shape.superquadric.views import looking_at

WIDTH, HEIGHT, VIEW_DEG = 320, 240, 50.0
NEAR, FAR = 0.05, 3.0
DISPARITY_STD = 0.15
"""Pixels of 1280 columns. Source: user reports of a Zed2i, 0.1 to 0.25."""
FOCAL, BASELINE = 530.0, 0.12
"""Of a Zed2i at 1280 columns: px, m."""
STRAYS = 0.1
POINTS = 2000


@dataclass
class TableCamera:
    """Looks at solids on a table from poses X_WC (x right, y down, z forward).

    Args:
        solids: in the world, the table is z = 0.
        seed: of noise and strays.
    """

    solids: Sequence[Any]
    seed: int

    def __post_init__(self) -> None:
        """Put the solids into an engine."""
        self.client = pybullet.connect(pybullet.DIRECT)
        self.random = np.random.default_rng(self.seed)
        for solid in self.solids:
            shape = pybullet.createVisualShape(
                pybullet.GEOM_MESH,
                vertices=solid.vertices.tolist(),
                indices=solid.faces.ravel().tolist(),
                physicsClientId=self.client,
            )
            pybullet.createMultiBody(0, -1, shape, physicsClientId=self.client)

    def close(self) -> None:
        """End the engine."""
        pybullet.disconnect(self.client)

    def look(self, pose: Array) -> Array:
        """Return noisy points (N, 3) of the objects in the world; a tenth are strays."""
        focal = 0.5 * WIDTH / np.tan(np.deg2rad(0.5 * VIEW_DEG))
        vertical = np.rad2deg(2.0 * np.arctan(0.5 * HEIGHT / focal))
        eye, forward, up = pose[:3, 3], pose[:3, 2], -pose[:3, 1]
        view = pybullet.computeViewMatrix(eye.tolist(), (eye + forward).tolist(), up.tolist())
        lens = pybullet.computeProjectionMatrixFOV(vertical, WIDTH / HEIGHT, NEAR, FAR)
        image = pybullet.getCameraImage(
            WIDTH,
            HEIGHT,
            view,
            lens,
            renderer=pybullet.ER_TINY_RENDERER,
            physicsClientId=self.client,
        )
        window = np.reshape(image[3], (HEIGHT, WIDTH)).astype(float)
        depth = FAR * NEAR / (FAR - (FAR - NEAR) * window)
        row, column = np.nonzero(np.reshape(image[4], (HEIGHT, WIDTH)) >= 0)
        chosen = self.random.permutation(len(row))[:POINTS]
        row, column = row[chosen], column[chosen]
        z = depth[row, column]
        z = z + self.random.normal(size=len(z)) * z**2 * DISPARITY_STD / (FOCAL * BASELINE)
        # TinyRenderer draws what lies at whole pixels from the lower left corner.
        x, y = (column - 0.5 * WIDTH) / focal, (row - 0.5 * HEIGHT + 1.0) / focal
        points = (np.stack([x, y, np.ones_like(x)], axis=1) * z[:, None]) @ pose[:3, :3].T + eye
        low, high = points.min(axis=0) - 0.02, points.max(axis=0) + 0.02
        strays = self.random.uniform(low, high, size=(int(STRAYS * len(points)), 3))
        strays[:, 2] = np.abs(strays[:, 2])
        return np.concatenate([points, strays])


def first_pose(target: Array, rng: np.random.Generator, distance: float = 0.5) -> Array:
    """Return a camera pose at 45 deg over the table, anywhere around a target."""
    turn = rng.uniform(0.0, 2.0 * np.pi)
    away = np.array([np.cos(turn), np.sin(turn), 1.0]) / np.sqrt(2.0)
    return looking_at(target + distance * away, target)
