"""Fit the analytic force estimator to simulated presses and write its constants.

Run as ``python -m tactile_dynamics_ros.sim.sensors.biotac.calibrate --seed 0``.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from tactile_dynamics_ros.core.tactile.calibration import (
    SHIPPED_CALIBRATION,
    ForceCalibration,
    LabelledPresses,
    fit_calibration,
)
from tactile_dynamics_ros.core.tactile.signal_change import RestState
from tactile_dynamics_ros.sim.sensors.biotac.presses import PressConfig, Presses, record_presses

HELD_OUT_SEED = 100_000


def label_presses(presses: Presses) -> LabelledPresses:
    """Return tared signals of the frames after rest, with their true force and point."""
    start = presses.rest_frames
    change = [
        RestState.from_frames(raw[: start - 5]).change(raw[start:].astype(float))
        for raw in presses.raw
    ]
    return LabelledPresses(np.array(change), presses.force[:, start:], presses.point[:, start:])


def calibrate(seed: int, units: int = 384) -> ForceCalibration:
    """Press ``units`` simulated sensors and fit; a quarter as many others give the uncertainty."""
    fitted = record_presses(PressConfig(units=units, seed=seed))
    other = record_presses(PressConfig(units=max(units // 4, 1), seed=seed + HELD_OUT_SEED))
    origin = f"simulated presses of {units} units, seed {seed}"
    return fit_calibration(label_presses(fitted), label_presses(other), origin)


def main() -> None:
    """Write the calibration file."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--units", type=int, default=384)
    parser.add_argument("--out", type=Path, default=SHIPPED_CALIBRATION)
    arguments = parser.parse_args()
    calibration = calibrate(arguments.seed, arguments.units)
    calibration.save(arguments.out)
    print(f"wrote {arguments.out}: {calibration.origin}")


if __name__ == "__main__":
    main()
