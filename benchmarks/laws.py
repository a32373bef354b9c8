"""Are laws that no catalogue has learnt, do they hold on a second recording, and else nothing?"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import replace
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.peers.laws import compare_peers
from benchmarks.support.laws import LAWS, NO_FORM, PUSHED_LAWS, draw_law, push, true_value
from tactile_dynamics_ros.api.discrepancies import Diagnosis
from tactile_dynamics_ros.api.questions import question_held
from tactile_dynamics_ros.api.reading import effects_of
from tactile_dynamics_ros.core.discrepancy.diagnosis import diagnose
from tactile_dynamics_ros.core.discrepancy.laws.documents import learn_file
from tactile_dynamics_ros.core.discrepancy.verdict.adequacy import noise_floor
from tactile_dynamics_ros.core.effects.registry import expand_files
from tactile_dynamics_ros.core.inertia.estimate import estimate
from tactile_dynamics_ros.core.planar.diagnosis.discrepancy_model import PushDiscrepancy
from tactile_dynamics_ros.recording import Recording
from tactile_dynamics_ros.synthetic import CATALOGUE
from tactile_dynamics_ros.synthetic.calibration import magnitude_for_whitened_rms
from tactile_dynamics_ros.synthetic.recordings import HiddenRecording, record
from tactile_dynamics_ros.synthetic.scenario import Scenario, ScenarioOptions

FIRST_SEED = 6800
"""Seeds from here on were not used for tuning (11 to 13 were)."""
LEVEL = 2.0
"""Whitened error to which each hidden effect would raise the model without it."""
WITHIN = 1.15
"""Error on a second recording over its floor up to which a law holds there."""


def make(name: str, seed: int, duration: float) -> tuple[HiddenRecording, HiddenRecording]:
    """Two recordings of one object and one hidden effect, along different motions.

    Args:
        name: of the hidden effect, empty for none.
        seed: of everything.
        duration: of each, s.
    """
    options = ScenarioOptions(duration=duration)
    first, other = Scenario.draw(seed, options), Scenario.draw(seed + 500_000, options)
    second = replace(first.moved(other.motion, first.options), seed=other.seed)
    hidden = []
    if name:
        effect = draw_law(name, seed, first)
        size = magnitude_for_whitened_rms(effect, LEVEL, first, None)
        hidden = [replace(effect, magnitude=size)]
    return record(first, tuple(hidden), None), record(second, tuple(hidden), None)


def ask(kind: str, name: str, seed: int, duration: float) -> dict[str, Any]:
    """Learn from the first recording, try on the second."""
    first, second = make(name, seed, duration)
    started = time.process_time()
    diagnosis = Diagnosis.of(question_held(Recording(first.streams, name)))
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"learnt_{name or 'clean'}_{seed}.yaml"
        middle = time.process_time()
        found = diagnosis.learn(path)
        law = found.document["law"]
        result = {
            "kind": kind, "name": name, "seed": seed, "verdict": diagnosis.verdict,
            "effect": diagnosis.effect, "form": law["form"] if law else None,
            "reason": found.document["nothing_learnt"],
            "diagnose_s": middle - started, "learn_s": time.process_time() - middle,
        }  # fmt: skip
        if law:
            result |= {"before": law["error"]["before"], "after": law["error"]["after"]}
            result |= {"others": [other["form"] for other in law["others"]]} | _graded(first, law)
            result |= _on_second(second, path)
    return result


def ask_peers(kind: str, name: str, seed: int, duration: float) -> dict[str, Any]:
    """What peers make of the residuals of the same recordings."""
    models = [
        question_held(Recording(one.streams, name)).model for one in make(name, seed, duration)
    ]
    return {"kind": kind, "name": name, "seed": seed, "peers": compare_peers(*models, seed)}


def ask_pushed(kind: str, name: str, seed: int, duration: float) -> dict[str, Any]:
    """The same of pushes; the second recording has other ones."""
    first, second = push(name, seed)
    started = time.process_time()
    model = PushDiscrepancy.of_streams(first)
    found = diagnose(model)
    middle = time.process_time()
    result: dict[str, Any] = {
        "kind": kind, "name": name, "seed": seed, "verdict": found.verdict, "effect": found.effect,
        "diagnose_s": middle - started,
    }  # fmt: skip
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"pushed_{name or 'clean'}_{seed}.yaml"
        document = learn_file(found, path)
        law, result["reason"] = document["law"], document["nothing_learnt"]
        result |= {"form": law["form"] if law else None, "learn_s": time.process_time() - middle}
        if law:
            form, parameter, value = PUSHED_LAWS.get(name, ("", "", None))
            entry = law["parameters"].get(parameter) if law["form"] == form else None
            inside = entry and abs(entry["value"] - value) <= 1.96 * entry["std"]
            bare = PushDiscrepancy.of_streams(second)
            known = PushDiscrepancy.of_streams(second, expand_files([*law["beside"], str(path)]))
            floor = noise_floor(known)
            errors = [float(np.sqrt(np.mean(m.residual**2)) / floor) for m in (bare, known)]
            result |= {"before": law["error"]["before"], "after": law["error"]["after"]}
            result |= {"form_right": law["form"] == form, "inside": inside, "off_std": np.nan}
            result |= dict(zip(("second_before", "second_after"), errors, strict=True))
            result |= {"others": [other["form"] for other in law["others"]]}
            result |= {"learnt": entry["value"], "std": entry["std"]} if entry else {}
    return result


def _graded(first: HiddenRecording, law: dict[str, Any]) -> dict[str, Any]:
    """Whether form and graded parameter are those of the truth."""
    effect = first.effects[0] if first.effects else None
    form, parameter, value = LAWS.get(effect.name if effect else "", ("", "", None))
    value = true_value(effect, parameter) if effect and value is None else value
    told = {"form_right": law["form"] == form, "inside": None}
    if law["form"] == form and value is not None:
        entry = law["parameters"][parameter]
        told |= {"learnt": entry["value"], "std": entry["std"], "true": value}
        told["inside"] = bool(abs(entry["value"] - value) <= 1.96 * entry["std"])
    return told


def _on_second(second: HiddenRecording, path: Path) -> dict[str, Any]:
    """Error over its floor on another recording with the law and without, mass and centre."""
    recording = Recording(second.streams, "second")
    bare = question_held(recording).model
    model = question_held(recording, effects_of(str(path))).model
    known = estimate(recording, effects_of(str(path))).to_estimate().to_json()
    body, mass, com = second.scenario.body, known["mass"], known["com"]
    off = [abs(mass["value"] - body.mass) / mass["std"]]
    off += list(np.abs(np.asarray(com["value"]) - body.com) / np.asarray(com["std"]))
    floor = noise_floor(model)
    return {
        "second_before": float(np.sqrt(np.mean(bare.residual**2)) / floor),
        "second_after": float(np.sqrt(np.mean(model.residual**2)) / floor),
        "off_std": float(max(off)),
    }


_ASK = {"pushed": ask_pushed, "pushed clean": ask_pushed, "peers": ask_peers}
"""What asks of a case by its kind; `ask` of all others."""
PEER_LAWS = ("charge_pull", "square_root_drag", "fading_pull")
"""Laws on which peers are compared: of place, of velocity and of time."""


def plan(start: int, each: int, clean: int, known: int) -> list[tuple[str, str, int]]:
    """All cases: kind, name and seed."""
    seeds = range(start, start + each)
    cases = [("law", name, seed) for seed in seeds for name in LAWS]
    cases += [("clean", "", start + k) for k in range(clean)]
    cases += [("pushed", name, seed) for seed in seeds for name in PUSHED_LAWS]
    cases += [("pushed clean", "", start + k) for k in range(clean // 5)]
    cases += [("no form", name, seed) for seed in seeds for name in NO_FORM]
    cases += [("peers", name, seed) for seed in seeds[:1] for name in PEER_LAWS]
    return cases + [("catalogue", name, start + k) for k in range(known) for name in CATALOGUE]


def summarise(found: Sequence[dict[str, Any]]) -> list[str]:
    """Lines of the page."""
    laws = [f for f in found if f["kind"] == "law"]
    learnt = [f for f in laws if f["form"]]
    inside = [f for f in learnt if f["inside"] is not None]
    holds = sum(f["second_after"] <= WITHIN for f in learnt)
    lines = [
        f"laws with a form: {len(learnt)} of {len(laws)} learnt, "
        f"{sum(f['form_right'] for f in learnt)} with the right form; on a second recording "
        f"{holds} of {len(laws)} within {WITHIN:g} of the floor",
        f"exponent, frequency or rate in its 95 % interval: "
        f"{sum(f['inside'] for f in inside)} of {len(inside)}; mass and centre within 3 std: "
        f"{sum(f['off_std'] <= 3.0 for f in learnt)} of {len(learnt)}",
    ]
    for one in (f for f in found if f["kind"] == "peers"):
        told = [
            f"{peer} {r['second_after']:.2f} times the floor, size {r['size']}, {r['cpu_s']:.0f} s"
            for peer, r in one["peers"].items()
        ]
        lines.append(f"peers on {one['name']} {one['seed']}, second recording: {'; '.join(told)}")
    own = [f for f in found if f["kind"] == "pushed"]
    learnt = [f for f in own if f["form"]]
    lines.append(
        f"pushed: {len(learnt)} of {len(own)} learnt, {sum(f['form_right'] for f in learnt)} with "
        f"the right form, {sum(bool(f['inside']) for f in learnt)} of "
        f"{sum(f['inside'] is not None for f in learnt)} in the interval; on a second recording "
        f"{sum(f['second_after'] <= WITHIN for f in learnt)} within {WITHIN:g} of the floor"
    )
    for kind in ("clean", "pushed clean", "no form", "catalogue"):
        own = [f for f in found if f["kind"] == kind]
        wrong = [f for f in own if f["form"]]
        names = ", ".join(f"{f['name']} {f['seed']}: {f['form']}" for f in wrong)
        lines.append(f"{kind}: {len(wrong)} of {len(own)} learnt a law {names}".rstrip())
    times = [f["learn_s"] for f in found if f.get("form")]
    if times:
        lines.append(f"time to learn: median {np.median(times):.0f} s, most {max(times):.0f} s CPU")
    return lines


def main(arguments: Sequence[str] | None = None) -> int:
    """Learn from all cases and print what was found."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--start", type=int, default=FIRST_SEED)
    parser.add_argument("--each", type=int, default=5, help="seeds of each effect outside")
    parser.add_argument("--clean", type=int, default=10)
    parser.add_argument(
        "--known", type=int, default=1, help="seeds of each effect of the catalogue"
    )
    parser.add_argument("--duration", type=float, default=30.0, help="of a recording, s")
    parser.add_argument("--only", default="", help="names of hidden effects, with commas")
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args(arguments)
    cases = plan(options.start, options.each, options.clean, options.known)
    wanted = [name for name in options.only.split(",") if name]
    found = []
    for case in (case for case in cases if not wanted or case[1] in wanted):
        # each in a process of its own: what one learns is no candidate of the next
        with get_context("spawn").Pool(1) as pool:
            found.append(pool.apply(_ASK.get(case[0], ask), (*case, options.duration)))
        print(json.dumps(found[-1]), file=sys.stderr, flush=True)
    print(json.dumps(found) if options.json else "\n".join(summarise(found)))
    return 0
