"""How well forces agree with gravity and motion under one reading of orientation and axes.

In the axes of the sensor a load reads f = s (m R'(a + g e_z) + [dw/dt] m c + [w]^2 m c) + b, in
those of the world R times it; s is -1 where the sensor reads what the load does to it. The unknowns
are linear: two masses (of weight and of acceleration, which agree if units and clock do), m c, b.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.numerics.local_polynomial import (
    LocalFunctional,
    Window,
    local_polynomial,
    typical_period,
)
from tactile_dynamics_ros.core.rigid_body.rotation import accumulated_rotation, skew
from tactile_dynamics_ros.core.streams.streams import nearest_samples
from tactile_dynamics_ros.recording.static_poses import wrong_rows

Array = NDArray[np.float64]

GRAVITY = 9.81
"""m/s^2, as in every recording."""
_MOST_ROWS = 1500
"""Rows at which a reading is judged; spread evenly, they tell as much as all."""
_HALF_WIDTH, _DEGREE = 0.12, 4
"""Window, s, and degree of the polynomials that motion is read by: accelerations of 1 mm poses at
100 Hz get noise of about 0.3 m/s^2, and motion up to 2 Hz stays."""
_FEWEST_IN_WINDOW = 7
"""Samples that such a window needs; slower poses tell orientation only."""
_CLEAR = 10.0
"""Size of a fitted mass over its standard deviation from which it counts as seen."""
_EXPLAINED = 0.15
"""Misfit over the weight up to which a load explains the forces. Logs with noise and taps stay
below 0.05; under wrong axes a fifth and more is left, however large the bias beside it."""
_FOLLOWED, _STEADY = 0.3, 0.05
"""Misfit over the change of the forces up to which a load follows it, and over their size up to
which there is hardly any. A weight and a bias that nearly cancel leave half of the change, as under
joint angles that are read as Euler angles; 40 layouts that are right leave 0.13 at most."""
_EVEN = 0.8
"""Smallest over largest scale of an affine map up to which it is no rotation: with a turned sensor
they agree but for noise and accelerations, under a wrong reading of angles they do not."""


class Windows:
    """Polynomials through samples around given times, found once for all readings of a table."""

    def __init__(self) -> None:
        self._known: dict[tuple[bytes, bytes], LocalFunctional] = {}

    def around(self, samples: Array, at: Array) -> LocalFunctional:
        """Return the functionals at times (n,) of samples (N,), s."""
        key = samples.tobytes(), at.tobytes()
        if key not in self._known:
            self._known[key] = local_polynomial(samples, at, Window(_HALF_WIDTH, _DEGREE))
        return self._known[key]


@dataclass(frozen=True)
class Measured:
    """What a table says, whatever its units and axes mean.

    Attributes:
        force: (N, 3).
        force_time: (N,) s, or None for rows without time.
        rotation: (M, 3, 3) under one reading.
        time: (M,) s of the poses, or None.
        position: (M, 3) m, or None.
        torque: (N, 3), or None.
        world: (3, 3) from the file's world to one whose z points up.
        windows: polynomials by which the motion is read, kept from reading to reading.
    """

    force: Array
    force_time: Array | None
    rotation: Array
    time: Array | None
    position: Array | None = None
    torque: Array | None = None
    world: Array = field(default_factory=lambda: np.eye(3))
    windows: Windows = field(default_factory=lambda: Windows())

    def upright(self, world: Array) -> Measured:
        """Return the same in another world; forces turn along where they are in its axes."""
        return replace(
            self,
            rotation=world @ self.rotation,
            position=None if self.position is None else self.position @ world.T,
            world=world,
        )


@dataclass(frozen=True)
class Weighing:
    """A load fitted to the forces.

    Attributes:
        axes: "sensor" or "world".
        rms: of what is left, in units of the force.
        spread: RMS of the force about its mean.
        size: RMS of the force.
        mass: signed mass by the weight, negative if the sensor reads the load's weight.
        mass_std: of it.
        inertial: mass by the acceleration; None where it is not seen.
        bias: size of the constant part.
    """

    axes: str
    rms: float
    spread: float
    size: float
    mass: float
    mass_std: float
    inertial: float | None
    bias: float

    @property
    def seen(self) -> bool:
        """Whether the weight shows in the forces."""
        weight = abs(self.mass) * GRAVITY
        little = min(_EXPLAINED * weight, max(_FOLLOWED * self.spread, _STEADY * self.size))
        return abs(self.mass) > _CLEAR * self.mass_std and self.rms < little

    @property
    def agreement(self) -> float | None:
        """Mass by acceleration over mass by weight; 1 if units are right, None if not seen."""
        return None if self.inertial is None or not self.seen else self.inertial / self.mass


def _timed(measured: Measured) -> Measured:
    """Return what has a pose's time; rows whose cell of the time is empty have none."""
    if measured.time is None or np.isfinite(measured.time).all():
        return measured
    known = np.isfinite(measured.time)
    place = measured.position
    return replace(
        measured,
        time=measured.time[known],
        rotation=measured.rotation[known],
        position=None if place is None else place[known],
    )


class Scene:
    """Motion under one reading, at rows of the forces."""

    def __init__(self, measured: Measured) -> None:
        self._measured = measured = _timed(measured)
        usable = np.isfinite(measured.force).all(axis=1)
        if measured.force_time is not None:
            usable &= np.isfinite(measured.force_time)
        rows = np.flatnonzero(usable)
        rows = rows[np.linspace(0, len(rows) - 1, min(len(rows), _MOST_ROWS)).astype(int)]
        self.rows = rows[self._posed(rows)]

    def _posed(self, rows: NDArray[np.int64]) -> NDArray[np.bool_]:
        """Which rows have a pose nearby."""
        m = self._measured
        known = np.isfinite(m.rotation).all(axis=(1, 2))
        if m.time is None or m.force_time is None:
            return np.asarray(known[rows])
        nearest = nearest_samples(m.time, m.force_time[rows])
        near = np.abs(m.time[nearest] - m.force_time[rows]) < 3.0 * typical_period(m.time)
        return np.asarray(known[nearest] & near)

    @cached_property
    def rotation(self) -> Array:
        """(n, 3, 3) body to world."""
        m = self._measured
        if m.time is None or m.force_time is None:
            return m.rotation[self.rows]
        return m.rotation[nearest_samples(m.time, m.force_time[self.rows])]

    @cached_property
    def motion(self) -> tuple[Array, Array, Array] | None:
        """Acceleration, angular velocity and acceleration (n, 3) in world axes; None if unknown."""
        m = self._measured
        if m.time is None or m.force_time is None or len(m.time) < 4 * _FEWEST_IN_WINDOW:
            return None
        if 2.0 * _HALF_WIDTH / typical_period(m.time) < _FEWEST_IN_WINDOW:
            return None
        if not np.isfinite(m.rotation).all():
            return None
        if m.position is not None and not np.isfinite(m.position).all():
            return None
        at = m.force_time[self.rows]
        functional = m.windows.around(m.time, at)
        turns = accumulated_rotation(m.rotation)
        rate, change = functional.apply(turns, 1), functional.apply(turns, 2)
        still = np.zeros_like(rate)
        moved = still if m.position is None else functional.apply(m.position, 2)
        good = functional.valid[:, None]
        return moved * good, rate * good, change * good

    def weigh(self, axes: str) -> Weighing:
        """Fit a load to the forces, given in sensor or world axes."""
        force = self._measured.force[self.rows]
        force = force @ self._measured.world.T if axes == "world" else force
        matrix = self._columns(axes)
        if self._measured.time is None:
            right = ~wrong_rows(matrix[:, :, [0, 5, 6, 7]], force, np.ones(len(force), dtype=bool))
            matrix, force = matrix[right], force[right]
        flat, readings = matrix.reshape(-1, matrix.shape[2]), force.ravel()
        used = np.linalg.norm(flat, axis=0) > 1e-9
        solution = np.zeros(flat.shape[1])
        solution[used] = np.linalg.lstsq(flat[:, used], readings, rcond=None)[0]
        left = readings - flat @ solution
        variance = float(left @ left) / max(len(readings) - int(used.sum()), 1)
        information = flat[:, used].T @ flat[:, used]
        stds = np.full(flat.shape[1], np.inf)
        stds[used] = np.sqrt(variance * np.diag(np.linalg.pinv(information)))
        seen = used[1] and abs(solution[1]) > _CLEAR * stds[1]
        return Weighing(
            axes=axes,
            rms=float(np.sqrt(variance)),
            spread=float(np.sqrt(np.mean((force - force.mean(axis=0)) ** 2))),
            size=float(np.sqrt(np.mean(force**2))),
            mass=float(solution[0]),
            mass_std=float(stds[0]),
            inertial=float(solution[1]) if seen else None,
            bias=float(np.linalg.norm(solution[5:8])),
        )

    def mounting(self) -> tuple[float, Array] | None:
        """Misfit and constant rotation (3, 3) from sensor to pose axes that would explain it.

        f = m Q' R' (a + g e_z) + b: the affine map that fits best is close to a rotation times a
        mass, or there is no such rotation and None is returned. It may be negative: readings of
        the load on the sensor.
        """
        force = self._measured.force[self.rows]
        if not np.any(force):
            return None
        carried = self._specific(self._in_axes("sensor"))
        rows = np.concatenate([carried, np.ones((len(carried), 1))], axis=1)
        affine = np.linalg.lstsq(rows, force, rcond=None)[0]
        share = float(np.sqrt(np.mean((rows @ affine - force) ** 2)) / np.sqrt(np.mean(force**2)))
        left, scales, right = np.linalg.svd(affine[:3])
        even = scales[2] > _EVEN * scales[0]
        rms = share * float(np.sqrt(np.mean(force**2)))
        if rms > _EXPLAINED * GRAVITY * float(scales.mean()) or not even:
            return None
        turn = left @ right
        return rms, np.asarray(turn * np.sign(np.linalg.det(turn)))

    def lever(self, weighing: Weighing) -> tuple[Array, float] | None:
        """Centre of mass (3,) as torques in their own unit tell it, and what is left of them.

        None where no torque is measured.
        """
        torque = self._measured.torque
        if torque is None or not np.isfinite(torque[self.rows]).all():
            return None
        own = self._in_axes("sensor")
        carried = weighing.mass * self._specific(own)
        read = torque[self.rows]
        if weighing.axes == "world":
            read = read @ self._measured.world.T
            read = np.einsum("nji,nj->ni", self.rotation, read)
        bias = np.tile(np.eye(3), (len(carried), 1, 1))
        flat = np.concatenate([-skew(carried), bias], axis=2).reshape(-1, 6)
        solution = np.linalg.lstsq(flat, read.ravel(), rcond=None)[0]
        left = float(np.sqrt(np.mean((flat @ solution - read.ravel()) ** 2)))
        return solution[:3], left

    def _in_axes(self, axes: str) -> Array:
        """(n, 3, 3) from the world to the axes of the readings."""
        turned = np.swapaxes(self.rotation, 1, 2)
        return turned if axes == "sensor" else np.broadcast_to(np.eye(3), turned.shape)

    def _specific(self, to_axes: Array) -> Array:
        """(n, 3) a + g e_z in some axes."""
        up = np.array([0.0, 0.0, GRAVITY])
        total = up if self.motion is None else self.motion[0] + up
        return np.asarray((to_axes @ np.broadcast_to(total, (len(to_axes), 3))[..., None])[..., 0])

    def _columns(self, axes: str) -> Array:
        """(n, 3, 8) what weight, acceleration, m c and the bias do to the force."""
        to_axes, count = self._in_axes(axes), len(self.rows)
        up = np.broadcast_to([0.0, 0.0, GRAVITY], (count, 3))
        columns = np.zeros((count, 3, 8))
        columns[:, :, 0] = np.einsum("nij,nj->ni", to_axes, up)
        columns[:, :, 5:] = to_axes @ self.rotation
        if self.motion is not None:
            moved, rate, change = self.motion
            columns[:, :, 1] = np.einsum("nij,nj->ni", to_axes, moved)
            turning = skew(change) + skew(rate) @ skew(rate)
            columns[:, :, 2:5] = to_axes @ turning @ self.rotation
        return columns
