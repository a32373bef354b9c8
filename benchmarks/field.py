"""Advice that is followed blindly: is the load right in the end, and after how many steps?"""

from __future__ import annotations

import argparse
import json
import re
import sys
import tempfile
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from operator import itemgetter
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.effects.product import Answer, ask_command
from benchmarks.field_cases import (
    CORRUPTIONS,
    FAULTS,
    STATIC_FAULTS,
    ZERO,
    Log,
    corrupted,
    draw_change,
    draw_log,
    draw_static,
    heavier,
    opened,
    write_log,
)
from benchmarks.kept import continued

FIRST_SEED = 100
"""First seed of a report; those below were used while the product was written."""
RECORDS = Path("out/bench_field/records.jsonl")
_STEPS = 4
"""Advice that is followed at most before somebody gives up."""
_WITHIN_STD, _WITHIN_SHARE = 3.0, 0.005
"""Error of a mass that is right: 3 standard deviations, or half a percent."""
_SAY = re.compile(r"--say (?:'([^']+)'|(\S+?)[;,.)]?(?:\s|$))")

Maker = Callable[[int], Log]


@dataclass(frozen=True)
class Case:
    """A kind of table.

    Attributes:
        kind: name.
        make: draws the log of a seed.
        names: of conventions, effects and events one of which is to be named; none if it is right
            as soon as it is imported.
        guessed: whether `import guess` finds the columns; else a mapping of plain columns is
            written and `diagnose` has to find what is wrong.
        torque: whether torques are written.
    """

    kind: str
    make: Maker
    names: tuple[str, ...] = ()
    guessed: bool = True
    torque: bool = True


def _wrong(name: str, zero: np.ndarray, draw: Callable[..., Log]) -> Maker:
    return lambda seed: corrupted(draw(seed, zero), CORRUPTIONS[name], seed)


def _faulty(corrupt: Any, draw: Callable[..., Log]) -> Maker:
    return lambda seed: corrupted(draw(seed), corrupt, seed)


_MOVING_ONLY = ("torque_in_n_cm", "world_mirrored", "inverse_pose", "quaternion_order")
"""Mistakes that a table of static poses does not have or show."""
_CONVENTION = {
    "force_mirrored": "mirrored_axes",
    "torque_mirrored": "mirrored_axes",
    "world_mirrored": "mirrored_axes",
    "inverse": "inverse_rotation",
    "gravity": "gravity_direction",
    "base": "gravity_tilt",
    "sensor_turned_90": "sensor_axes",
    "sensor_turned_37": "sensor_rotation",
    "forces_in_world": "world_axes",
    "torque_in": "torque_unit",
}
"""Names that are right, by the beginning of a kind."""


_EXPECTED = {"low_pass_10_hz": ("sensor_lag",), "zeroed": ("sensor_zeroed",)}
"""Effects and events that are behind a fault."""


def _names_of(kind: str) -> tuple[str, ...]:
    return tuple({name for start, name in _CONVENTION.items() if kind.startswith(start)}) or (kind,)


def _cases() -> list[Case]:
    """All kinds; others add theirs here."""
    zeros = (("", ZERO), ("_no_zero", 0.0 * ZERO))
    found = [
        Case(name + end, _wrong(name, zero, draw_log))
        for name in CORRUPTIONS
        for end, zero in zeros
    ]
    found += [
        Case(f"static_{name}", _wrong(name, ZERO, draw_static))
        for name in CORRUPTIONS
        if not name.startswith(_MOVING_ONLY)
    ]
    found += [
        Case(f"recorded_{name}{end}", _wrong(name, zero, draw_log), _names_of(name), False)
        for name in CORRUPTIONS
        for end, zero in zeros
    ]
    found += [
        Case(name, _faulty(corrupt, draw_log), _EXPECTED.get(name, ()))
        for name, corrupt in FAULTS.items()
    ]
    found += [Case(name, _faulty(corrupt, draw_static)) for name, corrupt in STATIC_FAULTS.items()]
    found += [
        Case("no_torque", draw_log, torque=False),
        Case(
            "payload_change",
            lambda seed: draw_change(seed, heavier, (7.0, 7.0)),
            ("payload_change",),
        ),
        Case(
            "gripper_opens",
            lambda seed: draw_change(seed, opened, (9.0, 10.0)),
            ("payload_change", "grasp_shift"),
        ),
    ]
    return found


CASES = _cases()
"""Kinds that are asked about; one line each."""


def ask(case: Case, seed: int) -> dict[str, Any]:
    """Draw a log, follow what the command says, and grade the end."""
    log = case.make(seed)
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        table = write_log(log, folder / "log.csv", case.torque)
        found = follow(table, folder / "log.yaml", folder / "log.mcap", case.guessed)
    found["outcome"] = _grade(found, log, case)
    return {"kind": case.kind, "seed": seed, "truth": [load.mass for load in log.load], **found}


def follow(table: Path, mapping: Path, bag: Path, guessed: bool) -> dict[str, Any]:
    """Do what the command says, one step after the other; what came out and how many steps."""
    said: list[str] = []
    if guessed:
        answer = _guess(table, mapping, said)
        if answer.code:
            return {"attempts": len(said), "code": answer.code, "said": answer.complaint}
    else:
        mapping.write_text(_PLAIN)
    ask_command(["import", "csv", str(mapping), str(bag)])
    effects, read = list[str](), list[str]()
    document: dict[str, Any] = {}
    for _ in range(_STEPS):
        answer = ask_command(["diagnose", str(bag), *_options(effects, read)])
        document = answer.json or {}
        name = document.get("effect") or (document.get("convention") or {}).get("name")
        if name is None or name in (*effects, *read):
            break
        (read if document["verdict"] == "convention" else effects).append(name)
    answer = ask_command(["estimate", str(bag), *_options(effects, read)])
    return {
        "attempts": max(1, len(said) + len(read)),
        "code": answer.code,
        "said": answer.complaint[-200:],
        "verdict": document.get("verdict"),
        "named": [*read, *effects],
        "mass": (answer.json or {}).get("mass"),
    }


def _guess(table: Path, mapping: Path, said: list[str]) -> Answer:
    """Guess a mapping; questions are answered with the words that they print."""
    while True:
        words = [part for one in said for part in ("--say", one)]
        answer = ask_command(["import", "guess", str(table), "--out", str(mapping), *words])
        proposed = _SAY.search(answer.complaint)
        if answer.code == 0 or proposed is None or len(said) == _STEPS:
            return answer
        said.append(proposed.group(1) or proposed.group(2))


def _options(effects: Sequence[str], read: Sequence[str]) -> list[str]:
    named = ["--effects", ",".join(effects)] if effects else []
    return [*named, *(part for name in read for part in ("--assume", name))]


def _grade(found: dict[str, Any], log: Log, case: Case) -> str:
    """One of right, asks, exit3-named, exit3, doubts, unnamed (mass right) and confident-wrong."""
    if found["code"] == 2:
        return "asks"
    plain = {label.partition("[")[0] for label in found["named"]}  # of an event, without its time
    named = not case.names or bool(set(case.names) & plain)
    if found["code"] == 3:
        return "exit3-named" if named else "exit3"
    mass = found["mass"]
    near = max(_WITHIN_STD * mass["std"], _WITHIN_SHARE * mass["value"])
    if any(abs(mass["value"] - load.mass) < near for load in log.load):
        return "right" if named else "unnamed"
    return "confident-wrong" if found["verdict"] in ("adequate", "missing_effect") else "doubts"


def describe(records: Sequence[dict[str, Any]]) -> str:
    """A line per kind, and the sums."""
    lines = []
    for kind in dict.fromkeys(r["kind"] for r in records):
        rows = [r for r in records if r["kind"] == kind]
        outcomes = ", ".join(
            f"{n} {what}" for what, n in Counter(r["outcome"] for r in rows).items()
        )
        most = max(r["attempts"] for r in rows)
        lines.append(f"{kind:32s} {outcomes}; steps at most {most}")
    total = Counter(r["outcome"] for r in records)
    once = sum(r["attempts"] <= 1 for r in records)
    return "\n".join([*lines, f"{dict(total)}, n = {len(records)}; one step for {once}"])


def main(arguments: Sequence[str] | None = None) -> int:
    """Run what is missing, print a line per kind."""
    parser = argparse.ArgumentParser(prog="bench field", description=__doc__)
    parser.add_argument("--json", action="store_true", help="print only JSON on stdout")
    parser.add_argument("--start", type=int, default=FIRST_SEED, help="first seed")
    parser.add_argument("--seeds", type=int, default=5, help="tables per kind")
    parser.add_argument("--only", nargs="*", default=[], metavar="KIND", help="beginnings of kinds")
    parser.add_argument("--records", type=Path, default=RECORDS, help="file that is continued")
    options = parser.parse_args(arguments)
    chosen = [c for c in CASES if not options.only or c.kind.startswith(tuple(options.only))]
    seeds = range(options.start, options.start + options.seeds)
    records = _run([(case, seed) for seed in seeds for case in chosen], options.records)
    print(json.dumps(records) if options.json else describe(records))
    return 0


def _run(tasks: Sequence[tuple[Case, int]], path: Path) -> list[dict[str, Any]]:
    """Answers of tasks; those that a file has are not asked again."""

    def answer(missing: list[int]) -> Iterator[dict[str, Any]]:
        for k in missing:
            yield (found := ask(*tasks[k]))
            print(found, file=sys.stderr, flush=True)

    keys = [(case.kind, seed) for case, seed in tasks]
    return continued(path, keys, itemgetter("kind", "seed"), answer)


_PLAIN = """\
contact_frame: object
object_pose:
  file: log.csv
  time: {columns: t}
  position: {columns: [x, y, z]}
  quaternion: {columns: [qx, qy, qz, qw]}
contacts:
  wrist:
    file: log.csv
    time: {columns: t}
    force: {columns: [fx, fy, fz], scale: -1}
    torque: {columns: [tx, ty, tz], scale: -1}
    position: [0.0, 0.0, 0.0]
    rotation: [1, 0, 0, 0, 1, 0, 0, 0, 1]
"""
"""A mapping that takes the columns of `write_log` by their names."""
