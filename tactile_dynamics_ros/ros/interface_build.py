"""Builds packages of messages, services and actions for the ROS 2 wheels, without colcon.

`python -m tactile_dynamics_ros.ros.interface_build` builds tactile_dynamics_msgs into the Python
environment that runs it. On a robot colcon builds the package.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import sysconfig
import tempfile
from collections.abc import Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from tactile_dynamics_ros.core.errors import BadInputError, TactileDynamicsError
from tactile_dynamics_ros.share import share_file

PACKAGE = "tactile_dynamics_msgs"
"""Package of the definitions in interfaces/."""
USES = (
    *("action_msgs", "builtin_interfaces", "geometry_msgs", "service_msgs", "std_msgs"),
    "unique_identifier_msgs",
)
"""Packages whose types those definitions use, by themselves or because they are actions."""
PARTS = (
    "rosidl_generator_c",
    "rosidl_typesupport_introspection_c",
    "rosidl_typesupport_fastrtps_c",
    "rosidl_generator_py",
)
"""Libraries of a package; Python's extension module has the last, and chooses among the others."""
RUNTIME = (
    *("rosidl_runtime_c", "rosidl_typesupport_c", "rosidl_typesupport_fastrtps_c", "rmw"),
    *("rosidl_typesupport_fastrtps_cpp", "rosidl_typesupport_introspection_c", "rcutils"),
    "fastcdr",
)
"""Libraries of the wheels with which those of a package are linked."""
LOAD = """
import ctypes, pathlib

for kind in ("generator_c", "typesupport_introspection_c", "typesupport_fastrtps_c"):
    name = f"lib{__name__}__rosidl_{kind}.so"
    ctypes.CDLL(str(pathlib.Path(__file__).with_name(name)), ctypes.RTLD_GLOBAL)
"""
"""Python package's own text: the middleware finds libraries by name, those that are loaded too."""
GENERATE = "import sys; from {} import generate; generate(*sys.argv[1:])"
"""Program that generates the sources, in a process whose folder is that of the definitions."""
KINDS = ("msg", "srv", "action")
"""Folders of definitions, whose files end in the same word."""


def missing_tools() -> str:
    """Return what this machine misses to build interfaces with, or an empty text."""
    header = Path(sysconfig.get_path("include")) / "Python.h"
    found = {name: bool(shutil.which(name)) for name in ("gcc", "g++")}
    found["Python.h (on Debian or Ubuntu: apt install python3-dev)"] = header.is_file()
    found["ROS 2 wheels"] = (Path(sys.prefix) / "share" / "rosidl_generator_py").is_dir()
    return ", ".join(name for name, there in found.items() if not there)


def build(package: str, source: Path, uses: Iterable[str], out: Path) -> None:
    """Build a package of definitions so that Python imports it from `out`.

    Args:
        package: its name.
        source: folder with msg/, srv/ or action/.
        uses: packages whose types it uses.
        out: folder on Python's path; a package of this name that is there is replaced.

    Raises:
        BadInputError: this machine misses a compiler, Python's headers or the wheels.
        TactileDynamicsError: generating or compiling fails.
    """
    if missing := missing_tools():
        raise BadInputError(f"{package} cannot be built here; missing: {missing}")
    files = sorted(p for kind in KINDS for p in (source / kind).glob(f"*.{kind}"))
    with tempfile.TemporaryDirectory() as scratch:
        made = Path(scratch) / package
        made.mkdir()
        program = GENERATE.format(__spec__.name)
        environment = os.environ | {"AMENT_PREFIX_PATH": sys.prefix}
        environment["PYTHONPATH"] = str(Path(__file__).resolve().parents[2])
        words = [sys.executable, "-c", program, package, str(made)]
        _run([*words, *(str(f.relative_to(source)) for f in files)], source, environment)
        _compile(package, made, uses)
        (made / "__init__.py").write_text(LOAD)
        shutil.rmtree(out / package, ignore_errors=True)
        shutil.copytree(made, out / package, ignore=_ignore_sources)


def generate(package: str, made: str, *files: str) -> None:
    """Generate the C, C++ and Python sources of a package; that needs a process of its own.

    Args:
        package: its name.
        made: folder for them.
        files: definitions, relative to the current folder.
    """
    from rosidl_generator_c.cli import GenerateC
    from rosidl_generator_py.cli import GeneratePython
    from rosidl_typesupport_c.cli import GenerateCTypesupport
    from rosidl_typesupport_fastrtps_c.cli import GenerateFastRTPSCTypesupport
    from rosidl_typesupport_introspection_c.cli import GenerateIntrospectionCTypesupport

    both = [PARTS[2], PARTS[1]]
    own, beside = Path(made), _introspection(Path(made))
    beside.mkdir(parents=True)
    for kind, folder in (
        (GenerateC("c"), own),
        (GenerateFastRTPSCTypesupport("fastrtps_c"), own),
        (GenerateIntrospectionCTypesupport("introspection_c"), beside),  # names as the others'
        (GenerateCTypesupport("c", typesupport_implementations=both), own),
        (GeneratePython("py", typesupport_implementations=["rosidl_typesupport_c"]), own),
    ):
        kind.generate(package, list(files), [Path(sys.prefix) / "share"], folder)


def _introspection(made: Path) -> Path:
    """Return the folder of the sources that would overwrite others."""
    return made.with_name(f"{made.name}_introspection") / made.name


def _compile(package: str, made: Path, uses: Iterable[str]) -> None:
    """Compile what was generated into the libraries and the extension module that rclpy loads."""
    import numpy

    prefix, beside = Path(sys.prefix), _introspection(made)
    folders = [made.parent, prefix / "include", numpy.get_include(), beside.parent]
    folders += [sysconfig.get_path("include")]
    folders += [folder for folder in (prefix / "include").iterdir() if folder.is_dir()]
    options = ["-fPIC", "-O1", "-w", *(f"-I{folder}" for folder in folders)]
    sources = sorted(p for folder in (made, beside) for p in folder.rglob("*.c*"))

    def compiled(path: Path) -> None:
        compiler = "gcc" if path.suffix == ".c" else "g++"
        _run([compiler, *options, "-c", str(path), "-o", f"{path}.o"])

    with ThreadPoolExecutor(os.cpu_count()) as pool:
        list(pool.map(compiled, sources))
    used = [f"{use}__{part}" for use in uses for part in (*PARTS, "rosidl_typesupport_c")]
    for number, part in enumerate(PARTS):
        own = [f"{package}__{earlier}" for earlier in PARTS[:number]]
        objects = [f"{path}.o" for path in sources if _part_of(path, made) == part]
        _link(package, part, objects, made, [*own, *used, *RUNTIME])


def _link(package: str, part: str, objects: list[str], made: Path, used: Sequence[str]) -> None:
    """Link one library; those of the package find each other beside them."""
    library = Path(sys.prefix) / "lib"
    known = [name for name in used if any(any(p.glob(f"lib{name}.so*")) for p in (made, library))]
    end = f"lib{package}__{part}.so"
    if part == PARTS[-1]:
        end = f"{package}_s__rosidl_typesupport_c{sysconfig.get_config_var('EXT_SUFFIX')}"
    words = ["g++", "-shared", *objects, f"-L{made}", f"-L{library}", f"-Wl,-soname,{end}"]
    words += ["-Wl,-rpath,$ORIGIN", f"-Wl,-rpath,{library}", *(f"-l{name}" for name in known)]
    _run([*words, "-o", str(made / end)])


def _part_of(path: Path, made: Path) -> str:
    """Return the library that a generated file belongs to."""
    if made not in path.parents:
        return PARTS[1]
    if path.name.endswith("__type_support_c.cpp"):
        return PARTS[2]
    return PARTS[0] if path.parent.name == "detail" else PARTS[-1]


def _ignore_sources(folder: str, names: list[str]) -> set[str]:
    """Return what an installed package does not need: all but Python and libraries."""
    files = {name for name in names if not (Path(folder) / name).is_dir()}
    return {name for name in files if not name.endswith((".py", ".so"))} | {"tmp", "detail"}


def _run(words: list[str], folder: Path | None = None, variables: object = None) -> None:
    done = subprocess.run(words, capture_output=True, text=True, cwd=folder, env=variables)
    if done.returncode:
        said = f"{done.stdout}{done.stderr}"[-3000:]
        raise TactileDynamicsError(f"{words[0]} ended with {done.returncode}:\n{said}")


def main() -> int:
    """Build tactile_dynamics_msgs into this environment; return the exit code."""
    place = Path(sysconfig.get_path("purelib"))
    try:
        build(PACKAGE, share_file("interfaces/msg/Estimate.msg").parents[1], USES, place)
    except (TactileDynamicsError, OSError) as error:
        print(f"error: {error}; nodes run without actions", file=sys.stderr)
        return 2
    print(f"{PACKAGE} is in {place}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
