"""What the page shows, whether it comes from topics or from a recording."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

KEPT = 600
"""Points of a chart: a minute at 10 Hz, about as many as it has pixels. More cost time to send."""

_REACH = 4.0
"""Height of a chart either way, in multiples of what the newer half of it needs. Smaller cuts off
more of how an estimate began, larger makes its last bands thin."""


@dataclass(frozen=True)
class Quantity:
    """A number with its standard deviation."""

    value: float
    std: float


@dataclass(frozen=True)
class Force:
    """Force of a contact on the object.

    Attributes:
        point: (3,) m, world.
        force: (3,) N, world axes.
        std: (3,) N along world axes; None if not stated.
    """

    point: Array
    force: Array
    std: Array | None = None


@dataclass(frozen=True)
class Body:
    """Mass and centre of mass of the object.

    Attributes:
        mass: kg.
        com: (3,) m, axes of the object.
        com_std: (3,) m.
    """

    mass: Quantity
    com: Array
    com_std: Array


@dataclass(frozen=True)
class Push:
    """A push of the object that may be made, is made, or was made.

    Attributes:
        point: (2,) m, where it begins on the outline, support.
        direction: (2,) unit vector.
        length: m.
        gain: expected information, nats; None if nobody said.
        chosen: whether it is the one that is made, and not a rival.
    """

    point: Array
    direction: Array
    length: float
    gain: float | None = None
    chosen: bool = True


class History:
    """The last values of a quantity with their bands."""

    def __init__(self) -> None:
        self._rows: deque[tuple[float, float, float]] = deque(maxlen=KEPT)

    def add(self, time: float, value: float, std: float = 0.0) -> None:
        """Add a value unless nothing is newer; what lies in the future of the time is dropped."""
        while self._rows and self._rows[-1][0] > time:
            self._rows.pop()
        if not self._rows or self._rows[-1][0] < time:
            self._rows.append((time, value, std))

    def columns(self) -> Array:
        """Time from the first, value, and both ends of ± one standard deviation, (4, N).

        What lies far from the newest value, as the first bands do, is cut off: later ones could not
        be seen beside it.
        """
        time, value, std = np.array(self._rows, dtype=float).reshape(-1, 3).T
        if not len(time):
            return np.zeros((4, 0))
        lately = value[len(value) // 2 :]
        reach = _REACH * max(np.ptp(lately), 2.0 * std[-1], 0.02 * abs(value[-1]))
        rows = np.array([value, value - std, value + std])
        return np.vstack([time - time[0], np.clip(rows, value[-1] - reach, value[-1] + reach)])


@dataclass
class State:
    """Everything that the page shows; what nobody told is None or empty.

    Attributes:
        object_pose: (4, 4) X_WO.
        forces: by contact.
        body: mass and centre of mass.
        friction: static coefficient.
        error: whitened RMS; 1 is the noise that sensors report.
        remark: what the estimator says of its estimate.
        good: whether that is good news.
        verdict: of the last diagnosis, in a sentence. fits: whether it found nothing missing.
        centre: centre of mass of a pushed object and its std, (3,) m, axes of the object.
        numbers: of a pushed object, in words, by name.
        plan: what explores or pushes the object, in a sentence.
        shape: (K, 3) corners of triangles of the object's surface, m, world, where it was seen.
        shape_pose: (4, 4) pose of the object then; None for an object that did not move since.
        footprint: (V, 2) m, outline on the support in axes of the object.
        second_pose: (4, 4) of a second part. second_footprint: (V, 2) m, its outline in its axes.
        pushes: the one that is made, and its rivals.
        next_view: (4, 4) pose where the camera should look from.
        urdf: of the robot.
        joints: positions by name, rad or m.
        histories: by quantity.
    """

    object_pose: Array | None = None
    forces: dict[str, Force] = field(default_factory=dict)
    body: Body | None = None
    friction: Quantity | None = None
    error: float | None = None
    remark: str = ""
    good: bool = True
    verdict: str = ""
    fits: bool = True
    centre: tuple[Array, Array] | None = None
    numbers: dict[str, str] = field(default_factory=dict)
    plan: str = ""
    shape: Array | None = None
    shape_pose: Array | None = None
    footprint: Array | None = None
    second_pose: Array | None = None
    second_footprint: Array | None = None
    pushes: tuple[Push, ...] = ()
    next_view: Array | None = None
    urdf: str = ""
    joints: dict[str, float] = field(default_factory=dict)
    histories: dict[str, History] = field(default_factory=dict)

    def note(self, name: str, time: float, value: float, std: float = 0.0) -> None:
        """Add a value to the history of a quantity."""
        self.histories.setdefault(name, History()).add(time, value, std)
