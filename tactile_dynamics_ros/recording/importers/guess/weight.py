"""How well forces agree with gravity and motion under one reading of orientation and axes.

In the axes of the pose a load reads f = s (m R'(a + g u) + [dw/dt] m c + [w]^2 m c) + b with u up,
in those of the world R times it; s is -1 where the sensor reads what the load does to it. The
unknowns are linear: two masses (of weight and of acceleration, which agree if units and clock do),
m c, b.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.numerics.local_polynomial import (
    LocalFunctional,
    Window,
    local_polynomial,
    typical_period,
)
from tactile_dynamics_ros.core.rigid_body.rotation import accumulated_rotation, exp_so3, skew
from tactile_dynamics_ros.core.streams.streams import nearest_samples
from tactile_dynamics_ros.recording.static_poses import wrong_rows

GRAVITY = 9.81
"""m/s^2, as in every recording."""
UP = np.array([0.0, 0.0, 1.0])
"""Where up is in a world to the contract."""
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
_SETTLED_S = 0.1
"""Time, s, about a change during which rows are left out: filters and contacts settle in less. Half
or twice as much leaves the same readings."""

_EVEN = 0.8
"""Smallest over largest scale of an affine map up to which it is no rotation: with a turned sensor
they agree but for noise and accelerations, under a wrong reading of angles they do not."""
_ROUNDS = 2
"""Steps of Gauss and Newton for the rotation of a sensor: the first leaves 0.1 deg of 3 deg, which
accelerations of the centre of mass feign, the second 1e-3 deg."""


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
        rotation: (M, 3, 3) under one reading, to the file's world.
        time: (M,) s of the poses, or None.
        position: (M, 3) m, or None.
        torque: (N, 3), or None.
        change: s, when something changes at once; None if nothing does.
        windows: polynomials by which the motion is read, kept from reading to reading.
    """

    force: Array
    force_time: Array | None
    rotation: Array
    time: Array | None
    position: Array | None = None
    torque: Array | None = None
    change: float | None = None
    windows: Windows = field(default_factory=lambda: Windows())


@dataclass(frozen=True)
class Side:
    """The load before or after a change; of the whole table if nothing changes.

    Attributes:
        mass: signed mass by the weight, negative if the sensor reads the load's weight.
        mass_std: of it.
        moment: (3,) signed first moment by what turning does to the force; 0 where nothing turns.
        moment_std: (3,) of it; infinite where nothing turns.
        bias: (3,) constant part, axes of the pose.
    """

    mass: float
    mass_std: float
    moment: Array
    moment_std: Array
    bias: Array


@dataclass(frozen=True)
class Weighing:
    """A load fitted to the forces.

    Attributes:
        axes: "sensor" or "world".
        up: (3,) unit vector, the file's world.
        turn: (3, 3) rotation from the recorded axes of the sensor to those of the pose.
        rms: of what is left, in units of the force.
        spread: RMS of the force about its mean.
        size: RMS of the force.
        sides: one, or those before and after a change.
        ratio: mass by acceleration over mass by weight; None where none is seen.
        inertial: mass by acceleration; None where none is seen.
    """

    axes: str
    up: Array
    turn: Array
    rms: float
    spread: float
    size: float
    sides: tuple[Side, ...]
    ratio: float | None
    inertial: float | None

    @property
    def mass(self) -> float:
        """Signed mass by the weight, of the lighter side of a change."""
        return min((side.mass for side in self.sides), key=abs)

    @property
    def seen(self) -> bool:
        """Whether the weight shows in the forces."""
        weight = abs(self.mass) * GRAVITY
        little = min(_EXPLAINED * weight, max(_FOLLOWED * self.spread, _STEADY * self.size))
        clear = all(abs(side.mass) > _CLEAR * side.mass_std for side in self.sides)
        same = len({side.mass > 0.0 for side in self.sides}) == 1
        return clear and same and self.rms < little

    @property
    def bias(self) -> float:
        """Size of the constant part."""
        return min(float(np.linalg.norm(side.bias)) for side in self.sides)

    @property
    def agreement(self) -> float | None:
        """Mass by acceleration over mass by weight; 1 if units are right, None if not seen."""
        return self.ratio if self.seen else None


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
        self.measured = measured = _timed(measured)
        usable = np.isfinite(measured.force).all(axis=1)
        if measured.force_time is not None:
            usable &= np.isfinite(measured.force_time)
        rows = np.flatnonzero(usable)
        rows = rows[np.linspace(0, len(rows) - 1, min(len(rows), _MOST_ROWS)).astype(int)]
        self.rows = rows[self._posed(rows)]

    def _posed(self, rows: NDArray[np.int64]) -> NDArray[np.bool_]:
        """Which rows have a pose nearby."""
        m = self.measured
        known = np.isfinite(m.rotation).all(axis=(1, 2))
        if m.time is None or m.force_time is None:
            return np.asarray(known[rows])
        nearest = nearest_samples(m.time, m.force_time[rows])
        near = np.abs(m.time[nearest] - m.force_time[rows]) < 3.0 * typical_period(m.time)
        return np.asarray(known[nearest] & near)

    @cached_property
    def force(self) -> Array:
        """(n, 3) as recorded."""
        return self.measured.force[self.rows]

    @cached_property
    def sides(self) -> list[NDArray[np.bool_]]:
        """Rows (n,) before and after a change; all of them if nothing changes."""
        m = self.measured
        if m.change is None or m.force_time is None:
            return [np.ones(len(self.rows), dtype=bool)]
        after = m.force_time[self.rows] - m.change
        return [after < -_SETTLED_S, after > _SETTLED_S]

    @cached_property
    def rotation(self) -> Array:
        """(n, 3, 3) body to world."""
        m = self.measured
        if m.time is None or m.force_time is None:
            return m.rotation[self.rows]
        return m.rotation[nearest_samples(m.time, m.force_time[self.rows])]

    @cached_property
    def to_body(self) -> Array:
        """(n, 3, 3) from the world to the axes of the pose."""
        return np.swapaxes(self.rotation, 1, 2)

    @cached_property
    def motion(self) -> tuple[Array, Array, Array] | None:
        """Acceleration, angular velocity and acceleration (n, 3) in body axes; None if unknown."""
        m = self.measured
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
        inside = [self.in_body(v * functional.valid[:, None]) for v in (moved, rate, change)]
        return inside[0], inside[1], inside[2]

    def in_body(self, vectors: Array) -> Array:
        """World vectors (n, 3), or one (3,), in the axes of the pose."""
        return np.asarray(
            (self.to_body @ np.broadcast_to(vectors, self.force.shape)[..., None])[..., 0]
        )

    def own_axes(self, values: Array, axes: str, turn: Array) -> Array:
        """Recorded vectors (n, 3) in the axes of the pose."""
        return self.in_body(values) if axes == "world" else np.asarray(values @ turn.T)

    def weigh(self, axes: str, up: Array = UP, turn: Array | None = None) -> Weighing:
        """Fit a load to the forces.

        Args:
            axes: of the forces, "sensor" or "world".
            up: (3,) unit vector, the file's world.
            turn: (3, 3) from the recorded axes of the sensor to those of the pose; none by default.
        """
        turn = np.eye(3) if turn is None else turn
        force = self.own_axes(self.force, axes, turn)
        weight = GRAVITY * self.in_body(up)[..., None]
        columns = np.concatenate([weight, self._columns], axis=2)
        squares, rows = 0.0, 0
        sides, ratios, inertial = [], [], []
        for part in self.sides:
            fit = _Fit.of(columns[part], force[part], self.measured.time is None)
            squares, rows = squares + fit.squares, rows + fit.freedom
            moment = slice(2, 5)
            sides.append(
                Side(fit.value[0], fit.std[0], fit.value[moment], fit.std[moment], fit.value[5:])
            )
            if abs(fit.value[1]) > _CLEAR * fit.std[1]:
                inertial.append(fit.value[1])
                ratios.append(fit.value[1] / fit.value[0] if fit.value[0] else np.inf)
        middle = np.concatenate([force[part] - force[part].mean(axis=0) for part in self.sides])
        return Weighing(
            axes=axes,
            up=up,
            turn=turn,
            rms=float(np.sqrt(squares / max(rows, 1))),
            spread=float(np.sqrt(np.mean(middle**2))),
            size=float(np.sqrt(np.mean(force**2))),
            sides=tuple(sides),
            ratio=float(np.median(ratios)) if ratios else None,
            inertial=float(np.median(inertial)) if inertial else None,
        )

    def measured_up(self, axes: str, turn: Array | None = None) -> Array | None:
        """Direction (3,) of up that fits best, file's world; None where no weight shows.

        Whether the sensor reads the load or what acts on it decides the sign: where accelerations
        are seen they tell, else the one nearer to z is taken.
        """
        force = self.own_axes(self.force, axes, np.eye(3) if turn is None else turn)
        columns = np.concatenate([GRAVITY * self.to_body, self._columns], axis=2)
        total = np.zeros(3)
        for part in self.sides:
            fit = _Fit.of(columns[part], force[part], self.measured.time is None)
            found, inertial = fit.value[:3], fit.value[3]
            seen = abs(inertial) > _CLEAR * fit.std[3]
            largest = found[np.argmax(np.abs(found))]
            total += found * np.sign(inertial if seen else found[2] or largest)
        length = float(np.linalg.norm(total))
        return total / length if length > 0.0 else None

    def measured_turn(self, up: Array) -> Array | None:
        """Rotation (3, 3) from the recorded axes of the sensor to those of the pose that fits best.

        f = s m Q' R'(a + g u) + b: the affine map that fits best is close to a rotation times a
        mass of either sign; None where it is not.
        """
        specific_force = GRAVITY * self.in_body(up) + self._columns[:, :, 0]
        ones = np.ones((len(specific_force), 1))
        columns = np.hstack([specific_force, ones, self._columns[:, :, 1:4].reshape(-1, 9)])
        total = np.zeros((3, 3))
        for part in self.sides:
            rows = columns[part]
            affine = np.linalg.lstsq(rows, self.force[part], rcond=None)[0][:3].T
            total += affine * np.sign(np.linalg.det(affine))
        left, scales, right = np.linalg.svd(total)
        if not scales[2] > _EVEN * scales[0]:
            return None
        return self._refined(np.asarray((left @ right).T), up)

    def _refined(self, turn: Array, up: Array) -> Array:
        """A rotation of the sensor, by Gauss-Newton with all that a load does."""
        weight = GRAVITY * self.in_body(up)[..., None]
        specific_force = weight[..., 0] + self._columns[:, :, 0]
        columns = np.concatenate([weight, -skew(specific_force), self._columns], axis=2)
        for _ in range(_ROUNDS):
            force, found = self.own_axes(self.force, "sensor", turn), np.zeros(4)
            for part in self.sides:
                fit = _Fit.of(columns[part], force[part], self.measured.time is None)
                found += fit.value[:4] * np.sign(fit.value[0])
            turn = exp_so3(-found[1:] / max(found[0], 1e-9)) @ turn
        return turn

    @cached_property
    def _columns(self) -> Array:
        """(n, 3, 7) what acceleration, m c and the bias do to the force, axes of the pose."""
        columns = np.zeros((len(self.rows), 3, 7))
        columns[:, :, 4:] = np.eye(3)
        if self.motion is not None:
            moved, rate, change = self.motion
            columns[:, :, 0] = moved
            columns[:, :, 1:4] = skew(change) + skew(rate) @ skew(rate)
        return columns


@dataclass(frozen=True)
class _Fit:
    """Least squares: values and standard deviations (k,), what is left, and its freedom."""

    value: Array
    std: Array
    squares: float
    freedom: int

    @classmethod
    def of(cls, columns: Array, readings: Array, separate: bool) -> _Fit:
        """Fit columns (n, 3, k) to readings (n, 3); `separate` rows that others contradict go."""
        flat = columns.reshape(-1, columns.shape[2])
        used = np.linalg.norm(flat, axis=0) > 1e-9
        if separate:
            right = ~wrong_rows(columns[:, :, used], readings, np.ones(len(readings), dtype=bool))
            flat, readings = columns[right].reshape(-1, len(used)), readings[right]
        value, std = np.zeros(len(used)), np.full(len(used), np.inf)
        value[used] = np.linalg.lstsq(flat[:, used], readings.ravel(), rcond=None)[0]
        left = readings.ravel() - flat @ value
        freedom = max(readings.size - int(used.sum()), 1)
        inverse = np.linalg.pinv(flat[:, used].T @ flat[:, used])
        std[used] = np.sqrt(float(left @ left) / freedom * np.diag(inverse))
        return cls(value, std, float(left @ left), freedom)
