"""Contact forces on the object, read from Bullet and averaged to a sensor's rate."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import pybullet
from numpy.typing import NDArray

from tactile_dynamics_ros.core.rigid_body.rotation import cross

Array = NDArray[np.float64]

OTHER = "other"


@dataclass(frozen=True)
class ContactReading:
    """What one finger (or everything else together) did to the object over a time window.

    Attributes:
        name: the finger, or "other" (table, palm, phalanges).
        time: centre of the window, s of simulated time.
        in_contact: whether there was a normal force at any time.
        force: (3,) mean force on the object, N, world axes.
        torque: (3,) mean torque about ``point``, N m, world axes; zero for one contact point.
        point: (3,) mean contact point weighted by normal force, m, world.
        normal: (3,) unit normal into the object, world axes.
        share: share of the window with contact, 0 to 1.
    """

    name: str
    time: float
    in_contact: bool
    force: Array
    torque: Array
    point: Array
    normal: Array
    share: float


class ContactAccumulator:
    """Collects the contacts of one body, step by step, and sums them per group of touching links.

    Bullet's columns, for a query with the object as body A: the normal points from B to A, so the
    normal force on the object is +normal f_n. The two friction columns act with + on the body of
    lower unique id, whichever way round it was asked.

    Args:
        client: Bullet client.
        body: the object's id.
        groups: name of the finger by (body id, link index); everything else is "other".
    """

    def __init__(self, client: int, body: int, groups: dict[tuple[int, int], str]) -> None:
        self._client = client
        self._body = body
        self._names = (*dict.fromkeys(groups.values()), OTHER)
        self._groups = {key: self._names.index(name) for key, name in groups.items()}
        self._rows: list[list[float]] = []
        self._times: list[float] = []

    def add(self, time: float) -> None:
        """Add the contacts of the simulation step that ended at ``time`` (s)."""
        points = pybullet.getContactPoints(bodyA=self._body, physicsClientId=self._client)
        step = len(self._times)
        self._times.append(time)
        other = len(self._names) - 1
        for point in points:
            if point[9] != 0.0:
                group = self._groups.get((point[2], point[4]), other)
                sign = 1.0 if self._body < point[2] else -1.0
                row = [group, step, *point[5], *point[7], *point[11], *point[13]]
                self._rows.append([*row, point[9], sign * point[10], sign * point[12]])

    def read(self) -> dict[str, ContactReading]:
        """Return the means since the last call and start anew."""
        rows = np.array(self._rows).reshape(-1, 17)
        steps = max(len(self._times), 1)
        time = 0.5 * (self._times[0] + self._times[-1]) if self._times else 0.0
        self._rows, self._times = [], []
        return {reading.name: reading for reading in _averages(self._names, rows, steps, time)}


def _averages(
    names: tuple[str, ...], rows: Array, steps: int, time: float
) -> Iterator[ContactReading]:
    """Means over a window of ``steps`` steps of contact rows (K, 17), for each group."""
    group = rows[:, 0].astype(int)
    own = (group == np.arange(len(names))[:, None]).astype(float)
    point, normal, first, second = (rows[:, k : k + 3] for k in (2, 5, 8, 11))
    pressure = rows[:, 14:15]
    forces = pressure * normal + rows[:, 15:16] * first + rows[:, 16:17] * second
    touched = np.unique(group * steps + rows[:, 1].astype(int)) // steps
    shares = np.bincount(touched, minlength=len(names)) / steps
    parts = (pressure, pressure * point, pressure * normal, forces, cross(point, forces))
    sums = own @ np.concatenate(parts, axis=1)
    for name, share, total in zip(names, shares.tolist(), sums, strict=True):
        if share == 0.0:
            zero = np.zeros(3)
            yield ContactReading(name, time, False, zero, zero, zero, zero, 0.0)
            continue
        weighted, mean_normal, force, torque = total[1:].reshape(4, 3)
        centre = weighted / total[0]
        yield ContactReading(
            name=name,
            time=time,
            in_contact=True,
            force=force / steps,
            torque=(torque - cross(centre, force)) / steps,
            point=centre,
            normal=mean_normal / max(math.sqrt(mean_normal @ mean_normal), 1e-12),
            share=share,
        )
