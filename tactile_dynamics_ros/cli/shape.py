"""`tactile-dynamics shape`: what stands on a table, from point clouds."""

from __future__ import annotations

import json
from argparse import Namespace, _SubParsersAction
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tactile_dynamics_ros.core.errors import BadInputError

if TYPE_CHECKING:
    from tactile_dynamics_ros.core.shape.superquadric.scene import Scene


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
    from tactile_dynamics_ros.core.shape.superquadric.scene import read_scene
    from tactile_dynamics_ros.recording.clouds import read_clouds

    cloud = read_clouds(args.clouds, args.unit)
    look = cloud.look if len(args.clouds) > 1 and args.align else None
    scene = read_scene(cloud.points, _support(args.support), depth=cloud.depth, look=look)
    if not 1 <= args.object <= len(scene.objects):
        raise BadInputError(
            f"--object {args.object}: {len(scene.objects)} objects were found, the largest is 1"
        )
    said = scene.to_json(args.object - 1)
    said["remarks"] = [*cloud.remarks, *said["remarks"]]
    if args.out:
        import trimesh

        parts = [part.shape.mesh() for part in scene.objects[args.object - 1].parts]
        trimesh.util.concatenate(parts).export(args.out)
    print(json.dumps(said) if args.json else _describe(scene, said, args.object))
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


def _describe(scene: Scene, said: dict[str, Any], number: int) -> str:
    first, *others = [part["words"] for part in said["parts"]]
    table = scene.support
    lines = [
        f"{first}" + "".join(f"; beside it {words}" for words in others),
        "support: " + ("unknown" if table is None else f"{1e3 * table:.1f} mm"),
        f"noise {1e3 * said['noise_m']:.2f} mm, {100 * said['outliers']:.0f} % strays, "
        f"{100 * said['entropy']:.0f} % of the surface unseen",
    ]
    for part in said["parts"]:
        x, y = (f"{1e3 * part[k]:.1f} +- {1e3 * part['std'][k]:.1f}" for k in "xy")
        lines.append(f"{part['words'].split(',')[0]}: at x {x}, y {y} mm")
    view = said["next_view"]
    if view is None:
        lines.append("another look would add little")
    else:
        place = ", ".join(f"{value:.3f}" for value in view["position"])
        lines.append(f"look next from ({place}) m: it would show {100 * view['gain']:.0f} % more")
    if len(scene.objects) > 1:
        lines.append(f"object {number} of {len(scene.objects)}; --object chooses")
    return "\n".join([*lines, *said["remarks"]])
