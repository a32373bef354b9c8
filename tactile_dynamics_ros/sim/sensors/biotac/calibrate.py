"""Fit the analytic force estimator to simulated presses and write its constants.

Run as ``python -m tactile_dynamics_ros.sim.sensors.biotac.calibrate --seed 0``.
"""

from __future__ import annotations

import argparse
import signal
from collections.abc import Iterable, Iterator
from multiprocessing import Pool
from pathlib import Path

import numpy as np

from tactile_dynamics_ros.core.errors import refuse_existing
from tactile_dynamics_ros.core.options import COUNT, SEED
from tactile_dynamics_ros.core.tactile.calibration import (
    SHIPPED_CALIBRATION,
    ForceCalibration,
    LabelledPresses,
    fit_calibration,
)
from tactile_dynamics_ros.core.tactile.signal_change import RestState
from tactile_dynamics_ros.sim.sensors.biotac.presses import Presses, protocols, record_presses
from tactile_dynamics_ros.sim.sensors.biotac.unit import BioTacConfig

HELD_OUT_SEED = 100_000
_PROCESSES = 2


def label_presses(presses: Presses) -> LabelledPresses:
    """Return tared signals of the frames after rest, with their true force and point."""
    start = presses.rest_frames
    rest = [RestState.from_frames(raw[: start - 5]) for raw in presses.raw]
    pressed = presses.raw[:, start:].astype(float)
    change = [
        state.change(raw, state.warming(raw)) for state, raw in zip(rest, pressed, strict=True)
    ]
    return LabelledPresses(
        np.array(change),
        presses.force[:, start:],
        presses.point[:, start:],
        np.array([state.electrodes for state in rest]),
    )


def label_protocols(
    units: int, seed: int, sensor: BioTacConfig | None = None
) -> dict[str, LabelledPresses]:
    """Return the labelled presses of every protocol, ``units`` individual sensors each."""
    configs = protocols(units, seed)
    return {name: label_presses(record_presses(config, sensor)) for name, config in configs.items()}


def _label_batch(units_and_seed: tuple[int, int]) -> list[LabelledPresses]:
    return list(label_protocols(*units_and_seed).values())


def _obey_caller() -> None:
    """End when the caller says so, whatever handlers it has, and leave Ctrl-C to it."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)


def label_batches(units: int, seed: int, batch: int = 250) -> Iterator[LabelledPresses]:
    """Yield the labelled presses of every protocol, ``batch`` sensors at a time, in order.

    Two processes press; they end with the caller, who alone hears Ctrl-C.
    """
    starts = range(0, units, batch)
    counts = [min(batch, units - start) for start in starts]
    seeds = [seed + len(protocols(1, 0)) * (start // batch) for start in starts]
    with Pool(_PROCESSES, _obey_caller) as pool:
        for parts in pool.imap(_label_batch, zip(counts, seeds, strict=True)):
            yield from parts


def join_presses(parts: Iterable[LabelledPresses]) -> LabelledPresses:
    """Return the sequences of all parts in one set."""
    parts = list(parts)
    return LabelledPresses(
        np.concatenate([part.change for part in parts]),
        np.concatenate([part.force for part in parts]),
        np.concatenate([part.point for part in parts]),
        np.concatenate([part.rest for part in parts]),
    )


def calibrate(seed: int, units: int = 160) -> ForceCalibration:
    """Press ``units`` simulated sensors per protocol and fit; others give the uncertainty."""
    fitted = join_presses(label_protocols(units, seed).values())
    others = join_presses(label_protocols(max(units // 4, 1), seed + HELD_OUT_SEED).values())
    origin = f"simulated presses, {units} units per protocol, seed {seed}"
    return fit_calibration(fitted, others, origin)


def main() -> None:
    """Write the calibration to a new file."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seed", type=SEED, default=0)
    parser.add_argument("--units", type=COUNT, default=160)
    parser.add_argument("--out", type=Path, default=Path(SHIPPED_CALIBRATION.name))
    arguments = parser.parse_args()
    refuse_existing(arguments.out)
    calibration = calibrate(arguments.seed, arguments.units)
    calibration.save(arguments.out)
    print(f"wrote {arguments.out}: {calibration.origin}")


if __name__ == "__main__":
    main()
