"""The repository as an ament_python package: what `ros2 run` and the ament index look at."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import tactile_dynamics_ros
from tactile_dynamics_ros.cli.live import node_names

ROOT = Path(tactile_dynamics_ros.__file__).parents[1]
COLCON = Path(sys.executable).with_name("colcon")
PARTS = (
    "package.xml",
    "setup.py",
    "setup.cfg",
    "pyproject.toml",
    "resource",
    "config",
    "launch",
    "tactile_dynamics_ros",
)


@pytest.fixture(scope="module")
def prefix(tmp_path_factory):
    """Build a copy of the package with colcon; return its install prefix."""
    if not COLCON.exists():
        pytest.skip("colcon is not installed")
    work = tmp_path_factory.mktemp("colcon")
    source = work / "src" / "tactile_dynamics_ros"
    source.mkdir(parents=True)
    for part in PARTS:
        copy = shutil.copytree if (ROOT / part).is_dir() else shutil.copy
        copy(ROOT / part, source / part)
    command = [str(COLCON), "build", "--event-handlers", "console_direct+"]
    done = subprocess.run(command, cwd=work, capture_output=True, text=True, timeout=240)
    assert done.returncode == 0, done.stdout + done.stderr
    return work / "install" / "tactile_dynamics_ros"


def test_all_executables_lie_where_ros2_run_looks(prefix):
    folder = prefix / "lib" / "tactile_dynamics_ros"
    found = {path.name for path in folder.iterdir() if os.access(path, os.X_OK)}
    assert {*node_names(), "tactile-dynamics"} <= found


def test_ament_index_finds_package_and_its_files(prefix):
    program = (
        "from ament_index_python.packages import get_package_prefix as p, "
        "get_package_share_directory as s; "
        "print(p('tactile_dynamics_ros')); print(s('tactile_dynamics_ros'))"
    )
    environment = {**os.environ, "AMENT_PREFIX_PATH": str(prefix)}
    command = [sys.executable, "-c", program]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
    found, share = (Path(line) for line in done.stdout.split())
    assert found == prefix
    for name in (
        "package.xml",
        "config/allegro_iiwa.yaml",
        "config/objects/box_0.yaml",
        "launch/bringup.launch.py",
    ):
        assert (share / name).is_file()


def test_data_files_inside_the_package_are_installed(prefix):
    listed = {p for p in (ROOT / "tactile_dynamics_ros").rglob("*") if p.is_file()}
    data = [p for p in listed if p.suffix not in (".py", ".pyc")]
    assert data
    library = next(prefix.glob("lib/python3*/site-packages"))
    missing = [p for p in data if not (library / p.relative_to(ROOT)).is_file()]
    assert missing == []


def test_installed_executable_runs_from_the_installed_files(prefix):
    library = next(prefix.glob("lib/python3*/site-packages"))
    environment = {**os.environ, "PYTHONPATH": str(library), "AMENT_PREFIX_PATH": str(prefix)}
    executable = prefix / "lib" / "tactile_dynamics_ros" / "tactile-dynamics"
    done = subprocess.run(
        [sys.executable, str(executable), "up", "--config", "config/none.yaml"],
        env=environment,
        cwd=prefix,
        capture_output=True,
        text=True,
        timeout=60,
    )
    assert done.returncode == 2
    assert str(prefix) in done.stderr
