"""Which recordings the benchmark makes, and what is hidden in them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import cycle
from typing import Any

from tactile_dynamics_ros.synthetic import (
    CATALOGUE,
    OUTSIDE,
    ScenarioOptions,
    SensorOptions,
    randomness,
)
from tactile_dynamics_ros.synthetic.recordings import HiddenRecording, generate_at_whitened_rms

REPORT_START = 1000
"""Seeds from here on are for reports; smaller ones may be used to tune."""

STRONG = 1.35
LEVELS = (1.1, 1.2, STRONG, 2.0, 4.0)
SENSOR_SETS: dict[str, dict[str, Any]] = {
    "fast_forces": {"force_rate_hz": 1000.0, "pose_rate_hz": 60.0, "stagger": True},
    "forces_250": {"force_rate_hz": 250.0},
    "poses_250": {"pose_rate_hz": 250.0, "stagger": True},
    "all_500": {"force_rate_hz": 500.0, "pose_rate_hz": 500.0},
    "all_50": {"force_rate_hz": 50.0, "pose_rate_hz": 50.0},
    "poses_30": {"pose_rate_hz": 30.0},
    "quiet_unstated": {"force_std": 0.005, "state_force_std": False},
    "loud_unstated": {"force_std": 0.1, "state_force_std": False},
    "loud_poses": {"position_std": 0.002, "rotation_std_deg": 1.0},
    "quiet_poses": {"position_std": 5e-5, "rotation_std_deg": 0.02},
    "noisy_points": {"contact_position_std": 0.0005},
    "gaps": {"pose_gaps": 4, "zero_when_lifted": True},
}
"""Sensors of other laboratories: what differs from the usual ones."""

_PAIR_PARTNERS = tuple(name for name in CATALOGUE if name != "sloshing_mass")


IN_PART = tuple(
    f"{name}[{bounds}]"
    for name, bounds in (
        ("dipole_pull", "8<t<20"),
        ("charge_pull", "t>15"),
        ("stiffening_spring", "t<18"),
        ("force_hysteresis", "10<t<22"),
    )
)
"""What no catalogue has and acts for a part of the time."""


@dataclass(frozen=True)
class Case:
    """One recording.

    Attributes:
        kind: "clean", "single", "calm" (single effects, a motion that tells little), "pair" or
            "outside".
        effects: what is hidden.
        level: whitened RMS to which each effect alone would raise the error.
        seed: of everything else.
        duration: s.
        sensor_set: one of `SENSOR_SETS`, or the usual ones.
    """

    kind: str
    effects: tuple[str, ...]
    level: float
    seed: int
    duration: float = 30.0
    sensor_set: str = ""

    @property
    def key(self) -> str:
        """Name that no other case has."""
        hidden = "+".join(self.effects) or "nothing"
        key = f"{self.kind}:{hidden}:{self.level:g}:{self.seed}:{self.duration:g}"
        return f"{key}:{self.sensor_set}" if self.sensor_set else key

    def scenario(self) -> ScenarioOptions:
        """Half of the recordings have a re-grasp, a quarter loses contact, a third has no roll.

        Calm ones turn by a few degrees in one and the same grasp.
        """
        if self.kind == "calm":
            return ScenarioOptions(
                duration=self.duration,
                band_hz=(0.2, 0.8),
                position_peak=(0.01, 0.03),
                angle_peak_deg=(4.0, 12.0),
                finger_roll=False,
            )
        return ScenarioOptions(
            duration=self.duration,
            finger_roll=self.seed % 3 != 0,
            regrasp=self.seed % 2 == 1,
            contact_breaks=2 if self.seed % 4 == 3 else 0,
        )

    def sensors(self) -> SensorOptions:
        """A quarter of the recordings samples at different phases, a third shows normals only."""
        frames = "finger" if self.seed % 3 else "normal"
        usual = SensorOptions(stagger=self.seed % 4 == 2, frames=frames)
        return replace(usual, **SENSOR_SETS.get(self.sensor_set, {}))

    @property
    def axes_told(self) -> bool:
        """Whether the recording tells the axes of the sensors, which turn against the object."""
        return self.scenario().finger_roll and self.sensors().frames == "finger"

    def record(self) -> HiddenRecording:
        """Generate the recording."""
        targets = dict.fromkeys(self.effects, self.level)
        return generate_at_whitened_rms(self.seed, targets, self.scenario(), self.sensors())


def plan_quick(start: int) -> list[Case]:
    """A handful of short recordings that show that everything works."""
    return [
        Case("clean", (), 1.0, start, 10.0),
        Case("single", ("viscous_drag",), 4.0, start, 10.0),
        Case("outside", ("dry_rubbing",), 4.0, start, 10.0),
    ]


def plan(start: int, seeds: int, clean: int, pairs: int, outside: int, calm: int) -> list[Case]:
    """Return all cases: those that matter most come first in every round of seeds.

    Args:
        start: first seed.
        seeds: recordings per effect and level.
        clean: recordings without any effect.
        pairs: recordings with two effects.
        outside: recordings per effect outside the catalogue.
        calm: recordings per effect with a motion that tells little.
    """
    cases = [Case("clean", (), 1.0, start + k) for k in range(clean)]
    for k in range(max(seeds, outside)):
        if k < seeds:
            cases += [Case("single", (name,), STRONG, start + k) for name in CATALOGUE]
        if k < outside:
            names = (*OUTSIDE, *IN_PART)
            cases += [Case("outside", (name,), 2.0, start + k) for name in names]
    cases += list(_draw_pairs(start, pairs))
    cases += [Case("calm", (name,), 2.0, start + k) for k in range(calm) for name in CATALOGUE]
    for level in (2.0, 1.2, 4.0, 1.1):
        cases += [
            Case("single", (name,), level, start + k) for k in range(seeds) for name in CATALOGUE
        ]
    return cases


def with_sensors(cases: Sequence[Case], names: Sequence[str]) -> list[Case]:
    """The cases with other sensors, sets of `SENSOR_SETS` in turn."""
    return [replace(case, sensor_set=name) for case, name in zip(cases, cycle(names), strict=False)]


def _draw_pairs(start: int, count: int) -> Iterator[Case]:
    for k in range(count):
        rng = randomness.stream(start + k, "pair")
        first, second = rng.choice(len(_PAIR_PARTNERS), size=2, replace=False)
        names = (_PAIR_PARTNERS[first], _PAIR_PARTNERS[second])
        yield Case("pair", names, 2.0, start + k)
