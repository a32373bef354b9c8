"""What setup.py, package.xml, README and the environments say about installing agrees."""

import re
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import pytest
import setuptools
import yaml
from packaging.requirements import Requirement

from tactile_dynamics_ros.cli.bringup import node_names

ROOT = Path(__file__).parents[2]
PACKAGE = "tactile_dynamics_ros"
README = (ROOT / "README.md").read_text()
DOCKERFILE = (ROOT / "Dockerfile").read_text()
CI = (ROOT / ".github" / "workflows" / "ci.yml").read_text()
BY_KEY = {
    "python3-jinja2": "jinja2",
    "python3-matplotlib": "matplotlib",
    "python3-numpy": "numpy",
    "python3-pil": "pillow",
    "python3-scipy": "scipy",
    "python3-yaml": "pyyaml",
}
"""Library of each rosdep key in package.xml."""


@pytest.fixture
def setup(monkeypatch):
    """What setup.py hands to setuptools."""
    given = {}
    monkeypatch.chdir(ROOT)
    monkeypatch.setattr(setuptools, "setup", lambda **fields: given.update(fields))
    exec(compile((ROOT / "setup.py").read_text(), "setup.py", "exec"), {})
    return given


def names(requirements):
    return {Requirement(text).name for text in requirements}


def keys():
    """Return the keys that package.xml depends on to run."""
    return {e.text for e in ElementTree.parse(ROOT / "package.xml").findall("exec_depend")}


def test_every_folder_with_modules_is_installed(setup):
    folders = {path.parent for path in (ROOT / PACKAGE).rglob("*.py")}
    dotted = {".".join(folder.relative_to(ROOT).parts) for folder in folders}
    assert dotted == set(setup["packages"])


def test_type_checkers_find_the_types_of_what_is_installed(setup):
    assert (ROOT / PACKAGE / "py.typed").exists()
    assert "py.typed" in setup["package_data"][PACKAGE]


def test_every_node_is_an_executable(setup):
    scripts = {line.split(" = ")[0] for line in setup["entry_points"]["console_scripts"]}
    assert scripts == {*node_names(), "tactile-dynamics"}


def test_a_robot_gets_every_library_from_apt_or_by_the_pip_line_of_the_readme(setup):
    (line,) = re.findall(r"^pip install ([\w. -]+)$", README, re.MULTILINE)
    by_key = {BY_KEY[key] for key in keys() - {"python3-venv"} if key.startswith("python3-")}
    assert set(line.split()) & by_key == set()
    assert set(line.split()) | by_key == names(setup["install_requires"])
    for other in (DOCKERFILE, CI):
        (same,) = re.findall(r"pip install ([\w. -]+)$", other, re.MULTILINE)
        assert same == line


def test_the_dockerfile_copies_what_exists_and_builds_as_the_readme_does():
    copies = re.findall(r"^COPY (?:--\w+=\S+ )?(\S+) \S+$", DOCKERFILE, re.MULTILINE)
    assert copies == ["package.xml", "interfaces/package.xml", "."]
    assert all((ROOT / source).exists() for source in copies)
    block = README.partition("## On a robot with ROS 2 Jazzy")[2].partition("```\n")[0]
    for command in ("rosdep install", "python3 -m venv", "colcon build"):
        (typed,) = re.findall(rf"^{command} [^&#\n]*\w", block, re.MULTILINE)
        assert typed in DOCKERFILE
    assert DOCKERFILE.index("USER robot") < DOCKERFILE.index("colcon build")


def test_continuous_integration_builds_for_jazzy_and_runs_what_exists():
    jobs = yaml.safe_load(CI)["jobs"]
    settings = jobs["industrial_ci"]["steps"][-1]["env"]
    assert settings["ROS_DISTRO"] == "jazzy"
    assert jobs["tests"]["steps"][-1]["run"] == "bash .ci/run" and (ROOT / ".ci/run").is_file()


def test_the_simulator_is_an_extra_and_every_extra_is_in_the_environment(setup):
    assert names(setup["extras_require"]["sim"]) == {"pybullet"}
    assert "pybullet" not in names(setup["install_requires"])
    (extras,) = re.findall(r"-e '\.\[([\w,]+)\]'", (ROOT / "dev").read_text())
    assert set(extras.split(",")) == set(setup["extras_require"])


def test_what_modules_import_of_ros_is_a_dependency_of_the_package():
    of_ros = r"(?:\w+_(?:msgs|srvs|interfaces)|rclpy|launch|launch_ros|ament_index_python)"
    pattern = re.compile(rf"^ *(?:from|import) ({of_ros})\b", re.MULTILINE)
    files = [path for folder in (PACKAGE, "launch") for path in (ROOT / folder).rglob("*.py")]
    imported = set(pattern.findall("\n".join(path.read_text() for path in files)))
    assert {"rclpy", "launch_ros"} <= imported <= keys()


def test_continuous_integration_has_the_versions_of_what_apt_installs():
    lines = (ROOT / ".ci" / "ubuntu-24.04.txt").read_text().splitlines()
    pinned = {line.split("==")[0].lower() for line in lines if "==" in line}
    assert pinned == set(BY_KEY.values())
