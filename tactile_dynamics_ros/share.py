"""Files that come with the package: configuration, objects, launch files."""

from __future__ import annotations

import importlib.util
import os
import sys
from pathlib import Path

from tactile_dynamics_ros.core.errors import BadInputError, nearest

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
        if os.path.isfile(candidate):  # False also for names that are too long
            return candidate
    raise BadInputError(f"no file '{name}', neither as a path nor in {folders[0]}")


def find_package_file(name: str, folder: Path) -> Path | None:
    """Return a file that a URDF or a robot's yaml names, or None if there is none.

    Args:
        name: a path relative to the folder, an absolute one, or package://PACKAGE/PATH with a
            package of ROS or of Python, or (as some simulators write it) a path in the folder.
        folder: of the file that names it.
    """
    scheme, separator, path = name.partition("://")
    if not separator or scheme == "file":
        found = [folder / (path or scheme)]
    else:
        package, _, rest = path.partition("/")
        prefixes = os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep)
        found = [Path(prefix) / "share" / path for prefix in prefixes if prefix]
        found += [Path(place) / rest for place in _python_package(package)] + [folder / path]
    return next((candidate for candidate in found if os.path.isfile(candidate)), None)


def _python_package(name: str) -> list[str]:
    """Return the folders of an installed Python package without importing it."""
    spec = importlib.util.find_spec(name) if name.isidentifier() else None
    return list(spec.submodule_search_locations or []) if spec is not None else []


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
        raise BadInputError(
            f"object '{name}' is unknown: expected one of {', '.join(known)}{nearest(name, known)}"
        )
    return folder / f"{name}.yaml"
