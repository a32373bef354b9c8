"""The yaml files that come with the package: every key is a field of some configuration."""

from pathlib import Path

import pytest
import yaml

import tactile_dynamics_ros
from tactile_dynamics_ros.cli.bringup import node_names, nodes_of, read_configuration
from tactile_dynamics_ros.sim.objects import list_objects, load_object

CONFIG = Path(tactile_dynamics_ros.__file__).parents[1] / "config"
TABLE_OBJECTS = "planar_objects"
ROBOTS = sorted(path for path in CONFIG.glob("*.yaml") if path.stem != TABLE_OBJECTS)


def test_there_are_robots_and_objects():
    assert ROBOTS
    assert {f"box_{k}" for k in range(5)} <= set(list_objects())
    assert len(list_objects()) >= 13


@pytest.mark.parametrize("path", ROBOTS, ids=lambda path: path.stem)
def test_robot_files_list_nodes_that_exist(path):
    assert set(nodes_of(path)) <= set(node_names())
    for entry in yaml.safe_load(path.read_text()).values():
        assert set(entry) == {"ros__parameters"}


def test_a_robot_loads_nothing_of_the_simulated_hand():
    robot = CONFIG / "allegro_iiwa.yaml"
    real, simulated = (read_configuration(robot, simulate) for simulate in (False, True))
    assert "robot_sim" in simulated
    assert "robot_sim" not in real
    assert {"drift", "gains"} <= set(simulated["biotac_force"])
    assert not {"drift", "gains", "tare_file"} & set(real["biotac_force"])
    assert not any("object" in parameters for parameters in real.values())
    assert not any(parameters["use_sim_time"] for parameters in real.values())


@pytest.mark.parametrize("name", list_objects())
def test_object_files_load(name):
    assert load_object(name).name == name
