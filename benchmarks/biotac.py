"""Force of fingertips that no model has seen: accuracy, honesty, speed, and in the hand.

Usage: ./dev bench biotac [--json] [--quick]

The compared voxel networks, and ours for comparison, are trained here on the same presses (about
half an hour on one core; kept under out/benchmarks for the next time).
"""

from __future__ import annotations

import argparse
import hashlib
import json
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch

from benchmarks.peers.voxel import (
    VoxelConfig,
    VoxelNetwork,
    predict_voxel,
    train_voxel_network,
)
from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.tactile.analytic_force import (
    classic_force,
    electrode_centroid,
    estimate_point,
    estimate_sequence,
    fit_unit_gain,
)
from tactile_dynamics_ros.core.tactile.calibration import (
    NORMAL_90,
    LabelledPresses,
    shipped_calibration,
)
from tactile_dynamics_ros.core.tactile.fingertip import FingertipConfig
from tactile_dynamics_ros.core.tactile.network.training import TrainingConfig, train_network
from tactile_dynamics_ros.core.tactile.network.weights import (
    SHIPPED_NETWORK,
    NetworkForceEstimator,
    NetworkWeights,
    lagged,
    network_inputs,
    predict_presses,
    shipped_network,
)
from tactile_dynamics_ros.sim.sensors.biotac import BioTacConfig
from tactile_dynamics_ros.sim.sensors.biotac.presses import (
    HELD_OUT_SEED,
    join_presses,
    label_protocols,
)

TEST_SEED = 777_000
BANDS = ((0.2, 0.5), (0.5, 1.0), (1.0, 2.0), (2.0, 5.0))
MEDIANS = ("magnitude_n", "direction_deg")
VOXEL_UNITS = 320
"""Simulated sensors per protocol that the compared networks are trained on."""

REPOSITORY = Path(__file__).parent.parent
CACHE = REPOSITORY / "out" / "benchmarks"
_TRAINING_CODE = ("core/tactile/network", "sim/sensors/biotac")
NOISES = {
    "models": BioTacConfig(),
    "models_at_quietest_noise": BioTacConfig(
        noise=0.35, wander=0.3, pressure_noise=0.3, loudest=1.0
    ),
    "models_at_loudest_noise": BioTacConfig(noise=3.4, wander=1.0, pressure_noise=1.2, loudest=1.0),
}
"""Held-out units as they come, and all as quiet or as loud as the ends of what real sensors show
(`benchmarks/biotac_noise.py`; rounding to whole counts adds 0.3)."""


def score_force(force: Array, std: Array | None, truth: Array) -> dict[str, Any]:
    """Median errors of forces (N, 3) between 0.2 and 2 N, and coverage of 90 % intervals."""
    strength = np.linalg.norm(truth, axis=1)
    size = np.linalg.norm(force, axis=1)
    cosine = np.sum(force * truth, axis=1) / np.maximum(size * strength, 1e-9)
    angle = np.rad2deg(np.arccos(np.clip(cosine, -1.0, 1.0)))
    useful = (strength >= 0.2) & (strength <= 2.0)
    result: dict[str, Any] = {
        "magnitude_n": float(np.median(np.abs(size - strength)[useful])),
        "direction_deg": float(np.median(angle[useful])),
        "vector_n": float(np.median(np.linalg.norm(force - truth, axis=1)[useful])),
    }
    if std is not None:
        inside = np.abs(force - truth) < NORMAL_90 * std
        result["coverage_90"] = float(inside[strength >= 0.2].mean())
        result["coverage_90_bands"] = {
            f"{low}-{high} N": float(inside[(strength >= low) & (strength < high)].mean())
            for low, high in BANDS
        }
    return result


def score_point(point: Array, truth: Array, force: Array) -> float:
    """Median distance (m) of contact points where the force is between 0.2 and 2 N."""
    strength = np.linalg.norm(force, axis=1)
    useful = (strength >= 0.2) & (strength <= 2.0)
    return float(np.median(np.linalg.norm(point - truth, axis=1)[useful]))


def score_models(
    test: LabelledPresses, voxels: dict[str, VoxelNetwork], same: NetworkWeights
) -> dict[str, Any]:
    """Score every estimator on held-out units; ``same`` is ours, trained as the voxel networks."""
    change, truth, place = test.frames()
    unit = classic_force(change, np.ones(3))
    scale = np.sum(unit * truth, axis=0) / np.sum(unit * unit, axis=0)
    results = {"classic formula": score_force(scale * unit, None, truth)}
    results["classic formula"]["point_mm"] = 1e3 * score_point(
        electrode_centroid(change), place, truth
    )
    found = [estimate_sequence(part, shipped_calibration()) for part in test.change]
    force, std = (np.concatenate(part) for part in zip(*found, strict=True))
    results["analytic"] = score_force(force, std, truth)
    point, _ = estimate_point(change, force, shipped_calibration())
    results["analytic"]["point_mm"] = 1e3 * score_point(point, place, truth)
    for name, network in voxels.items():
        force, std = predict_voxel(network, change)
        results[name] = score_force(force, std if network.heads > 1 else None, truth)
    for name, weights in (("ours, same presses", same), ("ours", shipped_network())):
        ours = predict_presses(test, weights)
        force = np.concatenate([each.force for each in ours])
        results[name] = score_force(force, np.concatenate([each.std for each in ours]), truth)
        point = np.concatenate([each.point for each in ours])
        results[name]["point_mm"] = 1e3 * score_point(point, place, truth)
    results["ours, unit gain known"] = score_with_gain(test, [each.force for each in ours])
    return results


def score_with_gain(test: LabelledPresses, found: Sequence[Array]) -> dict[str, Any]:
    """Score with the gain matrix of each unit fitted on the first half of its sequence."""
    half = test.change.shape[1] // 2
    corrected = [
        force[half:] @ fit_unit_gain(force[:half], truth[:half]).matrix.T
        for force, truth in zip(found, test.force, strict=True)
    ]
    return score_force(np.concatenate(corrected), None, test.force[:, half:].reshape(-1, 3))


def _cached(name: str) -> Path:
    """Return where a network is kept; one trained by other code, or on other presses, is not it."""
    digest = hashlib.sha256()
    for folder in _TRAINING_CODE:
        for source in sorted((REPOSITORY / "tactile_dynamics_ros" / folder).glob("*.py")):
            digest.update(source.read_bytes())
    CACHE.mkdir(parents=True, exist_ok=True)
    stem, kind = name.rsplit(".", 1)
    return CACHE / f"{stem}_{digest.hexdigest()[:8]}.{kind}"


def network_of_same_presses(quick: bool) -> NetworkWeights:
    """Train ours on the presses of the compared ones, or read what an earlier run trained."""
    units, epochs = (40, 3) if quick else (VOXEL_UNITS, 30)
    path = _cached(f"network_{units}_{epochs}.npz")
    if path.exists():
        return NetworkWeights.load(path)
    print("training our network on the presses of the voxel networks ...", file=sys.stderr)
    presses = label_protocols(units, seed=0).values()
    others = join_presses(label_protocols(max(units // 6, 2), HELD_OUT_SEED).values())
    config = TrainingConfig(epochs=epochs, every=5)
    weights = train_network(presses, others, f"{units} units, a comparison", config)
    weights.save(path)
    return weights


def voxel_networks(quick: bool) -> dict[str, VoxelNetwork]:
    """Train the compared networks, or read what an earlier run has trained."""
    units, epochs = (40, 3) if quick else (VOXEL_UNITS, 10)
    presses: LabelledPresses | None = None
    networks = {}
    for name, heads in (("ICRA 2019", 1), ("paper A", 10)):
        path = _cached(f"voxel_{heads}_{units}_{epochs}.pt")
        network = VoxelNetwork(heads)
        if path.exists():
            network.load_state_dict(torch.load(path, weights_only=True))
        else:
            if presses is None:
                presses = join_presses(label_protocols(units, seed=0).values())
            print(f"training the voxel network, {name} ...", file=sys.stderr)
            network = train_voxel_network(presses, VoxelConfig(heads=heads, epochs=epochs))
            torch.save(network.state_dict(), path)
        networks[name] = network.eval() if heads == 1 else network
    return networks


def measure_speed(test: LabelledPresses, baseline: VoxelNetwork) -> dict[str, float]:
    """Time four fingers per frame, ours and the voxel network, ms."""
    rng = np.random.default_rng(0)
    raw = rng.normal(2900.0, 3.0, (500, 4, 44))
    fingers = NetworkForceEstimator([FingertipConfig()] * 4)
    fingers.tare(raw[:50])

    def frame(k: int) -> None:
        fingers.observe(raw[k])

    def voxel_frame(k: int) -> None:
        predict_voxel(baseline, test.change[:4, k])

    past = np.stack([lagged(part[:100], test.period) for part in test.change[:4]])

    def network_frame(k: int) -> None:
        shipped_network().evaluate(*network_inputs(test.change[:4, k], past[:, k], test.rest[:4]))

    live, ours, theirs = _times(frame, 500), _times(network_frame, 100), _times(voxel_frame, 100)
    return {
        "live_frame_ms_median": float(np.median(live)),
        "live_frame_ms_p99": float(np.quantile(live, 0.99)),
        "network_frame_ms_median": float(np.median(ours)),
        "voxel_frame_ms_median": float(np.median(theirs)),
        "voxel_time_over_ours": float(np.median(theirs) / np.median(ours)),
    }


def _times(call: Callable[[int], None], count: int) -> Array:
    spent = []
    for k in range(count):
        start = time.perf_counter()
        call(k)
        spent.append(1e3 * (time.perf_counter() - start))
    return np.array(spent[count // 10 :])


def run(quick: bool = False, in_hand: bool = True) -> dict[str, Any]:
    """Run everything and return the numbers."""
    from benchmarks.biotac_bound import information_bound
    from benchmarks.biotac_in_hand import balance_in_hand
    from benchmarks.biotac_node import node_latency

    torch.set_num_threads(1)
    units = 12 if quick else 60
    voxels, same = voxel_networks(quick), network_of_same_presses(quick)
    tests = {
        name: join_presses(label_protocols(units, TEST_SEED, sensor).values())
        for name, sensor in NOISES.items()
    }
    results: dict[str, Any] = {"held_out_units": 3 * units, "bound": {}}
    for name, test in tests.items():
        results[name] = score_models(test, voxels, same)
        results["bound"][name] = information_bound(units, TEST_SEED, NOISES[name])
    models = results["models"]
    results["speed"] = measure_speed(tests["models"], voxels["ICRA 2019"])
    results["weights_kib"] = SHIPPED_NETWORK.stat().st_size / 1024
    results["weights_from"] = shipped_network().origin
    results["improvement_over_icra_2019"] = {
        ours: {name: models["ICRA 2019"][name] / models[ours][name] for name in MEDIANS}
        for ours in ("ours", "ours, same presses")
    }
    if in_hand:
        results["live_node"] = node_latency(300 if quick else 6000)
        seeds = range(1 if quick else 6)
        results["in_hand"] = [balance_in_hand(seed, seconds=32.0) for seed in seeds]
        results["in_hand_coverage_90"] = float(
            np.mean([hand["coverage_90"] for hand in results["in_hand"]])
        )
    return results


def describe(results: dict[str, Any]) -> str:
    """Return the numbers as a table."""
    lines = []
    for key in NOISES:
        lines.append(f"{key.replace('_', ' ')} ({results['held_out_units']} units, 0.2 to 2 N)")
        for name, score in results[key].items():
            cover = score.get("coverage_90")
            lines.append(
                f"  {name:24s} {score['magnitude_n']:.3f} N  {score['direction_deg']:5.2f} deg"
                + (f"  point {score['point_mm']:.2f} mm" if "point_mm" in score else "")
                + (f"  90 % intervals cover {100 * cover:.1f} %" if cover is not None else "")
            )
        bound = results["bound"][key]
        lines.append(
            f"  {'no estimator below':24s} {bound['magnitude_n']:.3f} N"
            f"  {bound['direction_deg']:5.2f} deg"
        )
    more = ("improvement_over_icra_2019", "speed", "live_node", "in_hand", "in_hand_coverage_90")
    for key in more:
        if key in results:
            lines.append(f"{key.replace('_', ' ')}: {json.dumps(results[key])}")
    return "\n".join(lines)


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the numbers."""
    parser = argparse.ArgumentParser(prog="./dev bench biotac", description=__doc__)
    parser.add_argument("--json", action="store_true", help="print only JSON")
    parser.add_argument("--quick", action="store_true", help="fewer units, shorter training")
    args = parser.parse_args(arguments)
    results = run(args.quick)
    print(json.dumps(results) if args.json else describe(results))
    return 0
