"""Whether a network that chooses the pushes that it learns from needs fewer of them."""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from scipy.stats import t as student

from tactile_dynamics_ros.cli import train_pushing_rounds as training
from tactile_dynamics_ros.cli.train_pushing import SETTINGS
from tactile_dynamics_ros.core.array import Array

Curves = dict[str, list[dict[str, float]]]
"""By choice: `pushes` and `error` after each round."""

KINDS = ("single", "jointed")
"""Families that paper B's Fig. 10 has."""
_PAIRS = (
    ("active", "uniform"),
    ("active", "random"),
    ("gain", "uniform"),
    ("gain", "random"),
    ("active (feed-forward)", "random (feed-forward)"),
    ("active", "active (feed-forward)"),
    ("random", "random (feed-forward)"),
)
"""Which way is put beside which, where both were learnt: how many pushes the first saves."""


@dataclass(frozen=True)
class Way:
    """One way to learn.

    Attributes:
        choice: of pushes.
        believed: whether from what a filter believes instead of the simulator's truth.
        feed_forward: whether with a plain network instead of the graph.
    """

    choice: str
    believed: bool = False
    feed_forward: bool = False


TRUE, BELIEVED = "the simulator's truth", "what a filter believes"
PEERS = "the simulator's truth, by the graph and by a feed-forward network"
SETS = {
    TRUE: {choice: Way(choice) for choice in training.CHOICES},
    BELIEVED: {choice: Way(choice, believed=True) for choice in ("random", "gain")},
    PEERS: {
        "active": Way("active"),
        "random": Way("random"),
        "active (feed-forward)": Way("active", feed_forward=True),
        "random (feed-forward)": Way("random", feed_forward=True),
    },
}
"""Ways that are compared, by what is learnt from."""


@dataclass(frozen=True)
class Size:
    """How much is learnt, by default so that one run takes about a minute of a core.

    Attributes:
        objects: that are pushed in all rounds together, 5 of 15 candidate pushes each.
        rounds: after which the error is told.
        epochs, width: of the last round, and of the network.
        judges: objects whose steps tell the error, one push each.
    """

    objects: int = 10
    rounds: int = 5
    epochs: int = 40
    width: int = 32
    judges: int = 64


def measure(
    kind: str,
    seeds: Sequence[int],
    keep: Callable[[str, Callable[[], Any]], Any],
    size: Size | None = None,
    learnt: str = TRUE,
) -> dict[str, Any]:
    """Learning curves of all ways of a set from the same candidates and judges.

    Args:
        kind: of the objects.
        seeds: of objects, pushes and weights together; at least two.
        keep: gives back what was kept under a name, or makes it.
        size: of each run.
        learnt: which of `SETS`.
    """
    import torch

    torch.set_num_threads(1)
    size, setting = size or Size(), SETTINGS["slow"]
    judges = keep("judges", partial(training.judging_steps, kind, size.judges, setting))
    first = training.Rounds("random", size.rounds, size.epochs, size.width, 0, setting)
    told: list[Curves] = []
    for seed in seeds:
        parts = training.round_seeds(seed, size.objects, size.rounds)
        rounds = [
            keep(f"pushes_{seed}_{k}", partial(training.candidate_pushes, kind, part, setting))
            for k, part in enumerate(parts)
        ]
        curves: Curves = {}
        for name, way in SETS[learnt].items():
            how = replace(first, choice=way.choice, believed=way.believed, seed=seed)
            make = partial(_curve, how, rounds, judges, way.feed_forward)
            kept = "_believed" * way.believed + "_feed_forward" * way.feed_forward
            curves[name] = keep(f"curve_{seed}_{way.choice}{kept}", make)
            print(f"\r{kind}, seed {seed}, {name}", end="", file=sys.stderr)
        told.append(curves)
    print(file=sys.stderr)
    return {"kind": kind, "learnt": learnt, **vars(size)} | compared(told)


def _curve(
    how: training.Rounds, rounds: Any, judges: Any, feed_forward: bool
) -> list[dict[str, float]]:
    if not feed_forward:
        return training.learn(how, rounds, judges)[1]
    from benchmarks.planar.feed_forward import train

    return training.learn(how, rounds, judges, trainer=train)[1]


def compared(told: Sequence[Curves]) -> dict[str, Any]:
    """What is told of the curves of several seeds, with intervals over these."""
    first = next(iter(told[0].values()))
    pushes = [one["pushes"] for one in first]
    errors = {
        choice: np.array([[one["error"] for one in each[choice]] for each in told])
        for choice in told[0]
    }
    needed = needed_pushes(np.array(pushes, dtype=float), errors)
    found: dict[str, Any] = {"n": len(told), "pushes": pushes, "saved": {}, "error_ratio": {}}
    found["error"] = {choice: [interval(row) for row in rows.T] for choice, rows in errors.items()}
    found["needed"] = {choice: interval(row) for choice, row in needed.items()}
    pairs = [pair for pair in _PAIRS if {*pair} <= set(errors)]
    for one, other in pairs:
        name = f"{one} beside {other}"
        ratio = interval(np.log(needed[one] / needed[other]))
        low, high = 1.0 - np.exp(ratio["high"]), 1.0 - np.exp(ratio["low"])
        found["saved"][name] = {"mean": 1.0 - float(np.exp(ratio["mean"]))}
        found["saved"][name] |= {"low": float(low), "high": float(high)}
        later = np.log(errors[one][:, 1:] / errors[other][:, 1:]).mean(axis=1)
        ends = interval(later)
        found["error_ratio"][name] = {key: float(np.exp(end)) for key, end in ends.items()}
    return found


def needed_pushes(pushes: Array, errors: dict[str, Array]) -> dict[str, Array]:
    """Pushes (seeds,) after which each choice has the best error that all of a seed reach.

    A choice's error counts as the best so far, between rounds as a straight line.

    Args:
        pushes: (rounds,) after each round.
        errors: (seeds, rounds) by choice.
    """
    best = {choice: np.minimum.accumulate(rows, axis=1) for choice, rows in errors.items()}
    aims = np.max([rows[:, -1] for rows in best.values()], axis=0)
    return {
        choice: np.array([_reached(pushes, row, aim) for row, aim in zip(rows, aims, strict=True)])
        for choice, rows in best.items()
    }


def _reached(pushes: Array, best: Array, aim: float) -> float:
    k = int(np.argmax(best <= aim))
    if k == 0:
        return float(pushes[0])
    share = (best[k - 1] - aim) / (best[k - 1] - best[k])
    return float(pushes[k - 1] + share * (pushes[k] - pushes[k - 1]))


def interval(values: Array) -> dict[str, float]:
    """Mean and the ends of its 95 % interval by Student's t: a few seeds are no bootstrap's."""
    mean, count = float(np.mean(values)), len(values)
    half = float(student.ppf(0.975, count - 1) * np.std(values, ddof=1) / np.sqrt(count))
    return {"mean": mean, "low": mean - half, "high": mean + half}


def table(found: dict[str, Any]) -> str:
    """Rows for people, and whether a difference is to be seen."""
    names = list(found["error"])
    rows = [
        f"## {found['kind']}: pushes that are chosen, learnt from {found['learnt']}, "
        f"n = {found['n']} seeds",
        "",
        f"| pushes | {' | '.join(names)} |",
        "|---" * (len(names) + 1) + "|",
    ]
    for k, count in enumerate(found["pushes"]):
        cells = [_cell(found["error"][name][k]) for name in names]
        rows.append(f"| {count} | {' | '.join(cells)} |")
    cells = [_cell(found["needed"][name]) for name in names]
    rows += [f"| to the error that all reach | {' | '.join(cells)} |", ""]
    for name, saved in found["saved"].items():
        shares = {end: round(value, 2) + 0.0 for end, value in saved.items()}  # no "-0%"
        said = "{mean:.0%} ({low:.0%} to {high:.0%})".format(**shares)
        ratio = "{mean:.3f} ({low:.3f} to {high:.3f})".format(**found["error_ratio"][name])
        rows.append(f"{name}: saves {said} of the pushes, {_seen(saved)}; its error")
        rows[-1] += f" after the same pushes is {ratio} of it"
    return "\n".join([*rows, ""])


def _seen(saved: dict[str, float]) -> str:
    if saved["low"] > 0.0:
        return "it needs fewer"
    return "it needs more" if saved["high"] < 0.0 else "no difference to be seen"


def _cell(one: dict[str, float]) -> str:
    return f"{one['mean']:.3g} ({one['low']:.3g} to {one['high']:.3g})"
