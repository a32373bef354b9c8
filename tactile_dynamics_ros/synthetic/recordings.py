"""Recordings with known truth: streams, what is hidden in them, and rosbag2 files."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from tactile_dynamics_ros.core.streams.streams import Streams
from tactile_dynamics_ros.recording import bag_writer
from tactile_dynamics_ros.synthetic.calibration import magnitude_for_whitened_rms
from tactile_dynamics_ros.synthetic.effects import HiddenEffect, create_hidden_effect
from tactile_dynamics_ros.synthetic.scenario import Scenario, ScenarioOptions
from tactile_dynamics_ros.synthetic.sensors import SensorOptions, read_sensors


@dataclass(frozen=True)
class HiddenRecording:
    """What was recorded, and the truth that the estimation side never sees."""

    streams: Streams
    scenario: Scenario
    effects: tuple[HiddenEffect, ...]

    def truth(self) -> dict[str, Any]:
        """Body and effects as plain numbers, ready for JSON."""
        body = self.scenario.body
        return {
            "seed": self.scenario.seed,
            "mass": body.mass,
            "com": body.com.tolist(),
            "inertia_com": body.inertia_com.tolist(),
            "effects": {effect.name: _describe(effect) for effect in self.effects},
        }


def generate(
    seed: int,
    effects: dict[str, float] | None = None,
    scenario: ScenarioOptions | None = None,
    sensors: SensorOptions | None = None,
) -> HiddenRecording:
    """Generate a recording with the named effects at the given magnitudes."""
    drawn = Scenario.draw(seed, scenario)
    hidden = tuple(
        create_hidden_effect(name, size, seed, drawn) for name, size in (effects or {}).items()
    )
    return record(drawn, hidden, sensors)


def generate_at_whitened_rms(
    seed: int,
    effects: dict[str, float] | None = None,
    scenario: ScenarioOptions | None = None,
    sensors: SensorOptions | None = None,
) -> HiddenRecording:
    """Generate a recording in which each effect alone would raise the whitened RMS to its value."""
    drawn = Scenario.draw(seed, scenario)
    hidden = []
    for name, target in (effects or {}).items():
        effect = create_hidden_effect(name, 1.0, seed, drawn)
        size = magnitude_for_whitened_rms(effect, target, drawn, sensors)
        hidden.append(dataclasses.replace(effect, magnitude=size))
    return record(drawn, tuple(hidden), sensors)


def record(
    scenario: Scenario, effects: tuple[HiddenEffect, ...], sensors: SensorOptions | None
) -> HiddenRecording:
    """Record a scenario with effects of magnitudes that are known."""
    active = tuple(effect for effect in effects if effect.magnitude != 0.0)
    truth = scenario.simulate(active)
    streams = read_sensors(truth, active, sensors or SensorOptions(), scenario.seed)
    return HiddenRecording(streams, scenario, effects)


def _describe(effect: HiddenEffect) -> dict[str, Any]:
    return {
        "magnitude": effect.magnitude,
        "reading": effect.reading,
        "parameters": {
            name: {"value": np.asarray(quantity.value).tolist(), "unit": quantity.unit}
            for name, quantity in effect.parameters.items()
        },
        "signature": effect.signature,
    }


EPOCH_NS = 1_700_000_000_000_000_000
"""Stamp of time zero in ns (November 2023): no stamp may be negative, and streams whose clocks
differ begin before their time zero."""


def write_bag(streams: Streams, path: Path) -> Path:
    """Write all streams to a new directory, or to a single file if the name ends in .mcap.

    Args:
        streams: what to write.
        path: where; must not exist.

    Raises:
        BadInputError: the path exists already or cannot be written.
    """
    return bag_writer.write_bag(streams, path, EPOCH_NS)
