"""Clouds of several looks in one frame although the camera's poses are a little off."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from tactile_dynamics_ros.core.array import Array

_REACH = 0.06
"""Largest distance of points that are paired, as a share of the size of the first cloud: 6 mm on 10
cm, what poses are off by at most. More pairs strays, less leaves larger errors."""
_CELL = 0.015
"""Width of the cells that points are averaged in first, as a share of the size: 1.5 mm on 10 cm,
about a pixel of a depth camera at 0.8 m. Larger blurs edges, smaller takes longer and gives
nothing."""
_LEAST_PAIRED = 0.3
"""Share of a cloud's points that must find a partner: a look at the other side of an object shares
less with the ones before, and sliding along it would do harm. Lower believes alignments by one
face, along which looks slide; higher leaves looks unaligned that share little."""
_FARTHEST, _WIDEST = 0.1, np.deg2rad(3.0)
"""Largest shift, as a share of the size, and turn that are believed: registration that moves a look
by more has slipped along a body of revolution or onto another face. Lower refuses corrections of
cameras that are off by as much, higher believes slips."""


def registered(clouds: Sequence[Array]) -> list[Array]:
    """Align clouds to the ones before them, plane to plane.

    Clouds that share too little with those before them, or that would move far, stay as they are.
    Source: Koide, small_gicp, 2024 (generalised ICP of Segal, Haehnel and Thrun, 2009).

    Args:
        clouds: (N, 3) each, world, m, right to some millimetres and half a degree, without the
            table: along it looks would slide.

    Returns:
        Clouds in the frame of the first one.
    """
    import small_gicp

    first = np.asarray(clouds[0], dtype=float)
    middle = np.median(first, axis=0)
    size = float(np.ptp(np.quantile(first, [0.02, 0.98], axis=0), axis=0).max())
    aligned = [first]
    for cloud in clouds[1:]:
        source = np.asarray(cloud, dtype=float)
        found = small_gicp.align(
            np.concatenate(aligned) - middle,
            source - middle,
            registration_type="GICP",
            downsampling_resolution=_CELL * size,
            max_correspondence_distance=_REACH * size,
        )
        count = max(len(small_gicp.voxelgrid_sampling(source - middle, _CELL * size).points()), 1)
        if _is_believed(found, count, size):
            motion = np.asarray(found.T_target_source)
            source = (source - middle) @ motion[:3, :3].T + motion[:3, 3] + middle
        aligned.append(source)
    return aligned


def _is_believed(found: Any, count: int, size: float) -> bool:
    motion = np.asarray(found.T_target_source)
    turn = float(np.arccos(np.clip(0.5 * (np.trace(motion[:3, :3]) - 1.0), -1.0, 1.0)))
    shift = float(np.linalg.norm(motion[:3, 3]))
    paired = found.num_inliers / count
    return bool(
        found.converged and paired > _LEAST_PAIRED and shift < _FARTHEST * size and turn < _WIDEST
    )
