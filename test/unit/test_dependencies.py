"""Who may import whom: walks the imports of every module."""

import ast
import re
import sys
from pathlib import Path

import pytest

import tactile_dynamics_ros
from tactile_dynamics_ros.cli.bringup import node_names

ROOT = Path(tactile_dynamics_ros.__file__).parent
ROS = {
    "rclpy",
    "builtin_interfaces",
    "diagnostic_msgs",
    "geometry_msgs",
    "lifecycle_msgs",
    "rcl_interfaces",
    "rosgraph_msgs",
    "sensor_msgs",
    "std_msgs",
    "std_srvs",
    "tf2_msgs",
    "visualization_msgs",
}
DISTRIBUTION = {
    "PIL": "pillow",
    "backports": "backports.zstd",
    "mpl_toolkits": "matplotlib",
    "pybullet_data": "pybullet",
    "yaml": "pyyaml",
}
PACKAGE = "tactile_dynamics_ros"


def imported_names(path):
    """Return the dotted names that a file imports, anywhere in it."""
    names = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: relative import"
            names |= {f"{node.module}.{alias.name}" for alias in node.names}
    return names


def imports_of(folder):
    """Return {relative path: imported names} of a folder or module of the package."""
    files = [folder] if folder.suffix == ".py" else sorted(folder.rglob("*.py"))
    return {str(file.relative_to(ROOT)): imported_names(file) for file in files}


def offenders(folder, forbidden):
    """Return (file, name) pairs that import something forbidden."""
    found = []
    for file, names in imports_of(ROOT / folder).items():
        for name in names:
            if any(name == bad or name.startswith(bad + ".") for bad in forbidden):
                found.append((file, name))
    return found


def internal(*parts):
    return [f"{PACKAGE}.{part}" for part in parts]


def test_the_walk_sees_the_package():
    assert len(imports_of(ROOT / "core")) > 10
    assert offenders("nodes", ["rclpy"])


@pytest.mark.parametrize("layer", ["core", "sim", "recording", "report"])
def test_only_nodes_and_cli_know_ros(layer):
    assert offenders(layer, ROS) == []


def test_core_imports_nothing_above_it():
    above = internal("nodes", "cli", "sim", "report", "recording")
    assert offenders("core", above) == []


def test_recordings_build_on_core_alone():
    assert offenders("recording", internal("nodes", "cli", "sim", "report")) == []


def test_simulator_never_sees_how_effects_or_diagnosis_are_modelled():
    graded = ("core.effects", "core.discrepancy", "core.inertia", "nodes", "cli", "report")
    assert offenders("sim", internal(*graded)) == []


def test_only_the_simulator_uses_bullet():
    for layer in ("core", "nodes", "cli", "report", "recording"):
        assert offenders(layer, ["pybullet", "pybullet_data"]) == []


def test_only_the_simulated_robot_and_the_demo_use_the_simulator():
    users = {file for layer in ("nodes", "cli") for file, _ in offenders(layer, internal("sim"))}
    assert users <= {"nodes/robot_sim.py", "cli/train.py", "cli/bringup.py"}


def test_nodes_never_import_each_other():
    nodes = set(node_names())
    assert {"robot_sim", "biotac_force", "inertial_estimator"} <= nodes
    for node in nodes:
        others = internal(*(f"nodes.{other}" for other in nodes - {node}))
        assert offenders(f"nodes/{node}.py", others) == []


def test_effects_know_no_estimator_and_rigid_body_knows_nobody():
    assert offenders("core/effects", internal("core.inertia", "core.discrepancy")) == []
    everyone = [
        name
        for names in imports_of(ROOT / "core" / "rigid_body").values()
        for name in names
        if name.startswith(PACKAGE)
    ]
    allowed = tuple(internal("core.rigid_body", "core.errors"))
    assert [name for name in everyone if not name.startswith(allowed)] == []


def test_heavy_libraries_stay_where_they_are_needed():
    for layer in ("core/rigid_body", "core/contact", "core/effects", "core/tracking", "nodes"):
        assert offenders(layer, ["torch", "gtsam"]) == []


def test_every_library_that_is_imported_is_declared():
    tree = ast.parse((ROOT.parent / "setup.py").read_text())
    texts = [n.value for n in ast.walk(tree) if isinstance(n, ast.Constant)]
    declared = {re.split(r"[<>=; ]", text)[0] for text in texts if isinstance(text, str)}
    imported = {name.split(".")[0] for names in imports_of(ROOT).values() for name in names}
    later = {"ament_index_python", "compression"}
    outside = imported - set(sys.stdlib_module_names) - ROS - {PACKAGE} - later
    assert {DISTRIBUTION.get(name, name) for name in outside} - declared == set()
