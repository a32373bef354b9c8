"""`tactile-dynamics shape`: what stands on a table, from point clouds."""

from __future__ import annotations

import json
from argparse import ArgumentTypeError, Namespace, _SubParsersAction
from pathlib import Path
from typing import Any

from tactile_dynamics_ros.core.files import written_whole
from tactile_dynamics_ros.core.options import COUNT, FINITE, file_to_write

_MESHES = (".ply", ".stl", ".obj", ".off")
"""Endings of the formats of meshes that common programs read; another one is refused before the
fit."""


def add_parser(verbs: _SubParsersAction[Any]) -> None:
    """Add the verb."""
    parser = verbs.add_parser(
        "shape",
        description="Describe an object on a table by superquadrics. Clouds are PLY, PCD, text "
        "(x y z in the first three columns) or npz (points; or depth in m, intrinsics and the "
        "camera's pose), in one frame whose z points up. Unless stated otherwise, the table is "
        "found in the cloud or taken to be at the foot of the object.",
    )
    parser.add_argument("clouds", nargs="+", metavar="CLOUD", type=Path)
    parser.add_argument(
        "--support",
        type=_support,
        default="auto",
        metavar="Z|auto|none",
        help="height of the table, m (auto)",
    )
    parser.add_argument("--unit", choices=("m", "mm"), help="of the clouds (guessed)")
    parser.add_argument("--object", type=COUNT, default=1, metavar="K", help="the K-th object (1)")
    parser.add_argument(
        "--align", action="store_true", help="align the clouds: the camera's poses are not exact"
    )
    parser.add_argument(
        "--out",
        type=_mesh_file,
        metavar="FILE",
        help="write the surface here as a mesh (PLY, STL)",
    )
    parser.set_defaults(run=run)


def run(args: Namespace) -> int:
    """Fit and print."""
    from tactile_dynamics_ros.api.verbs import shape

    found = shape(
        *args.clouds,
        support=args.support,
        unit=args.unit,
        number=args.object,
        align=args.align,
    )
    if args.out:
        import trimesh

        with written_whole(Path(args.out)) as part:
            trimesh.util.concatenate(found.meshes).export(part)
    print(json.dumps(found.to_json()) if args.json else found)
    return 0


def _mesh_file(text: str) -> str:
    """Return the path of a mesh that can be written.

    Raises:
        ArgumentTypeError: it has another ending, or nothing can be written there.
    """
    if Path(text).suffix.lower() not in _MESHES:
        raise ArgumentTypeError(f"'{text}', expected a file that ends in {', '.join(_MESHES)}")
    return file_to_write(text)


def _support(word: str) -> float | str | None:
    """Return where the table is: a height in m, "auto", or None for no table.

    Raises:
        ArgumentTypeError: the word says neither.
    """
    if word == "auto":
        return word
    if word == "none":
        return None
    try:
        return FINITE(word)
    except ArgumentTypeError:
        raise ArgumentTypeError(f"'{word}', expected a height in m, auto or none") from None
