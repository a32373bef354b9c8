"""Who may import whom: every module is held against the rooms of `rooms.py`."""

import ast
import re
import sys
from pathlib import Path

import pytest
from rooms import PACKAGE, PAGE, ROOMS, breaches, imported_names, page, room_of

import tactile_dynamics_ros
from benchmarks.stats import circular
from tactile_dynamics_ros.cli.bringup import node_names

ROOT = Path(tactile_dynamics_ros.__file__).parent
SOURCES = {file.relative_to(ROOT): file.read_text() for file in sorted(ROOT.rglob("*.py"))}
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
    "trajectory_msgs",
    "visualization_msgs",
}
DISTRIBUTION = {
    "PIL": "pillow",
    "backports": "backports.zstd",
    "mpl_toolkits": "matplotlib",
    "pybullet_data": "pybullet",
    "urdf_parser_py": "urdf-parser-py",
    "yaml": "pyyaml",
}

MOST_FILES = 15
"""At one level of a room of core: what somebody new can look through."""


@pytest.mark.parametrize("name", ROOMS)
def test_a_room_imports_only_what_it_may(name):
    found = [
        (str(file), breach)
        for file, text in SOURCES.items()
        if room_of(file.with_suffix("").parts) == name
        for breach in breaches(file, text)
    ]
    assert found == []


@pytest.mark.parametrize(
    ("file", "line"),
    [
        ("core/rigid_body/rotation.py", "from tactile_dynamics_ros.core.streams import streams"),
        ("core/numerics/noise.py", "from tactile_dynamics_ros.core.effects import effect"),
        ("core/effects/held/drag.py", "import tactile_dynamics_ros.core.inertia.batch.fitting"),
        ("core/discrepancy/search.py", "import tactile_dynamics_ros.core.contact.wrench_samples"),
        (
            "core/inertia/residuals/motion.py",
            "import tactile_dynamics_ros.core.inertia.batch",
        ),
        ("core/inertia/batch/prior.py", "import tactile_dynamics_ros.core.inertia.live.pipeline"),
        (
            "core/friction/probe_config.py",
            "from tactile_dynamics_ros.core.inertia.batch import batch",
        ),
        ("sim/world.py", "def late():\n    from tactile_dynamics_ros.core.effects import registry"),
        ("synthetic/sensors.py", "from tactile_dynamics_ros.core.effects.held import sensor"),
        ("recording/arrays.py", "import rclpy"),
        ("core/contact/contact_state.py", "import torch"),
        ("nodes/model_check.py", "import pybullet"),
    ],
)
def test_a_planted_breach_is_found(file, line):
    assert breaches(Path(file), SOURCES[Path(file)]) == []
    assert len(breaches(Path(file), SOURCES[Path(file)] + "\n" + line)) == 1


def test_rooms_allow_no_circle():
    open_rooms = dict(ROOMS)
    while open_rooms:
        settled = [n for n, room in open_rooms.items() if not set(room.imports) & set(open_rooms)]
        assert settled, f"circle among {sorted(open_rooms)}"
        for name in settled:
            del open_rooms[name]


def test_modules_import_no_circle():
    """Type checking counts too: who needs another to be understood cannot be understood alone."""
    graph = {name_of(file): imported_modules(text) for file, text in SOURCES.items()}
    assert sorted(circular(graph)) == []


def name_of(file):
    """Return the dotted name of a module; that of a package for its `__init__`."""
    return ".".join([PACKAGE, *file.with_suffix("").parts]).removesuffix(".__init__")


def imported_modules(text):
    """Return the modules of the package that a source imports."""
    known = {name_of(file) for file in SOURCES}
    return {
        next(n for n in (name, name.rpartition(".")[0]) if n in known)
        for name in imported_names(text)
        if name.startswith(PACKAGE + ".")
    }


def test_every_folder_is_a_room_or_within_one():
    folders = {file.parent.as_posix() for file in SOURCES} - {".", "core"}
    assert {folder for folder in folders if not room_of(folder.split("/"))} == set()
    assert {room_of(folder.split("/")) for folder in folders} == set(ROOMS)


@pytest.mark.parametrize("name", [name for name in ROOMS if name.startswith("core/")])
def test_a_room_of_core_can_be_looked_through(name):
    levels = {}
    for file in SOURCES:
        if file.as_posix().startswith(name + "/"):
            levels.setdefault(file.parent, []).append(file)
    inside = [level for level in levels if room_of(level.parts) == name]
    assert all(len(level.parts) <= 3 for level in inside)
    assert all(len(levels[level]) <= MOST_FILES for level in inside)


def test_the_page_has_the_rooms_of_today():
    assert PAGE.read_text() == page(), "run: python test/unit/rooms.py"


@pytest.mark.parametrize("layer", ["core", "sim", "recording", "report", "synthetic"])
def test_only_nodes_and_cli_know_ros(layer):
    assert importers(layer, ROS) == []


def importers(folder, names):
    """Return the files of a folder that import one of these names or what is below it."""
    return [
        str(file)
        for file, text in SOURCES.items()
        if file.parts[0] == folder
        for name in imported_names(text)
        if any(name == bad or name.startswith(bad + ".") for bad in names)
    ]


def test_only_the_simulated_robot_and_the_demo_use_the_simulator():
    users = set(importers("nodes", [f"{PACKAGE}.sim"])) | set(importers("cli", [f"{PACKAGE}.sim"]))
    assert users <= {"nodes/robot_sim.py", "cli/train.py", "cli/train_noise.py", "cli/bringup.py"}


def test_the_folder_of_nodes_is_the_list_of_executables():
    files = {file.stem for file in SOURCES if file.parts[0] == "nodes"} - {"__init__"}
    assert files == set(node_names())
    assert {"robot_sim", "biotac_force", "inertial_estimator"} <= files


def test_nodes_never_import_each_other():
    for node in node_names():
        names = imported_names(SOURCES[Path(f"nodes/{node}.py")])
        assert not [name for name in names if name.startswith(f"{PACKAGE}.nodes")]


def test_every_library_that_is_imported_is_declared():
    tree = ast.parse((ROOT.parent / "setup.py").read_text())
    texts = [n.value for n in ast.walk(tree) if isinstance(n, ast.Constant)]
    declared = {re.split(r"[<>=; ]", text)[0] for text in texts if isinstance(text, str)}
    imported = {name.split(".")[0] for text in SOURCES.values() for name in imported_names(text)}
    later = {"ament_index_python", "compression"}
    later |= {name for name in imported if name.startswith("rosidl_")}  # rclpy's wheel needs them
    outside = imported - set(sys.stdlib_module_names) - ROS - {PACKAGE} - later
    assert {DISTRIBUTION.get(name, name) for name in outside} - declared == set()
