"""Files that come with the package: configuration, objects, launch files."""

from __future__ import annotations

import os
import sys
from pathlib import Path

from tactile_dynamics_ros.core.errors import BadInputError

PACKAGE = "tactile_dynamics_ros"


def share_file(name: str) -> Path:
    """Return a file that the package ships, from the source tree if there is one.

    Args:
        name: for example "config/allegro_iiwa.yaml", or the path of any file.

    Raises:
        BadInputError: there is no such file; lists where it was looked for.
    """
    source = Path(__file__).resolve().parents[1]
    prefixes = [*os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep), sys.prefix]
    folders = [source] if (source / "package.xml").is_file() else []
    folders += [Path(prefix) / "share" / PACKAGE for prefix in prefixes if prefix]
    folders += [parent / "share" / PACKAGE for parent in source.parents]
    for candidate in [Path(name), *(folder / name for folder in folders)]:
        if candidate.is_file():
            return candidate
    raise BadInputError(f"no file '{name}', neither as a path nor in {folders[0]}")


def object_file(name: str) -> Path:
    """Return the file of an object by its name in config/objects, or by a path that ends in yaml.

    Raises:
        BadInputError: there is no such object; lists those that are known.
    """
    if name.endswith((".yaml", ".yml")):
        return share_file(name)
    folder = share_file("config/objects/box_0.yaml").parent
    known = sorted(path.stem for path in folder.glob("*.yaml"))
    if name not in known:
        raise BadInputError(f"object '{name}' is unknown: expected one of {', '.join(known)}")
    return folder / f"{name}.yaml"
