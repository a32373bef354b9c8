"""`tactile-dynamics train pushing --noise`: what makes poses and forces worse than they say."""

from __future__ import annotations

import json
import time
from argparse import Namespace
from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from tactile_dynamics_ros.cli.train_pushing import made_in_parts
from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.files import new_file
from tactile_dynamics_ros.core.planar.network.noise import NoiseWeights, shipped_noise_file
from tactile_dynamics_ros.core.planar.network.noise_features import (
    Looked,
    Touched,
    joined_looks,
    joined_touches,
    lasting,
)
from tactile_dynamics_ros.synthetic import pushed
from tactile_dynamics_ros.synthetic.pushed.scene import STEP
from tactile_dynamics_ros.synthetic.pushed.sensed import ForceErrors, force_errors
from tactile_dynamics_ros.synthetic.pushed.transitions import states_at

if TYPE_CHECKING:
    from tactile_dynamics_ros.sim.planar.looking import Told


_FIRST = 30_000
"""First seed of objects to train on: benchmarks have those below, other networks other ones."""
_PART = 8
"""Objects that are simulated together and kept as one file: a minute's work may be lost."""
_IMAGE = 1.0 / 15.0
"""s between images, as in the paper; a depth camera of the simulation has the same."""
_WRONG = np.array([0.02, 0.02, 0.3])
"""Errors of a pose, m and rad, from which it is of another thing or another turn that looks alike:
no noise, and no width of it would be right."""
_CROP_SHARE = 3
"""Part of the passes after which a net of crops is done: from then on it learns single recordings,
and is worse on others than one factor for all."""
_GAP = 0.01
"""m that every second tip flies before it meets the object, so that touches are lost."""


@dataclass(frozen=True)
class Setting:
    """How objects are pushed: period of the filter's steps, s, and the pushes."""

    period: float
    actions: pushed.ActionOptions


SETTINGS = {
    "slow": Setting(
        1.0 / 15.0,
        pushed.ActionOptions(count=2, speed=(0.015, 0.06), duration=2.0, travel=0.1, pauses=1),
    ),
    "fast": Setting(0.01, pushed.ActionOptions(count=1, speed=(0.03, 0.2))),
}
"""Steps of 15 Hz and pushes about as slow as the paper's, and steps of 100 Hz; both with stops."""


@dataclass(frozen=True, eq=False)
class NoiseRecord:
    """One recording: forces with their errors; reported poses (N, 3) with the true ones."""

    measured: ForceErrors
    told: Told | None
    truth: Array


def noise_record(one: Any, period: float, looking: bool) -> NoiseRecord:
    """Let a filter feel and, if wanted, a camera follow a recording while something passes."""
    seed = one.scene.seed
    measured = force_errors(one, period, seed)
    if not looking:
        return NoiseRecord(measured, None, np.zeros((0, 3)))
    from tactile_dynamics_ros.sim.planar.looking import looked_at, told_of

    truth = states_at(one.scene, one.motion)[3 :: round(_IMAGE / STEP), :3]
    link, times = one.scene.thing.links[0], _IMAGE * np.arange(len(truth))
    told = told_of(looked_at(link.corners, link.height, times, truth, seed), truth[:, 2])
    return NoiseRecord(measured, told, truth[told.rows])


def simulated_records(
    name: str, first: int, count: int, kept: Path | None, said: str = "pushing"
) -> list[NoiseRecord]:
    """Recordings of `count` objects from a seed on; parts that are kept are not made again."""
    from tactile_dynamics_ros.sim.planar.looking import Told

    setting = SETTINGS[name]

    def make(seeds: range) -> list[NoiseRecord]:
        gap = _GAP * (seeds.start // _PART % 2)
        options = pushed.PushOptions(
            actions=replace(setting.actions, gap=gap), variation=0.08, stiction=0.1, uneven=0.1
        )
        made = pushed.generate(seeds, None, options)
        return [noise_record(one, setting.period, name == "slow") for one in made]

    return made_in_parts(
        make,
        range(first, first + count),
        _PART,
        f"{said}, {name}",
        None if kept is None else kept / f"noise_{name}",
        (NoiseRecord, ForceErrors, Touched, Told, Looked),
    )


def touch_examples(records: Iterable[NoiseRecord]) -> Any:
    """Errors of forces along the axes of what the filter grants them anyway."""
    from tactile_dynamics_ros.core.planar.network.noise_training import NoiseExamples

    measured = [record.measured for record in records if len(record.measured.touched)]
    touched = joined_touches([each for one in measured for each in one.touched])
    errors = np.concatenate([one.errors for one in measured])
    size, axes = np.linalg.eigh(np.concatenate([one.granted for one in measured]))
    along = np.einsum("nij,ni->nj", axes, errors) / touched.stated[:, None]
    granted = np.maximum(size, 0.0) / touched.stated[:, None] ** 2
    return NoiseExamples(touched.features, None, along[:, None], granted[:, None])


def look_examples(records: Iterable[NoiseRecord], crop: bool) -> Any:
    """Lasting errors of poses over what is stated; those of another thing are left out."""
    from tactile_dynamics_ros.core.planar.network.noise_training import NoiseExamples

    seen = [
        (r.told, _lasting(r.told, r.truth))
        for r in records
        if r.told is not None and len(r.told.rows)
    ]
    looked = joined_looks([told.looked for told, _ in seen])
    white = np.concatenate([error for _, error in seen])
    yaw = np.column_stack([white[:, 2], np.full(len(white), np.nan)])
    both = np.stack([white[:, :2], yaw], axis=1)
    both[~looked.known] = np.nan
    crops = np.concatenate([told.crops for told, _ in seen]) if crop else None
    features = looked.features[:, -2:] if crop else looked.features
    return NoiseExamples(features, crops, both, np.zeros_like(both))


def _lasting(told: Told, truth: Array) -> Array:
    """Lasting errors (N, 3) over what is stated; NaN where a pose is of another thing."""
    errors = told.poses - truth
    right = np.all(np.abs(errors) < _WRONG, axis=1)[:, None] & told.looked.known[:, [0, 0, 1]]
    return lasting(np.where(right, errors / told.looked.std, np.nan))


def run(args: Namespace) -> int:
    """Simulate, train and write the nets."""
    import torch

    from tactile_dynamics_ros.core.planar.network.noise_training import (
        NoiseTrainingConfig,
        train_noise,
    )

    path = new_file(args.out or shipped_noise_file().name)
    torch.set_num_threads(1)
    start, kept = time.monotonic(), Path(args.keep) if args.keep else None
    first = _FIRST + 1000 * args.seed
    slow = simulated_records("slow", first, args.objects, kept)
    fast = simulated_records("fast", first + 500, -(-args.objects // 2), kept)
    config = NoiseTrainingConfig(epochs=args.epochs, seed=args.seed)
    fewer = replace(config, epochs=max(1, config.epochs // _CROP_SHARE))
    nets = {
        "touch": train_noise(touch_examples([*slow, *fast]), config),
        "look": train_noise(look_examples(slow, False), config),
        "crop": train_noise(look_examples(slow, True), fewer),
    }
    origin = (
        f"tactile-dynamics train pushing --noise --seed {args.seed} --objects {args.objects} "
        f"--epochs {args.epochs}"
    )
    NoiseWeights(nets, origin).save(path)
    seconds = time.monotonic() - start
    if args.json:
        print(json.dumps({"file": str(path), "seconds": seconds, "origin": origin}))
    else:
        print(f"wrote {path} ({path.stat().st_size / 1024:.0f} KiB) in {seconds:.0f} s")
    return 0
