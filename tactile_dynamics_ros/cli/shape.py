"""`tactile-dynamics shape`: what stands on a table, from point clouds."""

from __future__ import annotations

import json
from argparse import Namespace, _SubParsersAction
from pathlib import Path
from typing import Any

from tactile_dynamics_ros.core.errors import BadInputError


def add_parser(verbs: _SubParsersAction[Any]) -> None:
    """Add the verb."""
    parser = verbs.add_parser(
        "shape",
        help="parts, size and pose of an object on a table from point clouds, and where to look",
        description="Describe an object on a table by superquadrics. Clouds are PLY, PCD, text "
        "(x y z in the first three columns) or npz (points; or depth in m, intrinsics and the "
        "camera's pose), in one frame whose z points up. Where nothing else is told, the table is "
        "found in the cloud or taken to be at the foot of the object.",
    )
    parser.add_argument("clouds", nargs="+", metavar="CLOUD", type=Path)
    parser.add_argument(
        "--support", default="auto", metavar="Z|auto|none", help="height of the table, m (auto)"
    )
    parser.add_argument("--unit", choices=("m", "mm"), help="of the clouds (guessed)")
    parser.add_argument("--object", type=int, default=1, metavar="K", help="the K-th object (1)")
    parser.add_argument(
        "--align", action="store_true", help="align the clouds: the camera's poses are not exact"
    )
    parser.add_argument("--out", metavar="FILE", help="write the surface here as a mesh (PLY, STL)")
    parser.set_defaults(run=run)


def run(args: Namespace) -> int:
    """Fit and print."""
    from tactile_dynamics_ros.api.verbs import shape

    found = shape(
        *args.clouds,
        support=_support(args.support),
        unit=args.unit,
        number=args.object,
        align=args.align,
    )
    if args.out:
        import trimesh

        trimesh.util.concatenate(found.meshes).export(args.out)
    print(json.dumps(found.to_json()) if args.json else found)
    return 0


def _support(word: str) -> float | str | None:
    if word == "auto":
        return word
    if word == "none":
        return None
    try:
        return float(word)
    except ValueError:
        raise BadInputError(f"--support {word}: expected a height in m, auto or none") from None
