"""Run cases, one JSON line each, so that a stopped benchmark goes on where it was."""

from __future__ import annotations

import multiprocessing
import os
import sys
import tempfile
import time
import traceback
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from operator import itemgetter
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.effects.cases import Case
from benchmarks.effects.product import Answer, Ask, ask_command
from benchmarks.kept import continued
from benchmarks.support.planned import record_plan
from tactile_dynamics_ros.synthetic.calibration import excess_by_channel, excess_rms
from tactile_dynamics_ros.synthetic.recordings import HiddenRecording, write_bag


def run_case(case: Case, ask: Ask = ask_command) -> dict[str, Any]:
    """Make the recording, ask the product about it and return both, ready for JSON."""
    recording = case.record()
    record: dict[str, Any] = {"key": case.key, **vars(case), "truth": recording.truth()}
    record["axes_told"] = case.axes_told
    record["reached"] = [
        float(np.hypot(1.0, excess_rms(effect, recording.scenario, case.sensors())))
        for effect in recording.effects
    ]
    with tempfile.TemporaryDirectory() as folder:
        bag = str(write_bag(recording.streams, Path(folder) / "recording"))
        if case.kind == "pair":
            record["explain"] = _plain(ask(["explain", bag]))
        else:
            record["diagnose"] = _plain(ask(["diagnose", bag]))
        if case.kind == "outside":
            record["carried"] = _carried(case, recording)
        if case.kind == "clean":
            record["compare"] = _plain(ask(["compare", bag]))
        if case.kind in ("single", "calm"):
            record["estimates"] = _estimates(case.effects[0], record["diagnose"], bag, ask)
            record["separated"] = _separate(case, recording, record["diagnose"], folder, ask)
    return record


def _carried(case: Case, recording: HiddenRecording) -> dict[str, list[float]]:
    """How much each channel carries of the hidden effect, by frame."""
    [effect] = recording.effects
    found = excess_by_channel(effect, recording.scenario, case.sensors())
    return {frame: values.tolist() for frame, values in found.items()}


def _separate(
    case: Case, recording: HiddenRecording, asked: dict[str, Any], folder: str, ask: Ask
) -> dict[str, Any] | None:
    """Do the motion that a diagnosis proposes, and diagnose both recordings together."""
    plan = (asked["json"] or {}).get("separating_motion")
    if not plan:
        return None
    second = record_plan(recording, plan, case.sensors())
    bag = str(write_bag(second.streams, Path(folder) / "second"))
    return _plain(ask(["diagnose", str(Path(folder) / "recording"), bag]))


def run_all(cases: Sequence[Case], path: Path, workers: int) -> list[dict[str, Any]]:
    """Run the cases that the file does not hold yet; return all records of these cases."""

    def answer(missing: list[int]) -> Iterator[dict[str, Any]]:
        _limit_threads()
        begin = time.monotonic()
        with ProcessPoolExecutor(workers, multiprocessing.get_context("spawn")) as pool:
            futures = [pool.submit(_run_safely, cases[k]) for k in missing]
            for count, future in enumerate(as_completed(futures), start=1):
                yield (record := future.result())
                _show_progress(count, len(missing), begin, record["key"])

    return continued(path, [case.key for case in cases], itemgetter("key"), answer)


def named_effects(diagnosis: dict[str, Any]) -> list[str]:
    """The effect and the group that a diagnosis names, the first choice first."""
    names = [diagnosis.get("effect"), *(diagnosis.get("group") or [])]
    return list(dict.fromkeys(name for name in names if name))


def _estimates(effect: str, asked: dict[str, Any], bag: str, ask: Ask) -> dict[str, Any]:
    """Refit with the true effect and every member of an ambiguous group, as they were read."""
    diagnosis = asked["json"] or {}
    names = named_effects(diagnosis)
    if effect not in names:
        return {}
    members = names if diagnosis.get("verdict") == "ambiguous" else [effect]
    readings = {entry["name"]: entry.get("reading") for entry in diagnosis.get("candidates") or []}
    return {
        name: _plain(ask(["estimate", bag, "--effects", readings.get(name) or name]))
        for name in members
    }


def _plain(answer: Answer) -> dict[str, Any]:
    return vars(answer).copy()


def _run_safely(case: Case) -> dict[str, Any]:
    try:
        return run_case(case)
    except Exception:
        return {"key": case.key, **vars(case), "crash": traceback.format_exc(limit=8)}


def _limit_threads() -> None:
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ.setdefault(name, "1")


def _show_progress(count: int, total: int, begin: float, key: str) -> None:
    left = (time.monotonic() - begin) / count * (total - count)
    filled = round(30 * count / total)
    bar = "#" * filled + "." * (30 - filled)
    line = f"\r[{bar}] {count}/{total}, {left / 60:.0f} min left, {key[:40]:40s}"
    print(line, end="\n" if count == total else "", file=sys.stderr, flush=True)
