"""Which recordings the benchmark makes, and what is hidden in them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from benchmarks.hidden import CATALOGUE, OUTSIDE, ScenarioOptions, SensorOptions, randomness
from benchmarks.hidden.recordings import HiddenRecording, generate_at_whitened_rms

REPORT_START = 1000
"""Seeds from here on are for reports; smaller ones may be used to tune."""

STRONG = 1.35
LEVELS = (1.1, 1.2, STRONG, 2.0, 4.0)
_PAIR_PARTNERS = tuple(name for name in CATALOGUE if name != "sloshing_mass")


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
    """

    kind: str
    effects: tuple[str, ...]
    level: float
    seed: int
    duration: float = 30.0

    @property
    def key(self) -> str:
        """Name that no other case has."""
        hidden = "+".join(self.effects) or "nothing"
        return f"{self.kind}:{hidden}:{self.level:g}:{self.seed}:{self.duration:g}"

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
        return SensorOptions(stagger=self.seed % 4 == 2, frames=frames)

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
            cases += [Case("outside", (name,), 2.0, start + k) for name in OUTSIDE]
    cases += list(_draw_pairs(start, pairs))
    cases += [Case("calm", (name,), 2.0, start + k) for k in range(calm) for name in CATALOGUE]
    for level in (2.0, 1.2, 4.0, 1.1):
        cases += [
            Case("single", (name,), level, start + k) for k in range(seeds) for name in CATALOGUE
        ]
    return cases


def _draw_pairs(start: int, count: int) -> Iterator[Case]:
    for k in range(count):
        rng = randomness.stream(start + k, "pair")
        first, second = rng.choice(len(_PAIR_PARTNERS), size=2, replace=False)
        names = (_PAIR_PARTNERS[first], _PAIR_PARTNERS[second])
        yield Case("pair", names, 2.0, start + k)
