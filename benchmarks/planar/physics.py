"""What a graph network loses that is never told the physical parameters of an object."""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from benchmarks.planar import ahead
from benchmarks.planar.choices import interval
from tactile_dynamics_ros.cli import train_pushing_rounds as training
from tactile_dynamics_ros.cli.train_pushing import SETTINGS, simulate_steps
from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.planar.filter.patch import PatchProcess
from tactile_dynamics_ros.core.planar.network.transitions import Transitions

_FIRST = 10_000
"""First seed of the objects to train on, as in `train pushing`: test objects have those below."""
TOLD, UNTOLD = "true parameters", "no parameters"


@dataclass(frozen=True)
class Size:
    """How much is learnt, by each of both networks.

    Attributes:
        objects: that are pushed once each.
        epochs, width: of each network.
        seeds: of its initial weights.
    """

    objects: int = 256
    epochs: int = 40
    width: int = 32
    seeds: tuple[int, ...] = (1, 2, 3)


def unknown(steps: Transitions) -> Transitions:
    """The same steps of an object of which only the outline and the height are known.

    Product, mass, centre of mass and friction of the tip are what they are taken for before any
    push; the motion that is learnt is that of the centre of the outline.
    """
    known = steps.thing.com_height
    height = None if known is None else float(known[0])
    mean = PatchProcess(steps.thing.patches[0].outline, height).prior[0]
    return replace(steps, parameters=np.broadcast_to(mean, (len(steps), len(mean))))


def same(steps: Transitions) -> Transitions:
    """The steps themselves."""
    return steps


SEEN: dict[str, Callable[[Transitions], Transitions]] = {TOLD: same, UNTOLD: unknown}
"""By network, as what it is shown steps in training and judgement."""


def measure(
    objects: Sequence[Sequence[Transitions]],
    keep: Callable[[str, Callable[[], Any]], Any],
    size: Size | None = None,
) -> dict[str, Any]:
    """Errors one step ahead of both networks on the same objects, means over seeds of weights.

    Args:
        objects: steps of each object of one link, by push.
        keep: gives back what was kept under a name, or makes it.
        size: of the training.
    """
    import torch

    torch.set_num_threads(1)
    size, setting = size or Size(), SETTINGS["slow"]
    first = range(_FIRST, _FIRST + size.objects)
    steps = keep("steps", partial(simulate_steps, "single", first, setting))
    rows: dict[str, Array] = {}
    for name, seen in SEEN.items():
        told = []
        for seed in size.seeds:
            how = training.Rounds("random", 1, size.epochs, size.width, seed, setting)
            make = partial(_medians, how, steps, objects, seen)
            told.append(keep(f"{name}_{seed}", make))
            print(f"\r{name}, seed {seed}", end="", file=sys.stderr)
        rows[name] = np.mean(told, axis=0)
    print(file=sys.stderr)
    found = {name: ahead.summary(each.tolist()) for name, each in rows.items()}
    ratios = np.log(rows[UNTOLD][:, :3] / rows[TOLD][:, :3])
    return {
        "n": len(objects),
        **vars(size),
        "ahead": {"goes on": ahead.errors_of(ahead.still, objects)} | found,
        "ratio": {
            name: {end: float(np.exp(value)) for end, value in interval(each).items()}
            for name, each in zip(ahead.NAMES, ratios.T, strict=False)
        },
    }


def ratios(found: dict[str, Any]) -> str:
    """For people: geometric means over objects."""
    cells = "{mean:.2f} ({low:.2f} to {high:.2f})"
    return ", ".join(f"{name} {cells.format(**one)}" for name, one in found["ratio"].items())


def _medians(
    how: training.Rounds,
    steps: Sequence[Transitions],
    objects: Sequence[Sequence[Transitions]],
    seen: Callable[[Transitions], Transitions],
) -> Array:
    """Of a network that is trained and judged on what is seen of steps, by object."""
    network = ahead.network(training.trained(how, [seen(one) for one in steps], how.epochs))

    def predict(one: Transitions) -> tuple[Array, Array]:
        return network(seen(one))

    return np.array([ahead.medians_of(predict, parts) for parts in objects])
