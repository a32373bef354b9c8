"""Run probes in the simulator, several processes at a time, and keep plain numbers of each."""

from __future__ import annotations

import sys
import zlib
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass
from operator import itemgetter
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.biotac_press_rig import calibrate_units
from benchmarks.friction.probe_trial import ProbeResult, ProbeTrial, run_probe_trial
from benchmarks.friction.subjects import Subject, draw_friction
from benchmarks.kept import continued
from tactile_dynamics_ros.core.errors import TactileDynamicsError
from tactile_dynamics_ros.core.friction.estimate import FrictionEstimateConfig
from tactile_dynamics_ros.core.friction.probe_config import FrictionProbeConfig
from tactile_dynamics_ros.core.tactile.fingertip import FingertipConfig
from tactile_dynamics_ros.sim.simulated_robot import SimulatedRobotConfig
from tactile_dynamics_ros.sim.world import WorldConfig

WIDTH = 0.02
"""Asked for in every probe of the study, so that it goes on to its time limit."""


@dataclass(frozen=True)
class Case:
    """One probe of the study.

    Attributes:
        subject: what is probed. trial: number.
        hand: seed of joint offsets, fingertips, noise and place.
        friction: static coefficient to use, or None to draw it.
        gain: of the fingertip, gain_std: its uncertainty.
        in_air: lifted instead of standing.
        variant: of the ramp.
    """

    subject: Subject
    hand: int
    trial: int = 0
    friction: float | None = None
    gain: float = 1.0
    gain_std: float = 0.05
    in_air: bool = False
    variant: str = "unload"

    @property
    def key(self) -> str:
        """Name that tells cases apart."""
        place = "air" if self.in_air else "table"
        gain = f"{self.gain:.4f}±{self.gain_std:.4f}"
        return f"{self.subject.name}/{self.hand}/{self.trial}/{self.variant}/{place}/{gain}"


def build_trial(case: Case, tips: Sequence[FingertipConfig] | None = None) -> ProbeTrial:
    """Return the trial of a case with friction drawn from its name.

    Args:
        case: what is probed.
        tips: configurations of the hand's fingertips from their calibration by presses.
    """
    rng = np.random.default_rng([zlib.crc32(case.subject.name.encode()), case.hand, case.trial])
    surfaces = draw_friction(case.subject, rng)
    if case.friction is not None:
        known = surfaces[case.subject.region]
        share = case.friction / known.static
        surfaces[case.subject.region] = type(known)(case.friction, known.kinetic * share)
    estimate = FrictionEstimateConfig(gain=case.gain, gain_std=case.gain_std)
    world = WorldConfig(object_name=case.subject.path)
    return ProbeTrial(
        robot=SimulatedRobotConfig(seed=case.hand, unit_seed=case.hand, world=world),
        surfaces=surfaces,
        surface=case.subject.surface(),
        regions=case.subject.regions(),
        site=case.subject.site(),
        probe=FrictionProbeConfig(variant=case.variant, width=WIDTH, estimate=estimate),
        in_air=case.in_air,
        tips=tips,
    )


def run_case(case: Case) -> dict[str, Any]:
    """Run one probe and return what it found beside what was true."""
    trial = build_trial(case, calibrate_units(case.hand))
    row: dict[str, Any] = {"subject": case.subject.name, "hand": case.hand, "trial": case.trial}
    row |= {"in_air": case.in_air, "variant": case.variant}
    try:
        result = run_probe_trial(trial)
    except TactileDynamicsError as error:
        return row | {"outcome": str(error)}
    return row | summarise(case, trial, result)


def summarise(case: Case, trial: ProbeTrial, result: ProbeResult) -> dict[str, Any]:
    """Plain numbers of one probe."""
    truth = trial.surfaces[case.subject.region]
    row: dict[str, Any] = {
        "outcome": result.outcome,
        "duration": result.duration,
        "dropped": bool(result.dropped),
        "strongest": result.strongest,
        "moved_mm": 1e3 * result.moved,
        "true_static": truth.static,
        "true_kinetic": truth.kinetic,
        "events": [asdict(event) for event in result.events],
        "slip": slip_scores(result),
    }
    found = result.estimates.get(case.subject.region)
    if found is not None:
        row["estimate"] = asdict(found) | {"tilt": found.tilt.tolist()}
    return row


def holds_truth(row: dict[str, Any]) -> bool:
    """Whether the interval of a probe with an estimate holds the true static coefficient."""
    low, high = row["estimate"]["interval"]
    return bool(low <= row["true_static"] <= high)


def slip_scores(result: ProbeResult) -> dict[str, Any]:
    """Time series that compare detectors of slip with the true speed, thinned to what is needed."""
    if not result.record.rows:
        return {}
    names = ("time", "speed", "vibration", "electrodes", "path")
    return {name: result.record.column(name).round(6).tolist() for name in names} | {
        "phase": [row["phase"] for row in result.record.rows],
        "measured": result.record.column("measured").round(4).tolist(),
    }


def run_cases(
    cases: Iterable[Case],
    processes: int,
    cache: Path,
    work: Callable[[Case], dict[str, Any]] = run_case,
) -> list[dict[str, Any]]:
    """Run cases that the cache lacks and return the rows of all, in order."""
    cases = list(cases)

    def answer(missing: list[int]) -> Iterator[dict[str, Any]]:
        todo = [cases[k] for k in missing]
        for hand in {case.hand for case in todo}:
            calibrate_units(hand)  # once, before the processes are forked, which then know it
        with ProcessPoolExecutor(processes) as pool:
            for case, row in zip(todo, pool.map(work, todo), strict=True):
                yield (found := row | {"key": case.key})
                print(_line(found), file=sys.stderr, flush=True)

    return continued(cache, [case.key for case in cases], itemgetter("key"), answer)


def _line(row: dict[str, Any]) -> str:
    found = row.get("estimate")
    if found is None:
        return f"{row['key']}: {row['outcome']}"
    return (
        f"{row['key']}: {found['static']:.3f} ± {found['std']:.3f}, "
        f"true {row['true_static']:.3f}, "
        f"{len(row['events'])} slips in {row['duration']:.1f} s {row['outcome']}"
    )
