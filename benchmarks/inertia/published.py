"""Paper A's Tables I to IV as numbers, scored by the measures of this benchmark."""

from __future__ import annotations

import csv
from functools import lru_cache
from pathlib import Path

import numpy as np

from benchmarks.inertia.scores import Score
from tactile_dynamics_ros.core.rigid_body.inertial_parameters import InertialParameters

WRIST, VISION, RELAXED_RIGIDITY = 2, 3, 4

_TABLES = Path(__file__).with_name("published_tables.csv")
_UNITS = {1: 1e-2, 2: 1e-5, 3: 1e-5, 4: 1e-5}


@lru_cache(maxsize=1)
def _rows() -> dict[tuple[int, str, str], np.ndarray]:
    """Dynamic parameters (10,) by table, object and method.

    Products of inertia are tensor entries in Table I and have the opposite sign in the others;
    all inertias are about the body origin.
    """
    rows = {}
    with _TABLES.open() as file:
        for row in csv.DictReader(file):
            table, unit = int(row["table"]), _UNITS[int(row["table"])]
            sign = 1.0 if table == 1 else -1.0
            names = ("xx", "xy", "yy", "xz", "yz", "zz")
            signs = (1.0, sign, 1.0, sign, sign, 1.0)
            inertia = [unit * s * float(row[n]) for n, s in zip(names, signs, strict=True)]
            mass = float(row["mass"])
            first = [mass * float(row[f"com_{axis}"]) for axis in "xyz"]
            key = (table, row["object"], row["method"])
            rows[key] = np.array([mass, *first, *inertia])
    return rows


def published_truth(box: str) -> InertialParameters:
    """Ground truth of box_0 to box_4."""
    return InertialParameters.from_dynamic_parameters(_rows()[WRIST, box, "GT"])


def published_score(table: int, box: str, method: str = "C, No G") -> Score:
    """What a row of the paper scores; "C, No G" is its best without knowing the truth."""
    return Score.of(published_truth(box), _rows()[table, box, method], 0.0)
