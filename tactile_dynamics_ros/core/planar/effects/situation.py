"""What acts on a pushed object and how it moves, interval by interval, as effects see it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.array import Array


@dataclass(frozen=True, eq=False)
class Situation:
    """What acts in R intervals, axes of the support.

    Attributes:
        time: (R,) s.
        force: (R, 3) N of the pusher on the object, as measured.
        expected: (R, 3) N, the same without its noise, which errors of the sensor multiply: times
            the noise itself they would seem to explain it. expected_rate: (R, 3) N/s.
        point: (R, 3) m where it acts.
        facing: (R,) rad, direction of the pusher's axes, or else of the contact's normal.
        touching: (R,) whether anything is touched.
        gravity: (3,) m/s^2.
        mass: (R,) kg.
        com: (R, 2) m, centre of mass from the footprint's centroid, axes of the link.
    """

    time: Array
    force: Array
    expected: Array
    expected_rate: Array
    point: Array
    facing: Array
    touching: NDArray[np.bool_]
    gravity: Array
    mass: Array
    com: Array


@dataclass(frozen=True, eq=False)
class PlanarMotion:
    """Motion of the footprint's centroid in R intervals.

    Attributes:
        time: (R,) s.
        place: (R, 2) m and velocity: (R, 2) m/s, axes of the support.
        yaw: (R,) rad. rate: (R,) rad/s.
        gyration: squared radius of gyration of the footprint, m^2.
        middle: (2,) m, the mean place of the recording.
    """

    time: Array
    place: Array
    velocity: Array
    yaw: Array
    rate: Array
    gyration: float
    middle: Array

    @property
    def speed(self) -> Array:
        """Root mean square speed (R,) of the footprint, m/s."""
        squares = np.sum(self.velocity**2, axis=1) + self.gyration * self.rate**2
        return np.asarray(np.sqrt(squares))

    @property
    def away(self) -> Array:
        """(R, 2) m from the mean place."""
        return np.asarray(self.place - self.middle)
