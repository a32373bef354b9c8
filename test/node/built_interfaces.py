"""Builds packages of messages and services that no wheel brings, from their definitions."""

from __future__ import annotations

from pathlib import Path

import pytest

from tactile_dynamics_ros.ros import interface_build


def require_compilers() -> None:
    """Skip where these packages cannot be compiled."""
    if missing := interface_build.missing_tools():
        pytest.skip(f"interfaces cannot be built here; missing: {missing}")


def build(package: str, files: dict[str, str], uses: list[str], out: Path) -> None:
    """Build a package of definitions into one library that Python imports from `out`.

    Args:
        package: its name.
        files: text by path, such as msg/TFMessage.msg.
        uses: packages whose messages it uses.
        out: folder to put into PYTHONPATH.
    """
    source = out / "source" / package
    for path, text in files.items():
        (source / path).parent.mkdir(parents=True, exist_ok=True)
        (source / path).write_text(text)
    interface_build.build(package, source, uses, out)
