"""Every node comes up with the shipped configuration and refuses parameters that nobody reads."""

import importlib
import re
from pathlib import Path

import pytest
import rclpy

import tactile_dynamics_ros
from tactile_dynamics_ros.cli.bringup import configuration_files, nodes_of, read_configuration
from tactile_dynamics_ros.cli.live import node_names
from tactile_dynamics_ros.ros import shell
from tactile_dynamics_ros.ros.parameters import refuse_unknown
from tactile_dynamics_ros.ros.startup import introduce

CONFIG = Path(tactile_dynamics_ros.__file__).parents[1] / "config"
SUFFIX = ".simulated.yaml"
ROBOTS = [CONFIG / file.name.replace(SUFFIX, ".yaml") for file in sorted(CONFIG.glob(f"*{SUFFIX}"))]


def node_class(name):
    """Return the class that a node's main function runs."""
    module = importlib.import_module(f"tactile_dynamics_ros.nodes.{name}")
    classes = [v for v in vars(module).values() if isinstance(v, type)]
    own = [v for v in classes if issubclass(v, shell.Shell) and v.__module__ == module.__name__]
    assert len(own) == 1, f"{name}: one node class expected"
    return own[0]


@pytest.fixture
def start(monkeypatch):
    """Return a function that creates a node with command-line arguments."""
    nodes = []

    def create(name, *arguments):
        rclpy.init(args=["--ros-args", *arguments])
        nodes.append(node_class(name)())
        refuse_unknown(nodes[-1])
        return nodes[-1]

    yield create
    for node in nodes:
        node.destroy_node()
    rclpy.try_shutdown()


@pytest.mark.parametrize(
    ("config", "name"),
    [(config, name) for config in ROBOTS for name in nodes_of(config)],
    ids=lambda value: getattr(value, "stem", value),
)
def test_node_starts_with_shipped_configuration_and_describes_parameters(start, config, name):
    files = configuration_files(config, simulate=True)
    node = start(name, *(word for file in files for word in ("--params-file", str(file))))
    assert node.get_name() == name
    said = introduce(node)
    assert re.fullmatch(r"started; (listens to|publishes|offers) [^\n]+", said)
    assert "parameters" not in said
    for key, value in read_configuration(config)[name].items():
        found = node.get_parameter(key).value
        assert (list(found) if isinstance(value, list) else found) == value
    names = [n for n in node.get_parameters_by_prefix("") if not n.startswith("qos_overrides")]
    own = set(names) - {"use_sim_time", "start_type_description_service"}
    assert all(node.describe_parameter(n).description for n in own)


def typed_parameters():
    """Return the parameters of each node that pages tell people to type."""
    pages = [CONFIG.parent / "README.md", *sorted((CONFIG.parent / "docs").rglob("*.md"))]
    found = {}
    for page in pages:
        text = page.read_text().replace("\\\n", " ")
        for name, words in re.findall(r"^ros2 run tactile_dynamics_ros (\w+) (.*)$", text, re.M):
            found.setdefault(name, set()).update(re.findall(r"-p ([\w.]+):=", words))
    return sorted(found.items())


@pytest.mark.parametrize(("name", "parameters"), typed_parameters())
def test_a_node_has_the_parameters_that_pages_say(start, name, parameters):
    node = start(name)
    assert {p for p in parameters if not node.has_parameter(p)} == set()


@pytest.mark.parametrize("name", node_names())
def test_node_refuses_a_parameter_that_nobody_reads(start, name):
    from tactile_dynamics_ros.core.errors import BadInputError

    with pytest.raises(BadInputError, match="unknown parameter mistyped"):
        start(name, "-p", "mistyped:=1")
