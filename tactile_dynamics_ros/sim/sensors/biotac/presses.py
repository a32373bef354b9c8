"""Press protocols of a force/torque rig, and the analytic estimator that is fitted to them."""

from __future__ import annotations

import argparse
import signal
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from multiprocessing import Pool
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.configuration import check_ranges, parameter
from tactile_dynamics_ros.core.errors import refuse_existing
from tactile_dynamics_ros.core.options import COUNT, SEED
from tactile_dynamics_ros.core.tactile.calibration import (
    SHIPPED_CALIBRATION,
    ForceCalibration,
    LabelledPresses,
    fit_calibration,
)
from tactile_dynamics_ros.core.tactile.signal_change import RestState
from tactile_dynamics_ros.sim.sensors.biotac.sensor import OUTER_RADIUS, BioTacArray, outward_normal
from tactile_dynamics_ros.sim.sensors.biotac.unit import BioTacConfig


@dataclass(frozen=True)
class PressConfig:
    """How fingertips are pressed: how long, how hard, where, with which objects."""

    units: int = parameter(128, "individual sensors, one press sequence each", "", 1)
    frames: int = parameter(1200, "frames per sequence at 100 Hz", "", 20)
    rest_frames: int = parameter(60, "frames without contact at the start", "", 1)
    typical_force: float = parameter(1.0, "median of the largest force of a sequence", "N", 0.01)
    strongest_force: float = parameter(6.0, "largest force of all", "N", 0.01)
    friction: float = parameter(1.25, "largest ratio of tangential to normal force", "", 0.0, 3.0)
    hold_share: float = parameter(
        0.4,
        "share of sequences that hold a nearly constant force, half of them until its end",
        "",
        0,
        1,
    )
    flat_share: float = parameter(0.5, "share of sequences with a flat object", "", 0.0, 1.0)
    roll: float = parameter(1.5e-3, "how far the contact rolls over the skin", "m", 0.0, 1e-2)
    sharpest: float = parameter(60.0, "largest curvature of the objects", "1/m", 0.0, 1e3)
    seed: int = parameter(0, "of units, noise and motion", "", 0)

    def __post_init__(self) -> None:
        check_ranges(self)


def protocols(units: int, seed: int) -> dict[str, PressConfig]:
    """Return the three protocols of the training set, ``units`` individual sensors each.

    Flat pushes and a rolling ball of mostly up to 2 N, and a rig that presses and drags up to 10 N,
    after the data set of Sundaralingam et al., 2019.
    """
    return {
        "push": PressConfig(units=units, seed=seed, typical_force=0.9, flat_share=1.0),
        "ball": PressConfig(
            units=units, seed=seed + 1, typical_force=0.9, flat_share=0.0, sharpest=100.0, roll=3e-3
        ),
        "rig": PressConfig(
            units=units, seed=seed + 2, typical_force=2.5, strongest_force=10.0, roll=0.5e-3
        ),
    }


@dataclass(frozen=True)
class Presses:
    """Recorded presses of U units, T frames each.

    Attributes:
        raw: (U, T, 44) counts. force: (U, T, 3) N on the object, sensor frame.
        point: (U, T, 3) contact point, sensor frame, m.
        rest_frames: frames without contact at the start of every sequence.
    """

    raw: NDArray[np.uint16]
    force: Array
    point: Array
    rest_frames: int


def plan_presses(config: PressConfig) -> tuple[Array, Array, Array]:
    """Return forces (U, T, 3) N, contact points (U, T, 3) m and curvatures (U,) 1/m."""
    rng = np.random.default_rng([config.seed, 7])
    point = _contact_paths(config, rng)
    force = _forces(config, point, rng)
    flat = rng.random(config.units) < config.flat_share
    return force, point, np.where(flat, 0.0, config.sharpest * rng.random(config.units))


def record_presses(config: PressConfig, sensor: BioTacConfig | None = None) -> Presses:
    """Press ``config.units`` individual sensors and record counts, forces and contact points."""
    force, point, curvature = plan_presses(config)
    array = BioTacArray(config.units, sensor, seed=config.seed)
    raw = np.empty((config.units, config.frames, 44), dtype=np.uint16)
    for k in range(config.frames):
        raw[:, k] = array.measure(force[:, k], point[:, k], curvature=curvature)
    return Presses(raw, force, point, config.rest_frames)


def _contact_paths(config: PressConfig, rng: np.random.Generator) -> Array:
    """Return contact points (U, T, 3) on the pad that roll slowly over a few millimetres."""
    shape = (config.units, 1)
    along = rng.uniform(-13e-3, 6.3e-3, shape) + config.roll * _waves(config, rng, 0.5)
    across = rng.uniform(-1.1, 1.1, shape) + config.roll / OUTER_RADIUS * _waves(config, rng, 0.5)
    along, across = np.clip(along, -14e-3, 6.6e-3), np.clip(across, -1.2, 1.2)
    ahead = np.clip(along / OUTER_RADIUS, 0.0, 0.95)
    ring = OUTER_RADIUS * np.sqrt(1.0 - ahead**2)
    return np.stack([along, ring * np.sin(across), -ring * np.cos(across)], axis=-1)


def _forces(config: PressConfig, point: Array, rng: np.random.Generator) -> Array:
    """Return forces on the object: presses of random strength with friction-limited traction."""
    peak = config.typical_force * np.exp(0.7 * rng.standard_normal((config.units, 1)))
    peak = np.minimum(peak, config.strongest_force)
    held = rng.random((config.units, 1)) < config.hold_share
    wave = _waves(config, rng, 1.0)
    varying = np.clip(0.55 + 0.45 * wave, 0.0, None)
    strength = peak * np.where(held, np.clip(0.8 + 0.1 * wave, 0.0, None), varying)
    ramp = (np.arange(config.frames) - config.rest_frames) / 30.0
    strength = strength * np.clip(ramp, 0.0, 1.0) * np.where(held, _let_go(config, rng), 1.0)
    normal = outward_normal(point)
    tangent = np.stack([_waves(config, rng, 0.8) for _ in range(3)], axis=-1)
    tangent -= np.sum(tangent * normal, axis=-1, keepdims=True) * normal
    length = np.linalg.norm(tangent, axis=-1, keepdims=True)
    tangent *= np.minimum(1.0, 1.0 / np.maximum(length, 1e-9))
    share = config.friction * rng.random((config.units, 1))
    return np.asarray(strength[..., None] * (normal + share[..., None] * tangent))


def _let_go(config: PressConfig, rng: np.random.Generator) -> Array:
    """Return (U, T) shares of a hold: one, and zero once the finger is lifted off for good."""
    last = config.frames * rng.uniform(0.4, 1.6, (config.units, 1))
    return np.clip((last - np.arange(config.frames)) / 20.0, 0.0, 1.0)


def _waves(config: PressConfig, rng: np.random.Generator, rate_hz: float) -> Array:
    """Return smooth random curves (U, T) of about unit amplitude, up to ``rate_hz``."""
    time = 0.01 * np.arange(config.frames)
    frequency = rate_hz * rng.uniform(0.05, 1.0, (config.units, 4, 1))
    phase = rng.uniform(0.0, 2 * np.pi, (config.units, 4, 1))
    return np.asarray(np.sin(2 * np.pi * frequency * time + phase).sum(axis=1) / np.sqrt(2.0))


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
