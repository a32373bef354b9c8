"""Slips of one probe as arrays, ready for a model of friction."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.errors import BadInputError, NotIdentifiableError
from tactile_dynamics_ros.core.friction.estimate import SlipEvent

Array = NDArray[np.float64]

FEWEST = 12
"""Slips that a model of friction needs: two numbers each, for two coefficients, an error of
direction and a rival effect. Fewer leave no scatter to judge by. More refuse probes that would
do."""
LEAST_SPEED = 2e-3
"""Speed, m/s, below which a fingertip creeps with nearly static friction, so that its force is not
kinetic. Facts on practice call less than 1 mm/s incipient. Lower takes static friction for kinetic,
higher leaves slow slides out."""


@dataclass(frozen=True)
class SlipTable:
    """N slips, each just before it began and while it went on.

    Attributes:
        time: (N,) s. angle: (N,) direction of the pull, rad.
        normal, tangential: (N, 2) N, before the slip and while sliding.
        speed: (N,) m/s, of the sliding.
        memory_normal, memory_tangential: (N,) N, what the skin remembers of past forces.
    """

    time: Array
    angle: Array
    normal: Array
    tangential: Array
    speed: Array
    memory_normal: Array
    memory_tangential: Array

    def __post_init__(self) -> None:
        for field in fields(self):
            if not np.all(np.isfinite(getattr(self, field.name))):
                raise BadInputError(f"slips: {field.name} has values that are not finite")

    def __len__(self) -> int:
        return len(self.time)


def tabulate_slips(events: Sequence[SlipEvent], region: str | None = None) -> SlipTable:
    """Return the slips of one region that slid far and fast enough, in the order of time.

    Args:
        events: slips of a probe.
        region: the one with most slips if None.

    Raises:
        NotIdentifiableError: too few slips.
    """
    names = [event.region for event in events]
    region = region or max(names, key=names.count, default="")
    sliding = [e for e in events if np.isfinite(e.kinetic) and e.speed > LEAST_SPEED]
    own = [event for event in sliding if event.region == region]
    if len(own) < FEWEST:
        raise NotIdentifiableError(
            f"probe recording: {len(own)} slips of '{region}' slid long enough, expected at least "
            f"{FEWEST}; probe longer (most_slips, time_limit) or slide further (slide_time)"
        )
    own = sorted(own, key=lambda event: event.time)

    def column(name: str) -> Array:
        return np.array([getattr(event, name) for event in own], dtype=float)

    pressing = column("sliding_normal")
    return SlipTable(
        time=column("time"),
        angle=column("angle"),
        normal=np.column_stack([column("normal"), pressing]),
        tangential=np.column_stack([column("tangential"), column("kinetic") * pressing]),
        speed=column("speed"),
        memory_normal=column("memory_normal"),
        memory_tangential=column("memory_tangential"),
    )


def event_from_values(values: Mapping[str, str]) -> SlipEvent:
    """Return the slip that key-value pairs of `/friction_probe/slip` describe.

    Raises:
        BadInputError: a value is missing or no number.
    """
    texts = {"region", "variant"}
    try:
        found = {
            field.name: values[field.name] if field.name in texts else float(values[field.name])
            for field in fields(SlipEvent)
        }
    except (KeyError, ValueError) as error:
        raise BadInputError(f"/friction_probe/slip: {error!r}; expected all of a slip") from error
    return SlipEvent(**found)  # type: ignore[arg-type]


def slip_scalars(slips: SlipTable) -> dict[str, tuple[str, str, Array]]:
    """Name, unit and values (N,) of what a slip went through, by symbol.

    `t` (time), `N` (normal force), `v` (sliding speed) and `phi` (direction of the pull).
    """
    return {
        "t": ("time", "s", slips.time - slips.time[0]),
        "N": ("normal force", "N", slips.normal[:, 0]),
        "v": ("sliding speed", "m/s", slips.speed),
        "phi": ("direction", "deg", np.degrees(np.mod(slips.angle, 2.0 * np.pi))),
    }
