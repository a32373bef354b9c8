"""Are mistaken units, signs, axes and orders found, and never where there are none?"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from operator import itemgetter
from pathlib import Path
from typing import Any

from benchmarks.effects.cases import STRONG, Case
from benchmarks.effects.product import ask_command
from benchmarks.kept import continued
from benchmarks.support.conventions import MISTAKES, OF_FINGERS, OF_IMU, mistaken
from benchmarks.support.tables import WristOptions, finger_table, wrist_table
from tactile_dynamics_ros.core.inertia.diagnosis.misreading import question
from tactile_dynamics_ros.recording import Recording
from tactile_dynamics_ros.synthetic import CATALOGUE

RECORDS = Path("out/bench_conventions/records.jsonl")
REPORT_START = 11
"""First seed of a report; 1 to 4 were used to tune."""
BESIDE = ("viscous_drag", "hanging_cable", "spinning_rotor", "unsensed_contact", "tether_spring")
"""Effects that are hidden beside a convention, in turn, and how large they are."""
SIZES = {"viscous_drag": 2.0, "hanging_cable": 2.0, "spinning_rotor": 3.0}
CLEAN_WRIST, CLEAN_FINGERS = 30, 30
SINGLE_LEVELS = (STRONG, 4.0)
SINGLE_SEEDS = 2


@dataclass(frozen=True)
class Task:
    """One recording: its kind, what is hidden in it, and the seed."""

    kind: str
    hidden: str
    seed: int
    beside: str = ""
    level: float = 0.0

    @property
    def key(self) -> str:
        """Name that no other task has."""
        return f"{self.kind}:{self.hidden}:{self.beside}:{self.level:g}:{self.seed}"


def plan(start: int, seeds: int, pairs: int, clean: int, singles: int) -> list[Task]:
    """All tasks: conventions alone, on fingers, with an effect, clean, and single effects."""
    span = range(start, start + seeds)
    tasks = [Task("wrist", name, seed) for seed in span for name in MISTAKES]
    tasks += [Task("clean", "wrist" if k % 2 else "finger", start + k) for k in range(clean)]
    tasks += [
        Task("single", name, 1000 + k, level=level)
        for level in SINGLE_LEVELS
        for k in range(singles)
        for name in CATALOGUE
    ]
    tasks += [
        Task("pair", name, seed, BESIDE[(seed + place) % len(BESIDE)])
        for seed in span[:pairs]
        for place, name in enumerate(MISTAKES)
    ]
    tasks += [Task("finger", name, seed) for seed in span for name in OF_FINGERS]
    return tasks


def run_task(task: Task) -> dict[str, Any]:
    """Make the recording, ask the command about it, and return what it says."""
    if task.kind == "single":
        return _search(task)
    with tempfile.TemporaryDirectory() as folder:
        bag = _write(task, Path(folder) / "recording")
        begin = time.perf_counter()
        answer = ask_command(["explain" if task.kind == "pair" else "diagnose", bag])
        seconds = time.perf_counter() - begin
    said = answer.json or {}
    convention = said.get("convention") or {}
    return {
        "key": task.key,
        **vars(task),
        "code": answer.code,
        "complaint": answer.complaint if not said else "",
        "verdict": said.get("verdict"),
        "effect": said.get("effect"),
        "effects": said.get("effects"),
        "groups": said.get("groups"),
        "error": said.get("error"),
        "name": convention.get("name"),
        "change": convention.get("change"),
        "others": convention.get("others") or [],
        "seconds": seconds,
    }


def _search(task: Task) -> dict[str, Any]:
    """Look for a convention where one effect is the cause, whatever the catalogue says of it."""
    case = Case("single", (task.hidden,), task.level, task.seed)
    begin = time.perf_counter()
    found = question(case.record().streams).convention()
    return {
        "key": task.key,
        **vars(task),
        "verdict": "convention" if found else "none",
        "name": found and found.name,
        "change": found and found.change,
        "others": [],
        "effect": None,
        "seconds": time.perf_counter() - begin,
    }


def _write(task: Task, path: Path) -> str:
    if task.kind == "clean":
        streams = _table(task.hidden, task.seed, "", imu=task.seed % 4 == 1).streams()
    else:
        hand = "finger" if task.kind == "finger" else "wrist"
        table = _table(hand, task.seed, task.beside, imu=task.hidden in OF_IMU)
        streams = mistaken(table, task.hidden, task.seed).streams()
    return str(Recording(streams, task.key, {}, 1_700_000_000_000_000_000).to_bag(path))


def _table(hand: str, seed: int, beside: str, imu: bool) -> Any:
    effects = ((beside, SIZES.get(beside, 1.0)),) if beside else ()
    if hand == "finger":
        return finger_table(seed, effects)[0]
    return wrist_table(seed, WristOptions(imu=imu, effects=effects))[0]


def grade(records: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """Rates by kind of recording."""
    by_kind: dict[str, list[dict[str, Any]]] = {}
    for record in records:
        by_kind.setdefault(record["kind"], []).append(record)
    summary: dict[str, Any] = {}
    for kind in ("wrist", "finger"):
        found = by_kind.get(kind, [])
        summary[kind] = {
            "count": len(found),
            "right_alone": _share([_is_right(r) and not r["others"] for r in found]),
            "right_first": _share([_is_right(r) for r in found]),
            "right_or_in_others": _share([_is_among(r) for r in found]),
            "wrong": [f"{r['key']} -> {_said(r)}" for r in found if not _is_among(r)],
        }
    pairs = by_kind.get("pair", [])
    summary["pair"] = {
        "count": len(pairs),
        "read_right_first": _share([_is_among(r) for r in pairs]),
        "effect_named_then": _share([_is_among(r) and _names_effect(r) for r in pairs]),
        "wrong": [
            f"{r['key']} -> {_said(r)}, {r['effects']}"
            for r in pairs
            if not (_is_among(r) and _names_effect(r))
        ],
    }
    for kind in ("clean", "single"):
        found = by_kind.get(kind, [])
        summary[kind] = {
            "count": len(found),
            "conventions": sum(bool(r["name"]) for r in found),
            "verdicts": dict(Counter(str(r["verdict"]) for r in found)),
            "wrong": [f"{r['key']} -> {_said(r)}" for r in found if r["name"]],
        }
    summary["crashes"] = [r["key"] for r in records if r["verdict"] is None]
    return summary


def _said(record: dict[str, Any]) -> str:
    other = record["effect"] or record["verdict"] or record["complaint"]
    return f"{record['name']} ({record['change']})" if record["name"] else str(other)


def _is_right(record: dict[str, Any]) -> bool:
    return bool(record["name"] == record["hidden"])


def _is_among(record: dict[str, Any]) -> bool:
    return record["hidden"] in (record["name"], *record["others"])


def _names_effect(record: dict[str, Any]) -> bool:
    named = set(record["effects"] or [])
    for members in (record["groups"] or {}).values():
        named |= set(members)
    return record["beside"] in named


def _share(values: list[bool]) -> float | None:
    return sum(values) / len(values) if values else None


def describe(summary: dict[str, Any]) -> str:
    """The summary for people, with what is required."""
    lines = []
    for kind, text in (("wrist", "17 conventions, wrist"), ("finger", "10 conventions, fingers")):
        found = summary[kind]
        lines.append(
            f"{text}: right or in others {_percent(found['right_or_in_others'])} (>= 90 %), "
            f"first {_percent(found['right_first'])}, alone {_percent(found['right_alone'])} "
            f"(>= 75 %), n = {found['count']}"
        )
    pair = summary["pair"]
    lines.append(
        f"with an effect: read right first {_percent(pair['read_right_first'])}, then the effect "
        f"{_percent(pair['effect_named_then'])} (>= 80 %), n = {pair['count']}"
    )
    for kind in ("clean", "single"):
        found = summary[kind]
        lines.append(
            f"{kind}: {found['conventions']} conventions (0), n = {found['count']}, "
            f"{found['verdicts']}"
        )
    for kind in ("wrist", "finger", "pair", "clean", "single"):
        lines += [f"  {text}" for text in summary[kind]["wrong"]]
    return "\n".join([*lines, f"crashes: {summary['crashes']}"])


def _percent(share: float | None) -> str:
    return "-" if share is None else f"{100 * share:.0f} %"


def main(arguments: Sequence[str] | None = None) -> int:
    """Run what is missing, grade everything, print."""
    parser = argparse.ArgumentParser(prog="bench conventions", description=__doc__)
    parser.add_argument("--json", action="store_true", help="print only JSON on stdout")
    parser.add_argument("--start", type=int, default=REPORT_START, help="first seed")
    parser.add_argument("--seeds", type=int, default=5, help="recordings per convention")
    parser.add_argument("--pairs", type=int, default=3, help="of these with an effect beside")
    parser.add_argument("--clean", type=int, default=CLEAN_WRIST + CLEAN_FINGERS)
    parser.add_argument("--singles", type=int, default=SINGLE_SEEDS, help="per effect and size")
    parser.add_argument("--only", nargs="*", help="kinds or conventions")
    parser.add_argument("--records", type=Path, default=RECORDS, help="file that is continued")
    options = parser.parse_args(arguments)
    tasks = plan(options.start, options.seeds, options.pairs, options.clean, options.singles)
    wanted = set(options.only or [])
    tasks = [task for task in tasks if not wanted or wanted & {task.kind, task.hidden}]
    records = _run(tasks, options.records)
    summary = grade(records)
    print(json.dumps(summary) if options.json else describe(summary))
    return 0


def _run(tasks: Sequence[Task], path: Path) -> list[dict[str, Any]]:
    def answer(missing: list[int]) -> Iterator[dict[str, Any]]:
        for k in missing:
            yield run_task(tasks[k])
            print(f"{k + 1}/{len(tasks)} {tasks[k].key}", file=sys.stderr, flush=True)

    return continued(path, [task.key for task in tasks], itemgetter("key"), answer)
