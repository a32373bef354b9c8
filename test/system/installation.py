"""Environments away from the source, made of the libraries that this one has: no download."""

import csv
import importlib.metadata
import os
import subprocess
import sys
import sysconfig
from dataclasses import dataclass
from pathlib import Path

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

LEAKS = (
    "_ROS_WHEELS_BOOTSTRAP_COMPLETE",
    "LD_LIBRARY_PATH",
    "AMENT_PREFIX_PATH",
    "PYTHONPATH",
    "PYTHONDONTWRITEBYTECODE",
    "ROS_DISTRO",
)
"""What another environment sets for its own ROS (as `isolate` in ./dev), or makes starts slow."""

HERE = Path(sysconfig.get_path("purelib"))


def clean_copy(source: Path, target: Path) -> Path:
    """Copy what git knows or would add of a working tree, without anything built in it."""
    words = ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"]
    listed = subprocess.run(words, cwd=source, capture_output=True, check=True).stdout.decode()
    for name in filter(None, listed.split("\0")):
        if (source / name).is_file():
            (target / name).parent.mkdir(parents=True, exist_ok=True)
            (target / name).write_bytes((source / name).read_bytes())
            (target / name).chmod((source / name).stat().st_mode)
    return target


def closure(requirements):
    """Return the distributions of this environment that requirements need, each with its own."""
    found, waiting = {}, [(Requirement(text), "") for text in requirements]
    while waiting:
        requirement, extra = waiting.pop()
        if requirement.marker and not requirement.marker.evaluate({"extra": extra}):
            continue
        key = (canonicalize_name(requirement.name), frozenset(requirement.extras))
        if key in found:
            continue
        found[key] = importlib.metadata.distribution(requirement.name)
        for text in found[key].requires or ():
            waiting += [(Requirement(text), name) for name in ("", *requirement.extras)]
    return {name: distribution for (name, _), distribution in found.items()}


def files_of(distributions):
    """Return what belongs to distributions, relative to the prefix.

    A folder of the libraries that belongs to no other distribution stands for all that is in it.
    """
    library = os.path.relpath(HERE, sys.prefix)
    mine, others = set(), set()
    for distribution in importlib.metadata.distributions():
        owned = canonicalize_name(distribution.metadata["Name"]) in distributions
        for row in csv.reader((distribution.read_text("RECORD") or "").splitlines()):
            path = os.path.normpath(f"{library}/{row[0]}")
            if not path.startswith(("bin/", "include/")):
                (mine if owned else others).add(path)

    def folder(path):
        """Return the folder or module among the libraries that a file is in, if any."""
        inside = path.removeprefix(f"{library}/")
        return None if inside == path else f"{library}/{inside.split('/')[0]}"

    alone = {folder(path) for path in mine} - {folder(path) for path in others} - {None}
    return alone | {path for path in mine if folder(path) not in alone}


@dataclass
class Environment:
    """A virtual environment and the variables of a shell in which it is active.

    Attributes:
        root: of the virtual environment.
        variables: of the shell.
    """

    root: Path
    variables: dict[str, str]

    @property
    def python(self) -> Path:
        """The interpreter."""
        return self.root / "bin" / "python"

    def run(self, *words, timeout=120, **options):
        """Run a command to its end, away from the source."""
        return subprocess.run(
            [str(word) for word in words],
            env=self.variables,
            cwd=self.root,
            capture_output=True,
            text=True,
            timeout=timeout,
            **options,
        )

    def start(self, *words, log: Path):
        """Start a process whose output goes to a file."""
        with log.open("wb") as output:
            return subprocess.Popen(
                [str(word) for word in words],
                env=self.variables,
                cwd=self.root,
                stdin=subprocess.DEVNULL,
                stdout=output,
                stderr=subprocess.STDOUT,
            )


def make_environment(root: Path, requirements) -> Environment:
    """Make a virtual environment with what some requirements need, and nothing else."""
    words = [sys.executable, "-m", "venv", "--without-pip", str(root)]
    subprocess.run(words, check=True, capture_output=True)
    needed = closure(requirements)
    for file in files_of(needed):
        link = f"{root}/{file}"
        os.makedirs(os.path.dirname(link), exist_ok=True)
        os.symlink(f"{sys.prefix}/{file}", link)
    variables = {name: value for name, value in os.environ.items() if name not in LEAKS}
    variables |= {"PATH": f"{root / 'bin'}:{os.environ['PATH']}", "VIRTUAL_ENV": str(root)}
    variables["PYTHONFAULTHANDLER"] = "1"  # what hangs tells where on SIGABRT
    return Environment(root, variables)
