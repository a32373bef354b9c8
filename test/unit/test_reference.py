"""`./dev docs`: the reference of modules is made from their docstrings."""

import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip("pdoc")

ROOT = Path(__file__).resolve().parents[2]


def reference(out, *modules):
    command = [sys.executable, str(ROOT / "docs" / "reference.py"), str(out), *modules]
    return subprocess.run(command, capture_output=True, text=True, timeout=120)


def test_the_reference_of_a_module_has_its_functions_and_their_arguments(tmp_path):
    done = reference(tmp_path, "tactile_dynamics_ros.core.errors", "tactile_dynamics_ros")
    assert done.returncode == 0, done.stderr
    page = (tmp_path / "tactile_dynamics_ros" / "core" / "errors.html").read_text()
    assert "nearest_file" in page
    assert "what it could have been" in page
    front = (tmp_path / "tactile_dynamics_ros.html").read_text()
    assert "Tell which effect is missing" in front
    assert (tmp_path / "index.html").exists()


def test_a_module_that_is_not_there_is_refused_in_one_line(tmp_path):
    done = reference(tmp_path, "tactile_dynamics_ros.nothing")
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1
