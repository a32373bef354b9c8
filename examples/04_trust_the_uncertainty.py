"""Check the stated uncertainty of an estimate against the recording itself.

    python examples/04_trust_the_uncertainty.py RUN.mcap --parts 6

Each part of a recording is estimated on its own. If the stated standard deviations are honest,
the estimates scatter about their common mean by as much as they claim: the normalised scatter is
near 1. It comes out well above 1 where the model lacks something, or where the stated sensor
noise is too small.
"""

import argparse
from pathlib import Path

import numpy as np

from tactile_dynamics_ros.core.inertia.batch.inertial_estimate import PARAMETER_NAMES
from tactile_dynamics_ros.core.inertia.estimate import estimate
from tactile_dynamics_ros.recording import Recording


def estimate_parts(recording: Recording, parts: int) -> tuple[np.ndarray, np.ndarray]:
    """Return (parts, 4) mass and centre of mass of each part, and their standard deviations."""
    edges = np.linspace(0.0, recording.duration + 1e-6, parts + 1)
    values, stds = [], []
    for start, stop in zip(edges[:-1], edges[1:], strict=True):
        found = estimate(recording.between(start, stop)).to_estimate()
        values.append([found.inertia.mass, *found.inertia.com])
        stds.append(found.parameter_std[:4])
        print(
            f"  {start:5.1f} to {stop:5.1f} s   mass {values[-1][0]:.4f} ± {stds[-1][0]:.4f} kg   "
            f"error {found.error.whitened_rms:.2f}"
        )
    return np.array(values), np.array(stds)


def main(arguments: list[str] | None = None) -> None:
    """Estimate parts, compare their scatter with what they state."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("recording", type=Path)
    parser.add_argument("--parts", type=int, default=6)
    options = parser.parse_args(arguments)
    recording = Recording.from_bag(options.recording)

    print(f"{options.parts} parts of {recording.source}")
    values, stds = estimate_parts(recording, options.parts)

    # Weighted mean over the parts, and its scatter: chi^2 per degree of freedom.
    weights = stds**-2.0
    mean = (weights * values).sum(axis=0) / weights.sum(axis=0)
    scatter = np.sqrt((weights * (values - mean) ** 2).sum(axis=0) / (options.parts - 1))
    whole = estimate(recording).to_estimate()
    all_values = np.array([whole.inertia.mass, *whole.inertia.com])

    print("\nparameter   mean of parts   whole recording   stated ±   normalised scatter")
    units = [(1.0, "kg"), *[(1e3, "mm")] * 3]
    for k, (scale, unit) in enumerate(units):
        print(
            f"{PARAMETER_NAMES[k]:9s}   {scale * mean[k]:13.4f}   {scale * all_values[k]:15.4f}   "
            f"{scale * whole.parameter_std[k]:9.4f}   {scatter[k]:10.2f}   ({unit})"
        )
    total = float(np.sqrt(np.mean(scatter**2)))
    expected = f"1 ± {1 / np.sqrt(2 * 4 * (options.parts - 1)):.2f}"
    print(f"\noverall normalised scatter: {total:.2f} (honest: {expected})")


if __name__ == "__main__":
    main()
