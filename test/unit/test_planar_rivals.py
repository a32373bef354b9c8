"""Rivals of the graph network in the benchmark: a plain perceptron, and a graph without physics."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from benchmarks.planar import choices, feed_forward, physics
from benchmarks.planar.__main__ import Kept
from tactile_dynamics_ros.cli import train_pushing_rounds
from tactile_dynamics_ros.core.planar.mechanics.support import SupportPatch
from tactile_dynamics_ros.core.planar.network.graph import EDGE, MOTION, NODE, Graph, Push, Thing
from tactile_dynamics_ros.core.planar.network.process import step_on
from tactile_dynamics_ros.core.planar.network.training import GraphTrainingConfig, train_graph
from tactile_dynamics_ros.core.planar.network.transitions import Examples, Noise, Transitions
from tactile_dynamics_ros.core.planar.network.weights import GraphWeights, net_sizes

STEP, SPEED, ONES = 1.0 / 15.0, 0.025, (np.ones(MOTION), np.ones(2))


def toy(count: int, seed: int) -> Examples:
    """Motion and force that are linear in features of the link, the robot and both edges."""
    rng = np.random.default_rng(seed)
    nodes, edges = rng.normal(size=(count, 3, NODE)), rng.normal(size=(count, 2, EDGE))
    motion = np.tile(nodes[:, 2, :1] - nodes[:, 0, 4:5], (1, MOTION))[:, None]
    force = edges[:, 0, 9:] + edges[:, 1, 4:5] * np.array([1.0, -1.0])
    return Examples(nodes, edges, motion, force, Noise(np.zeros_like(motion), np.zeros_like(force)))


def about() -> GraphWeights:
    return GraphWeights("graph", STEP, SPEED, *ONES, {}, "test")


def test_a_perceptron_learns_what_is_linear_in_link_robot_and_edges():
    config = GraphTrainingConfig(width=16, epochs=20, batch=64, learning_rate=1e-2)
    weights = feed_forward.train(about(), toy(800, 1), config)
    judges = toy(300, 2)
    assert train_pushing_rounds.relative_error(weights, judges) < 0.3


@pytest.mark.parametrize("links", [1, 2])
def test_the_perceptron_in_numpy_is_that_in_torch(links):
    rng = np.random.default_rng(links)
    nodes, edges = rng.normal(size=(7, 2 + links, NODE)), rng.normal(size=(7, 2 * links, EDGE))
    torch.manual_seed(0)
    network = feed_forward.FeedForward(links, about(), 16).double()
    linear = [one for one in network.nets["whole"] if isinstance(one, torch.nn.Linear)]
    layers = tuple((one.weight.detach().numpy().T, one.bias.detach().numpy()) for one in linear)
    weights = feed_forward.FeedForwardWeights(
        "graph", STEP, SPEED, *ONES, {"whole": layers}, "test"
    )
    with torch.no_grad():
        other = network(torch.tensor(nodes), torch.tensor(edges))
    mine = weights.outputs(Graph(nodes, edges))
    assert [each.shape for each in mine] == [(7, links, 2 * MOTION), (7, 4)]
    for one, its in zip(mine, other, strict=True):
        np.testing.assert_allclose(one, its.numpy(), rtol=0.0, atol=1e-6)


@pytest.mark.parametrize("width", [8, 32])
def test_the_perceptron_has_as_many_parameters_as_the_graph_and_no_more(width):
    most = feed_forward.parameter_count(net_sizes("graph", width))
    network = feed_forward.FeedForward(1, about(), width)
    count = sum(each.numel() for each in network.parameters())
    assert 0.96 * most < count <= most
    graph = train_graph(about(), [toy(8, 0)], [toy(8, 0)], GraphTrainingConfig(width, epochs=1))
    assert most == sum(a.size + b.size for layers in graph.nets.values() for a, b in layers)


def test_the_perceptron_is_put_beside_the_same_curves_of_the_graph(tmp_path, monkeypatch):
    made = []

    def learn(how, rounds, judges, trainer=None):
        made.append((how.choice, how.believed, how.seed, trainer))
        error = 0.5 if trainer is None else 0.7
        return None, [{"pushes": 10, "error": 1.0}, {"pushes": 20, "error": error + how.seed / 100}]

    monkeypatch.setattr(train_pushing_rounds, "learn", learn)
    for name in ("candidate_pushes", "judging_steps"):
        monkeypatch.setattr(train_pushing_rounds, name, lambda *_: [])
    keep = Kept(tmp_path, "small").of
    choices.measure("single", (1, 2), keep)
    assert len(made) == 2 * len(train_pushing_rounds.CHOICES)
    made.clear()
    found = choices.measure("single", (1, 2), keep, learnt=choices.PEERS)
    plain = feed_forward.train
    assert made == [(c, False, seed, plain) for seed in (1, 2) for c in ("active", "random")]
    needed = found["needed"]["random (feed-forward)"]["mean"]
    assert needed == pytest.approx(20.0)
    assert found["needed"]["random"]["mean"] < 17.0
    assert "random beside random (feed-forward): saves" in choices.table(found)


def test_rounds_train_the_network_of_the_trainer():
    how = train_pushing_rounds.Rounds("random", 1, 1, 8, 3, train_pushing_rounds.SETTINGS["slow"])
    steps = [steps_of(1.0, 0.0)]
    peer = train_pushing_rounds.trained(how, steps, 2, feed_forward.train)
    assert isinstance(peer, feed_forward.FeedForwardWeights)
    assert set(peer.nets) == {"whole"}
    assert set(train_pushing_rounds.trained(how, steps, 2).nets) == set(net_sizes("graph", 8))


def steps_of(product: float, com: float, count: int = 40, seed: int = 0) -> Transitions:
    """Steps whose force is the product and whose motion only the centre of mass tells."""
    rng = np.random.default_rng(seed)
    outline = 0.05 * np.array([[-1.0, -0.6], [1.0, -0.6], [1.0, 0.6], [-1.0, 0.6]])
    thing = Thing((SupportPatch(outline, 25),), np.array([0.02]))
    normal = np.tile([1.0, 0.0], (count, 1))
    point = np.column_stack([np.full(count, -0.05), rng.uniform(-0.02, 0.02, count)])
    push = Push(
        point, normal * SPEED, normal, np.ones(count), np.full(count, 0.02), STEP
    )  # fmt: skip
    states, after = np.zeros((count, 6)), np.zeros((count, 6))
    rate = 10.0 * SPEED * com / 0.01
    after[:, 2], after[:, 5] = STEP * rate, rate
    parameters = np.tile([np.log(product), np.log(0.7), 0.0, com, np.log(0.35)], (count, 1))
    return Transitions(thing, parameters, states, after, push, 9.81 * product * normal)


def test_untold_objects_differ_in_nothing_that_a_network_sees():
    weights = replace(about(), nets=random_nets())
    one, other = steps_of(0.1, 0.01), steps_of(0.5, -0.01)
    hidden = [physics.unknown(each) for each in (one, other)]
    for seen, differ in (([one, other], True), (hidden, False)):
        after, force = zip(
            *(step_on(weights, s.thing, s.states, s.parameters, s.push)[:2] for s in seen),
            strict=True,
        )
        assert (np.abs(force[0] - force[1]).max() > 1e-3) == differ
        assert (np.abs(after[0] - after[1]).max() > 1e-6) == differ
    np.testing.assert_array_equal(hidden[0].after, one.after)
    np.testing.assert_array_equal(hidden[0].force, one.force)


def random_nets() -> dict[str, tuple[tuple[np.ndarray, np.ndarray], ...]]:
    rng = np.random.default_rng(0)
    return {
        name: tuple(
            (rng.normal(size=(a, b)) / np.sqrt(a), rng.normal(size=b))
            for a, b in zip(sizes[:-1], sizes[1:], strict=True)
        )
        for name, sizes in net_sizes("graph", 16).items()
    }


def test_a_network_that_is_not_told_objects_misses_forces_by_how_much_they_differ(monkeypatch):
    """A straight line through ln force over ln product stands for the network."""
    products = 0.2 * np.exp([-0.6, -0.1, 0.1, 0.6])

    def line(how, steps, epochs):
        rows = np.concatenate([one.parameters[:, 0] for one in steps])
        force = np.concatenate([one.force[:, 0] for one in steps])
        return np.linalg.lstsq(np.column_stack([np.ones_like(rows), rows]), np.log(force))[0]

    def network(fit):
        def predict(one):
            pressing = np.exp(fit[0] + fit[1] * one.parameters[:, :1])
            return one.after + 1e-3, pressing * [1.0, 0.0]

        return predict

    monkeypatch.setattr(train_pushing_rounds, "trained", line)
    monkeypatch.setattr(physics.ahead, "network", network)
    monkeypatch.setattr(physics, "simulate_steps", lambda *_: [steps_of(q, 0.0) for q in products])
    objects = [[steps_of(q, 0.0)] for q in (0.1, 0.4)]
    for (one,) in objects:
        one.force[:] *= 0.99
    found = physics.measure(objects, lambda _, make: make())
    assert found["ahead"][physics.TOLD]["force"]["mean"] == pytest.approx(0.01)
    missed = [0.2 / 0.1 - 0.99, 0.99 - 0.2 / 0.4]
    assert found["ahead"][physics.UNTOLD]["force"]["mean"] == pytest.approx(np.mean(missed))
    assert found["ratio"]["force"]["mean"] == pytest.approx(np.sqrt(np.prod(missed)) / 0.01)
    assert found["ratio"]["yaw_deg"]["mean"] == pytest.approx(1.0)
    assert physics.ratios(found).count("force") == 1


def test_a_pull_at_the_centre_of_mass_may_be_a_lean_and_one_beside_it_is_none() -> None:
    from tactile_dynamics_ros.core.planar.diagnosis.twins import lean_of

    covariance = np.diag([0.01, 0.1, 2e-3, 2e-3, 0.02, 0.02, 1e-3, 1e-3]) ** 2
    centre = np.array([-0.010, -0.009])

    def lean(point: tuple[float, float]) -> tuple[str, ...]:
        present = {"constant_pull": np.array([-0.5, -0.6, *point])}
        return lean_of("constant_pull", centre, [2, 3], present, covariance)

    assert lean((-0.012, -0.008)) == ("support_tilt",)
    assert lean((0.002, -0.008)) == ()
    joint = covariance.copy()  # both known together only: the same distance is beyond chance
    joint[np.ix_([2, 6], [2, 6])] = 1e-6 * np.array([[4.0, 1.999], [1.999, 1.0]])
    present = {"constant_pull": np.array([-0.5, -0.6, -0.006, -0.009])}
    assert lean_of("constant_pull", centre, [2, 3], present, joint) == ()
    assert lean_of("viscous_support", centre, [2, 3], {"viscous_support": np.ones(1)}, joint) == ()
