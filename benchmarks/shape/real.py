"""Real clouds of single objects: time, size, and whether the answer depends on how they lie."""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.rigid_body.rotation import exp_so3
from tactile_dynamics_ros.core.shape.superquadric.scene import Scene, read_scene
from tactile_dynamics_ros.recording.clouds import read_clouds

CLOUDS = Path(__file__).resolve().parents[3] / "shared/data/clouds_tabletop"
"""Clouds of the iCub's stereo cameras and of a spray can; beside the repository, not in it."""


def real_clouds() -> dict[str, Any]:
    """Answers to all clouds, and how far they move when the clouds are transformed."""
    paths = sorted([*CLOUDS.glob("*.txt"), *CLOUDS.glob("*.pcd")])
    return {path.stem: one_cloud(read_clouds([path]).points) for path in paths}


def one_cloud(points: Array) -> dict[str, Any]:
    """Extents of the largest part, m, processor time, and relative changes of the extents."""
    scene, seconds = timed(points)
    parts = scene.objects[0].parts
    extents = extents_of(scene)
    found: dict[str, Any] = {
        "points": len(points),
        "parts": len(parts),
        "extents_m": extents.tolist(),
        "seconds": seconds,
        "remarks": scene.to_json()["remarks"],
        "changes": {},
    }
    for name, other, unit in transformed(points):
        again, _ = timed(other)
        if len(again.objects[0].parts) != len(parts):
            found["changes"][name] = None
            continue
        found["changes"][name] = float(np.max(np.abs(unit * extents_of(again) / extents - 1.0)))
    return found


def transformed(points: Array) -> Iterator[tuple[str, Array, float]]:
    """Yield the same cloud in other places, orders, units and densities, and the unit, m."""
    rng = np.random.default_rng(4)
    yield "moved", points + [3.0, -2.0, 0.5], 1.0
    yield "turned", points @ exp_so3(np.array([0.0, 0.0, 0.7])).T, 1.0
    yield "shuffled", points[rng.permutation(len(points))], 1.0
    yield "in mm", 1e3 * points, 1e-3
    yield "thinned to half", points[rng.permutation(len(points))[: len(points) // 2]], 1.0


def extents_of(scene: Scene) -> Array:
    """Sorted extents (3,) of the largest part of the first object."""
    return np.sort(2.0 * scene.objects[0].parts[0].shape.semi_axes)


def timed(points: Array) -> tuple[Scene, float]:
    """The scene, and how long it took on this thread, s."""
    started = time.thread_time()
    scene = read_scene(points)
    return scene, time.thread_time() - started
