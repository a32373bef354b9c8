"""Learnt and physical models of pushing: one step ahead, and properties by a filter with each."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

from benchmarks.kept import kept
from benchmarks.planar import ahead, choice, choices, daily, noise, physics, speed
from benchmarks.planar.ablations import WAYS, Way
from benchmarks.planar.fit import fitted
from benchmarks.planar.scores import mean_interval, scored
from benchmarks.planar.trial import (
    INSIDE,
    SETTINGS,
    Population,
    filtered,
    simulated,
    truth_of,
)
from tactile_dynamics_ros.core.planar.filter.dual import DualConfig
from tactile_dynamics_ros.core.planar.filter.linked_patch import LinkedPatchProcess
from tactile_dynamics_ros.core.planar.filter.patch import PatchProcess
from tactile_dynamics_ros.core.planar.filter.process import Process
from tactile_dynamics_ros.core.planar.network.mechanics import expected_steps
from tactile_dynamics_ros.core.planar.network.process import GraphProcess
from tactile_dynamics_ros.core.planar.network.weights import (
    shipped_file,
    shipped_graph,
    shipped_networks,
)
from tactile_dynamics_ros.synthetic.pushed.objects import draw_object
from tactile_dynamics_ros.synthetic.pushed.transitions import cut_steps, describe

MODELS = {"single": ("patch", "graph_residual", "graph", "estimate"),
          "rigid_pair": ("patch", "graph"), "jointed": ("patch", "graph")}  # fmt: skip
"""Which models predict a family: the residual network knows one link. `estimate` is no filter but
the product's fit to whole recordings, whose model is the mechanics too."""
PLAIN = ("patch", "estimate")
"""Those that need no weights."""
SET = range(1, 121)
"""Seeds of the object set whose range normalises errors."""
_KEYS = tuple(f"{part}{link}" for link in (1, 2) for part in ("m", "f", "q", "com"))
"""Quantities whose errors over their std are collected."""
FIRST = 121
"""First seed of the test objects: networks are trained on seeds from 10000 on."""


@dataclass(frozen=True)
class Kept:
    """Results of an interrupted run, in a folder or, where there is none, nowhere."""

    folder: Path | None
    name: str

    def of(self, what: str, make: Callable[[], Any]) -> Any:
        """What was kept under a name, or else is made now."""
        return kept(self.folder and self.folder / f"{self.name}_{what}.pkl", make)


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure all families and print tables."""
    parser = argparse.ArgumentParser(prog="bench planar", description=__doc__)
    parser.add_argument("--families", nargs="+", choices=sorted(MODELS), default=list(MODELS))
    parser.add_argument("--models", nargs="+", default=list(MODELS["single"]))
    parser.add_argument("--setting", choices=sorted(SETTINGS), default="slow")
    parser.add_argument("--action", choices=("push", "pull"), default="push")
    parser.add_argument("--objects", type=int, default=12, help="test objects of each family (12)")
    parser.add_argument("--only", choices=(*WITHIN, *SECTIONS), help="one part only")
    parser.add_argument("--first", type=int, default=FIRST, help=f"seed of the first ({FIRST})")
    parser.add_argument("--seeds", type=int, default=5, help="of --only choices (5)")
    parser.add_argument("--keep", type=Path, help="folder from which an interrupted run goes on")
    parser.add_argument("--json", action="store_true", help="print only JSON on stdout")
    options = parser.parse_args(arguments)
    if options.seeds < 2:
        parser.error(f"--seeds {options.seeds}: expected at least 2, intervals are over seeds")
    found: dict[str, Any] = {}
    for name, (make, say) in SECTIONS.items():
        if options.only in (None, name):
            found[name] = make(options)
            if not options.json:
                print(say(found[name]), flush=True)
    for family in options.families if options.only in (None, *WITHIN) else ():
        found[family] = measure(family, options)
        if not options.json:
            print(table(family, found[family]), flush=True)
    if options.json:
        print(json.dumps(found))
    return 0


def models_of(family: str, options: argparse.Namespace) -> list[str]:
    """Models of a family that are asked for and, if learnt, shipped for this setting."""
    return [
        name
        for name in MODELS[family]
        if name in options.models
        and (name in PLAIN or shipped_file(name, options.setting).exists())
    ]


def measure(family: str, options: argparse.Namespace) -> dict[str, Any]:
    """All figures of a family."""
    ones, keep = recorded(family, options)
    names = models_of(family, options)
    found: dict[str, Any] = {"n": len(ones), "setting": options.setting, "action": options.action}
    if options.only != "filter":
        found["ahead"] = one_step(names, ones, options.setting, options.action)
    if options.only != "ahead":
        found["filter"] = properties(names, family, ones, options.setting, keep)
    return found


def recorded(family: str, options: argparse.Namespace) -> tuple[list[Any], Kept]:
    """Recordings of the test objects of a family, and where results on them are kept."""
    seeds = range(options.first, options.first + options.objects)
    pulls = "_pull" if options.action == "pull" else ""
    keep = Kept(options.keep, f"{family}_{options.setting}{pulls}_{seeds.start}_{seeds.stop}")
    make = partial(simulated, seeds, family, options.setting, options.action)
    return keep.of("pushes", make), keep


def one_step(names: list[str], ones: list[Any], setting: str, action: str) -> dict[str, Any]:
    """Errors of one step from exact states with true parameters."""
    objects = [cut_steps(one.scene, one.motion, SETTINGS[setting][0]) for one in ones]
    found = {"goes on": ahead.errors_of(ahead.still, objects)}
    for name in names:
        if name == "estimate" or (name == "patch" and objects[0][0].thing.links > 1):
            continue  # steps of many pushers at once are predicted for one link
        if name == "patch":
            found[name] = ahead.errors_of(expected_steps, objects)
        elif shipped_file(name, setting, action).exists():
            weights = shipped_graph(name, setting, action)
            found[name] = ahead.errors_of(ahead.network(weights), objects)
    return found


def choice_times(options: argparse.Namespace) -> dict[str, Any]:
    """Times of a choice of a push."""
    return choice.measure(range(options.first, options.first + options.objects))


def learnt(options: argparse.Namespace) -> dict[str, Any]:
    """Learning curves of pushes that are chosen, of the families that are asked for."""
    seeds = range(1, options.seeds + 1)
    kinds = [kind for kind in choices.KINDS if kind in options.families]
    return {
        f"{kind}, {how}": choices.measure(
            kind, seeds, Kept(options.keep, f"choices_{kind}").of, learnt=how
        )
        for kind in kinds
        for how in choices.SETS
    }


def untold(options: argparse.Namespace) -> dict[str, Any]:
    """What networks lose without the physical parameters, on the test objects of one part."""
    ones, keep = recorded("single", options)
    objects = [cut_steps(one.scene, one.motion, SETTINGS["slow"][0]) for one in ones]
    return physics.measure(objects, Kept(options.keep, f"physics_{keep.name}").of)


def untold_table(found: dict[str, Any]) -> str:
    """Rows of both networks, and how many times as large errors are."""
    said = {"setting": "slow", "action": "push"} | found
    rows = table("networks with and without physical parameters", said)
    return f"{rows}\nerrors without over those with: " + physics.ratios(found) + "\n"


def speeds(options: argparse.Namespace) -> dict[str, dict[str, float]]:
    """Times of a step of the filter with each model of a link and of two."""
    found = {}
    for family, names in MODELS.items():
        one = SimpleNamespace(scene=SimpleNamespace(thing=draw_object(FIRST, family)))
        for name in names:
            if name != "estimate":
                process = process_of(name, one, options.setting)
                found[f"{family}, {name}"] = speed.step_times(process, one.scene.thing)
    return found


def process_of(name: str, one: Any, setting: str) -> Process:
    """A model of one object."""
    thing = describe(one.scene.thing)
    if name == "patch":
        parts = tuple(
            PatchProcess(patch.outline, 0.5 * link.height)
            for patch, link in zip(thing.patches, one.scene.thing.links, strict=True)
        )
        return LinkedPatchProcess(parts, thing.joint, thing.rigid)
    return GraphProcess.of(thing, *shipped_networks(name, setting))


def properties(
    names: list[str], family: str, ones: list[Any], setting: str, keep: Kept
) -> dict[str, Any]:
    """NRMSE of estimates after all pushes, beside what is known without and from the product."""
    population = Population.of(family)
    truths = [truth_of(one.scene) for one in ones]
    ranges = ranges_of(family)
    links = len(ones[0].scene.thing.links)
    known = [
        population.given_product(np.array([t[f"q{k + 1}"] for k in range(links)])) for t in truths
    ]
    found: dict[str, Any] = {
        "prior mean": scored([population.means()] * len(ones), truths, ranges),
        "product known": scored(known, truths, ranges),
    }
    for name in names:

        def tell(k: int, name: str = name) -> dict[str, Any]:
            if name == "estimate":
                return fitted(population, ones[k])
            process = process_of(name, ones[k], setting)
            return filtered(process, population.prior(process), ones[k], setting, name, k)

        told = each_of(tell, len(ones), keep, name)
        found[name] = scored([t["values"] for t in told], truths, ranges)
        found[name] |= calibration(told)
    return found


def each_of(
    tell: Callable[[int], dict[str, Any]], count: int, keep: Kept, name: str
) -> list[dict[str, Any]]:
    """What is told of each recording, with progress."""
    told = []
    for k in range(count):
        told.append(keep.of(f"{name}_{k}", partial(tell, k)))
        print(f"\r{keep.name} {name} {k + 1}/{count}", end="", file=sys.stderr)
    print(file=sys.stderr)
    return told


def daily_objects(options: argparse.Namespace) -> dict[str, Any]:
    """Paper B's Table IV: the prior is the process's own, as in `property_estimator`."""
    keep = Kept(options.keep, f"daily_{options.setting}_{options.action}")
    things, population = daily.daily_things(), Population.of("single")
    make = partial(simulated, list(things), "single", options.setting, options.action, things)
    ones = keep.of("pushes", make)
    truths = [truth_of(one.scene) for one in ones]
    ranges = {name: float(np.ptp([t[name] for t in truths])) for name in truths[0]}
    rows = {n: scored(v, truths, ranges) for n, v in daily.baselines(population).items()}
    for name in models_of("single", options):

        def tell(k: int, name: str = name) -> dict[str, Any]:
            if name == "estimate":
                return fitted(population, ones[k])
            process = process_of(name, ones[k], options.setting)
            return filtered(process, process.prior, ones[k], options.setting, name, k)

        told = each_of(tell, len(ones), keep, name)
        rows[name] = scored([t["values"] for t in told], truths, ranges) | calibration(told)
    return {"n": len(ones), "setting": options.setting, "action": options.action, "filter": rows}


def ablated(options: argparse.Namespace) -> dict[str, Any]:
    """The filter on the mechanics of one part, with single decisions undone."""
    ones, keep = recorded("single", options)
    population, truths = Population.of("single"), [truth_of(one.scene) for one in ones]
    ranges, rows = ranges_of("single"), {}
    for name, way in WAYS.items():

        def tell(k: int, way: Way = way) -> dict[str, Any]:
            process = process_of("patch", ones[k], options.setting)
            prior, config = population.prior(process), DualConfig(learning=way.learning)
            how = way.make, config, way.sense(ones[k].scene, k)
            return filtered(process, prior, ones[k], options.setting, "patch", k, *how)

        told = each_of(tell, len(ones), keep, f"patch, {name}")
        rows[name] = scored([t["values"] for t in told], truths, ranges) | calibration(told)
    return {"n": len(ones), "setting": options.setting, "action": options.action, "filter": rows}


def noises(options: argparse.Namespace) -> dict[str, Any]:
    """What noise nets say of looks and touches, and what a filter makes of it."""
    seeds = range(options.first, options.first + options.objects)
    keep = Kept(options.keep, f"noise_{seeds.start}_{seeds.stop}")
    ones = [keep.of(f"case_{seed}", partial(noise.case_of, seed)) for seed in seeds]
    truths, ranges = [truth_of(one.one.scene) for one in ones], ranges_of("single")
    found: dict[str, Any] = {"n": len(ones), "setting": "slow", "action": "push", "filter": {}}
    found |= {"poses": noise.looks(ones), "forces": noise.touches(ones)}
    for name, way in noise.WAYS.items():

        def tell(k: int, way: noise.Way = way) -> dict[str, Any]:
            return noise.run(ones[k], way)

        told = each_of(tell, len(ones), keep, name)
        row = scored([t["values"] for t in told], truths, ranges) | calibration(told)
        row |= {key: mean_interval(np.array([t[key] for t in told])) for key in noise.POSES}
        found["filter"][name] = row
    return found


def noise_table(found: dict[str, Any]) -> str:
    """Rows of what is stated, then of what filters make of it."""
    return noise.table(found) + "\n" + table("filter with and without noise nets", found)


def calibration(told: list[dict[str, Any]]) -> dict[str, Any]:
    """How often 90 % intervals hold, the worst error in its std, NEES of poses, times."""
    rows = {key: [z for t in told for z in t["z"].get(key, [])] for key in _KEYS}
    off = {key: np.abs(row) for key, row in rows.items() if row}
    within = [max(abs(z) for row in t["z"].values() for z in row) < 3.0 for t in told if t["z"]]
    found: dict[str, Any] = {
        "within_3": [int(sum(within)), len(within)],
        "inside_90": {key: float(np.mean(each < INSIDE)) for key, each in off.items()},
        "stated": {key: len(each) for key, each in off.items()},
        "worst_z": max(float(each.max()) for each in off.values()),
    }
    if "nees" not in told[0]:
        refused = sum("refused" in t for t in told)
        cpu = [t["cpu_s"] for t in told if "cpu_s" in t]
        return found | {"refused": refused, "cpu_s": float(np.median(cpu))}
    return found | {
        "nees": mean_interval(np.array([t["nees"] for t in told])),
        "step_ms": float(np.mean([t["step_ms"] for t in told])),
        "step_ms_p99": max(t["step_ms_p99"] for t in told),
    }


def ranges_of(family: str) -> dict[str, float]:
    all_ = [truth_of(SimpleNamespace(thing=draw_object(seed, family))) for seed in SET]
    return {n: float(np.ptp([each[n] for each in all_])) for n in all_[0]}


def table(family: str, found: dict[str, Any]) -> str:
    """Rows for people."""
    rows = [f"## {family}, {found['setting']}, {found['action']}, n = {found['n']} objects", ""]
    if "ahead" in found:
        rows += ["| one step ahead | place mm | yaw deg | force | far |", "|---|---|---|---|---|"]
        for name, one in found["ahead"].items():
            cells = [_cell(one[key]) for key in ("place_mm", "yaw_deg", "force", "far")]
            rows.append(f"| {name} | {' | '.join(cells)} |")
        rows.append("")
    if "filter" in found:
        first = next(iter(found["filter"].values()))
        keys = [k for k in first if isinstance(first[k], dict) and "mean" in first[k]]
        keys = [k for k in keys if k != "nees"]
        links = sorted({k[-1] for k in keys})
        judged = ["overall", "in 90 %", "all in 3 std", "worst z", "NEES", "ms"]
        rows.append(f"| {' | '.join(['NRMSE', *keys, *judged])} |")
        rows.append("|---" * (len(keys) + 7) + "|")
        for name, one in found["filter"].items():
            cells = [_cell(one[key]) if key in one else "" for key in keys]
            overall = ", ".join(f"{one[f'overall{k}']:.2f}" for k in links if f"overall{k}" in one)
            stated = one.get("stated", {})
            inside = " ".join(
                f"{k} {v:.0%} of {stated[k]}" for k, v in one.get("inside_90", {}).items()
            )
            near = "{} of {}".format(*one["within_3"]) if "within_3" in one else ""
            judged = [overall, inside, near, "", "", ""]
            if "nees" in one:
                time = f"{one['step_ms']:.1f}, p99 {one['step_ms_p99']:.1f}"
                judged[3:] = [f"{one['worst_z']:.1f}", _cell(one["nees"]), time]
            elif "refused" in one:
                said = f"{one['cpu_s']:.1f} s, {one['refused']} refused"
                judged[3:] = [f"{one['worst_z']:.1f}", "", said]
            rows.append(f"| {name} | {' | '.join([*cells, *judged])} |")
        rows.append("")
    return "\n".join(rows)


def _cell(one: dict[str, float]) -> str:
    return f"{one['mean']:.3g} ({one['low']:.2g}-{one['high']:.2g})"


WITHIN = ("ahead", "filter")
"""Parts of the figures of a family."""
SECTIONS: dict[str, tuple[Callable[..., Any], Callable[..., str]]] = {
    "choice": (choice_times, choice.table),
    "choices": (learnt, lambda found: "\n".join(map(choices.table, found.values()))),
    "speed": (speeds, speed.table),
    "daily": (daily_objects, partial(table, "daily objects")),
    "noise": (noises, noise_table),
    "physics": (untold, untold_table),
    "ablations": (ablated, partial(table, "ablations of the filter on `patch`")),
}
"""Parts of their own: what measures and what tells them."""
