"""A table that begins to lean, or changes otherwise, many times: when it is noticed.

Beside it stand, for leans, a likelihood ratio that knows all and the raw likelihood of a filter.

Pushes on the simulated table go through the same filter and statistic as live ones. What is known
of the object is drawn around the truth with the spread of a fit to five pushes, because fits take
ten times as long as all the rest. Rows are kept in a file: a run that is cut goes on.
"""

from __future__ import annotations

import argparse
import json
import sys
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.explore.changes import SIZES, Watched
from benchmarks.kept import read_rows
from benchmarks.peers.raw_likelihood import RawLikelihood
from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.planar.filter.change import ChangeMonitor
from tactile_dynamics_ros.core.planar.filter.patch import PatchProcess
from tactile_dynamics_ros.sim.objects import planar_object
from tactile_dynamics_ros.sim.planar.simulated_table import SimulatedTableConfig

FIT_STD = np.array([0.05, 0.2, 1e-3, 1e-3])
"""Of ln friction force, ln mass and centre of mass, m: what fits to five pushes state."""
SOON = 3.0
"""s of touch within which a lean should be noticed."""
ENOUGH = 3.5
"""s of touch after the change, at most."""
TRIALS = 18000.0
"""Pieces in an hour of touch: the bound has the same rate of false alarms as the statistic."""
OBJECTS = (4, 5, 6, 7, 18, 21, 34, 121, 123, 129)
"""Of one part, with friction below 0.25; the statistic was made on recordings of 124."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the section's options."""
    parser.add_argument("--leaning", type=int, nargs="+", default=list(OBJECTS), help="objects")
    parser.add_argument("--lean-seeds", type=int, nargs="+", default=[811, 812], help="of each")
    parser.add_argument("--lean-spreads", type=float, nargs="+", default=[0.05], help="of friction")
    parser.add_argument("--begins", nargs="+", default=["support_tilt"], help="hidden effects")
    parser.add_argument("--lean-clean", type=int, default=4, help="clean pushes before")
    parser.add_argument("--lean-rows", type=Path, default=Path("out/explore_detection.jsonl"))


def measure(options: argparse.Namespace) -> dict[str, Any]:
    """One row for each object, seed and spread; those in the file are not made again."""
    path: Path = options.lean_rows
    path.parent.mkdir(parents=True, exist_ok=True)
    rows = read_rows(path)
    done = {(row["effect"], row["spread"], row["seed"], row["object"]) for row in rows}
    cases = product(options.begins, options.lean_spreads, options.lean_seeds, options.leaning)
    for case in list(cases)[: 1 if options.quick else None]:
        if case in done:
            continue
        rows.append(_row(*case, options.lean_clean))
        with path.open("a") as file:
            file.write(json.dumps(rows[-1]) + "\n")
        print(json.dumps(_brief(rows[-1])), file=sys.stderr, flush=True)
    return {"rows": rows}


class Witness:
    """Shows one filter to two monitors: one that knows what a fit knows, and one the truth.

    Attributes:
        touch: s so far. told: touch and statistic of the first, at each of its pieces.
        pieces: touch, lack and expected force (N), with friction, of the second. alarms: touch.
    """

    def __init__(self, outline: Array, truth: Array, rng: np.random.Generator) -> None:
        self.monitors = [ChangeMonitor(PatchProcess(outline)) for _ in range(2)]
        self.mean = truth + FIT_STD * rng.standard_normal(4)
        self.monitors[0].refer(self.mean, np.diag(FIT_STD**2))
        self.monitors[1].refer(truth, 1e-8 * np.eye(4))
        self.touch = 0.0
        self.told: list[tuple[float, float]] = []
        self.pieces: list[list[float]] = []
        self.alarms: list[float] = []

    def see(self, time: float, state: Any, motion: Any, measured: Any, poses: Any) -> None:
        """Take a step."""
        self.touch += motion.step
        self._shown(lambda monitor: monitor.see(time, state, motion, measured, poses))

    def release(self, time: float) -> None:
        """Note the end of a touch."""
        self._shown(lambda monitor: monitor.release(time))

    def _shown(self, show: Any) -> None:
        before = [monitor.pieces[-1] if monitor.pieces else None for monitor in self.monitors]
        for monitor in self.monitors:
            show(monitor)
        first, second = self.monitors
        if first.pieces and first.pieces[-1] is not before[0] and first.change is not None:
            self.told.append((self.touch, first.change.statistic))
            if first.change.alarmed:
                self.alarms.append(self.touch)
        if second.pieces and second.pieces[-1] is not before[1]:
            piece = second.pieces[-1]
            self.pieces.append([self.touch, *piece.lack, *piece.expected])


def _row(effect: str, spread: float, seed: int, number: int, clean: int) -> dict[str, Any]:
    watched = Watched(
        SimulatedTableConfig(
            seed=seed, object_number=number, hidden_effect=effect,
            hidden_magnitude=SIZES.get(effect, 1.35),
            hidden_waits=True, friction_spread=spread, vision_rate_hz=30.0, depth_rate_hz=0.0,
        )
    )  # fmt: skip
    part = planar_object(number).parts[0]
    truth = np.array([np.log(part.mass * part.friction), np.log(part.mass), *part.com])
    tracker = watched.live.tracker
    assert tracker is not None
    try:
        watched.push()
        assert tracker.filter is not None
        witness = Witness(watched.table.outlines[0].corners, truth, np.random.default_rng(seed))
        tracker.filter.inform(witness.mean, np.diag(FIT_STD**2))
        likelihood = RawLikelihood(tracker.filter)
        tracker.watch = witness  # type: ignore[assignment]
        for _ in range(clean):
            watched.push()
        row: dict[str, Any] = {
            "effect": effect, "object": number, "seed": seed, "spread": spread,
            "friction": part.friction,
            "newtons": 9.81 * part.mass * part.friction, "clean_s": witness.touch,
            "clean_alarms": len(witness.alarms), "clean_logs": len(likelihood.logs),
            "clean_told": len(witness.told), "clean_pieces": len(witness.pieces),
        }  # fmt: skip
        watched.table.begin()
        while witness.touch < row["clean_s"] + ENOUGH:
            watched.push()
        row["truth"] = watched.table.reveal()["hidden_effect"]["parameters"]
        if effect == "support_tilt":
            angle, way = (row["truth"][key]["value"] for key in ("angle", "direction"))
            row["lean_n"] = (9.81 * part.mass * np.sin(angle) * np.array(way)).tolist()
        rounded = {"told": witness.told, "pieces": witness.pieces}
        row |= {key: np.round(rows, 4).tolist() for key, rows in rounded.items()}
        return row | {"logs": np.round(likelihood.logs, 2).tolist()}
    finally:
        watched.table.world.close()


def _brief(row: dict[str, Any]) -> dict[str, Any]:
    """What a person wants to see of a row."""
    keys = ("effect", "object", "seed", "spread", "clean_s", "clean_alarms")
    most = max((value for _, value in row["told"][: row["clean_told"]]), default=0.0)
    return {key: row[key] for key in keys} | {"clean_most": most, "after_s": delay(row)}


def delay(row: dict[str, Any]) -> float | None:
    """Touch, s, after which the statistic told the lean; None if it did not."""
    threshold = ChangeMonitor(PatchProcess(np.eye(3, 2))).threshold
    after = row["told"][row["clean_told"] :]
    return next((at - row["clean_s"] for at, value in after if value > threshold), None)


def bound_delay(row: dict[str, Any], noise: Array) -> float | None:
    """Touch, s, after which a likelihood ratio tells it that knows object, lean and noise.

    CUSUM of ln p(lack | lean) - ln p(lack | none), up to ln of the pieces in an hour.

    Args:
        row: of a case.
        noise: (2, 2) covariance of a clean piece's lack along and across its force, over friction.
    """
    total = 0.0
    for at, lack, expected in _turned(row)[row["clean_pieces"] :]:
        lean = -_share(np.array(row["lean_n"]), expected, row["newtons"])
        white = np.linalg.solve(noise, lean)
        total = max(0.0, total + float(white @ lack - 0.5 * white @ lean))
        if total > np.log(TRIALS):
            return at - float(row["clean_s"])
    return None


def peer_delay(row: dict[str, Any], least: float) -> float | None:
    """Touch, s, after which the mean likelihood of a second is below a threshold."""
    below = np.flatnonzero(_seconds(row["logs"][row["clean_logs"] - 100 :]) < least)
    return None if len(below) == 0 else 0.01 * float(below[0])


def _seconds(logs: list[float]) -> Array:
    """Mean likelihood of each second of touch."""
    return np.convolve(np.exp(logs), np.full(100, 0.01), "valid")


def _turned(row: dict[str, Any]) -> list[tuple[float, Array, Array]]:
    """Touch, lack along and across the expected force over friction, and that force, of pieces."""
    rows = [(r[0], np.array(r[1:3]), np.array(r[3:5])) for r in row["pieces"]]
    return [(at, _share(lack, force, row["newtons"]), force) for at, lack, force in rows]


def _share(lack: Array, expected: Array, newtons: float) -> Array:
    way = expected / np.linalg.norm(expected)
    return np.array([lack @ way, way[0] * lack[1] - way[1] * lack[0]]) / newtons


def clean_noise(rows: list[dict[str, Any]]) -> Array:
    """Covariance (2, 2) of clean pieces, along and across, over the friction."""
    lacks = [lack for row in rows for _, lack, _ in _turned(row)[: row["clean_pieces"]]]
    return np.asarray(np.mean([np.outer(lack, lack) for lack in lacks], axis=0))


def least_clean(rows: list[dict[str, Any]]) -> float:
    """Lowest mean likelihood of a second of clean touch."""
    logs = [row["logs"][: row["clean_logs"]] for row in rows if row["clean_logs"] >= 100]
    return float(min(_seconds(each).min() for each in logs))


def table(found: dict[str, Any]) -> str:
    """What is noticed soon, by the statistic, the bound and the peer."""
    lines = [
        "| begins | friction differs by | n | clean touch s, false alarms | by | within 3 s "
        "| median s |",
        "|---|---|---|---|---|---|---|",
    ]
    for effect, spread in sorted({(row["effect"], row["spread"]) for row in found["rows"]}):
        rows = [r for r in found["rows"] if (r["effect"], r["spread"]) == (effect, spread)]
        clean = sum(row["clean_s"] for row in rows)
        alarms = sum(row["clean_alarms"] > 0 for row in rows)
        for k, (name, delays) in enumerate(_delays(effect, rows).items()):
            soon = sum(each is not None and each <= SOON for each in delays)
            middle = float(np.median([np.inf if each is None else each for each in delays]))
            told = f"{clean:.0f}, {alarms}" if k == 0 else ""
            lines.append(
                f"| `{effect}` | {spread:g} | {len(rows)} | {told} | {name} | {soon} "
                f"| {middle:.1f} |"
            )
    return "\n".join(lines)


def _delays(effect: str, rows: list[dict[str, Any]]) -> dict[str, list[float | None]]:
    ways = {"the statistic": [delay(row) for row in rows]}
    if effect != "support_tilt":
        return ways
    noise, least = clean_noise(rows), least_clean(rows)
    told = "likelihood ratio that knows object, lean and noise"
    ways[told] = [bound_delay(row, noise) for row in rows]
    ways["raw likelihood, no clean second of these is lower"] = [
        peer_delay(row, least) for row in rows
    ]
    return ways
