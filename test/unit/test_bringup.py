"""What is started, with which parameters, and how often again; the launch file that uses it."""

import importlib.util
import sys
from pathlib import Path
from types import ModuleType, SimpleNamespace

import pytest
import yaml

from tactile_dynamics_ros.cli import bringup
from tactile_dynamics_ros.cli.bringup import (
    MOST_RESPAWNS,
    RESPAWN_DELAY,
    RESPAWN_WINDOW,
    Respawns,
    nodes_of,
    read_configuration,
    read_names,
    read_namespace,
    read_switch,
    write_parameters,
)
from tactile_dynamics_ros.cli.main import build_parser
from tactile_dynamics_ros.core.errors import BadInputError

ROOT = Path(bringup.__file__).parents[2]
ROBOT = {
    "contact_state": {"point_std": 0.002, "filter": {"rate": 3, "order": 2}},
    "inertial_estimator": {"contacts": ["left", "right"]},
}
SIMULATED = {"contact_state": {"filter.rate": 5}, "robot_sim": {"seed": 4}}


def write_robot(path, nodes):
    content = {name: {"ros__parameters": parameters} for name, parameters in nodes.items()}
    path.write_text(yaml.safe_dump(content, sort_keys=False))
    return path


@pytest.fixture
def robot(tmp_path):
    """A robot without a simulator in its file, and what a simulation adds beside it."""
    write_robot(tmp_path / "robot.simulated.yaml", SIMULATED)
    return write_robot(tmp_path / "robot.yaml", ROBOT)


def parameters_of(file):
    return yaml.safe_load(file.read_text())["/**"]["ros__parameters"]


def test_simulation_reads_the_file_beside_and_a_robot_does_not(robot):
    simulated = read_configuration(robot, simulate=True)
    assert list(simulated) == ["contact_state", "inertial_estimator", "robot_sim"]
    assert simulated["contact_state"] == {
        "point_std": 0.002,
        "filter.rate": 5,
        "filter.order": 2,
        "use_sim_time": True,
    }
    assert simulated["robot_sim"] == {"seed": 4}
    real = read_configuration(robot, simulate=False)
    assert list(real) == ["contact_state", "inertial_estimator"]
    assert real["contact_state"]["filter.rate"] == 3
    assert {node["use_sim_time"] for node in real.values()} == {False}


def test_a_robot_file_that_lists_the_simulator_works_without_it(tmp_path):
    file = write_robot(tmp_path / "robot.yaml", {"robot_sim": {}, **ROBOT})
    assert nodes_of(file, simulate=False) == list(ROBOT)
    assert nodes_of(file) == ["robot_sim", *ROBOT]


def test_parameter_files_reach_nodes_of_any_namespace(robot, tmp_path):
    files = write_parameters(robot, tmp_path / "parameters", simulate=False)
    assert parameters_of(files["inertial_estimator"])["contacts"] == ["left", "right"]
    assert list(yaml.safe_load(files["contact_state"].read_text())) == ["/**"]


def test_nodes_are_left_out_by_name(robot, tmp_path):
    files = write_parameters(robot, tmp_path / "p", True, ["contact_state", "robot_sim"])
    assert list(files) == ["inertial_estimator"]
    with pytest.raises(BadInputError, match="no node 'contact_sate'"):
        write_parameters(robot, tmp_path / "p", True, ["contact_sate"])
    with pytest.raises(BadInputError, match="nothing to start"):
        write_parameters(robot, tmp_path / "p", False, list(ROBOT))


def test_a_simulation_keeps_its_own_tare(tmp_path):
    file = write_robot(tmp_path / "robot.yaml", {"biotac_force": {}})
    simulated = write_parameters(file, tmp_path / "simulated")["biotac_force"]
    assert parameters_of(simulated)["tare_file"] == str(tmp_path / "simulated" / "tare.npy")
    real = write_parameters(file, tmp_path / "real", simulate=False)["biotac_force"]
    assert "tare_file" not in parameters_of(real)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ("[1, 2]", "expected node names"),
        ("grasp_controler: {ros__parameters: {}}", "no node 'grasp_controler'"),
        ("contact_state: {point_std: 0.002}", "contact_state: expected ros__parameters"),
        ("contact_state: [", "robot.yaml: line 2: not valid yaml"),
        (b"\xff\xfe\x00", "robot.yaml is no text"),
    ],
)
def test_a_file_that_is_no_configuration_is_refused(tmp_path, content, words):
    file = tmp_path / "robot.yaml"
    file.write_bytes(content if isinstance(content, bytes) else content.encode())
    with pytest.raises(BadInputError, match=words):
        read_configuration(file)
    with pytest.raises(BadInputError, match="no such file"):
        read_configuration(tmp_path / "none.yaml")


def test_arguments_are_read_as_people_write_them():
    for text in ("[a, b]", "a,b", "a b", "['a','b']", '["a", "b"]'):
        assert read_names(text) == ["a", "b"]
    assert read_names("[]") == read_names("") == []
    assert [read_namespace(n) for n in ("", "/", "left", "/a/b")] == ["", "", "/left", "/a/b"]
    assert [read_switch("simulate", t) for t in ("true", "False", "0")] == [True, False, False]
    with pytest.raises(BadInputError, match="simulate 'maybe'"):
        read_switch("simulate", "maybe")
    for bad in ("left/", "2nd", "a b", "left hand"):
        with pytest.raises(BadInputError, match="namespace"):
            read_namespace(bad)


def test_three_new_starts_a_minute_and_no_more():
    respawns = Respawns()
    deaths = [RESPAWN_DELAY * k for k in range(MOST_RESPAWNS + 1)]
    verdicts = [respawns.note_death("a", 1, now) for now in deaths]
    assert [v.again for v in verdicts] == [True] * MOST_RESPAWNS + [False]
    assert "a ended with 1 after 3 new starts within 60 s" in verdicts[-1].sentence
    assert respawns.note_death("b", 1, deaths[-1]).again


def test_a_node_that_dies_now_and_then_always_comes_back():
    respawns = Respawns()
    interval = RESPAWN_WINDOW / MOST_RESPAWNS + 0.1
    assert all(respawns.note_death("a", 1, interval * k).again for k in range(20))


class Action:
    """Stands for any action of a launch: keeps what it was made of."""

    def __init__(self, *arguments, **fields):
        self.arguments = arguments
        self.fields = fields

    def perform(self, context):
        """As LaunchConfiguration does."""
        return context.launch_configurations[self.arguments[0]]


def kind(name):
    return type(name, (Action,), {})


@pytest.fixture
def launch_file(monkeypatch):
    """The launch file, loaded with stand-ins for `launch` and `launch_ros`."""
    modules = {
        "launch": {"LaunchDescription": kind("LaunchDescription")},
        "launch.actions": {
            name: kind(name)
            for name in ("DeclareLaunchArgument", "LogInfo", "OpaqueFunction", "TimerAction")
        },
        "launch.substitutions": {"LaunchConfiguration": kind("LaunchConfiguration")},
        "launch_ros": {},
        "launch_ros.actions": {"Node": kind("Node")},
        "ament_index_python": {},
        "ament_index_python.packages": {"get_package_share_directory": lambda _: str(ROOT)},
    }
    for name, members in modules.items():
        module = ModuleType(name)
        vars(module).update(members)
        monkeypatch.setitem(sys.modules, name, module)
    path = ROOT / "launch" / "bringup.launch.py"
    spec = importlib.util.spec_from_file_location("bringup_launch", path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def launch(module, **given):
    """Return the nodes that a launch with these arguments starts, by name, and its context."""
    (entities,) = module.generate_launch_description().arguments
    *declared, start = entities
    values = {a.arguments[0]: a.fields["default_value"] for a in declared}
    assert set(given) <= set(values)
    context = SimpleNamespace(launch_configurations=values | given, is_shutdown=False)
    nodes = start.fields["function"](context)
    return {node.fields["name"]: node for node in nodes}, context


def test_launch_is_of_a_real_robot_unless_a_simulation_is_asked_for(launch_file):
    nodes, _ = launch(launch_file)
    config = ROOT / "config" / "allegro_iiwa.yaml"
    assert list(nodes) == nodes_of(config, simulate=False)
    assert "robot_sim" not in nodes
    given = build_parser().parse_args(["up"])
    assert read_switch("--simulate", given.simulate) is False


def test_launch_starts_what_is_listed(launch_file):
    nodes, _ = launch(launch_file, simulate="true")
    assert list(nodes) == nodes_of(ROOT / "config" / "allegro_iiwa.yaml")
    assert {node.fields["namespace"] for node in nodes.values()} == {None}


def test_launch_on_a_robot(launch_file, tmp_path):
    file = write_robot(tmp_path / "robot.yaml", ROBOT)
    nodes, _ = launch(
        launch_file,
        config=str(file),
        without="[contact_state]",
        namespace="left",
    )
    assert list(nodes) == ["inertial_estimator"]
    fields = nodes["inertial_estimator"].fields
    assert fields["namespace"] == "/left"
    assert parameters_of(Path(*fields["parameters"])) == {
        "contacts": ["left", "right"],
        "use_sim_time": False,
    }


def test_launch_refuses_unknown_names(launch_file):
    with pytest.raises(BadInputError, match="no node 'camera'"):
        launch(launch_file, without="[camera]")


def test_launch_starts_a_dead_node_again_three_times_and_says_when_it_stops(launch_file):
    nodes, context = launch(launch_file, without="[grasp_controller]")
    node, died = nodes["model_check"], SimpleNamespace(returncode=1)
    for _ in range(MOST_RESPAWNS):
        report, timer = node.fields["on_exit"](died, context)
        assert "started again in 2 s" in report.fields["msg"]
        assert timer.fields["period"] == RESPAWN_DELAY
        (again,) = timer.fields["actions"]
        assert again.fields["parameters"] == node.fields["parameters"]
        node = again
    (report,) = node.fields["on_exit"](died, context)
    assert "model_check ended with 1" in report.fields["msg"]
    assert "not started again" in report.fields["msg"]


def test_launch_that_ends_starts_nothing_again(launch_file):
    nodes, context = launch(launch_file)
    context.is_shutdown = True
    assert nodes["model_check"].fields["on_exit"](SimpleNamespace(returncode=0), context) is None
