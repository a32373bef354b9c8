"""Point clouds from files: PLY, PCD, text, npz, and depth images with their camera."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import trimesh
from numpy.typing import NDArray

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.reading import open_arrays, require_file

UNITS = {"m": 1.0, "mm": 1e-3}
"""Metres per unit of length."""
_LARGEST = 5.0
"""Extent, in the file's unit, beyond which it is taken to be mm: no table is 5 m wide, and nothing
that is looked at is smaller than 5 mm."""
MESH_SUFFIXES = (".ply", ".obj", ".stl", ".off")
"""Endings that are read as vertices of a mesh."""


@dataclass(frozen=True)
class Cloud:
    """Points of one or more looks in one frame.

    Attributes:
        points: (N, 3) world, z up, m.
        look: (N,) number of the file that each is from, from 0.
        depth: (N,) m along the axis of the camera; None where a file does not tell it.
        remarks: what was presumed in reading them.
    """

    points: Array
    look: NDArray[np.intp]
    depth: Array | None = None
    remarks: tuple[str, ...] = ()


def read_clouds(paths: Sequence[Path], unit: str | None = None) -> Cloud:
    """Read files whose points are in one frame, and put them together.

    Args:
        paths: PLY, PCD, text with three or more columns, npz with `points`, or with `depth` (m),
            `intrinsics` (3, 3) and the camera's `pose` (4, 4).
        unit: "m" or "mm"; guessed from the extent if None.

    Raises:
        BadInputError: a file cannot be read, names the file and what was expected.
    """
    read = [_read(path) for path in paths]
    points = np.concatenate([points for points, _ in read])
    look = np.repeat(np.arange(len(read)), [len(points) for points, _ in read])
    depths = [depth for _, depth in read if depth is not None]
    depth = np.concatenate(depths) if len(depths) == len(read) else None
    finite = np.isfinite(points).all(axis=1)
    points, look = points[finite], look[finite]
    if len(points) == 0:
        raise BadInputError(f"{paths[0]}: no finite points")
    remarks = []
    if unit is None:
        extent = float(np.ptp(np.quantile(points, [0.02, 0.98], axis=0), axis=0).max())
        unit = "mm" if extent > _LARGEST else "m"
        if unit == "mm":
            remarks.append(f"read as mm, since the points reach over {extent:.4g}; --unit says so")
    if depth is not None:
        depth = depth[finite] * UNITS[unit]
    return Cloud(points * UNITS[unit], look, depth, tuple(remarks))


def _read(path: Path) -> tuple[Array, Array | None]:
    """Return points (N, 3), and their depths (N,) where the file has an image of them."""
    require_file(path, "PLY, PCD, text or npz")
    suffix = path.suffix.lower()
    try:
        if suffix == ".npz":
            return _from_arrays(path)
        if suffix == ".pcd":
            from pypcd4 import PointCloud

            points = PointCloud.from_path(path).numpy(("x", "y", "z"))
            return np.asarray(points, dtype=float), None
        if suffix in MESH_SUFFIXES:
            return np.asarray(trimesh.load(path, process=False).vertices, dtype=float), None
        return _from_text(path), None
    except BadInputError:
        raise
    except Exception as error:
        raise BadInputError(f"{path}: not read as a cloud ({error})") from error


def _from_text(path: Path) -> Array:
    """Return the first three columns of a text file, split at blanks, commas or semicolons."""
    text = path.read_text(errors="replace").replace(",", " ").replace(";", " ")
    rows = []
    for number, line in enumerate(text.splitlines(), start=1):
        words = line.split("#")[0].split()
        if not words:
            continue
        try:
            rows.append([float(word) for word in words[:3]])
        except ValueError:
            if not rows:
                continue  # a heading
            raise BadInputError(
                f"{path}: line {number} is no point: '{line.strip()[:40]}'"
            ) from None
        if len(rows[-1]) < 3:
            raise BadInputError(
                f"{path}: line {number} has {len(rows[-1])} columns, expected x y z"
            )
    if not rows:
        raise BadInputError(f"{path}: no points; expected lines of x y z")
    return np.array(rows)


def _from_arrays(path: Path) -> tuple[Array, Array | None]:
    with open_arrays(path) as arrays:
        if "points" in arrays:
            return np.asarray(arrays["points"], dtype=float).reshape(-1, 3), None
        if "depth" not in arrays or "intrinsics" not in arrays:
            raise BadInputError(
                f"{path}: has {', '.join(arrays) or 'nothing'}; expected points, or depth and "
                "intrinsics (and pose)"
            )
        depth, camera = np.asarray(arrays["depth"], dtype=float), arrays["intrinsics"]
        pose = arrays["pose"] if "pose" in arrays else np.eye(4)
    row, column = np.mgrid[: depth.shape[0], : depth.shape[1]]
    rays = np.stack(
        [
            (column - camera[0, 2]) / camera[0, 0],
            (row - camera[1, 2]) / camera[1, 1],
            np.ones(depth.shape),
        ],
        axis=-1,
    )
    valid = np.isfinite(depth) & (depth > 0.0)
    local = rays[valid] * depth[valid][:, None]
    return np.asarray(local @ pose[:3, :3].T + pose[:3, 3]), depth[valid]
