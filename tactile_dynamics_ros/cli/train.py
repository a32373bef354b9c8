"""`tactile-dynamics train`: retrain what the package ships with learnt weights."""

from __future__ import annotations

import json
import os
import sys
import time
from argparse import Namespace, _SubParsersAction
from collections.abc import Iterable, Iterator
from typing import Any

from tactile_dynamics_ros.core.errors import require_extra
from tactile_dynamics_ros.core.files import new_file
from tactile_dynamics_ros.core.options import COUNT, SEED, file_to_write, folder_to_write

_MOST_HELD_OUT = 400
"""Simulated sensors per protocol that only calibrate the uncertainty."""


def add_parser(verbs: _SubParsersAction[Any]) -> None:
    """Add the verb."""
    parser = verbs.add_parser("train")
    parser.add_argument("what", choices=["biotac", "pushing"], help="what to train")
    parser.add_argument("--seed", type=SEED, default=0, help="of units, presses and weights (0)")
    parser.add_argument(
        "--units", type=COUNT, default=12000, help="simulated sensors per protocol (12000)"
    )
    parser.add_argument(
        "--epochs", type=COUNT, help="passes over the examples (biotac 11, pushing 30, --noise 60)"
    )
    parser.add_argument(
        "--out",
        type=file_to_write,
        metavar="FILE",
        help="new file for the weights (in this folder, named as the shipped one)",
    )
    pushing = parser.add_argument_group("pushing")
    pushing.add_argument("--kind", choices=["graph", "graph_residual"], default="graph")
    pushing.add_argument(
        "--action", choices=["push", "pull"], default="push", help="what to learn (push)"
    )
    pushing.add_argument("--setting", choices=["slow", "fast"], default="slow", help="15 Hz (slow)")
    pushing.add_argument(
        "--objects", type=COUNT, help="simulated single objects (640; 48 with --noise)"
    )
    pushing.add_argument("--width", type=COUNT, default=64, help="hidden units (64)")
    pushing.add_argument(
        "--keep",
        type=folder_to_write,
        metavar="DIR",
        help="where an interrupted run goes on from",
    )
    pushing.add_argument(
        "--choice",
        choices=["active", "uniform", "random", "gain"],
        help="train in rounds, on pushes that are chosen so among 15 of each object",
    )
    pushing.add_argument("--rounds", type=COUNT, default=4, help="of --choice (4)")
    pushing.add_argument(
        "--believed",
        action="store_true",
        help="with --choice: learn from what a filter believes instead of the simulator's truth",
    )
    pushing.add_argument(
        "--noise",
        action="store_true",
        help="train what estimates by how much poses and forces are worse than they state",
    )
    parser.set_defaults(run=run)


def _count(parts: Iterable[Any]) -> Iterator[Any]:
    """Yield parts and say how many there were."""
    for number, part in enumerate(parts, start=1):
        print(f"\rparts of simulated presses: {number}", end="", file=sys.stderr)
        yield part
    print(file=sys.stderr)


def run(args: Namespace) -> int:
    """Press, train, calibrate and write the weights."""
    require_extra("torch", "train", "training")
    if args.epochs is None:
        args.epochs = 11 if args.what == "biotac" else 60 if args.noise else 30
    if args.objects is None:
        args.objects = 48 if args.noise else 640
    if args.what == "pushing" and args.noise:
        from tactile_dynamics_ros.cli import train_noise

        return train_noise.run(args)
    if args.what == "pushing":
        from tactile_dynamics_ros.cli import train_pushing, train_pushing_rounds

        return (train_pushing_rounds if args.choice else train_pushing).run(args)
    import torch

    from tactile_dynamics_ros.core.tactile.network.training import TrainingConfig, train_network
    from tactile_dynamics_ros.core.tactile.network.weights import SHIPPED_NETWORK
    from tactile_dynamics_ros.sim.sensors.biotac.presses import (
        HELD_OUT_SEED,
        join_presses,
        label_batches,
    )

    path = new_file(args.out or SHIPPED_NETWORK.name)
    torch.set_num_threads(os.cpu_count() or 1)
    start = time.monotonic()
    print("pressing simulated fingertips ...", file=sys.stderr)
    presses = _count(label_batches(args.units, args.seed))
    others = min(max(args.units // 6, 2), _MOST_HELD_OUT)
    held_out = join_presses(label_batches(others, args.seed + HELD_OUT_SEED, -(-others // 2)))
    command = f"train biotac --seed {args.seed} --units {args.units} --epochs {args.epochs}"
    config = TrainingConfig(epochs=args.epochs, seed=args.seed)

    def report(epoch: int, loss: float) -> None:
        print(f"\repoch {epoch + 1}/{args.epochs}  loss {loss:.4f}", end="", file=sys.stderr)

    weights = train_network(presses, held_out, f"tactile-dynamics {command}", config, report)
    print(file=sys.stderr)
    weights.save(path)
    seconds = time.monotonic() - start
    if args.json:
        print(json.dumps({"file": str(path), "seconds": seconds, "origin": weights.origin}))
    else:
        print(f"wrote {path} ({path.stat().st_size / 1024:.0f} KiB) in {seconds:.0f} s")
    return 0
