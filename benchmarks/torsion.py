"""What torsion of the simulated skin does to estimates in the hand, and whether it is found.

A row takes one to two minutes of an idle core, most of it the simulated grasp with its fingertips;
the first of a seed a minute more, in which these are calibrated.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence

import numpy as np

from benchmarks.inertia.in_hand import record_in_hand
from tactile_dynamics_ros.core.discrepancy.diagnosis import diagnose
from tactile_dynamics_ros.core.effects.registry import create_effects
from tactile_dynamics_ros.core.inertia.batch.fitted_model import FittedModel
from tactile_dynamics_ros.core.inertia.diagnosis.discrepancy_model import HeldObjectModel
from tactile_dynamics_ros.core.inertia.diagnosis.readings import fit_with_readings
from tactile_dynamics_ros.core.inertia.estimate import estimate
from tactile_dynamics_ros.core.rigid_body.inertial_parameters import InertialParameters

TORSION = (0.0, 0.002, 0.005)
"""Coefficients of the skin, m: none, and of contact patches of about 3 and 7 mm radius."""


def row(torsion: float, box: str, seed: int) -> str:
    """Row of the table of one recording."""
    streams, truth, outcome = record_in_hand(box, seed, skin_torsion=torsion)
    plain, with_it = estimate(streams), estimate(streams, create_effects(["contact_torsion"]))
    diagnosis = diagnose(HeldObjectModel.from_fit(fit_with_readings(streams)))
    said = diagnosis.effect or diagnosis.verdict
    return (
        f"| {1e3 * torsion:g} mm | {seed} | {outcome} | {_errors(plain, truth)} | "
        f"{_errors(with_it, truth)} | {said} |"
    )


def _errors(model: FittedModel, truth: InertialParameters) -> str:
    found = model.to_estimate()
    mass = 100.0 * (found.inertia.mass / truth.mass - 1.0)
    com = 1e3 * np.linalg.norm(found.inertia.com - truth.com)
    std = 1e3 * np.linalg.norm(found.parameter_std[1:4])
    rms = found.error.whitened_rms
    return f"{mass:+.1f} %, {com:.2f} mm (std {std:.2f}), error {rms:.2f}"


def main(arguments: Sequence[str] | None = None) -> int:
    """Record with every coefficient and print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--object", default="box_1")
    parser.add_argument("--seeds", type=int, nargs="+", default=[1])
    parser.add_argument("--torsion", type=float, nargs="+", default=TORSION, help="m")
    options = parser.parse_args(arguments)
    print("| skin | seed | grasp | rigid body | with `contact_torsion` | `diagnose` |")
    print("|---|---|---|---|---|---|", flush=True)
    for seed in options.seeds:
        for torsion in options.torsion:
            print(row(torsion, options.object, seed), flush=True)
    return 0
