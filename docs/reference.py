"""Makes the reference of what can be imported as HTML: `./dev docs`.

python docs/reference.py OUT [MODULE ..]
"""

from __future__ import annotations

import argparse
import importlib
import pkgutil
import sys
import warnings
from pathlib import Path

import pdoc

import tactile_dynamics_ros

ROOMS = ("api", "core", "export", "recording", "synthetic")
"""Rooms that people import; nodes and verbs have docs/ros.md and `--help`."""


def module_names() -> list[str]:
    """Return the names of all modules that somebody may import, the package itself first."""
    package = tactile_dynamics_ros.__name__
    found = pkgutil.walk_packages(tactile_dynamics_ros.__path__, f"{package}.")
    return [package, *(name for _, name, _ in found if name.split(".")[1] in ROOMS)]


def write_reference(out: Path, names: list[str]) -> None:
    """Write a page for each module and an index with a search.

    Args:
        out: folder of the pages.
        names: of modules.
    """
    for name in tactile_dynamics_ros.__all__:  # what is imported when it is asked for
        setattr(tactile_dynamics_ros, name, getattr(tactile_dynamics_ros, name))
    pdoc.render.configure(docformat="google", math=True, show_source=False)
    for name in names:
        importlib.import_module(name)  # a misspelt one is an error, not a warning
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # annotations that only checkers import stay as written
        pdoc.pdoc(*names, output_directory=out)


def main() -> int:
    """Write the reference of the modules that are named, or of all."""
    parser = argparse.ArgumentParser(description="reference of all modules as HTML")
    parser.add_argument("out", type=Path)
    parser.add_argument("modules", nargs="*", metavar="MODULE")
    args = parser.parse_args()
    try:
        write_reference(args.out, args.modules or module_names())
    except ModuleNotFoundError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    print(f"reference: {args.out / 'index.html'}", file=sys.stderr)
    return 0


if __name__ == "__main__":
    sys.exit(main())
