"""`train pushing --choice`: a network that chooses the pushes that it learns from, in rounds."""

from __future__ import annotations

import json
import sys
import time
from argparse import Namespace
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TextIO

import numpy as np

from tactile_dynamics_ros.cli.train_pushing import SETTINGS, Setting, simulate_steps
from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.files import new_file
from tactile_dynamics_ros.core.planar.actions.information import Belief, expected_gain, updated
from tactile_dynamics_ros.core.planar.network.believed import (
    CandidatePush,
    believed_steps,
    expected_information,
)
from tactile_dynamics_ros.core.planar.network.graph import Graph, build_graph
from tactile_dynamics_ros.core.planar.network.process import GraphProcess, help_units
from tactile_dynamics_ros.core.planar.network.transitions import (
    Examples,
    Transitions,
    joined,
    make_examples,
)
from tactile_dynamics_ros.core.planar.network.weights import GraphWeights, shipped_file
from tactile_dynamics_ros.synthetic import pushed
from tactile_dynamics_ros.synthetic.pushed.objects import draw_object
from tactile_dynamics_ros.synthetic.pushed.sensed import SensedStep, giving_way, sensed_steps
from tactile_dynamics_ros.synthetic.pushed.transitions import cut_steps

if TYPE_CHECKING:
    from tactile_dynamics_ros.core.planar.network.training import GraphTrainingConfig

    Trainer = Callable[[GraphWeights, Examples, GraphTrainingConfig], GraphWeights]


CHOICES = ("active", "uniform", "random", "gain")
"""How pushes of an object are chosen: where the network states the widest spread, at angles that
differ most, as drawn, or where a filter with the network expects to learn most of the object."""
_CANDIDATES, _KEPT = 15, 5
"""Pushes of an object that are candidates, and those of them that are kept: paper B's top five."""
_FIRST, _HELD_OUT, _JUDGES = 200_000, 510_000, 12
"""First seed of objects to push, that of objects which only judge, and how many those are."""


@dataclass(frozen=True)
class Rounds:
    """How a network learns in rounds.

    Attributes:
        choice: of pushes, one of `CHOICES`; the first round takes them as drawn in any case.
        count: of rounds.
        epochs: passes over the pushes of all rounds. Each round begins anew and takes as many
            steps as the last, so that its error tells the pushes and not the length of training;
            steps that are believed do not overlap, and are passed over the more often.
        width: hidden units.
        seed: of initial weights and order.
        setting: how objects are pushed.
        origin: command that is kept with the weights.
        believed: whether parameters, poses and forces are those that a filter believes, instead of
            the simulator's.
    """

    choice: str
    count: int
    epochs: int
    width: int
    seed: int
    setting: Setting
    origin: str = ""
    believed: bool = False


def run(args: Namespace) -> int:
    """Simulate and train in rounds; write weights and tell the error after each round."""
    import torch

    if (args.kind, args.action) != ("graph", "push"):
        raise BadInputError("--choice: expected --kind graph and --action push")
    path = new_file(args.out or shipped_file(args.kind, args.setting).name)
    torch.set_num_threads(1)
    start, setting = time.monotonic(), SETTINGS[args.setting]
    command = (
        f"tactile-dynamics train pushing --choice {args.choice} --objects {args.objects} --rounds "
        f"{args.rounds} --epochs {args.epochs} --width {args.width} --seed {args.seed}"
        + " --believed"
        * args.believed
    )
    parts = round_seeds(args.seed, args.objects, args.rounds)
    how = Rounds(
        args.choice, len(parts), args.epochs, args.width, args.seed, setting, command, args.believed
    )
    judges = judging_steps("single", _JUDGES, setting)
    offered = (candidate_pushes("single", part, setting) for part in parts)
    weights, curve = learn(how, offered, judges, sys.stderr)
    weights.save(path)
    found = {"choice": args.choice, "curve": curve, "seconds": time.monotonic() - start}
    print(json.dumps(found) if args.json else f"wrote {path} in {found['seconds']:.0f} s")
    return 0


def learn(
    how: Rounds,
    rounds: Iterable[Sequence[list[CandidatePush]]],
    judges: Examples,
    told: TextIO | None = None,
    trainer: Trainer | None = None,
) -> tuple[GraphWeights, list[dict[str, float]]]:
    """Train after each round on all pushes that were chosen, and judge.

    Args:
        how: choice and training.
        rounds: candidate pushes of each object, by round.
        judges: steps of other objects.
        told: where each round is reported.
        trainer: of another network than the graph, from what the graph would be trained with.

    Returns:
        The last weights, and `pushes` and `error` (`relative_error`) after each round.
    """
    buffer: list[Transitions] = []
    weights, curve = None, []
    apart = how.setting.period / how.setting.every if how.believed else 1.0
    for k, objects in enumerate(rounds, start=1):
        for candidates in objects:
            chosen = _chosen(how.choice, candidates, weights)
            known = believed_steps(chosen, how.seed) if how.believed else [c.steps for c in chosen]
            buffer += known
        weights = trained(how, buffer, round(apart * how.epochs * how.count / k), trainer)
        curve.append({"pushes": len(buffer), "error": relative_error(weights, judges)})
        said = f"round {k}: {len(buffer)} pushes, error {curve[-1]['error']:.3f} of a mean's"
        if told is not None:
            print(said, file=told)
    assert weights is not None
    return weights, curve


def round_seeds(seed: int, objects: int, rounds: int) -> list[list[int]]:
    """Seeds of the objects of each round."""
    first = _FIRST + 1000 * seed
    parts = np.array_split(np.arange(first, first + objects), min(rounds, objects))
    return [[int(number) for number in part] for part in parts]


def judging_steps(kind: str, count: int, setting: Setting) -> Examples:
    """Steps of as many objects that only judge, pushed at their first link."""
    steps = simulate_steps(kind, range(_HELD_OUT, _HELD_OUT + count), setting)
    return _joined([one for one in steps if one.push.link == 0], setting)


def candidate_pushes(
    kind: str, objects: Sequence[int], setting: Setting
) -> list[list[CandidatePush]]:
    """Pushes of the first link of each object, each push on a table of its own."""
    seeds = [_CANDIDATES * number + k for number in objects for k in range(_CANDIDATES)]
    things = {seed: draw_object(seed // _CANDIDATES, kind) for seed in seeds}
    options = pushed.PushOptions(
        kind=kind, actions=setting.actions, variation=0.08, stiction=0.1, uneven=0.1, things=things
    )
    made: Any = pushed.generate(seeds, None, options)
    pushes = []
    for one, seed in zip(made, seeds, strict=True):
        truth = cut_steps(one.scene, one.motion, setting.period, setting.every)[0]
        sensed = sensed_steps(one, setting.period, seed)
        pushes.append(CandidatePush(truth, sensed, _giving_way(sensed)))
    return [pushes[k : k + _CANDIDATES] for k in range(0, len(pushes), _CANDIDATES)]


def _giving_way(steps: Sequence[SensedStep]) -> list[SensedStep]:
    """Steps with a tip that gives way where it touches."""
    return [
        step if step.motion is None else giving_way(steps[max(k - 1, 0) : k + 2], step)
        for k, step in enumerate(steps)
    ]


def _chosen(
    choice: str, pushes: list[CandidatePush], weights: GraphWeights | None
) -> list[CandidatePush]:
    """The pushes that go into the buffer; without a network yet, as drawn."""
    if choice == "random" or weights is None:
        return pushes[:_KEPT]
    if choice == "gain":
        return most_telling(pushes, weights, _KEPT)
    if choice == "uniform":
        order = np.argsort([float(np.arctan2(*p.steps.push.normal[0][::-1])) for p in pushes])
        return [pushes[k] for k in order[:: max(len(pushes) // _KEPT, 1)][:_KEPT]]
    order = np.argsort([-_spread(weights, push.steps) for push in pushes])
    return [pushes[k] for k in order[:_KEPT]]


def most_telling(
    pushes: list[CandidatePush], weights: GraphWeights, count: int
) -> list[CandidatePush]:
    """The pushes of one object that together tell most of it, chosen one after the other.

    Each time that of the largest expected Kullback-Leibler divergence is added, given those that
    were chosen before.

    Args:
        pushes: candidates, of which the ways of the tip are known, not what they will show.
        weights: of the network that the filter predicts with.
        count: wanted.

    Source: paper B, Eq. 17 and IV-B2.
    """
    process = GraphProcess.of(pushes[0].steps.thing, weights)
    told = np.stack([expected_information(process, push) for push in pushes])
    size = told.shape[1]
    mean, covariance = process.prior
    belief = Belief(mean[:size], covariance[:size, :size])
    chosen: list[int] = []
    for _ in range(min(count, len(pushes))):
        gains = expected_gain(belief, told)
        gains[chosen] = -np.inf
        chosen.append(int(np.argmax(gains)))
        belief = updated(belief, told[chosen[-1]])
    return [pushes[k] for k in chosen]


def _spread(weights: GraphWeights, push: Transitions) -> float:
    """Mean ln of the standard deviations that a network states of a push."""
    graph = build_graph(push.thing, push.states, push.parameters, push.push, weights.speed, None)
    said = weights.evaluate(graph)
    return float(np.log(said.motion_std).mean() + np.log(said.force_std).mean())


def trained(
    how: Rounds, buffer: Sequence[Transitions], epochs: int, trainer: Trainer | None = None
) -> GraphWeights:
    """Return a network that was trained anew on steps of objects with as many links.

    Args:
        how: width, seed, setting and origin; the rest is not read.
        buffer: the steps.
        epochs: passes over them.
        trainer: of another network than the graph.
    """
    from tactile_dynamics_ros.core.planar.network.training import GraphTrainingConfig, train_graph

    setting = how.setting
    units = help_units(setting.speed)
    about = GraphWeights("graph", setting.period, setting.speed, *units, {}, how.origin)
    config = GraphTrainingConfig(
        epochs=epochs, seed=how.seed, width=how.width, batch=128, learning_rate=6e-3
    )
    examples = _joined(buffer, setting)
    if trainer is not None:
        return trainer(about, examples, config)
    return train_graph(about, [examples], [examples], config)


def _joined(steps: Sequence[Transitions], setting: Setting) -> Examples:
    units = help_units(setting.speed)
    return joined([make_examples(one, setting.speed, units, None) for one in steps])


def relative_error(weights: GraphWeights, judges: Examples) -> float:
    """Error of motion and force over that of their mean: below 1 it beats the prior mean."""
    said = weights.evaluate(Graph(judges.nodes, judges.edges))
    told = np.column_stack([said.motion[:, 0], said.force])
    true = np.column_stack([judges.motion[:, 0], judges.force])
    shares = np.sum((told - true) ** 2, axis=0) / np.sum((true - true.mean(axis=0)) ** 2, axis=0)
    return float(np.sqrt(np.mean(shares)))
