"""How well any estimator could tell force from the counts of an unknown sensor: a Bayesian bound.

Usage: python -m benchmarks.biotac_bound [--units N] [--json]

The posterior covariance of the force now, given the counts of the last moments, an exact model of
the simulated sensor linearised about the truth, and as prior knowledge how forces, contact points,
units and objects vary. White noise, wander, the noise of the rest state and what differs between
units are as simulated; creep and hysteresis are taken as known. No estimator that remembers as
much does better on average.

Source: Van Trees, 1968 (Bayesian Cramer-Rao bound; exact for linear Gaussian problems).
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import sys
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.sim.sensors.biotac import BioTacArray, BioTacConfig
from tactile_dynamics_ros.sim.sensors.biotac.presses import PressConfig, plan_presses, protocols
from tactile_dynamics_ros.sim.sensors.biotac.sensor import (
    electrode_counts,
    fluid_thickness,
    indent,
    outward_normal,
    sensed_share,
    static_pressure,
)
from tactile_dynamics_ros.sim.sensors.biotac.unit import (
    GAP_STD,
    LOCAL_SHARE_STD,
    NODE_STD,
    PRESSURE_GAIN_STD,
    STIFFNESS_STD,
    Units,
)

FRAMES = 50
"""Frames of 10 ms that are remembered."""
FRAMES_PER_UNIT = 4
_DRAWS = 20
_REST_FRAMES = 55
_CURVATURE_STD = 25.0
_LEVEL_STD = np.array([1.0, 1.0, 1.0, 5e-3, 5e-3])
"""How far forces (N) and contact points (m) may lie anywhere, before any signal."""
_RATE_HZ = np.array([1.0, 1.0, 1.0, 0.5, 0.5])
"""How fast they vary at most in the presses."""
_UNIT_STD = {"gap": GAP_STD, "stiffness": STIFFNESS_STD, "pressure_gain": PRESSURE_GAIN_STD}


@dataclass(frozen=True)
class Instant:
    """A moment of a press: force (3,), contact point (3,), the unit, and how both vary (5,)."""

    force: Array
    point: Array
    unit: Units
    spread: Array


def information_bound(
    units: int, seed: int, config: BioTacConfig | None = None
) -> dict[str, float]:
    """Return median errors of magnitude, N, and direction, deg, that no estimator undercuts.

    Args:
        units: simulated sensors per protocol of presses, as in the comparison of models.
        seed: of units and presses.
        config: noise of the sensor.
    """
    config = config or BioTacConfig()
    rng = np.random.default_rng(seed)
    size, angle = [], []
    for press in protocols(units, seed).values():
        for instant in _instants(press, config, rng):
            axes = _axes(instant.point)
            covariance = axes @ force_covariance(instant, config) @ axes.T
            found = rng.multivariate_normal(instant.force, covariance, _DRAWS)
            length = np.linalg.norm(found, axis=1)
            strength = float(np.linalg.norm(instant.force))
            cosine = found @ instant.force / (length * strength)
            size.append(np.abs(length - strength))
            angle.append(np.rad2deg(np.arccos(np.clip(cosine, -1.0, 1.0))))
    return {
        "magnitude_n": float(np.median(size)),
        "direction_deg": float(np.median(angle)),
    }


def _instants(press: PressConfig, config: BioTacConfig, rng: np.random.Generator) -> list[Instant]:
    """Draw moments with a force of 0.2 to 2 N."""
    forces, points, _ = plan_presses(press)
    units = BioTacArray(press.units, config, seed=press.seed).units
    found = []
    for k, (force, point) in enumerate(zip(forces, points, strict=True)):
        strength = np.linalg.norm(force, axis=1)
        useful = np.flatnonzero((strength >= 0.2) & (strength <= 2.0))
        for frame in rng.choice(useful, FRAMES_PER_UNIT) if len(useful) else ():
            axes = _axes(point[frame])
            spread = np.concatenate(
                [(force[strength > 0.0] @ axes).std(axis=0), (point @ axes[:, 1:]).std(axis=0)]
            )
            own = Units(
                *(getattr(units, field.name)[[k, k]] for field in dataclasses.fields(Units))
            )
            found.append(Instant(force[frame], point[frame], own, spread))
    return found


def force_covariance(instant: Instant, config: BioTacConfig) -> Array:
    """Return the covariance (3, 3) of the force now along normal and two tangents, N^2.

    Unknown are the force (3) and the contact point (2) of every frame, smooth in time, and what
    stays: the unit and the object's curvature. The signals' noise is white, with the electrodes'
    wander and the rest state's error on top, alike for all electrodes.
    """
    time = 0.01 * np.arange(FRAMES)
    lag = np.abs(time[:, None] - time)
    rest = config.noise**2 / _REST_FRAMES + 0.9 * config.wander**2
    wander = config.wander**2 * np.exp(-lag / config.wander_time)
    loudness = float(instant.unit.loudness[0]) ** 2
    electrodes = np.linalg.inv(loudness * (config.noise**2 * np.eye(FRAMES) + wander + rest))
    hiss = loudness * config.pressure_noise**2
    pressure = hiss * (np.eye(FRAMES) + 1.0 / _REST_FRAMES)
    weights = electrodes, np.linalg.inv(pressure)
    moving, lasting = _moving(instant, config), _lasting(instant, config)
    count = 5 * FRAMES
    information = np.eye(count + lasting.shape[1])
    information[:count, :count] = _prior_information(instant, lag)
    for part, weight in zip((slice(19), slice(19, 20)), weights, strict=True):
        rows, fixed = moving[part], lasting[part]
        information[:count, :count] += np.kron(rows.T @ rows, weight)
        cross = np.kron(rows.T @ fixed, weight.sum(axis=1)[:, None])
        information[:count, count:] += cross
        information[count:, :count] += cross.T
        information[count:, count:] += weight.sum() * fixed.T @ fixed
    now = np.zeros((len(information), 3))
    now[FRAMES * np.arange(1, 4) - 1, np.arange(3)] = 1.0
    return np.asarray(now.T @ np.linalg.solve(information, now))


def _prior_information(instant: Instant, lag: Array) -> Array:
    """Return the prior (5 F, 5 F) of forces and points: waves of all frequencies up to a rate."""
    prior = np.zeros((5 * FRAMES, 5 * FRAMES))
    for k, (spread, level, rate) in enumerate(
        zip(instant.spread, _LEVEL_STD, _RATE_HZ, strict=True)
    ):
        frequency = rate * np.linspace(0.05, 1.0, 100)
        waves = np.cos(2.0 * np.pi * frequency[:, None, None] * lag).mean(axis=0)
        covariance = spread**2 * waves + level**2 * (1.0 + 1e-8 * np.eye(FRAMES))
        part = slice(k * FRAMES, (k + 1) * FRAMES)
        prior[part, part] = np.linalg.inv(covariance)
    return prior


def _moving(instant: Instant, config: BioTacConfig) -> Array:
    """Return the signals' derivatives (20, 5) by force, per N, and contact point, per m."""
    axes, unit = _axes(instant.point), instant.unit
    columns = [
        _slope(instant.force + np.outer([h, -h], axis), instant.point, unit, config, h)
        for h, axis in zip(3 * [1e-3], axes.T, strict=True)
    ] + [
        _slope(instant.force, instant.point + np.outer([h, -h], axis), unit, config, h)
        for h, axis in zip(2 * [2e-5], axes.T[1:], strict=True)
    ]
    return np.stack(columns, axis=1)


def _lasting(instant: Instant, config: BioTacConfig) -> Array:
    """Return the signals' changes (20, C) by one standard deviation of what stays unknown."""
    unit, at = instant.unit, (instant.force, instant.point)
    step = np.array([1e-3, -1e-3])
    columns = []
    for name, std in _UNIT_STD.items():
        other = dataclasses.replace(unit, **{name: getattr(unit, name) * np.exp(step)})
        columns.append(std * _slope(*at, other, config, 1e-3))
    share = unit.local_share * np.exp(step)[:, None]
    other = dataclasses.replace(unit, local_share=share)
    columns += _each_electrode(LOCAL_SHARE_STD * _slope(*at, other, config, 1e-3))
    for axis in np.eye(3):
        moved = unit.nodes + 1e-6 * np.array([1.0, -1.0])[:, None, None, None] * axis
        other = dataclasses.replace(unit, nodes=moved)
        columns += _each_electrode(NODE_STD * _slope(*at, other, config, 1e-6))
    columns.append(_CURVATURE_STD * _slope(*at, unit, config, 1.0, np.array([1.0, -1.0])))
    return np.stack(columns, axis=1)


def _each_electrode(change: Array) -> list[Array]:
    """Split a change (20,) by parameters of electrodes into that by each one's."""
    return list(np.diag(change)[:19])


def _slope(
    force: Array,
    point: Array,
    unit: Units,
    config: BioTacConfig,
    step: float,
    bend: Array | None = None,
) -> Array:
    """Return the central difference (20,) of two neighbouring cases of two like units."""
    force, point = np.broadcast_to(force, (2, 3)), np.broadcast_to(point, (2, 3))
    normal = outward_normal(point)
    press = np.maximum(np.sum(force * normal, axis=1), 0.0)
    measured = sensed_share(point)
    traction = measured[:, None] * (press[:, None] * normal - force)
    curvature = np.zeros(2) if bend is None else bend
    patch = indent(measured * press, traction, point, curvature, unit, config)
    counts = electrode_counts(fluid_thickness(patch, unit, config), unit)
    signals = np.column_stack([counts, static_pressure(patch, unit, config)])
    return np.asarray((signals[0] - signals[1]) / (2.0 * step))


def _axes(point: Array) -> Array:
    """Return the normal at a contact point and two tangents as columns (3, 3)."""
    normal = outward_normal(point[None])[0]
    first = np.eye(3)[int(np.argmin(np.abs(normal)))]
    first = first - (first @ normal) * normal
    first /= np.linalg.norm(first)
    return np.stack([normal, first, np.cross(normal, first)], axis=1)


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the bound at the noises of the comparison of models."""
    from benchmarks.biotac import NOISES, TEST_SEED

    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--units", type=int, default=60, help="simulated sensors per protocol")
    parser.add_argument("--json", action="store_true", help="print only JSON")
    args = parser.parse_args(arguments)
    found = {
        name: information_bound(args.units, TEST_SEED, sensor) for name, sensor in NOISES.items()
    }
    if args.json:
        print(json.dumps(found))
    else:
        for name, bound in found.items():
            size, turn = bound["magnitude_n"], bound["direction_deg"]
            print(f"{name.replace('_', ' '):24s} {size:.4f} N  {turn:.2f} deg")
    return 0


if __name__ == "__main__":
    sys.exit(main())
