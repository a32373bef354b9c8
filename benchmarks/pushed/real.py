"""Real pushes by others: what is estimated from them, beside what their authors know."""

from __future__ import annotations

import argparse
import json
import time
from argparse import Namespace
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.support.residual_map import residual_map
from tactile_dynamics_ros.core.planar.mechanics.simulation import GRAVITY
from tactile_dynamics_ros.core.planar.sparse.fit import SparseFit, fit_pushes, fit_sparse
from tactile_dynamics_ros.core.planar.sparse.prediction import product_between_rests
from tactile_dynamics_ros.core.planar.sparse.pushes import cut_pushes
from tactile_dynamics_ros.recording.importers.goal_pushes_zhou2017 import GoalPushesZhou2017Importer
from tactile_dynamics_ros.recording.importers.pushes_mit import PushesMitImporter
from tactile_dynamics_ros.recording.importers.pushes_zhou2016 import PushesZhou2016Importer

DATA = Path(__file__).resolve().parents[3] / "shared/data"
"""Measurements of others; beside the repository, not in it."""
MASS, MASS_STD = 1.518, 0.002
COM = np.array([0.05, 0.05])
"""Mass, kg, and centre, m in the tracked frame, of the triangular block: its authors' figures."""
GOAL = np.array([0.0, -0.3175])
"""Where the goal pushes lead, m; yaw 0."""
BLOCK_PUSHES = {metal: [f"{metal}_{k}" for k in range(1, 7)] for metal in ("Al", "St")}
QUANTILE = 1.645
"""Half width of a 90 % interval in std."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add how many draws of ten pushes are made."""
    parser.add_argument("--draws", type=int, default=12, help="draws of ten real pushes per set")
    parser.add_argument("--seed", type=int, default=1, help="of the draws")


def measure(options: Namespace) -> dict[str, Any]:
    """Figures of all real recordings that are here."""
    if not (DATA / "pushes_zhou2016").exists():
        return {"skipped": f"no real pushes in {DATA}"}
    draws = 2 if options.quick else options.draws
    sets = json.loads((DATA / "pushes_zhou2016/meta.json").read_text())
    names = [name for k, name in enumerate(sets) if not options.quick or k in (0, 4)]
    slow = {name: slow_set(name, sets[name], draws, options.seed) for name in names}
    found: dict[str, Any] = {"slow_sets": slow, "draws": draws, "intervals": intervals(slow)}
    if (DATA / "pushes_mit").exists():
        found |= {"blocks": blocks(), "hexagon": hexagon()}
    if (DATA / "goal_pushes_zhou2017").exists():
        found["goal_pushes"] = goal_pushes()
    return found


def slow_set(name: str, about: dict[str, Any], draws: int, seed: int) -> dict[str, Any]:
    """Estimates from all pushes of one support and surface, and from ten drawn ones."""
    path = DATA / f"pushes_zhou2016/{name}.npz"
    streams = PushesZhou2016Importer().read(path, Namespace(pushes=None)).streams
    points = about["support_points_m_wrt_com"]
    feet = None if points is None else np.array(points) + COM
    started = time.process_time()
    fit = fit_sparse(streams, (MASS, MASS_STD), feet)
    seconds = time.process_time() - started
    authors = about["friction_force_N_authors"]
    rng = np.random.default_rng([seed, len(name)])
    pushes, outline = cut_pushes(streams), streams.links[0].footprint
    drawn = [pushes.taken(rng.permutation(len(pushes))[:10]) for _ in range(draws)]
    tens = [fit_pushes(ten, outline, None, feet) for ten in drawn]
    blind = fit_pushes(drawn[0], outline) if feet is not None else None
    return {
        "from_all": compared(fit, authors) | {"friction": fit.friction, "seconds": seconds},
        "from_ten": [compared(one, authors) for one in tens],
        "feet_unknown": None if blind is None else compared(blind, authors),
        "deviations": [vars(d) for d in residual_map(fit) if d.stands_out],
        "scatter": fit.scatter.tolist(),
    }


def compared(fit: SparseFit, authors: float) -> dict[str, Any]:
    """An estimate beside the authors' friction force, N, and centre of mass."""
    product, std = fit.friction_force
    com, com_std = fit.values[1:3], fit.std[1:3]
    return {
        "pushes": len(fit.pushes),
        "product_n": product,
        "product_std_n": std,
        "product_error": product / authors - 1.0,
        "product_z": (product - authors) / std,
        "com_error_m": float(np.linalg.norm(com - COM)),
        "com_std_m": com_std.tolist(),
        "com_z": ((com - COM) / com_std).tolist(),
        "size": float(np.exp(fit.values[3])),
        "converged": fit.converged,
        "undetermined": list(fit.undetermined),
    }


def intervals(sets: dict[str, Any]) -> dict[str, Any]:
    """Shares of 90 % intervals that hold the authors' figures.

    Whole faces count for the centre alone: their authors' friction was measured on feet.
    """
    on_feet = [s for name, s in sets.items() if "patch" not in name]
    found = {}
    for key in ("from_ten", "from_all"):
        of = lambda s, k=key: s[k] if isinstance(s[k], list) else [s[k]]  # noqa: E731
        product = [abs(one["product_z"]) < QUANTILE for s in on_feet for one in of(s)]
        com = [abs(z) < QUANTILE for s in sets.values() for one in of(s) for z in one["com_z"]]
        found[key] = {
            "product": float(np.mean(product)) if product else None,
            "n_product": len(product),
            "com": float(np.mean(com)),
            "n_com": len(com),
        }
    return found


def blocks() -> dict[str, Any]:
    """Product of each push of the blocks by the work between rests, and how well it repeats."""
    found = {}
    for metal, names in BLOCK_PUSHES.items():
        values = [product_between_rests(mit_push(name)) for name in names]
        spread = float(np.std(values, ddof=1) / np.mean(values))
        found[metal] = {"products_n": values, "relative_std": spread}
    return found


def mit_push(name: str | None) -> Any:
    """Streams of a push of a block, or of the hexagon."""
    folder = DATA / "pushes_mit"
    path = folder / "prelim_al_st_blocks.npz" if name else next(folder.glob("hex_*.json"))
    return PushesMitImporter().read(path, Namespace(push=name)).streams


def hexagon() -> dict[str, Any]:
    """What one push of the hexagon at 150 mm/s tells."""
    streams = mit_push(None)
    fit = fit_sparse(streams)
    return {
        "product_between_rests_n": product_between_rests(streams),
        "mass_quantiles_kg": mass_quantiles(fit),
        "undetermined": list(fit.undetermined),
    }


def mass_quantiles(fit: SparseFit) -> list[float]:
    """5 and 95 % of the mass, kg."""
    half = QUANTILE * fit.std[5]
    return [float(np.exp(fit.values[5] + sign * half)) for sign in (-1.0, 1.0)]


def goal_pushes() -> dict[str, Any]:
    """How near the goal the 61 pushes of others ended, and how many poses were lost."""
    importer, path = GoalPushesZhou2017Importer(), DATA / "goal_pushes_zhou2017/logs.npz"
    ends, lost, poses = [], 0, 0
    for k in range(61):
        recording = importer.read(path, Namespace(log=k))
        ends.append(recording.streams.links[0].pose[-1])
        lost += sum(recording.problems.values())
        poses += len(recording.streams.links[0].time)
    away = np.linalg.norm(np.array(ends)[:, :2] - GOAL, axis=1)
    turn = np.abs(np.angle(np.exp(1j * np.array(ends)[:, 2])))
    return {
        "logs": len(ends),
        "median_m": float(np.median(away)),
        "p90_m": float(np.quantile(away, 0.9)),
        "median_rad": float(np.median(turn)),
        "lost_share": lost / (lost + poses),
    }


def table(found: dict[str, Any]) -> str:
    """Rows for people."""
    if "skipped" in found:
        return f"skipped: {found['skipped']}"
    rows = [
        "| support | friction from all | authors' | product from ten | CoM from ten | CoM from all "
        "| ten, feet unknown: product, CoM | time |",
        "|---|---|---|---|---|---|---|---|",
        *(_row(name, one) for name, one in found["slow_sets"].items()),
        "",
        f"{found['draws']} draws of ten; medians of absolute errors; CoM in mm.",
    ]
    for key, one in found["intervals"].items():
        rows.append(
            f"90 % intervals {key}: product {one['product']:.0%} of {one['n_product']}, "
            f"CoM {one['com']:.0%} of {one['n_com']}"
        )
    for name, one in found["slow_sets"].items():
        for d in one["deviations"]:
            rows.append(
                f"{name}: {d['residual']} {d['mean']:+.3g} ± {d['std_error']:.2g} where "
                f"{d['grouped_by']} is {d['group']} (n = {d['pushes']})"
            )
    return "\n".join([*rows, *_fast_rows(found)])


def _row(name: str, one: dict[str, Any]) -> str:
    whole, tens, blind = one["from_all"], one["from_ten"], one["feet_unknown"]
    mean, std = whole["friction"]
    authors = whole["product_n"] / (1.0 + whole["product_error"]) / (MASS * GRAVITY)
    product = np.median([abs(t["product_error"]) for t in tens])
    com = 1e3 * np.median([t["com_error_m"] for t in tens])
    unknown = "" if blind is None else (
        f"{blind['product_error']:+.1%}, {1e3 * blind['com_error_m']:.1f}"
    )  # fmt: skip
    return (
        f"| {name} | {mean:.3f} ± {std:.3f} | {authors:.3f} | {product:.1%} | {com:.1f} "
        f"| {1e3 * whole['com_error_m']:.1f} | {unknown} | {whole['seconds']:.0f} s |"
    )


def _fast_rows(found: dict[str, Any]) -> list[str]:
    rows = []
    for metal, one in found.get("blocks", {}).items():
        mean = np.mean(one["products_n"])
        rows.append(f"{metal} block: product {mean:.3f} N, {one['relative_std']:.1%} in 6 pushes")
    if "hexagon" in found:
        one = found["hexagon"]
        low, high = one["mass_quantiles_kg"]
        rows.append(
            f"hexagon at 150 mm/s: product {one['product_between_rests_n']:.2f} N, mass {low:.2f} "
            f"to {high:.2f} kg (0.983 documented), undetermined: {', '.join(one['undetermined'])}"
        )
    if "goal_pushes" in found:
        one = found["goal_pushes"]
        rows.append(
            f"goal pushes: {1e3 * one['median_m']:.1f} mm and {np.degrees(one['median_rad']):.1f} "
            f"deg from the goal (medians of {one['logs']}), {one['lost_share']:.0%} of poses lost"
        )
    return rows
