"""Which layouts of tables `import FILE --guess` reads right: `./dev bench layouts`."""

from __future__ import annotations

import argparse
import tempfile
from collections import Counter
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from benchmarks.support.layouts import (
    LAYOUTS,
    STATIC,
    UNSEEN,
    UNTOLD,
    Layout,
    WristLog,
)
from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.recording import Recording
from tactile_dynamics_ros.recording.importers.csv_mapping import read_mapping
from tactile_dynamics_ros.recording.importers.guess import guess_tables

RIGHT, ASKS, WRONG = "right", "asks", "wrong"
_ANGLE, _PLACE_M, _FORCE_N, _TORQUE_NM = 0.01, 1e-3, 0.05, 5e-3
"""Differences of a reading that is right: rounding of the files, and of interpolation between
stamps. A wrong unit, sign, order or frame is off by a hundred times as much."""


def judge_layout(
    name: str, layout: Layout, seed: int, folder: Path, seconds: float = 20.0
) -> tuple[str, str]:
    """Write a log in a layout, guess its mapping, and compare what is read with the truth.

    Returns:
        One of "right", "asks", "wrong", and a line that says why.
    """
    log = WristLog.draw_static(seed) if name in STATIC else WristLog.draw(seed, seconds)
    paths = layout(log, folder)
    try:
        guess = guess_tables(paths)
        if guess.question:
            return ASKS, guess.question
        recording = read_mapping(guess.mapping, folder, name)
    except BadInputError as error:
        return ASKS, str(error)
    if name in STATIC:
        return _judge_static(log, recording)
    return _judge_motion(log, recording)


def _judge_motion(log: WristLog, recording: Recording) -> tuple[str, str]:
    """Compare poses and net wrench with those of the log, in any world that is turned about z."""
    pose = recording.streams.pose
    assert pose is not None
    rows = np.clip(
        np.rint(pose.time / (log.time[1] - log.time[0])).astype(int), 0, len(log.time) - 1
    )
    if np.abs(pose.time - log.time[rows]).max() > 2e-3 or len(rows) < 0.3 * len(log.time):
        return WRONG, "time"
    turned = Rotation.from_matrix(pose.rotation)
    yaw = (turned * log.rotation[rows].inv()).mean()
    if np.linalg.norm(yaw.apply([0.0, 0.0, 1.0]) - [0.0, 0.0, 1.0]) > _ANGLE:
        return WRONG, "the world does not stand upright"
    if (turned.inv() * yaw * log.rotation[rows]).magnitude().max() > _ANGLE:
        return WRONG, "orientation"
    moved = pose.position - pose.position.mean(axis=0)
    truth = yaw.apply(log.position[rows] - log.position[rows].mean(axis=0))
    if np.ptp(pose.position) > 0.0 and np.abs(moved - truth).max() > _PLACE_M:
        return WRONG, "position"
    return _judge_wrench(log, recording, yaw)


def _judge_wrench(log: WristLog, recording: Recording, yaw: Rotation) -> tuple[str, str]:
    contacts = list(recording.streams.contacts.values())
    time = contacts[0].time
    inside = (time > 0.1) & (time < log.time[-1] - 0.1)
    total = np.sum([c.force for c in contacts], axis=0)[inside]
    truth = _at(log.time, yaw.apply(log.world_force), time[inside])
    if np.sqrt(np.mean((total - truth) ** 2)) > 3.0 * _FORCE_N:
        return WRONG, "force"
    if len(contacts) == 1:
        torque = _at(log.time, yaw.apply(log.world_torque), time[inside])
        if np.sqrt(np.mean((contacts[0].torque[inside] - torque) ** 2)) > 3.0 * _TORQUE_NM:
            return WRONG, "torque"
    return RIGHT, ""


def _at(stamps: np.ndarray, values: np.ndarray, time: np.ndarray) -> np.ndarray:
    return np.stack([np.interp(time, stamps, column) for column in values.T], axis=1)


def _judge_static(log: WristLog, recording: Recording) -> tuple[str, str]:
    """Compare the mean of each hold with its row."""
    pose, wrist = recording.streams.pose, recording.streams.contacts["wrist"]
    assert pose is not None
    rows = len(log.time)
    if len(pose.time) % rows:
        return WRONG, "rows"
    each = len(pose.time) // rows
    turned = Rotation.from_matrix(pose.rotation[::each])
    yaw = (turned * log.rotation.inv()).mean()
    if (turned.inv() * yaw * log.rotation).magnitude().max() > _ANGLE:
        return WRONG, "orientation"
    for measured, truth, least in (
        (wrist.force, log.force, _FORCE_N),
        (wrist.torque, log.torque, _TORQUE_NM),
    ):
        own = Rotation.from_matrix(pose.rotation).inv().apply(measured)
        if np.abs(own.reshape(rows, each, 3).mean(axis=1) - truth).max() > least:
            return WRONG, "wrench"
    return RIGHT, ""


def run(layouts: Mapping[str, Layout], seeds: range) -> dict[str, list[tuple[str, str]]]:
    """Judge each layout on each seed."""
    verdicts: dict[str, list[tuple[str, str]]] = {}
    for name, layout in layouts.items():
        for seed in seeds:
            with tempfile.TemporaryDirectory() as folder:
                verdict = judge_layout(name, layout, seed, Path(folder))
            verdicts.setdefault(name, []).append(verdict)
    return verdicts


def main(arguments: list[str] | None = None) -> None:
    """Print how often each layout is read right, asked about, or read wrong."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=5, help="logs per layout")
    parser.add_argument("--first", type=int, default=0, help="first seed")
    options = parser.parse_args(arguments)
    seeds = range(options.first, options.first + options.seeds)
    groups = {
        "seen while the guess was written": LAYOUTS,
        "written after it": UNSEEN,
        "that no guess can read: it has to ask": UNTOLD,
    }
    for title, layouts in groups.items():
        print(f"\n{title} ({len(layouts)} layouts, {options.seeds} logs each)")
        _print_verdicts(run(layouts, seeds))


def _print_verdicts(verdicts: Mapping[str, list[tuple[str, str]]]) -> None:
    total: Counter[str] = Counter()
    for name, found in verdicts.items():
        counts = Counter(verdict for verdict, _ in found)
        total += counts
        reasons = {reason for _, reason in found if reason}
        print(f"{name:24s} {_counts(counts)}  {' | '.join(sorted(reasons))[:160]}")
    print(f"{'all':24s} {_counts(total)}")


def _counts(counts: Counter[str]) -> str:
    return "  ".join(f"{verdict} {counts[verdict]:3d}" for verdict in (RIGHT, ASKS, WRONG))
