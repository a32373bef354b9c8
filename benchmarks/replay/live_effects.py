"""Effects that are added while a recording is replayed live: as right as offline, and when?"""

from __future__ import annotations

import argparse
import json
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.effects.cases import Case
from benchmarks.effects.parameters import parameter_errors
from benchmarks.effects.product import ask_command
from benchmarks.replay.observations import WRONG, Status
from benchmarks.replay.player import Player, replay
from benchmarks.replay.tape import messages_of
from tactile_dynamics_ros.core.errors import TactileDynamicsError
from tactile_dynamics_ros.core.inertia.batch.inertial_estimate import PARAMETER_NAMES
from tactile_dynamics_ros.synthetic import CATALOGUE
from tactile_dynamics_ros.synthetic.recordings import HiddenRecording, write_bag

NODE = "inertial_estimator"
LEVEL = 2.0
"""Whitened error to which the hidden effect raises the recording: twice the noise."""
SEEDS = 3
SETTLE = 20.0
"""Time after the replay's end by which live must be as right as offline, s."""
NEAR, MEDIAN = 2.0, 0.5
"""Distance of live from offline in offline's standard deviations: the largest, and the median."""
FLOOR = 1.1
"""Live error over offline's."""
_ROWS, _COLUMNS = (0, 0, 1, 0, 1, 2), (0, 1, 1, 2, 2, 2)
REMARKS = {
    "mass_change": "mass as of the recording's start",
    "force_scale": "gains against their mean: a gain of all fingers is a mass; the ten as they are",
    "force_bias": "of one finger where the product gives one of all",
}
"""What a true parameter is compared with where that is not plain."""


@dataclass(frozen=True)
class Found:
    """An estimate, live or offline.

    Attributes:
        value, std: by name, the ten and those of the effect.
        effects: parameters of effects as JSON has them.
        error: whitened.
    """

    value: dict[str, float]
    std: dict[str, float]
    effects: dict[str, Any]
    error: float


@dataclass
class Result:
    """One recording: how far live and offline are from the truth and from each other.

    Attributes:
        z, offline_z: |estimate - truth| / std by parameter.
        distance: |live - offline| / offline's std by parameter.
        missing: parameters that only one of both has.
        floor: live error over offline's.
        seconds: after the replay's end when the last status came.
    """

    effect: str
    seed: int
    z: dict[str, float] = field(default_factory=dict)
    offline_z: dict[str, float] = field(default_factory=dict)
    distance: dict[str, float] = field(default_factory=dict)
    missing: list[str] = field(default_factory=list)
    floor: float = float("nan")
    seconds: float = float("nan")
    text: str = ""
    failures: list[str] = field(default_factory=list)


def main(arguments: Sequence[str] | None = None) -> int:
    """Replay every effect and seed, print a row for each; 1 if one is not as it must be."""
    options = _parse(arguments)
    results: list[Result] = []
    if not options.json:
        print(HEADING, flush=True)
    for seed in options.seeds:
        for name in options.only or CATALOGUE:
            results.append(run_case(name, seed, options))
            if not options.json:
                print(describe(results[-1]), flush=True)
    median = median_distance(results)
    if options.json:
        rows = [{**vars(r), "remark": REMARKS.get(r.effect)} for r in results]
        print(json.dumps({"rows": rows, "median_distance": median}))
    else:
        good = sum(not r.failures for r in results)
        print(f"{good} of {len(results)} are as they must be; median distance {median:.2f}")
        print(*(f"{name}: {text}" for name, text in REMARKS.items()), sep="\n")
    return int(any(r.failures for r in results) or not median <= MEDIAN)


def median_distance(results: Sequence[Result]) -> float:
    """Return the median of |live - offline| / offline's std over all parameters and recordings."""
    distances = [d for result in results for d in result.distance.values()]
    return float(np.median(distances)) if distances else float("nan")


def run_case(name: str, seed: int, options: argparse.Namespace) -> Result:
    """Estimate a recording offline and live with its hidden effect, and compare."""
    case = Case("single", (name,), options.level, seed, options.duration)
    recording, result = case.record(), Result(name, seed)
    try:
        offline = estimate_offline(recording, name)
        with replay((NODE,), logs=options.logs) as player:
            status = replay_with_effect(player, recording, name, options)
        result.seconds = player.quiet_since
    except TactileDynamicsError as error:
        result.failures.append(str(error))
        return result
    if status is None:
        result.failures.append("no status")
        return result
    result.text = status.text
    compare(result, found_live(status), offline, recording.truth(), case.axes_told)
    return result


def estimate_offline(recording: HiddenRecording, effect: str) -> Found:
    """Return what `tactile-dynamics estimate --effects EFFECT` says.

    Raises:
        TactileDynamicsError: it says nothing.
    """
    with tempfile.TemporaryDirectory() as folder:
        bag = write_bag(recording.streams, Path(folder) / "recording")
        answer = ask_command(["estimate", str(bag), "--effects", effect])
    if answer.json is None:
        raise TactileDynamicsError(f"offline: {answer.complaint}")
    said = answer.json
    tensors = [np.asarray(said["inertia_com"][key])[_ROWS, _COLUMNS] for key in ("value", "std")]
    value, std = (
        [said["mass"][key], *said["com"][key], *tensor]
        for key, tensor in zip(("value", "std"), tensors, strict=True)
    )
    return _found(value, std, said["effects"], said["error"]["whitened_rms"])


def replay_with_effect(
    player: Player, recording: HiddenRecording, effect: str, options: argparse.Namespace
) -> Status | None:
    """Replay, add the effect half-way as `ros2 param set` does, wait; return the last status.

    Raises:
        TactileDynamicsError: the node died or did not take the parameter.
    """
    messages = messages_of(recording.streams)
    half = [m for m in messages if m.due < 0.5 * options.duration]
    player.play(half, options.speed)
    change = player.set_parameter(NODE, "effects", [effect])
    player.play(messages[len(half) :], options.speed)
    answer = player.answer_of(change)
    if answer is None or not answer.successful:
        raise TactileDynamicsError(f"effects: {answer.reason if answer else 'no answer'}")
    player.listen_while(partial(_lives, player), options.settle)
    if player.dead():
        raise TactileDynamicsError(f"{NODE} ended: {_last_words(player)}")
    return player.heard.statuses[-1] if player.heard.statuses else None


def found_live(status: Status) -> Found:
    """Return the estimate of a status."""
    effects = {}
    for title, entries in status.entries.items():
        if title.startswith("effect "):
            keys = [key for key in entries if f"{key}_std" in entries]
            name = title.removeprefix("effect ")
            effects[name] = {
                key.removeprefix(f"{name}."): {
                    "value": float(entries[key]),
                    "std": float(entries[f"{key}_std"]),
                }
                for key in keys
            }
    error = float(status.entries.get("solver", {}).get("whitened_rms", "nan"))
    return _found(status.value, status.std, effects, error)


def compare(
    result: Result, live: Found, offline: Found, truth: Mapping[str, Any], axes_told: bool
) -> None:
    """Fill in distances, and what is not as it must be.

    Args:
        result: to fill in.
        live: estimate.
        offline: estimate.
        truth: of the recording.
        axes_told: whether the recording tells the axes of the sensors.
    """
    result.z = _distances_from_truth(result.effect, live, truth, axes_told)
    result.offline_z = _distances_from_truth(result.effect, offline, truth, axes_told)
    result.missing = sorted(live.value.keys() ^ offline.value.keys())
    result.distance = {
        key: abs(live.value[key] - offline.value[key]) / offline.std[key]
        for key in offline.value
        if key in live.value and offline.std[key] > 0
    }
    result.floor = live.error / offline.error
    _require(result)


def _require(result: Result) -> None:
    """Note what is not as it must be."""
    limits = (("off", result.z, WRONG), ("from offline", result.distance, NEAR))
    for word, numbers, limit in limits:
        for key, number in numbers.items():
            if not number <= limit:
                result.failures.append(f"{key} {word} {number:.1f}")
    if result.missing:
        result.failures.append(f"only one has {', '.join(result.missing[:4])}")
    if not result.floor <= FLOOR:
        result.failures.append(f"error {result.floor:.2f} times offline's")


def _distances_from_truth(
    effect: str, found: Found, truth: Mapping[str, Any], axes_told: bool
) -> dict[str, float]:
    tensor = np.asarray(truth["inertia_com"])[_ROWS, _COLUMNS]
    true = [truth["mass"], *truth["com"], *tensor]
    distances = {
        name: abs(found.value[name] - value) / found.std[name]
        for name, value in zip(PARAMETER_NAMES, true, strict=True)
    }
    errors = parameter_errors(effect, dict(truth), {"effects": found.effects}, axes_told)
    return distances | {f"{effect}.{key}": abs(e) / std for key, (e, std) in errors.items()}


def _found(
    value: Sequence[float], std: Sequence[float], effects: dict[str, Any], error: float
) -> Found:
    values = dict(zip(PARAMETER_NAMES, map(float, value), strict=True))
    stds = dict(zip(PARAMETER_NAMES, map(float, std), strict=True))
    for name, parameters in effects.items():
        for key, entry in parameters.items():
            title = f"{name.split(':')[0]}.{key}"
            values[title], stds[title] = entry["value"], entry["std"]
    return Found(values, stds, effects, error)


HEADING = (
    f"{'effect':18s} {'seed':>4s} {'':4s} {'worst z':>8s} {'offline':>8s} {'distance':>9s} "
    f"{'median':>7s} {'error':>6s} {'after':>7s}  failures"
)


def describe(result: Result) -> str:
    """Return a line of the table."""
    far = list(result.distance.values()) or [float("nan")]
    failures = ", ".join(result.failures[:3])
    more = f" (+{len(result.failures) - 3})" if len(result.failures) > 3 else ""
    return (
        f"{result.effect:18s} {result.seed:4d} {'-' if result.failures else 'ok':4s} "
        f"{_largest(result.z):8.1f} {_largest(result.offline_z):8.1f} {np.max(far):9.2f} "
        f"{np.median(far):7.2f} {result.floor:6.2f} {result.seconds:5.1f} s  {failures}{more}"
    )


def _largest(numbers: Mapping[str, float]) -> float:
    return max(numbers.values(), default=float("nan"))


def _lives(player: Player) -> bool:
    return not player.dead()


def _last_words(player: Player) -> str:
    return player.supervisor.members[NODE].last_words()


def _parse(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="bench live_effects", description=__doc__)
    parser.add_argument("--only", nargs="+", choices=CATALOGUE, metavar="NAME", help="these alone")
    parser.add_argument("--seeds", nargs="+", type=int, default=list(range(1, SEEDS + 1)))
    parser.add_argument("--level", type=float, default=LEVEL, help="error that the effect makes")
    parser.add_argument("--duration", type=float, default=30.0, help="of the recordings, s")
    parser.add_argument("--settle", type=float, default=SETTLE, help="wait after the end, s")
    parser.add_argument("--speed", type=float, default=1.0, help="of the replay, 1 is real time")
    parser.add_argument("--quick", action="store_true", help="two effects, one seed, 10 s")
    parser.add_argument("--logs", type=Path, help="folder for the log of the node")
    parser.add_argument("--json", action="store_true", help="print only JSON on stdout")
    options = parser.parse_args(arguments)
    if options.quick:
        options.only = options.only or ["viscous_drag", "tether_spring"]
        options.seeds, options.duration, options.settle = [1], 10.0, 5.0
    return options
