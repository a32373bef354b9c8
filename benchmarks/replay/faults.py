"""What faults of topics, clocks, sensors, calls and arguments do to the nodes, one at a time."""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from benchmarks.replay.command_faults import COMMAND_FAULTS
from benchmarks.replay.input_faults import INPUT_FAULTS
from benchmarks.replay.observations import Status, risen, said_text, wrong_time
from benchmarks.replay.player import NODES, replay
from benchmarks.replay.rig import TRUTH, Rig, Row
from benchmarks.replay.stream_faults import STREAM_FAULTS
from tactile_dynamics_ros.core.errors import TactileDynamicsError
from tactile_dynamics_ros.core.inertia.batch.inertial_estimate import PARAMETER_NAMES

CLEAN = "clean"
CLEAN_SECONDS = 30.0
REFERENCE_STD = np.array(
    [1.122e-4, 1.703e-5, 1.738e-5, 6.224e-5]  # mass, com
    + [1.755e-5, 3.478e-6, 1.169e-5, 6.708e-6, 4.199e-6, 1.803e-5]  # inertia
)
"""Standard deviations (10,) after 30 s of the clean recording, in the order of PARAMETER_NAMES, by
the nodes of commit 734e391, whose faults were not mended: `./dev bench faults --only clean --json`.
"""
WIDEST = 1.1
"""Intervals of the clean recording may be that much wider."""
PUBLISHED = 0.99
"""Share of the updates of the clean recording that have intervals."""
_FAULTS = {fault.name: fault for fault in (*STREAM_FAULTS, *INPUT_FAULTS)}
NAMES = (CLEAN, *_FAULTS, *COMMAND_FAULTS)


def main(arguments: Sequence[str] | None = None) -> int:
    """Inject the faults, print a row for each; the exit code is 1 if one is not as it must be."""
    options = _parse(arguments)
    rows: list[Row] = []
    with replay(NODES, logs=options.logs) as player:
        rig = Rig(player, options.speed, options.lead, options.seconds, not options.shared)
        for row in run_faults(rig, options.only or NAMES):
            if not options.json and not rows:
                print(HEADING)
            rows.append(row)
            if not options.json:
                print(describe(row), flush=True)
    if options.json:
        print(json.dumps([row.to_json() for row in rows]))
    else:
        print(f"{sum(not row.failures for row in rows)} of {len(rows)} are as they must be")
    return int(any(row.failures for row in rows))


def run_faults(rig: Rig, names: Sequence[str]) -> Iterator[Row]:
    """Yield the row of each named fault."""
    for name in names:
        try:
            yield run_fault(rig, name)
        except TactileDynamicsError as error:
            yield Row(name, died=rig.player.dead(), failures=[str(error)])


def run_fault(rig: Rig, name: str) -> Row:
    """Return the row of one fault."""
    if name == CLEAN:
        return run_clean(rig)
    if name in _FAULTS:
        return rig.run(_FAULTS[name])
    row = COMMAND_FAULTS[name](rig)
    row.name = name
    return row


def run_clean(rig: Rig, seconds: float = CLEAN_SECONDS) -> Row:
    """Replay the clean recording alone: everything published, right and as sure as ever."""
    begun = rig.prepare(0.0, forget=True)
    rig.play(rig.record(seconds))
    row = rig.judge(CLEAN, begun, begun + 1.0, rig.now)
    statuses = rig.player.heard.during(begun + 1.0, rig.now + 1e-6)
    row.said = sorted(risen(rig.player.heard.reports, begun, rig.now) | said_text(statuses))
    row.worst, row.wrong_s = wrong_time(statuses, TRUTH)
    widths = width_ratios(statuses[-1]) if statuses else {"": float("inf")}
    widest = max(widths, key=lambda name: widths[name])
    row.note = f"{len(statuses)} updates, {widest} {widths[widest]:.3f} times as wide"
    if row.died:
        row.failures.append(f"died: {', '.join(row.died)}")
    if row.said:
        row.failures.append("false alarm")
    if row.withheld > 1.0 - PUBLISHED:
        row.failures.append("withheld")
    if row.wrong_s > 0.0:
        row.failures.append(f"wrong for {row.wrong_s:.1f} s")
    if seconds == CLEAN_SECONDS and not widths[widest] <= WIDEST:
        row.failures.append("wider")
    return row


def width_ratios(status: Status) -> dict[str, float]:
    """Return the standard deviations over those of the reference, by parameter."""
    ratios = np.nan_to_num(status.std / REFERENCE_STD, nan=np.inf)
    return dict(zip(PARAMETER_NAMES, ratios.tolist(), strict=True))


HEADING = (
    f"{'fault':38s} {'':4s} {'worst z':>8s} {'>4 for':>7s} {'held':>5s} {'used':>5s} "
    f"{'named':>6s} {'after':>7s} {'level':>6s} {'error':>6s}  said; note; failures"
)


def describe(row: Row) -> str:
    """Return a line of the table."""
    after = "-" if row.after is None else f"{row.after:.1f}"
    named = "-" if row.named is None else f"{row.named:.1f} s"
    said = ", ".join(text[:70] for text in row.said[:4]) or "-"
    more = f" (+{len(row.said) - 4})" if len(row.said) > 4 else ""
    words = [said + more, row.note, "FAILS: " + ", ".join(row.failures) if row.failures else ""]
    return (
        f"{row.name:38s} {'-' if row.failures else 'ok':4s} {row.worst:8.1f} {row.wrong_s:5.1f} s "
        f"{100 * row.withheld:3.0f} % {100 * row.samples:3.0f} % {named:>6s} {after:>7s} "
        f"{row.level:>6s} {row.error:6.2f}  {'; '.join(word for word in words if word)}"
    )


def _parse(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="bench faults", description=__doc__)
    parser.add_argument("--only", nargs="+", choices=NAMES, metavar="NAME", help="these alone")
    parser.add_argument("--seconds", type=float, default=5.0, help="that a fault lasts")
    parser.add_argument("--lead", type=float, default=15.0, help="of clean data before, s")
    parser.add_argument("--speed", type=float, default=1.0, help="of the replay, 1 is real time")
    parser.add_argument("--shared", action="store_true", help="forget nothing between faults")
    parser.add_argument("--logs", type=Path, help="folder for the logs of the nodes")
    parser.add_argument("--json", action="store_true", help="print only JSON on stdout")
    parser.add_argument("--list", action="store_true", help="print the names of the faults")
    options = parser.parse_args(arguments)
    if options.list:
        print("\n".join(NAMES))
        parser.exit()
    return options
