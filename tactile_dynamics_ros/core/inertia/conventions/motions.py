"""Motion of the object at a few instants, read quickly from many readings of one recording."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.contact.wrench_samples import GRAVITY_W
from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.inertia.conventions.disturbances import disturbance_columns
from tactile_dynamics_ros.core.inertia.residuals.motion import IMU_HALF_WIDTH, Motion
from tactile_dynamics_ros.core.inertia.residuals.newton_euler_residual import ProblemConfig
from tactile_dynamics_ros.core.numerics.local_polynomial import (
    LocalFunctional,
    Window,
    local_polynomial,
    typical_period,
)
from tactile_dynamics_ros.core.numerics.noise import white_noise_std
from tactile_dynamics_ros.core.rigid_body.newton_euler import regressor
from tactile_dynamics_ros.core.streams.streams import ImuStream, Streams

_WIDER = (1.5, 2.2, 3.3)
"""Widths of windows that are tried, over that of the fit's regressors: noise of accelerations falls
with the power 2.5 of the width, twentyfold at 3.3. Slow motions need it, or readings that make
accelerations smaller look better than the right one. More widths cost a look each; with none of
them forces decide between readings by noise of accelerations."""
_FOLLOWED = 1.15
"""RMS of what polynomials leave of the poses, over what noise leaves there, up to which they follow
the motion. It scatters by 4 % over the poses that are looked at; at 1.5 quick motions are cut."""
_PROBED = 100
"""Poses, spread over the recording, at which that is looked at: with their coordinates 700 numbers,
whose RMS scatters by a few percent, less than `_FOLLOWED` allows. Fewer decide the width by chance,
more cost time only."""
_DEGREE = ProblemConfig().regressor_degree
"""Degree of the polynomials, that of the fit: a lower one ranks readings by forces that the fit
does not see, a higher one lets more noise pass."""


def followed_width(streams: Streams) -> float:
    """Half width, in samples of the pose, of the widest polynomials that follow the motion."""
    source = streams.pose or streams.imu
    if source is None or source.rotation is None:
        return 0.0
    period = typical_period(source.time)
    least = ProblemConfig().windows(period)[1].half_width / period
    paths = [_continuous_quaternion(source.rotation)]
    if streams.pose is not None:
        paths.append(streams.pose.position)
    width = least
    for factor in _WIDER:
        wider = factor * least
        if 8.0 * wider > len(source.time):
            break
        window = Window(wider * period, _DEGREE)
        if not all(_is_followed(source.time, path, window) for path in paths):
            break
        width = wider
    return width


def _is_followed(time: Array, values: Array, window: Window) -> bool:
    """Whether polynomials leave no more of samples than their noise."""
    std = white_noise_std(time, values)
    at = np.unique(np.linspace(0, len(time) - 1, _PROBED).astype(int))
    functional = local_polynomial(time, time[at], window, orders=1)
    weights = functional.weights[:, 0]
    own = weights[np.arange(len(at)), at - functional.start]
    expected = 1.0 - 2.0 * own + np.sum(weights**2, axis=1)
    square = np.mean((values[at] - functional.apply(values, 0)) ** 2, axis=1)
    kept = functional.valid
    return bool(np.sum(square[kept]) <= (_FOLLOWED * std) ** 2 * np.sum(expected[kept]))


@dataclass(frozen=True)
class Course:
    """A motion at a few instants, with the columns of what readings may hold.

    Attributes:
        motion: at N instants.
        valid: (N,) whether the motion is known.
    """

    motion: Motion
    valid: NDArray[np.bool_]

    @cached_property
    def specific_force(self) -> Array:
        """(N, 3) acceleration without gravity, m/s^2, body axes."""
        world = self.motion.acceleration - GRAVITY_W
        return np.asarray(np.einsum("nji,nj->ni", self.motion.rotation, world))

    @cached_property
    def load(self) -> Array:
        """(M, 6, 10) regressors of the body where the motion is known."""
        motion = self.motion
        rows = regressor(
            self.specific_force, motion.angular_velocity_B, motion.angular_acceleration_B
        )
        return np.asarray(rows[self.valid])

    @cached_property
    def disturbances(self) -> Array:
        """(M, 6, 19) columns of what else may act where the motion is known."""
        return np.asarray(disturbance_columns(self.motion)[self.valid])


@dataclass
class Motions:
    """Reads motions of streams; what only the stamps decide is computed once.

    Attributes:
        half_width: of the polynomials, in samples of the pose; 0 for that of the fit.
    """

    half_width: float = 0.0
    _functionals: dict[tuple[int, int, Window, int], tuple[object, LocalFunctional]] = field(
        default_factory=dict
    )
    _courses: dict[tuple[int, int, int], tuple[object, Course]] = field(default_factory=dict)

    def read(self, streams: Streams, stamps: Array) -> Course:
        """Motion at the stamps (N,).

        Derivatives are those of polynomials through unit quaternions and positions; where there is
        an IMU, accelerations and angular velocities are its own.

        Raises:
            BadInputError: nothing says how the object is turned.
        """
        key = (id(streams.pose), id(streams.imu), id(stamps))
        if key not in self._courses:
            kept = (streams.pose, streams.imu, stamps)
            self._courses[key] = (kept, self._compute(streams, stamps))
        return self._courses[key][1]

    def _compute(self, streams: Streams, stamps: Array) -> Course:
        source = streams.pose or streams.imu
        if source is None or source.rotation is None:
            raise BadInputError("no orientation of the object")
        period = typical_period(source.time)
        window = ProblemConfig().windows(period)[1]
        if self.half_width:
            window = Window(self.half_width * period, _DEGREE)
        functional = self._functional(source.time, stamps, window, 3)
        rotation, omega, alpha = _turning(source.rotation, functional)
        position = np.zeros((3, len(stamps), 3))
        if streams.pose is not None:
            position = functional.apply_all(streams.pose.position)
        motion = Motion(rotation, position[0], position[1], position[2], omega, alpha)
        valid = functional.valid
        if streams.imu is not None:
            motion, also = self._with_imu(motion, streams.imu, stamps, window)
            valid = valid & also
        return Course(motion, valid)

    def _with_imu(
        self, motion: Motion, imu: ImuStream, stamps: Array, window: Window
    ) -> tuple[Motion, NDArray[np.bool_]]:
        mean = self._functional(imu.time, stamps, Window(IMU_HALF_WIDTH, 2), 1)
        specific_force = mean.apply(imu.specific_force, 0)
        world = np.einsum("nij,nj->ni", motion.rotation, specific_force) + GRAVITY_W
        changed, valid = replace(motion, acceleration=world), mean.valid
        if imu.angular_velocity is not None:
            rate = self._functional(imu.time, stamps, window, 2)
            changed = replace(
                changed,
                angular_velocity_B=rate.apply(imu.angular_velocity, 0),
                angular_acceleration_B=rate.apply(imu.angular_velocity, 1),
            )
            valid = valid & rate.valid
        return changed, valid

    def _functional(
        self, time: Array, stamps: Array, window: Window, orders: int
    ) -> LocalFunctional:
        key = (id(time), id(stamps), window, orders)
        if key not in self._functionals:
            found = local_polynomial(time, stamps, window, orders=orders)
            self._functionals[key] = ((time, stamps), found)
        return self._functionals[key][1]


def _turning(rotation: Array, functional: LocalFunctional) -> tuple[Array, Array, Array]:
    """R (N, 3, 3), and angular velocity and acceleration (N, 3) in body axes.

    With a unit quaternion q, omega = 2 conj(q) q' and alpha = 2 (conj(q) q'' + conj(q') q').
    """
    value, rate, change = functional.apply_all(_continuous_quaternion(rotation))
    length = np.maximum(np.linalg.norm(value, axis=1, keepdims=True), 1e-12)
    value, rate, change = value / length, rate / length, change / length
    omega = 2.0 * _conjugate_times(value, rate)
    alpha = 2.0 * (_conjugate_times(value, change) + _conjugate_times(rate, rate))
    return Rotation.from_quat(value).as_matrix(), omega, alpha


def _continuous_quaternion(rotation: Array) -> Array:
    """Unit quaternions (N, 4) whose signs do not jump."""
    quaternion = Rotation.from_matrix(rotation).as_quat()
    same = np.sum(quaternion[1:] * quaternion[:-1], axis=1)
    quaternion[1:] *= np.cumprod(np.where(same < 0.0, -1.0, 1.0))[:, None]
    return np.asarray(quaternion)


def _conjugate_times(p: Array, q: Array) -> Array:
    """Vector part (N, 3) of conj(p) q of quaternions (N, 4), x y z w."""
    return np.asarray(p[:, 3:] * q[:, :3] - q[:, 3:] * p[:, :3] - np.cross(p[:, :3], q[:, :3]))
