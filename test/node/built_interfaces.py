"""Builds packages of messages and services that no wheel brings, from their definitions."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import sysconfig
from pathlib import Path

import pytest

PREFIX = Path(sys.prefix)
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
LOAD = """
import ctypes, pathlib

for kind in ("generator_c", "typesupport_introspection_c", "typesupport_fastrtps_c"):
    name = f"lib{__name__}__rosidl_{kind}.so"
    ctypes.CDLL(str(pathlib.Path(__file__).with_name(name)), ctypes.RTLD_GLOBAL)
"""
"""Package of Python: the middleware finds libraries by name, those that are loaded too."""
GENERATE = """
import sys, pathlib
from rosidl_generator_c.cli import GenerateC
from rosidl_generator_py.cli import GeneratePython
from rosidl_typesupport_c.cli import GenerateCTypesupport
from rosidl_typesupport_fastrtps_c.cli import GenerateFastRTPSCTypesupport
from rosidl_typesupport_introspection_c.cli import GenerateIntrospectionCTypesupport

package, made, *files = sys.argv[1:]
both = ["rosidl_typesupport_fastrtps_c", "rosidl_typesupport_introspection_c"]
for kind in (
    GenerateC("c"),
    GenerateFastRTPSCTypesupport("fastrtps_c"),
    GenerateIntrospectionCTypesupport("introspection_c"),
    GenerateCTypesupport("c", typesupport_implementations=both),
    GeneratePython("py", typesupport_implementations=["rosidl_typesupport_c"]),
):
    own = pathlib.Path(made)
    if "Introspection" in type(kind).__name__:  # its files bear the names of others
        own = own.with_name(f"{package}_introspection") / package
        own.mkdir(parents=True)
    kind.generate(package, files, [pathlib.Path(sys.prefix) / "share"], own)
"""


def require_compilers() -> None:
    """Skip where these packages cannot be compiled."""
    header = Path(sysconfig.get_path("include")) / "Python.h"
    if not (shutil.which("gcc") and shutil.which("g++") and header.is_file()):
        pytest.skip("no gcc, g++ or Python.h to build interfaces with")


def build(package: str, files: dict[str, str], uses: list[str], out: Path) -> None:
    """Build a package of definitions into one library that Python imports from `out`.

    Args:
        package: its name.
        files: text by path, such as msg/TFMessage.msg.
        uses: packages whose messages it uses.
        out: folder to put into PYTHONPATH.
    """
    source, made = out / "source" / package, out / package
    for path, text in files.items():
        (source / path).parent.mkdir(parents=True, exist_ok=True)
        (source / path).write_text(text)
    made.mkdir(parents=True, exist_ok=True)
    environment = os.environ | {"AMENT_PREFIX_PATH": str(PREFIX)}
    words = [sys.executable, "-c", GENERATE, package, str(made), *files]
    _run(words, cwd=source, env=environment)
    (made / "__init__.py").write_text(LOAD)
    _compile(package, made, uses)


def _compile(package: str, made: Path, uses: list[str]) -> None:
    """Compile what was generated into the libraries and the extension module that rclpy loads."""
    import numpy

    folders = [made.parent, PREFIX / "include", numpy.get_include()]
    folders += [sysconfig.get_path("include")]
    folders += [folder for folder in (PREFIX / "include").iterdir() if folder.is_dir()]
    options = ["-fPIC", "-O1", "-w", *(f"-I{folder}" for folder in folders)]
    beside = made.with_name(f"{package}_introspection")
    options.append(f"-I{beside}")
    objects: dict[str, list[str]] = {part: [] for part in PARTS}
    for path in sorted(p for folder in (made, beside) for p in folder.rglob("*.c*")):
        compiled = path.with_suffix(f"{path.suffix}.o")
        compiler = "gcc" if path.suffix == ".c" else "g++"
        _run([compiler, *options, "-c", str(path), "-o", str(compiled)])
        objects[_part_of(path, made)].append(str(compiled))
    own: list[str] = []
    for part, compiled_files in objects.items():
        names = [*own, *(f"{use}__{part}" for use in uses for part in PARTS), *RUNTIME]
        places = (made, PREFIX / "lib")
        known = [n for n in names if any(any(p.glob(f"lib{n}.so*")) for p in places)]
        words = ["g++", "-shared", *compiled_files]
        words += [w for p in places for w in (f"-L{p}", f"-Wl,-rpath,{p}")]
        end = f"{package}_s__rosidl_typesupport_c{sysconfig.get_config_var('EXT_SUFFIX')}"
        end = end if part == PARTS[-1] else f"lib{package}__{part}.so"
        words.append(f"-Wl,-soname,{end}")
        _run([*words, *(f"-l{name}" for name in known), "-o", str(made / end)])
        own.append(f"{package}__{part}")


def _part_of(path: Path, made: Path) -> str:
    """Which library a generated file belongs to."""
    if made not in path.parents:
        return PARTS[1]
    if path.name.endswith("__type_support_c.cpp"):
        return PARTS[2]
    return PARTS[0] if path.parent.name == "detail" else PARTS[-1]


def _run(words: list[str], **options: object) -> None:
    done = subprocess.run(words, capture_output=True, text=True, **options)
    assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-3000:]
