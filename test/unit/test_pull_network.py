"""The graph network of pulls says the gripper's torque too, from simulator to filter."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tactile_dynamics_ros.cli.main import main
from tactile_dynamics_ros.cli.train_pushing import SETTINGS, simulate_steps
from tactile_dynamics_ros.core.planar.filter.dual import DualFilter
from tactile_dynamics_ros.core.planar.filter.observation import (
    MeasuredWrench,
    Observation,
    SeenPose,
)
from tactile_dynamics_ros.core.planar.filter.patch import PatchProcess
from tactile_dynamics_ros.core.planar.filter.process import PusherMotion
from tactile_dynamics_ros.core.planar.mechanics.linkage import turned
from tactile_dynamics_ros.core.planar.mechanics.support import SupportPatch
from tactile_dynamics_ros.core.planar.network.graph import Thing, grip_axis
from tactile_dynamics_ros.core.planar.network.mechanics import expected_steps
from tactile_dynamics_ros.core.planar.network.models import pushing_model
from tactile_dynamics_ros.core.planar.network.process import GraphProcess, help_units, step_on
from tactile_dynamics_ros.core.planar.network.training import GraphTrainingConfig, train_graph
from tactile_dynamics_ros.core.planar.network.transitions import (
    Transitions,
    joined,
    make_examples,
)
from tactile_dynamics_ros.core.planar.network.weights import (
    KINDS,
    GraphWeights,
    shipped_file,
    shipped_graph,
)

SETTING = SETTINGS["slow"]
STEP, SPEED = SETTING.period, SETTING.speed
SIZE = 0.05
OUTLINE = SIZE * np.array([[-1.0, -0.8], [1.0, -0.8], [1.0, 0.8], [-1.0, 0.8]])
THING = Thing((SupportPatch(OUTLINE, 25),), np.array([0.02]))
POSE_STD = np.array([5e-4, 5e-4, 3e-3])


def parameters_of(product: float, count: int, com: tuple[float, float] = (0.0, 0.0)) -> np.ndarray:
    return np.tile([np.log(product), np.log(0.7), *com, np.log(0.35)], (count, 1))


@pytest.fixture(scope="module")
def pulled() -> list[Transitions]:
    return simulate_steps("single", range(6), SETTING, "pull")


@pytest.fixture(scope="module")
def trained(pulled) -> GraphWeights:
    parts = [make_examples(steps, SPEED, help_units(SPEED, 3), None) for steps in pulled]
    about = GraphWeights("graph", STEP, SPEED, *help_units(SPEED, 3), {}, "test")
    config = GraphTrainingConfig(width=16, epochs=60, batch=64, learning_rate=6e-3)
    return train_graph(about, [joined(parts)], [joined(parts)], config)


def test_simulated_pulls_are_what_the_mechanics_expect_torque_included(pulled):
    for steps in pulled:
        after, wrench = expected_steps(steps)
        size = np.median(np.linalg.norm(steps.force[:, :2], axis=1))
        off = np.median(np.abs(wrench - steps.force), axis=0)
        assert off[:2].max() < 0.2 * size
        assert off[2] < 0.2 * size * SIZE
        assert np.median(np.abs(after - steps.after)[:, :2]) < 5e-5
    turning = np.concatenate([steps.push.turning for steps in pulled])
    torque = np.concatenate([steps.force[:, 2] for steps in pulled])
    assert np.abs(turning).max() > 0.1
    assert np.abs(torque).max() > 0.02


def test_a_small_training_tells_force_and_torque_of_pulls(pulled, trained):
    assert trained.forces == 3
    said = [step_on(trained, s.thing, s.states, s.parameters, s.push)[1] for s in pulled]
    off, true = np.concatenate(said), np.concatenate([s.force for s in pulled])
    error = np.sqrt(np.mean((off - true) ** 2, axis=0))
    assert np.all(error < 0.5 * np.std(true, axis=0))


def test_pulls_look_alike_from_every_side_of_the_table(pulled, trained):
    steps = pulled[0]
    angle = np.full(len(steps), 0.7)

    def moved(state: np.ndarray) -> np.ndarray:
        place = turned(state[:, :2], angle) + np.array([0.3, -0.2])
        return np.column_stack(
            [place, state[:, 2] + angle, turned(state[:, 3:5], angle), state[:, 5]]
        )

    push = steps.push
    there = replace(
        push,
        point=turned(push.point, angle) + np.array([0.3, -0.2]),
        velocity=turned(push.velocity, angle),
        normal=turned(push.normal, angle),
    )
    known = steps.parameters
    after, wrench, _ = step_on(trained, steps.thing, steps.states, known, push)
    after_there, wrench_there, _ = step_on(trained, steps.thing, moved(steps.states), known, there)
    np.testing.assert_allclose(after_there, moved(after), atol=1e-9)
    np.testing.assert_allclose(wrench_there[:, :2], turned(wrench[:, :2], angle), atol=1e-9)
    np.testing.assert_allclose(wrench_there[:, 2], wrench[:, 2], atol=1e-9)


def test_a_gripper_that_stands_has_the_direction_of_its_yaw():
    velocity, yaw = np.array([[0.0, 0.02], [0.0, 1e-6]]), np.array([0.0, np.pi])
    np.testing.assert_allclose(grip_axis(velocity, yaw), [[0.0, 1.0], [-1.0, 0.0]], atol=1e-12)


def silent(weights: GraphWeights) -> GraphWeights:
    return replace(weights, motion_scale=np.zeros(6), force_scale=np.zeros(weights.forces))


def grip(step: int = 1, turning: float = 0.2, lift: float = 0.0) -> PusherMotion:
    way = np.array([SPEED, 0.3 * SPEED, turning]) * STEP
    return PusherMotion(step * way, (step + 1) * way, STEP, 0.02, True, True, lift=lift)


def test_a_residual_network_of_pulls_that_says_nothing_leaves_the_mechanics():
    push, pull = (silent(shipped_graph("graph_residual", action=a)) for a in ("push", "pull"))
    process = GraphProcess.of(THING, push, pull)
    states = np.tile([0.0, 0.0, 0.1, 0.02, 0.0, 0.1], (3, 1))
    known = parameters_of(0.2, 3, (0.01, -0.005))
    mine, its = (p.predict(states, known, grip()) for p in (process, process.base))
    np.testing.assert_allclose(mine.states, its.states, atol=1e-12)
    np.testing.assert_allclose(mine.wrench, its.wrench, atol=1e-9)


def test_a_lift_takes_friction_off_the_support_as_in_the_mechanics():
    process = GraphProcess.of(THING, shipped_graph("graph"), shipped_graph("graph", action="pull"))
    states, weight = np.zeros((1, 6)), 0.7 * 9.81
    lifted = process.predict(states, parameters_of(0.2, 1), grip(lift=0.5 * weight))
    light = process.predict(states, parameters_of(0.1, 1), grip())
    np.testing.assert_allclose(lifted.wrench, light.wrench, atol=1e-4)


@pytest.mark.parametrize("kind", KINDS)
def test_a_filter_learns_product_and_centre_from_a_pull_by_the_shipped_network(kind):
    assert f"train pushing --kind {kind} --action pull" in shipped_graph(kind, action="pull").origin
    assert shipped_file(kind, action="pull").stat().st_size < 2e6
    process = pushing_model(kind).create(OUTLINE)
    assert isinstance(process, GraphProcess)
    assert process.pull is not None
    true, mechanics = parameters_of(0.3, 1, (0.012, 0.0)), PatchProcess(OUTLINE)
    belief = DualFilter(process, np.zeros(3), POSE_STD)
    prior = belief.parameters[1]
    state = np.zeros((1, 6))
    for k in range(40):
        motion = grip(k, turning=0.3 if k % 20 < 10 else -0.3)
        now = mechanics.predict(state, true, motion)
        state = now.states
        forces = MeasuredWrench(now.wrench[0], np.array([0.05, 0.05, 0.002]))
        pose = SeenPose(state[0, :3], POSE_STD)
        belief.step(motion, Observation((pose,), forces if k > 1 else None))
    mean, covariance = belief.parameters
    assert covariance[0, 0] < 0.05 * prior[0, 0]
    assert abs(mean[0] - true[0, 0]) < 0.15
    assert abs(mean[2] - 0.012) < 0.006


def test_pulls_are_learnt_by_a_command_of_their_own_and_not_in_rounds(tmp_path, capsys):
    out = tmp_path / "network.npz"
    arguments = ["train", "pushing", "--action", "pull", "--out", str(out)]
    one_part = ["--kind", "graph_residual", "--objects", "2", "--epochs", "1"]
    assert main([*arguments, *one_part]) == 0
    assert GraphWeights.load(out).forces == 3
    assert main([*arguments, "--choice", "active"]) != 0
    assert "--action push" in capsys.readouterr().err
