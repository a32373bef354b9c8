"""Do the pushes that `check` proposes for a recording of two pushes bring what it promised?"""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from benchmarks.page_section import compose_section, section_parser, show
from tactile_dynamics_ros.api.pushed_checks import PushedCheck, check_pushes
from tactile_dynamics_ros.core.errors import NotIdentifiableError
from tactile_dynamics_ros.core.planar.joining import join_pushes
from tactile_dynamics_ros.core.planar.mechanics.support import SupportPatch
from tactile_dynamics_ros.core.planar.properties.estimate import PushedEstimate, estimate
from tactile_dynamics_ros.core.planar.streams import PushedStreams
from tactile_dynamics_ros.recording.pushed import PushedRecording
from tactile_dynamics_ros.synthetic import pushed

FIRST_SEED = 26024
"""Seeds from here on were not used for tuning (25900 to 26023 were, or were looked into)."""
WANTED = 1.5
"""Factor within which what came is wanted to be of what was promised, as of held objects: by its
square too few or too many pushes are proposed."""
_TWO = pushed.ActionOptions(count=2, speed=(0.03, 0.2))
KINDS = {
    "even table": pushed.PushOptions(actions=_TWO),
    "uneven by 10 %": pushed.PushOptions(
        actions=_TWO, variation=0.1, uneven=0.1, sensors=pushed.SensorOptions(systematic=1.0)
    ),
    "slower sensors": pushed.PushOptions(
        actions=_TWO, sensors=pushed.SensorOptions(rate_hz=50.0, force_rate_hz=50.0)
    ),
    "noisier forces": pushed.PushOptions(actions=_TWO, sensors=pushed.SensorOptions(force_std=0.1)),
}
"""Recordings of two pushes: on which table, by which sensors."""
PARAMETERS = ("friction force", "mass", "centre of mass along x", "centre of mass along y")
"""What `check` tells of one part, in its order."""


@dataclass(frozen=True)
class Outcome:
    """What was promised of a parameter and what the proposed pushes brought.

    Attributes:
        kind: of KINDS. seed: of the recording. pushes: that were proposed.
        parameter: of PARAMETERS. lacking: whether it was not known as well as wanted.
        said: standard deviation that `check` states, over that of `estimate`.
        now, promised, got: standard deviation over size before, as promised, and afterwards; nan
            where nothing was promised or the pushes could not be estimated.
        error: error afterwards in promised standard deviations.
    """

    kind: str
    seed: int
    pushes: int
    parameter: str
    lacking: bool
    said: float
    now: float
    promised: float
    got: float
    error: float

    @property
    def ratio(self) -> float:
        """What came over what was promised."""
        return self.got / self.promised


def outcomes(start: int, count: int) -> Iterator[Outcome]:
    """Check recordings of two pushes, make the proposed ones, and estimate from all."""
    for seed in range(start, start + count):
        kind = list(KINDS)[(seed - start) % len(KINDS)]
        [made] = pushed.generate([seed], {}, KINDS[kind])
        try:
            yield from graded(kind, made)
        except NotIdentifiableError as error:
            print(f"{kind} {seed}: refused, {error}", file=sys.stderr)


def graded(kind: str, made: pushed.HiddenPush) -> list[Outcome]:
    """Check one recording, push on as proposed, and grade each parameter.

    Raises:
        NotIdentifiableError: the object slides too little, or a fit does not come to an end.
    """
    checked = check_pushes(PushedRecording(made.streams, kind))
    alone = relative(_of_one(made.streams), made)
    promised, got, error = np.full((3, len(PARAMETERS)), np.nan)
    if checked.addition is not None:
        promised = np.array([checked.promised[name] for name in PARAMETERS])
        second = push_on(made, checked, KINDS[kind].sensors)
        both = _of_one(join_pushes([made.streams, second.streams]))
        got = relative(both, made)
        error = errors(both, made) / promised
    now = [checked.relative[name] for name in PARAMETERS]
    pushes = checked.addition.count if checked.addition else 0
    return [
        Outcome(kind, made.scene.seed, pushes, name, name in checked.lacking, *map(float, row))
        for name, *row in zip(
            PARAMETERS, np.array(now) / alone, now, promised, got, error, strict=True
        )
    ]


def push_on(
    made: pushed.HiddenPush, checked: PushedCheck, sensors: pushed.SensorOptions
) -> pushed.HiddenPush:
    """Record the pushes that are proposed for a recording, from where it left the object."""
    assert checked.addition is not None
    push = checked.addition.choice.candidate
    planned = pushed.PlannedPush(
        push.point,
        push.direction,
        push.speed,
        push.length,
        push.acceleration,
        push.travel.stopping,
    )
    return pushed.record_pushes(made, planned, checked.addition.count, sensors)


def _of_one(streams: PushedStreams) -> PushedEstimate:
    found = estimate(streams)
    assert isinstance(found, PushedEstimate)
    return found


def relative(found: PushedEstimate, made: pushed.HiddenPush) -> np.ndarray:
    """Return standard deviations (4,) over size, in the order of PARAMETERS."""
    force, mass = (found.values[n][1] / found.values[n][0] for n in ("friction_force_n", "mass"))
    return np.array([force, mass, *(found.values[n][1] / _reach(made) for n in ("com_x", "com_y"))])


def errors(found: PushedEstimate, made: pushed.HiddenPush) -> np.ndarray:
    """Return errors (4,) over size, in the order of PARAMETERS."""
    truth = made.truth()["links"][0]
    shares = [found.values[n][0] / truth[n] - 1.0 for n in ("friction_force_n", "mass")]
    away = np.array([found.values[n][0] for n in ("com_x", "com_y")]) - truth["com"]
    return np.array([*shares, *away / _reach(made)])


def _reach(made: pushed.HiddenPush) -> float:
    """Radius of gyration of the footprint, m."""
    return float(np.sqrt(SupportPatch(made.scene.thing.links[0].corners).gyration))


def table(found: Sequence[Outcome]) -> list[str]:
    """Rows of the table: each parameter of all recordings, what was lacking, each kind."""
    rows: list[tuple[str, list[Outcome]]] = [
        (name, [one for one in found if one.parameter.startswith(name)])
        for name in ("friction force", "mass", "centre of mass")
    ]
    lacking = [one for one in found if one.lacking]
    rows += [("all that was lacking", lacking)]
    rows += [(f"lacking, {kind}", [o for o in lacking if o.kind == kind]) for kind in KINDS]
    rows += [("all", list(found))]
    head = [
        "| parameters | recordings | n | std now, promised, got (median over size) | got over "
        "promised: median, least, most | within 1.5; worse | RMS error in promised std |",
        "|---|---|---|---|---|---|---|",
    ]
    return head + [line for name, own in rows for line in _line(name, own)]


def _line(name: str, own: Sequence[Outcome]) -> list[str]:
    own = [one for one in own if np.isfinite(one.ratio)]
    if not own:
        return []
    ratio = np.array([one.ratio for one in own])
    within = int(np.sum(np.abs(np.log(ratio)) <= np.log(WANTED)))
    worse = int(np.sum(ratio > WANTED))
    medians = " ".join(
        f"{100 * float(np.median([getattr(one, name) for one in own])):.2g} %"
        for name in ("now", "promised", "got")
    )
    rms = float(np.sqrt(np.mean([one.error**2 for one in own])))
    return [
        f"| {name} | {len({one.seed for one in own})} | {len(own)} | {medians} | "
        f"{np.median(ratio):.2f}, {ratio.min():.2f}, {ratio.max():.2f} | {within}/{len(own)}; "
        f"{worse} | {rms:.2f} |"
    ]


def section(found: Sequence[Outcome], command: str) -> str:
    """The section of the page."""
    seeds = {one.seed for one in found}
    kept = {one.seed: one.pushes for one in found if np.isfinite(one.ratio)}
    said = float(np.exp(max(abs(np.log(one.said)) for one in found)))
    text = [
        "## Recordings of two pushes, and which `check` proposes to add",
        "",
        "Two pushes of 30 to 200 mm/s of one object. `check` proposes pushes for what is not known",
        "to 10 %; the simulator goes on from where the object lies, on the same table with the",
        "same lasting errors of sensors, and makes them as proposed: point, direction, speed, way,",
        "acceleration, number. Both recordings are estimated together. Wanted: what came is within",
        "a factor of 1.5 of what was promised; *worse* came wider than that.",
        f"`check` proposed pushes for {len(kept)} of {len(seeds)} recordings,",
        f"{np.mean(list(kept.values())):.1f} on average. Its standard deviations over those of",
        f"`estimate`: at most {said:.3f}.",
    ]
    return compose_section("pushed_check", text, command, table(found))


def main(arguments: Sequence[str] | None = None) -> int:
    """Check, push, estimate; print the table and write it."""
    parser = section_parser(__doc__, FIRST_SEED)
    parser.add_argument("--count", type=int, default=24, help="recordings")
    options = parser.parse_args(arguments)
    command = f"./dev bench pushed_check --start {options.start} --count {options.count}"
    found = outcomes(options.start, options.count)
    return show(found, table, lambda found: section(found, command), options.write)
