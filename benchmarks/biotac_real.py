"""Contact normals of a real BioTac: models fitted to it, and models that only know simulation.

Usage: python -m benchmarks.biotac_real [--data ../shared/data/biotac_contact_normal] [--json]

The recordings hold PDC, 19 electrodes and the direction of the pressed surface by motion capture,
in a finger frame whose rotation to the sensor frame is not stated. Forces were not measured.
"""

from __future__ import annotations

import argparse
import json
import re
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.shape.skin_surface import skin_normal
from tactile_dynamics_ros.core.tactile.analytic_force import electrode_centroid
from tactile_dynamics_ros.core.tactile.network.weights import predict_sequence, shipped_network
from tactile_dynamics_ros.core.tactile.signal_change import place_features

DATA = Path(__file__).parent.parent.parent / "shared" / "data" / "biotac_contact_normal"
PERIOD = 0.0165
TOUCH_COUNTS = 60.0
RIDGE = 30.0
LIGHT = 1.5
"""PDC (hundreds of counts) below which presses are light, about 1.5 N."""

_BLOCK = re.compile(
    r"pdc: \n(\d+)\nelectrode: \n\(([^)]*)\)\nz_dir: \n"
    r"\[\[([^\]]*)\]\n \[([^\]]*)\]\n \[([^\]]*)\]\]"
)


@dataclass(frozen=True)
class NormalTrial:
    """One recording: tared signals (N, 20), rest counts (19,), directions (N, 3), touch (N,)."""

    name: str
    change: Array
    rest: Array
    direction: Array
    touching: NDArray[np.bool_]


def read_trial(path: Path) -> NormalTrial:
    """Read a log of PDC, electrodes and surface direction.

    Raises:
        BadInputError: the file holds no such blocks.
    """
    blocks = _BLOCK.findall(path.read_text())
    if not blocks:
        raise BadInputError(f"{path}: no blocks of pdc, electrode and z_dir found")
    pressure = np.array([float(block[0]) for block in blocks])
    electrodes = np.array([[float(v) for v in block[1].split(",")] for block in blocks])
    direction = np.array([[float(v) for v in block[2:]] for block in blocks])
    floor = np.percentile(pressure, 1)
    rest = np.median(electrodes[pressure < floor + 4], axis=0)
    change = np.column_stack([electrodes - rest, pressure - floor]) / 100.0
    return NormalTrial(path.name, change, rest, direction, pressure - floor > TOUCH_COUNTS)


def angles(found: Array, truth: Array) -> Array:
    """Return angles (N,) between directions, deg."""
    cosine = np.sum(found * truth, axis=1) / np.linalg.norm(found, axis=1)
    return np.rad2deg(np.arccos(np.clip(cosine, -1.0, 1.0)))


def best_rotation(source: Array, target: Array) -> Array:
    """Return the rotation (3, 3) that turns directions onto others. Source: Wahba's problem."""
    u, _, v = np.linalg.svd(target.T @ source)
    return np.asarray(u @ np.diag([1.0, 1.0, np.sign(np.linalg.det(u @ v))]) @ v)


def score_pair(train: NormalTrial, test: NormalTrial) -> dict[str, float]:
    """Median angle (deg) on one trial of models that know the other, or simulation only."""
    known, truth = train.direction[train.touching], test.direction[test.touching]
    mean = known.mean(axis=0)
    result = {"constant": float(np.median(angles(np.tile(mean, (len(truth), 1)), truth)))}
    linear = [np.column_stack([t.change, np.ones(len(t.change))]) for t in (train, test)]
    rich = [place_features(t.change) for t in (train, test)]
    for name, (features, unseen) in (("linear", linear), ("polynomial", rich)):
        features, unseen = features[train.touching], unseen[test.touching]
        scale = features.std(axis=0) + 1e-6
        gram = (features / scale).T @ (features / scale) + RIDGE * np.eye(features.shape[1])
        weights = np.linalg.solve(gram, (features / scale).T @ known) / scale[:, None]
        result[name] = float(np.median(angles(unseen @ weights, truth)))
    for name, points in (
        ("electrode centroid, sensor rotation from the other trial", _centroids),
        ("network from simulation, sensor rotation from the other trial", _network_points),
    ):
        normals = [skin_normal(points(t))[t.touching] for t in (train, test)]
        rotation = best_rotation(normals[0], known)
        error = angles(normals[1] @ rotation.T, truth)
        light = test.change[test.touching, 19] < LIGHT
        result[name] = float(np.median(error))
        result[f"{name}, light presses"] = float(np.median(error[light]))
    return result


def _centroids(trial: NormalTrial) -> Array:
    return electrode_centroid(trial.change)


def _network_points(trial: NormalTrial) -> Array:
    return predict_sequence(trial.change, trial.rest, shipped_network(), PERIOD).point


def run(folder: Path = DATA) -> dict[str, Any]:
    """Score both directions between the two trials.

    Raises:
        BadInputError: the folder does not hold two logs.
    """
    logs = sorted(folder.glob("*.log"))
    if len(logs) != 2:
        raise BadInputError(f"{folder}: {len(logs)} logs found, expected the two trials")
    first, second = (read_trial(path) for path in logs)
    return {
        f"trained on {first.name}": score_pair(first, second),
        f"trained on {second.name}": score_pair(second, first),
    }


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the numbers."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--data", type=Path, default=DATA, help="folder with the two logs")
    parser.add_argument("--json", action="store_true", help="print only JSON")
    args = parser.parse_args(arguments)
    results = run(args.data)
    if args.json:
        print(json.dumps(results))
        return 0
    for name, scores in results.items():
        print(name)
        for model, angle in scores.items():
            print(f"  {angle:5.1f} deg  {model}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
