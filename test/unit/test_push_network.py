"""The graph network that predicts pushes: same in numpy and torch, resumable, usable, honest."""

from __future__ import annotations

import json
from dataclasses import replace
from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest
import torch

from tactile_dynamics_ros.cli import train_pushing_rounds
from tactile_dynamics_ros.cli.main import main
from tactile_dynamics_ros.core.errors import BadInputError
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
from tactile_dynamics_ros.core.planar.network.graph import EDGE, Graph, Push, Thing
from tactile_dynamics_ros.core.planar.network.mechanics import expected_steps
from tactile_dynamics_ros.core.planar.network.process import (
    GraphProcess,
    advanced,
    help_units,
    step_on,
)
from tactile_dynamics_ros.core.planar.network.training import (
    GraphNetwork,
    GraphTrainingConfig,
    train_graph,
)
from tactile_dynamics_ros.core.planar.network.transitions import (
    Transitions,
    joined,
    make_examples,
    outcome,
)
from tactile_dynamics_ros.core.planar.network.weights import (
    KINDS,
    NETS,
    GraphWeights,
    net_sizes,
    node_features,
    propagate,
    shipped_file,
    shipped_graph,
)

STEP, SPEED = 1.0 / 15.0, 0.025


def box(half: tuple[float, float]) -> Thing:
    x, y = half
    outline = np.array([[-x, -y], [x, -y], [x, y], [-x, y]])
    return Thing((SupportPatch(outline, 25),), np.array([0.02]))


def pair() -> Thing:
    first, second = box((0.05, 0.04)), box((0.06, 0.03))
    return Thing(first.patches + second.patches, np.full(2, 0.02), np.array([0.05, 0.0]))


def drawn_parameters(rng: np.random.Generator, count: int) -> np.ndarray:
    mass, friction = rng.uniform(0.35, 1.6, count), rng.uniform(0.15, 0.5, count)
    com = rng.uniform(-0.012, 0.012, (count, 2))
    return np.column_stack([np.log(mass * friction), np.log(mass), com, np.full(count, -1.0)])


def pushed_by_mechanics(seed: int, count: int) -> Transitions:
    """Steps of one box that slides, from the mechanics: no simulator, no time."""
    rng = np.random.default_rng(seed)
    thing = box((rng.uniform(0.04, 0.07), rng.uniform(0.03, 0.05)))
    parameters = np.tile(drawn_parameters(rng, 1), (count, 1))
    low = thing.patches[0].outline[:, 0].min()
    point = np.column_stack([np.full(count, low), rng.uniform(-0.02, 0.02, count)])
    velocity = np.column_stack([rng.uniform(0.015, 0.03, count), rng.uniform(-0.002, 0.002, count)])
    ones = np.ones(count)
    normal = np.tile([1.0, 0.0], (count, 1))
    push = Push(point, velocity, normal, ones, 0.02 * ones, STEP)
    start = Transitions(thing, parameters, np.zeros((count, 6)), np.zeros((count, 6)), push, point)
    moving, _ = expected_steps(start)
    states = np.pad(moving[:, 3:], ((0, 0), (3, 0)))
    steps = replace(start, states=states)
    after, force = expected_steps(steps)
    return replace(steps, after=after, force=force)


def random_weights(kind: str, seed: int = 0) -> GraphWeights:
    rng = np.random.default_rng(seed)
    nets = {
        name: tuple(
            (rng.normal(size=(a, b)) / np.sqrt(a), 0.1 * rng.normal(size=b))
            for a, b in pairwise(sizes)
        )
        for name, sizes in net_sizes(kind, 16).items()
    }
    return GraphWeights(kind, STEP, SPEED, np.full(6, 0.01), np.ones(2), nets, "test")


def about(kind: str = "graph") -> GraphWeights:
    return GraphWeights(kind, STEP, SPEED, *help_units(SPEED), {}, "test")


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("links", [1, 2, 3])
def test_numpy_and_torch_agree(kind, links):
    weights, rng = random_weights(kind), np.random.default_rng(links)
    nodes = rng.normal(size=(7, 2 + links, node_features(kind)))
    edges = rng.normal(size=(7, 2 * links, EDGE))
    network = GraphNetwork(about(kind), 16).double()
    for name in NETS:
        linear = [layer for layer in network.nets[name] if isinstance(layer, torch.nn.Linear)]
        for layer, (matrix, bias) in zip(linear, weights.nets[name], strict=True):
            layer.weight.data, layer.bias.data = torch.tensor(matrix.T), torch.tensor(bias)
    with torch.no_grad():
        other = network(torch.tensor(nodes), torch.tensor(edges))
    for mine, its in zip(propagate(weights.nets, Graph(nodes, edges)), other, strict=True):
        np.testing.assert_allclose(mine, its.numpy(), rtol=0.0, atol=1e-6)


def test_cause_reaches_the_last_link_and_its_effect_the_robot():
    weights, rng = random_weights("graph"), np.random.default_rng(3)
    nodes, edges = rng.normal(size=(1, 4, 16)), rng.normal(size=(1, 4, EDGE))
    process, touch = propagate(weights.nets, Graph(nodes, edges))
    robot = nodes.copy()
    robot[:, 0] += 0.1
    assert np.abs(propagate(weights.nets, Graph(robot, edges))[0] - process)[0, 1].max() > 1e-6
    support = edges.copy()
    support[:, 3, 4] += 0.1
    assert np.abs(propagate(weights.nets, Graph(nodes, support))[1] - touch).max() > 1e-6


@pytest.mark.parametrize("link", [0, 1])
def test_a_table_seen_from_another_side_changes_nothing(link):
    thing, weights, rng = pair(), random_weights("graph"), np.random.default_rng(5)
    count, angle, shift = 6, 0.7, np.array([0.3, -0.2])
    states = rng.normal(size=(count, 12)) * 0.05
    parameters = np.column_stack(
        [drawn_parameters(rng, count)[:, :4], drawn_parameters(rng, count), np.full(count, -3.0)]
    )
    heading = rng.normal(size=count)
    normal = np.stack([np.cos(heading), np.sin(heading)], axis=1)
    push = Push(
        rng.normal(size=(count, 2)) * 0.05, rng.normal(size=(count, 2)) * 0.02, normal,
        np.ones(count), np.full(count, 0.02), STEP, link,
    )  # fmt: skip
    turn = np.full(count, angle)

    def moved(values):
        parts = values.reshape(count, 2, 6).copy()
        for k in range(2):
            parts[:, k, :2] = turned(parts[:, k, :2], turn) + shift
            parts[:, k, 2] += angle
            parts[:, k, 3:5] = turned(parts[:, k, 3:5], turn)
        return parts.reshape(count, 12)

    there = replace(
        push, point=turned(push.point, turn) + shift, velocity=turned(push.velocity, turn),
        normal=turned(normal, turn),
    )  # fmt: skip
    after, force, _ = step_on(weights, thing, states, parameters, push)
    after_there, force_there, _ = step_on(weights, thing, moved(states), parameters, there)
    np.testing.assert_allclose(after_there, moved(after), atol=1e-12)
    np.testing.assert_allclose(force_there, turned(force, turn), atol=1e-12)
    assert np.abs(force).max() > 0.01


def test_what_is_learnt_of_a_step_leads_back_to_its_end():
    steps = pushed_by_mechanics(1, 5)
    back = advanced(
        steps.thing, steps.states, steps.parameters, steps.push, outcome(steps, steps.after)
    )
    np.testing.assert_allclose(back, steps.after, atol=1e-12)


def test_mechanics_of_many_steps_are_those_of_the_process():
    steps = pushed_by_mechanics(2, 4)
    base = PatchProcess(steps.thing.patches[0].outline, 0.02)
    for k in range(len(steps)):
        before = np.append(steps.push.point[k], 0.0)
        after = before + STEP * np.append(steps.push.velocity[k], 0.0)
        motion = PusherMotion(before, after, STEP, 0.02, touching=True, normal=steps.push.normal[k])
        found = base.predict(steps.states[k : k + 1], steps.parameters[k : k + 1], motion)
        np.testing.assert_allclose(found.states[0], steps.after[k], atol=1e-12)
        np.testing.assert_allclose(found.wrench[0, :2], steps.force[k], atol=1e-9)


def untrained_residual() -> GraphWeights:
    weights = random_weights("graph_residual")
    return replace(weights, motion_scale=np.zeros(6), force_scale=np.zeros(2))


def test_a_residual_network_that_says_nothing_leaves_the_mechanics():
    steps = pushed_by_mechanics(3, 1)
    process = GraphProcess.of(steps.thing, untrained_residual())
    before = np.append(steps.push.point[0], 0.0)
    after = before + STEP * np.append(steps.push.velocity[0], 0.0)
    motion = PusherMotion(before, after, STEP, 0.02, touching=True, normal=np.array([1.0, 0.0]))
    found = process.predict(steps.states, steps.parameters, motion)
    np.testing.assert_allclose(found.states, steps.after, atol=1e-12)
    np.testing.assert_allclose(found.wrench[:, :2], steps.force, atol=1e-9)


def test_a_small_training_beats_the_prior_mean():
    objects = [pushed_by_mechanics(seed, 15) for seed in range(72)]
    parts = [make_examples(steps, SPEED, help_units(SPEED), None) for steps in objects]
    config = GraphTrainingConfig(width=32, epochs=40, batch=128, learning_rate=6e-3)
    weights = train_graph(about(), [joined(parts[:64])], [joined(parts[64:])], config)
    draws = drawn_parameters(np.random.default_rng(1), 200)
    told = [product_by(weights, steps, draws) - steps.parameters[0, 0] for steps in objects[64:]]
    prior = [draws[:, 0].mean() - steps.parameters[0, 0] for steps in objects[64:]]
    assert np.sqrt(np.mean(np.square(told))) < 0.4 * np.sqrt(np.mean(np.square(prior)))


def product_by(weights: GraphWeights, steps: Transitions, draws: np.ndarray) -> float:
    """Expected ln product given the forces, over equally likely objects."""
    count = len(steps)
    every = np.tile(np.arange(count), len(draws))
    push = replace(
        steps.push,
        **{
            name: getattr(steps.push, name)[every]
            for name in ("point", "velocity", "normal", "touching", "height")
        },
    )
    guess = np.repeat(draws, count, axis=0)
    _, force, said = step_on(weights, steps.thing, steps.states[every], guess, push)
    off = (force - steps.force[every]) / (0.05 + 3.0 * said.force_std)
    likelihood = -0.5 * np.sum((off**2).reshape(len(draws), -1), axis=1)
    chance = np.exp(likelihood - likelihood.max())
    return float(chance @ draws[:, 0] / chance.sum())


def test_an_interrupted_training_goes_on_as_if_it_had_not_been(tmp_path):
    part = make_examples(pushed_by_mechanics(4, 30), SPEED, help_units(SPEED), None)
    config = GraphTrainingConfig(width=8, epochs=4, batch=8)
    whole = train_graph(about(), [part], [part], config)

    def stop(epoch: int, _: float, __: float) -> None:
        if epoch == 3:
            raise KeyboardInterrupt

    kept = str(tmp_path / "training.pt")
    with pytest.raises(KeyboardInterrupt):
        train_graph(about(), [part], [part], config, stop, kept)
    seen: list[int] = []
    again = train_graph(about(), [part], [part], config, lambda k, *_: seen.append(k), kept)
    assert seen == [3, 4]
    for name in NETS:
        for mine, its in zip(whole.nets[name], again.nets[name], strict=True):
            np.testing.assert_array_equal(mine[0], its[0])


@pytest.mark.parametrize("kind", KINDS)
def test_a_filter_learns_from_the_shipped_network(kind):
    weights = shipped_graph(kind)
    assert f"train pushing --kind {kind}" in weights.origin
    assert shipped_file(kind).stat().st_size < 2e6
    thing = box((0.05, 0.04))
    process = GraphProcess.of(thing, weights)
    belief = DualFilter(process, np.zeros(3), np.array([5e-4, 5e-4, 3e-3]))
    before = belief.parameters[1][0, 0]
    speed = np.array([SPEED * STEP, 0.0, 0.0])
    for k in range(20):
        at = np.array([-0.05, 0.0, 0.0]) + k * speed
        motion = PusherMotion(at, at + speed, STEP, touching=True, normal=np.array([1.0, 0.0]))
        pose = SeenPose((k + 1) * speed, np.array([5e-4, 5e-4, 3e-3]))
        measured = MeasuredWrench(np.array([3.0, 0.0]), np.full(2, 0.1))
        belief.step(motion, Observation((pose,), measured if k > 1 else None))
    mean, covariance = belief.parameters
    assert covariance[0, 0] < 0.05 * before
    assert abs(np.exp(mean[0]) * 9.81 - 3.0) < 0.6


@pytest.mark.parametrize("motion", [{"grip": True}, {"touching": False}])
def test_what_a_network_never_saw_the_mechanics_predict(motion):
    process = GraphProcess.of(box((0.05, 0.04)), random_weights("graph"))
    states = np.tile([0.0, 0.0, 0.1, 0.02, 0.0, 0.1], (3, 1))
    parameters = drawn_parameters(np.random.default_rng(6), 3)
    way = np.array([-0.05, 0.0, 0.0]), np.array([-0.05 + SPEED * STEP, 0.0, 0.0])
    step = PusherMotion(*way, STEP, **motion)
    mine, its = (p.predict(states, parameters, step) for p in (process, process.base))
    np.testing.assert_array_equal(mine.states, its.states)
    np.testing.assert_array_equal(mine.wrench, its.wrench)


def test_a_network_states_by_how_much_its_states_are_off_link_by_link():
    process, rng = GraphProcess.of(pair(), random_weights("graph")), np.random.default_rng(11)
    parameters = np.column_stack([drawn_parameters(rng, 5)[:, :4], drawn_parameters(rng, 5)])
    parameters = np.column_stack([parameters, np.full(5, -3.0)])
    at = np.array([-0.05, 0.0, 0.0])
    motion = PusherMotion(
        at, at + SPEED * STEP, STEP, touching=True, normal=np.array([1.0, 0.0]), link=1
    )
    found = process.predict(np.zeros((5, 12)), parameters, motion)
    push = process.push_of(np.zeros((5, 12)), motion)
    said = step_on(process.weights, process.thing, np.zeros((5, 12)), parameters, push)[2]
    touched = np.median(said.motion_std[:, 0], axis=0)
    assert np.all(found.state_std > 0.0)
    np.testing.assert_allclose(
        found.state_std[8] / found.state_std[11], STEP * touched[2] / touched[5]
    )


def test_a_network_states_its_force_noise_once_per_way_over_which_it_lasts():
    process = GraphProcess.of(box((0.05, 0.04)), random_weights("graph"))
    parameters = drawn_parameters(np.random.default_rng(7), 1)

    def stated(step: float) -> float:
        at = np.array([-0.05, 0.0, 0.0])
        ahead = at + np.array([SPEED * step, 0.0, 0.0])
        normal = np.array([1.0, 0.0])
        motion = PusherMotion(at, ahead, step, touching=True, normal=normal)
        return process.predict(np.zeros((1, 6)), parameters, motion).force_std

    assert stated(STEP) > 0.0
    np.testing.assert_allclose(stated(STEP / 4.0), 2.0 * stated(STEP))


@pytest.mark.parametrize(("count", "lasting"), [(1, 1.0), (2, 6.0)])
def test_errors_of_a_network_last_longer_for_two_parts(count, lasting):
    thing = box((0.05, 0.04)) if count == 1 else pair()
    process = GraphProcess.of(thing, random_weights("graph"))
    at = np.array([-0.05, 0.0, 0.0])
    way = np.array([SPEED * STEP, 0.0, 0.0])
    motion = PusherMotion(at, at + way, STEP, touching=True, normal=np.array([1.0, 0.0]))
    known = process.prior[0][None]
    assert process.predict(np.zeros((1, 6 * count)), known, motion).lasting == lasting
    away = replace(motion, touching=False)  # by the mechanics
    assert process.predict(np.zeros((1, 6 * count)), known, away).lasting == 1.0


def test_the_height_of_the_push_stands_for_an_unknown_centre():
    rng, known = np.random.default_rng(8), pushed_by_mechanics(5, 4)
    unknown = replace(known, thing=Thing(known.thing.patches))
    assert known.push.height[0] == known.thing.com_height[0]
    for mine, its in zip(expected_steps(known), expected_steps(unknown), strict=True):
        np.testing.assert_array_equal(mine, its)
    weights, parameters = random_weights("graph"), drawn_parameters(rng, 4)
    mine, its = (
        step_on(weights, steps.thing, steps.states, parameters, steps.push)[0]
        for steps in (known, unknown)
    )
    np.testing.assert_array_equal(mine, its)


def test_a_residual_network_of_linked_parts_is_refused():
    with pytest.raises(BadInputError, match="one link only"):
        GraphProcess.of(pair(), random_weights("graph_residual"))


def test_a_file_of_another_version_is_named(tmp_path):
    path = tmp_path / "network.npz"
    with pytest.raises(BadInputError, match=r"network\.npz"):
        GraphWeights.load(path)
    replace(random_weights("graph"), kind="graph_residual").save(path)
    with pytest.raises(BadInputError, match="train again"):
        GraphWeights.load(path)


def test_weights_come_back_from_their_file(tmp_path):
    weights = random_weights("graph")
    weights.save(tmp_path / "network.npz")
    again = GraphWeights.load(tmp_path / "network.npz")
    assert (again.kind, again.step, again.speed, again.origin) == ("graph", STEP, SPEED, "test")
    for name in NETS:
        for mine, its in zip(weights.nets[name], again.nets[name], strict=True):
            np.testing.assert_allclose(mine[0], its[0], rtol=1e-6)


def test_the_command_simulates_trains_and_writes(tmp_path, capsys):
    out, kept = tmp_path / "network.npz", tmp_path / "kept"
    arguments = ["train", "pushing", "--kind", "graph_residual", "--objects", "2", "--json"]
    arguments += ["--epochs", "1", "--out", str(out), "--keep", str(kept)]
    assert main(arguments) == 0
    assert GraphWeights.load(out).residual
    assert len(list(kept.glob("single_push_slow_*.npz"))) == 2


def test_a_network_that_chooses_its_pushes_beats_the_mean_and_learns_from_the_widest_spread(
    tmp_path, capsys, monkeypatch
):
    monkeypatch.setattr(train_pushing_rounds, "_JUDGES", 3)
    monkeypatch.setattr(train_pushing_rounds, "_CANDIDATES", 6)
    scores = []
    spread = train_pushing_rounds._spread

    def noted(weights, push):
        scores.append(spread(weights, push))
        return scores[-1]

    monkeypatch.setattr(train_pushing_rounds, "_spread", noted)
    arguments = ["train", "pushing", "--choice", "active", "--objects", "4", "--rounds", "2"]
    arguments += ["--epochs", "20", "--width", "16", "--out", str(tmp_path / "n.npz"), "--json"]
    assert main(arguments) == 0
    curve = json.loads(capsys.readouterr().out)["curve"]
    assert [each["pushes"] for each in curve] == [10, 20]
    assert curve[-1]["error"] < 0.8
    assert len(scores) == 12
    order = [SimpleNamespace(steps=size) for size in (3.0, 1.0, 7.0, 5.0, 2.0, 6.0, 4.0)]
    monkeypatch.setattr(train_pushing_rounds, "_spread", lambda _, push: push)
    chosen = train_pushing_rounds._chosen("active", order, object())
    assert [each.steps for each in chosen] == [7.0, 6.0, 5.0, 4.0, 3.0]
