"""Forces and places around slips: what one says of it, and all of a probe as arrays."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.errors import BadInputError, NotIdentifiableError
from tactile_dynamics_ros.core.friction.estimate import SlipEvent

_REACH = 0.45
"""Time before an alarm, s, in which the slip is sought: several times what detection takes. Longer
takes in creep of the slip before, shorter may miss the peak of the ratio."""
_AFTER = 0.05
"""Time after an alarm, s, that still belongs to it: means of `_SMOOTHED` instants reach 0.04 s
beyond their middle at 100 Hz. Longer takes in the slide."""
_SMOOTHED = 9
"""Instants whose mean is taken for the force at one of them, 0.09 s at 100 Hz: such means round the
peak off by about as much as the greatest of noisy ones is too high. More make friction too low,
fewer too high."""
_FEWEST = 6
"""Instants that a part of a slip needs to be looked at; the window needs twice as many. At 100 Hz
it is 60 ms. Fewer give means and slopes of noise, more leave slips out that were quick."""
_LEAST_PATH = 6e-4
"""Way of a slide, m, from which its force counts as kinetic: less is within what the skin gives.
Less takes the skin's give for sliding, more leaves short slides without a kinetic coefficient."""
_LEAST_TILT_PATH = 1e-3
"""Way of a slide, m, from which its slope against the mesh is reported: 0.1 mm of error are 6 deg
of slope then. Shorter slides give slopes of noise, longer are rare (a slide takes 0.15 s)."""
_LEAST_UNLOAD = 0.25
"""Change of the normal force, N, from which the give of fingertip and surface is distinguished from
it: eight times the noise of a fingertip's force. Less gives noise for an answer, more leaves
attempts without one."""
_LEAST_COSINE = 0.8
"""Share of the tangential force that must be along the pull: within 37 deg. A slip in another
direction is not that of the attempt, and is left out. Lower takes other slips in, higher leaves
those out that the grain of a surface turns."""


@dataclass(frozen=True)
class Attempt:
    """One attempt to make the finger slip, as it was planned.

    Attributes:
        angle: direction that was pulled, rad. region: of the surface. variant: of the ramp.
        began: when the ramp began, s. detected: when the slip was noticed, s.
        basis: (3, 3) rows normal, e1, e2 of the plane of contact, world axes.
        memory: (3,) past normal and tangential forces, averaged, N.
        skin_stiffness: normal stiffness of the fingertip, N/m.
    """

    angle: float
    region: str
    variant: str
    began: float
    detected: float
    basis: Array
    memory: Array
    skin_stiffness: float = 4000.0


class SlipLog:
    """Collects one attempt from load to the end of the slide."""

    def __init__(self) -> None:
        self.clear()

    def clear(self) -> None:
        """Forget the past attempt."""
        self._time: list[float] = []
        self._force: list[Array] = []
        self._place: list[Array] = []

    def add(self, time: float, force: Array, place: Array) -> None:
        """Add one instant.

        Args:
            time: s.
            force: (3,) normal force and two tangential components, N.
            place: (3,) place of the fingertip relative to the object, m, world axes.
        """
        self._time.append(time)
        self._force.append(force)
        self._place.append(place)

    def event(self, attempt: Attempt) -> SlipEvent | None:
        """Return the slip of the attempt, or None if too little was seen of it.

        Tangential forces are taken along the pull: what is measured across it is mostly the error
        of the force's direction. The slip is where the ratio of the smoothed forces is greatest, so
        that neither the delay of the detection enters nor creep before the slip.
        """
        time, force = np.array(self._time), np.array(self._force)
        place = np.array(self._place) @ attempt.basis.T
        heading = np.array([np.cos(attempt.angle), np.sin(attempt.angle)])
        window = (time >= max(attempt.detected - _REACH, attempt.began)) & (
            time <= attempt.detected + _AFTER
        )
        if window.sum() < 2 * _FEWEST or np.any(force[window, 0] < 0.03):
            return None
        near = np.flatnonzero(window)[find_slip(force[window, 0], force[window, 1:] @ heading)]
        onset, (value, std) = float(time[near].mean()), _mean(time[near], force[near])
        ramp = (time >= attempt.began) & (time < onset)
        normal, tangential = float(value[0]), float(value[1:] @ heading)
        whole = float(np.linalg.norm(value[1:]))
        if normal <= 0.05 or tangential <= max(0.02, _LEAST_COSINE * whole):
            return None
        ratio = tangential / normal
        kinetic, speed, tilt, sliding = _slide(time, force, place, time > attempt.detected, attempt)
        return SlipEvent(
            time=onset,
            region=attempt.region,
            angle=attempt.angle,
            normal=normal,
            tangential=tangential,
            std=ratio * float(np.hypot(std[0] / normal, np.linalg.norm(std[1:]) / tangential)),
            kinetic=kinetic,
            speed=speed,
            variant=attempt.variant,
            tilt=tilt,
            delay=attempt.detected - onset,
            give=_give(force[ramp, 0], place[ramp, 0]),
            sliding_normal=sliding,
            memory_normal=float(attempt.memory[0]),
            memory_tangential=float(attempt.memory[1:] @ heading),
        )


def find_slip(normal: Array, tangential: Array) -> slice:
    """Instants about which the ratio of the mean tangential to the mean normal force is greatest.

    Means are over as many instants: of single ones the greatest ratio is one of noise.

    Args:
        normal: (T,) N, positive.
        tangential: (T,) N along the pull.
    """
    window = np.ones(min(_SMOOTHED, len(normal)))
    ratio = np.convolve(tangential, window, "valid") / np.convolve(normal, window, "valid")
    first = int(np.argmax(ratio))
    return slice(first, first + len(window))


def _slide(
    time: Array, force: Array, place: Array, after: NDArray[np.bool_], attempt: Attempt
) -> tuple[float, float, float, float]:
    """Ratio, speed (m/s), slope against the mesh (rad) and normal force (N) of the slide.

    What cannot be reported because it was too short is nan.
    """
    nothing = float("nan")
    if after.sum() < 4:
        return nothing, 0.0, nothing, nothing
    moved = place[after][-1] - place[after][0]
    path = float(np.linalg.norm(moved[1:]))
    speed = path / float(time[after][-1] - time[after][0])
    mean = force[after].mean(axis=0)
    if path < _LEAST_PATH or mean[0] <= 0.05:
        return nothing, speed, nothing, nothing
    sunk = (force[after][-1, 0] - force[after][0, 0]) / attempt.skin_stiffness
    tilt = float(np.arctan2(moved[0] - sunk, path)) if path > _LEAST_TILT_PATH else nothing
    ratio = float(mean[1:] @ [np.cos(attempt.angle), np.sin(attempt.angle)] / mean[0])
    return ratio, speed, tilt, float(mean[0])


def _give(press: Array, depth: Array) -> float:
    """How far the fingertip follows the surface per newton, m/N; nan if the force hardly changed.

    Args:
        press: (T,) normal force while it is ramped, N.
        depth: (T,) place of the fingertip along the normal, m.
    """
    if len(press) < _FEWEST or float(np.ptp(press)) < _LEAST_UNLOAD:
        return float("nan")
    change = press - press.mean()
    return float(change @ depth / (change @ change))


def _mean(time: Array, values: Array) -> tuple[Array, Array]:
    """Mean of (T, K) values and its standard deviation, from the scatter about lines."""
    design = np.column_stack([np.ones_like(time), time - time.mean()])
    error = values - design @ np.linalg.lstsq(design, values, rcond=None)[0]
    variance = np.sum(error**2, axis=0) / max(len(time) - 2, 1)
    return values.mean(axis=0), np.sqrt(variance / len(time))


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
