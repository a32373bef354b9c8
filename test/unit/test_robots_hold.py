"""Other robots than the right Allegro hold an object in the simulator and estimate it."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest

import benchmarks.robots
from benchmarks.bullet_recordings import record_in_bullet
from benchmarks.inertia.in_hand import record_in_hand
from tactile_dynamics_ros.cli.bringup import read_configuration
from tactile_dynamics_ros.core.inertia.estimate import estimate
from tactile_dynamics_ros.core.manipulation.excitation import ExcitationConfig
from tactile_dynamics_ros.core.manipulation.grasp_controller import GraspConfig
from tactile_dynamics_ros.core.manipulation.grasp_planner import GraspGeometry
from tactile_dynamics_ros.core.manipulation.squeeze import SqueezeConfig

SHORT = ExcitationConfig(duration=6.0)


@pytest.mark.slow
def test_a_left_hand_holds_and_estimates():
    """Contacts with noise straight from the engine; the fingertips' electrodes are the same."""
    behaviour = GraspConfig(excitation=SHORT)
    made = record_in_bullet(
        object_name="box_2", robot_name="allegro_iiwa_left", behaviour=behaviour, seed=1
    )
    assert made.phase == "done"
    found = estimate(made.streams).to_estimate().inertia
    assert found.mass == pytest.approx(made.truth["mass"], rel=0.05)
    assert np.linalg.norm(found.com - made.truth["com"]) < 5e-3


@pytest.mark.slow
def test_two_pads_with_torque_hold_and_estimate():
    """Taken beside its centre of mass: without torque, the centre would be between the pads."""
    config = read_configuration(Path("config/panda_gripper.yaml"))["grasp_controller"]
    behaviour = GraspConfig(
        excitation=SHORT,
        geometry=GraspGeometry(opening=config["geometry.opening"]),
        squeeze=SqueezeConfig(least=config["squeeze.least"]),
    )
    streams, truth, outcome = record_in_hand(
        benchmarks.robots.BAR, 1, behaviour, robot_name="panda_gripper"
    )
    assert outcome == "done"
    assert set(streams.contacts) == {"pad_left", "pad_right"}
    found = estimate(streams).to_estimate().inertia
    assert found.mass == pytest.approx(truth.mass, rel=0.05)
    assert np.linalg.norm(found.com - truth.com) < 5e-3
    points = {
        name: dataclasses.replace(contact, torque=0.0 * contact.torque, carries_torque=False)
        for name, contact in streams.contacts.items()
    }
    blind = estimate(dataclasses.replace(streams, contacts=points)).to_estimate().inertia
    assert np.linalg.norm(blind.com - truth.com) > 5e-3
