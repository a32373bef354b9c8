"""A push or a pull that might be made, and the way on which it leads the tip or the grip."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.planar.actions.straight import Travel

MANNERS = ("push", "stop", "pull", "shake")
"""A push, a faster one with a hard stop, a pull, a pull that is shaken along its way."""
WORDS = {
    "push": "push it",
    "stop": "push it and stop hard",
    "pull": "pull it",
    "shake": "shake it while pulling",
}
"""The manners as what is to be done."""
_REST = {"push": 0.1, "stop": 0.4, "pull": 0.1, "shake": 0.1}
"""s that are looked at after the way: what a hard stop lets slide on at 0.3 m/s comes to rest
within 0.3 s where friction is above 0.1; everything else rests with the tip."""


@dataclass(frozen=True, eq=False)
class Candidate:
    """A straight push or pull that might be made, in the object's frame.

    Attributes:
        point: (2,) m on the outline; of a pull the middle between the pads.
        normal: (2,) unit, into the object; of a pull from the right pad to the left one.
        direction: (2,) unit. speed: m/s. length: m after contact.
        acceleration: m/s^2, at the start. manner: one of MANNERS.
        braking: m/s^2, at the stop; 0 as at the start.
        sway: m, of a shake along the way, from end to end. sway_hz: how often.
        width: m, between the pads of a pull once they grip.
    """

    point: Array
    normal: Array
    direction: Array
    speed: float
    length: float
    acceleration: float
    manner: str = "push"
    braking: float = 0.0
    sway: float = 0.0
    sway_hz: float = 0.0
    width: float = 0.0

    @property
    def grips(self) -> bool:
        """Whether two pads hold the object."""
        return self.manner in ("pull", "shake")

    @property
    def travel(self) -> Travel:
        """How the way is gone."""
        return Travel(self.speed, self.acceleration, self.braking, self.sway, self.sway_hz)


def path_of(candidate: Candidate, step: float) -> Array:
    """Poses (T, 3) of the tip's or the grip's point: from rest to rest, and a little rest.

    Args:
        candidate: what is done.
        step: s, between poses.
    """
    travel = candidate.travel
    whole = travel.duration(candidate.length) + _REST[candidate.manner]
    time = np.asarray(np.arange(int(np.ceil(whole / step)) + 1) * step, dtype=float)
    along = travel.at(time, candidate.length)
    place = candidate.point + along[:, None] * candidate.direction
    return np.column_stack([place, np.zeros(len(time))])
