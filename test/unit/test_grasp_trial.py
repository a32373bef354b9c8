"""A whole grasp in the simulator, and Newton's and Euler's laws for what the fingers do."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from benchmarks.grasp_trial import GraspTrial, draw_trials, run_trial
from tactile_dynamics_ros.core.manipulation.excitation import ExcitationConfig
from tactile_dynamics_ros.core.manipulation.grasp_controller import (
    GraspConfig,
    GraspController,
    Phase,
)
from tactile_dynamics_ros.core.rigid_body.newton_euler import regressor
from tactile_dynamics_ros.core.robot.hand_kinematics import HandKinematics
from tactile_dynamics_ros.core.robot.robot_file import load_robot
from tactile_dynamics_ros.sim.world import HandWorld, WorldConfig

ROBOT = load_robot()

QUICK = GraspConfig(
    excitation=ExcitationConfig(duration=3.0, ramp=0.5),
    descend_speed=0.2,
    lift_speed=0.15,
    carry_speed=0.4,
    close_time=1.2,
    settle=0.4,
    hover=0.06,
)


@pytest.fixture(scope="module")
def held():
    """Samples at 1 kHz of a box that the hand swings: motion, contacts, world."""
    with HandWorld(WorldConfig(object_name="box_1", object_yaw=0.3)) as world:
        world.reset(ROBOT.start)
        controller = GraspController(HandKinematics(), world.model.grasp, QUICK)
        rows, forces = [], {}
        while controller.phase is not Phase.RETURN and len(rows) < 1500 and world.time < 60.0:
            state = world.joint_state()
            pose = world.object_pose()
            world.command(controller.update(world.time, state.position, forces, pose))
            if controller.phase is Phase.EXCITE:
                rows += [step_and_measure(world) for _ in range(10)]
                forces = rows[-1]["forces"]
            else:
                world.step(10)
                forces = finger_forces(world)
        assert controller.phase is Phase.EXCITE, controller.outcome
        keys = [key for key in rows[0] if key != "forces"]
        yield {key: np.array([row[key] for row in rows]) for key in keys}, world.model


def finger_forces(world: HandWorld) -> dict[str, np.ndarray]:
    readings = world.contacts()
    return {name: readings[name].force for name in world.fingers if readings[name].in_contact}


def step_and_measure(world: HandWorld) -> dict[str, Any]:
    """One step: the accelerations it made, and the wrench of all contacts about the body origin."""
    pose = world.object_pose()
    spin, velocity = world.object_velocity()
    world.step()
    spin_after, velocity_after = world.object_velocity()
    after = world.object_pose()
    readings = [reading for reading in world.contacts().values() if reading.in_contact]
    dt = world.config.time_step
    rotation = pose[:3, :3]
    force = sum(reading.force for reading in readings)
    moment = sum(
        np.cross(reading.point - pose[:3, 3], reading.force) + reading.torque
        for reading in readings
    )
    # the integrator moves the centre of mass: go back from the body origin without the turning
    com = rotation @ world.model.inertia.com
    com_after = after[:3, :3] @ world.model.inertia.com
    centre = velocity + np.cross(spin, com)
    centre_after = velocity_after + np.cross(spin_after, com_after)
    angular = (spin_after - spin) / dt
    acceleration = (centre_after - centre) / dt
    origin = acceleration - np.cross(angular, com) - np.cross(spin, np.cross(spin, com))
    return {
        "specific": rotation.T @ (origin - world.gravity),
        "spin": rotation.T @ spin,
        "angular": rotation.T @ angular,
        "wrench": np.concatenate([rotation.T @ moment, rotation.T @ force]),
        "forces": {r.name: r.force for r in readings if r.name in world.fingers},
        "fingers": sum(reading.name in world.fingers for reading in readings),
    }


def test_contact_forces_balance_inertia_and_weight(held):
    rows, model = held
    expected = regressor(rows["specific"], rows["spin"], rows["angular"])
    expected = expected @ model.inertia.dynamic_parameters
    for part in (slice(0, 3), slice(3, 6)):
        error = np.linalg.norm(rows["wrench"][:, part] - expected[:, part], axis=1)
        size = np.sqrt(np.mean(np.sum(expected[:, part] ** 2, axis=1)))
        assert error.max() < 1e-3 * size


def test_four_fingers_hold_the_box_all_the_time(held):
    rows, model = held
    assert (rows["fingers"] == 4).mean() > 0.99
    weight = np.linalg.norm(rows["wrench"][:, 3:], axis=1).mean()
    assert weight == pytest.approx(9.81 * model.inertia.mass, rel=0.1)


def test_a_grasp_with_noisy_pose_and_touch_succeeds():
    result = run_trial(draw_trials(["gelatin_box"], 1, seed=5, behaviour=QUICK)[0])
    assert result.success, result
    assert result.fingers >= 3
    assert result.slip_mm < 10.0


def test_a_grasp_beside_the_object_is_reported_as_failed():
    trial = GraspTrial(WorldConfig(object_name="duplo_brick"), QUICK, position_std=0.15, seed=4)
    result = run_trial(trial)
    assert not result.success
    assert result.outcome
