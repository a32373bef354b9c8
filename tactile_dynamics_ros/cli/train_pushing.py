"""`tactile-dynamics train pushing`: simulate pushes or pulls, train the graph network on them."""

from __future__ import annotations

import hashlib
import json
import sys
import time
from argparse import Namespace
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, TypeVar

from tactile_dynamics_ros.core.files import new_file, read_records, write_records
from tactile_dynamics_ros.core.planar.network.mechanics import expected_steps
from tactile_dynamics_ros.core.planar.network.process import help_units
from tactile_dynamics_ros.core.planar.network.transitions import (
    TRANSITION_KINDS,
    Examples,
    Transitions,
    joined,
    make_examples,
)
from tactile_dynamics_ros.core.planar.network.weights import ACTIONS, GraphWeights, shipped_file
from tactile_dynamics_ros.synthetic import pushed
from tactile_dynamics_ros.synthetic.pushed.transitions import cut_all

Record = TypeVar("Record")

_PART = 64
"""Objects that are simulated together and kept as one file: half a minute's work may be lost."""
_HELD_OUT_FROM = 500_000
"""First seed of objects whose loss is only reported; far from all that are trained on."""
_FIRST = 10_000
"""First seed of objects to train on: benchmarks have those below."""


@dataclass(frozen=True)
class Setting:
    """How objects are pushed, and how a network sees it.

    Attributes:
        period: s of a step. every: s between the beginnings of steps. speed: m/s, unit.
        velocity_std: m/s, point_std: m, errors of the states that every second object has.
        actions: pushes.
    """

    period: float
    every: float
    speed: float
    velocity_std: float
    point_std: float
    actions: pushed.ActionOptions


SETTINGS = {
    "slow": Setting(
        period=1.0 / 15.0,
        every=1.0 / 45.0,
        speed=0.025,
        velocity_std=0.001,
        point_std=0.0003,
        actions=pushed.ActionOptions(
            count=1, speed=(0.015, 0.03), duration=0.8, travel=0.125, pauses=0, hard_stop=False
        ),
    ),
    "fast": Setting(
        period=0.01,
        every=0.02,
        speed=0.1,
        velocity_std=0.002,
        point_std=0.0003,
        actions=pushed.ActionOptions(count=1, speed=(0.03, 0.2)),
    ),
}
"""Paper B's 15 Hz and 25 mm/s, and 100 Hz with pushes of 30 to 200 mm/s that stop hard."""
KINDS = {
    "push": {"single": 1.0, "rigid_pair": 0.1, "jointed": 0.1},
    "pull": {"single": 1.0, "rigid_pair": 0.4, "jointed": 0.4},
}
"""Shares of `--objects`; each link of a linked object is pushed once, the first is pulled twice. A
part that trails behind a joint takes more examples: with a tenth the centre of the pulled part came
out worse than known beforehand."""


def run(args: Namespace) -> int:
    """Simulate, train and write the weights."""
    import torch

    from tactile_dynamics_ros.core.planar.network.training import GraphTrainingConfig, train_graph

    path = new_file(args.out or shipped_file(args.kind, args.setting, args.action).name)
    torch.set_num_threads(1)
    start = time.monotonic()
    setting, kept = SETTINGS[args.setting], Path(args.keep) if args.keep else None
    residual = args.kind == "graph_residual"
    shares = {"single": 1.0} if residual else KINDS[args.action]
    train, held_out = (
        [
            _examples(_simulated(args, kind, first, count, kept), setting, residual)
            for kind, count in ((k, _count(args.objects * share * s)) for k, s in shares.items())
        ]
        for first, share in ((_FIRST + 1000 * args.seed, 1.0), (_HELD_OUT_FROM, 0.1))
    )
    command = (
        f"tactile-dynamics train pushing --kind {args.kind} --action {args.action} --setting "
        f"{args.setting} --seed {args.seed} --objects {args.objects} --epochs {args.epochs}"
    )
    units = help_units(setting.speed, ACTIONS[args.action])
    about = GraphWeights(args.kind, setting.period, setting.speed, *units, {}, command)
    config = GraphTrainingConfig(epochs=args.epochs, seed=args.seed, width=args.width)
    checkpoint = None
    if kept is not None:
        checkpoint = str(kept / f"training_{hashlib.sha256(command.encode()).hexdigest()[:12]}.pt")
    weights = train_graph(about, train, held_out, config, _report(args.epochs), checkpoint)
    print(file=sys.stderr)
    weights.save(path)
    return _say(args, path, weights.origin, time.monotonic() - start)


def _say(args: Namespace, path: Path, origin: str, seconds: float) -> int:
    if args.json:
        print(json.dumps({"file": str(path), "seconds": seconds, "origin": origin}))
    else:
        print(f"wrote {path} ({path.stat().st_size / 1024:.0f} KiB) in {seconds:.0f} s")
    return 0


def _count(objects: float) -> int:
    return max(2, round(objects))


def _report(epochs: int) -> Callable[[int, float, float], None]:
    def report(epoch: int, loss: float, held_out: float) -> None:
        said = f"\repoch {epoch}/{epochs}  loss {loss:.4f}  on other objects {held_out:.4f}"
        print(said, end="", file=sys.stderr)

    return report


def _simulated(
    args: Namespace, kind: str, first: int, count: int, kept: Path | None
) -> list[Transitions]:
    """Steps of `count` objects from a seed on; parts that are kept are not simulated again."""
    return made_in_parts(
        lambda seeds: simulate_steps(kind, seeds, SETTINGS[args.setting], args.action),
        range(first, first + count),
        _PART,
        f"{args.action}ing {kind} objects",
        None if kept is None else kept / f"{kind}_{args.action}_{args.setting}",
        TRANSITION_KINDS,
    )


def made_in_parts(
    make: Callable[[range], list[Record]],
    seeds: range,
    size: int,
    said: str,
    kept: Path | None,
    kinds: Sequence[type],
) -> list[Record]:
    """What is made of seeds, part by part; a part that is kept is read instead.

    Args:
        make: from the seeds of a part.
        seeds: all of them.
        size: of a part.
        said: in front of the count of the seeds, on standard error.
        kept: files of the parts, without the seeds and the ending; None keeps nothing.
        kinds: dataclasses of which the records are made.

    Raises:
        BadInputError: a file that is there holds something else.
    """
    found: list[Record] = []
    for k in range(0, len(seeds), size):
        own = seeds[k : k + size]
        print(f"\r{said}: {k + len(own)}/{len(seeds)}", end="", file=sys.stderr)
        name = f"_{own.start}_{own.stop}.npz"
        file = None if kept is None else kept.with_name(kept.name + name)
        if file is not None and file.exists():
            found += read_records(file, kinds)
            continue
        part = make(own)
        if file is not None:
            write_records(part, file)
        found += part
    print(file=sys.stderr)
    return found


def simulate_steps(
    kind: str, seeds: Sequence[int], setting: Setting, action: str = "push"
) -> list[Transitions]:
    """Steps of moved objects on tables whose friction varies, on faces that are not quite even."""
    actions = replace(setting.actions, kind=action, count=1 if kind == "single" else 2)
    options = pushed.PushOptions(
        kind=kind, actions=actions, variation=0.08, stiction=0.1, uneven=0.1
    )
    made: Any = pushed.generate(seeds, None, options)
    return cut_all([(one.scene, one.motion) for one in made], setting.period, setting.every)


def _examples(steps: Sequence[Transitions], setting: Setting, residual: bool) -> Examples:
    """Examples of all steps; those of every second object start from disturbed states."""
    units = help_units(setting.speed, steps[0].force.shape[1])
    mechanics = expected_steps if residual else None
    parts = []
    for k, one in enumerate(steps):
        seen = one.disturbed(setting.velocity_std, setting.point_std, k) if k % 2 else one
        parts.append(make_examples(seen, setting.speed, units, mechanics))
    return joined(parts)
