"""Motion of the object as linear functionals of the raw pose or IMU samples."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.inertia.residuals.followed import unfollowed_scale
from tactile_dynamics_ros.core.inertia.residuals.latent import LatentSignal, isotropic_factor
from tactile_dynamics_ros.core.numerics.local_polynomial import (
    LocalFunctional,
    Window,
    local_polynomial,
    typical_period,
)
from tactile_dynamics_ros.core.numerics.noise import white_noise_std, white_pose_noise_std
from tactile_dynamics_ros.core.rigid_body.rotation import (
    accumulated_rotation,
    exp_so3,
    log_so3,
    skew,
)
from tactile_dynamics_ros.core.streams.pose_noise import (
    ASSUMED_POSITION_STD,
    ASSUMED_ROTATION_STD,
    read_covariances,
)
from tactile_dynamics_ros.core.streams.streams import ImuStream, PoseStream, Streams

_FALLBACK_SPECIFIC_FORCE_STD = 0.05
"""Standard deviation of an accelerometer's axis, m/s^2, where none is stated and the samples show
no noise: 5 mg. More would let the forces count for more than the motion. Less lets noise of the IMU
count as motion."""
OVERSTATED = 0.7
"""Seen over stated noise of poses below which the stated one is scaled down to what is seen.
Trackers state slow errors too, which differentiation does not see. The seen one scatters by 7 %
over 200 poses, so that 0.7 is out of reach by chance (least of 200 draws: 0.81); nearer to 1 honest
covariances are replaced by noisy ones."""
IMU_HALF_WIDTH = 0.01
"""Half width, s, of the parabola through which accelerations of an IMU are read. No derivative is
taken, so that it only averages: of 10 Hz it leaves out 0.06 %, of 20 Hz 0.9 %. Wider averages more
noise away and cuts quick motion."""


@dataclass(frozen=True)
class Motion:
    """Kinematics on the grid; world axes unless the name ends in _B.

    Attributes:
        rotation: (N, 3, 3) R_WO.
        position: (N, 3) m.
        velocity: (N, 3) m/s.
        acceleration: (N, 3) m/s^2.
        angular_velocity_B: (N, 3) rad/s.
        angular_acceleration_B: (N, 3) rad/s^2.
    """

    rotation: Array
    position: Array
    velocity: Array
    acceleration: Array
    angular_velocity_B: Array
    angular_acceleration_B: Array


@dataclass(frozen=True)
class MotionSignals:
    """Raw samples behind a `Motion`, each with its noise; any of the optional ones may be absent.

    Attributes:
        rotation: (K, 3, 3) measured R_WO, with signal `orientation`.
        position: (K, 3) measured p_WO, or None.
        specific_force: (J, 3) measured R_OW (a - g), or None.
        gyro: (J, 3) measured body angular velocity, or None.
        signals: the latent signals by name: orientation, position, specific_force, gyro.
        gravity: (3,) world.
        valid: (N,) grid times at which every signal is available.
        unfollowed: share of the poses that are too far from their neighbours to show the motion.
    """

    rotation: Array
    position: Array | None
    specific_force: Array | None
    gyro: Array | None
    signals: dict[str, LatentSignal]
    gravity: Array
    valid: NDArray[np.bool_]
    unfollowed: float = 0.0

    @property
    def at_one_place(self) -> bool:
        """Whether every position is the same number, and no IMU says otherwise."""
        place = self.position
        fixed = place is not None and bool(np.all(place == place[0]))
        return fixed and self.specific_force is None

    def corrected(self, corrections: dict[str, Array]) -> MotionSignals:
        """Return the signals moved by corrections (K, 3) by name; rotations by world rotations."""
        orientation = corrections.get("orientation")
        rotation = self.rotation if orientation is None else exp_so3(orientation) @ self.rotation
        moved = {
            name: getattr(self, name) + corrections[name]
            for name in ("position", "specific_force", "gyro")
            if name in corrections
        }
        return replace(self, rotation=rotation, **moved)

    @cached_property
    def charted_signals(self) -> dict[str, LatentSignal]:
        """The signals; that of the orientation with how rotation vectors move with it."""
        orientation = replace(self.signals["orientation"], chart=self._rotation_chart())
        return self.signals | {"orientation": orientation}

    def _rotation_chart(self) -> Array:
        """(N, W, 3, 3) derivative of local rotation vectors by world rotations d, R -> exp(d) R.

        log(exp(d) exp(v)) = v + (1 - [v] / 2 + [v]^2 / 12 - ...) d; [v] is not small while a body
        turns by a tenth of a radian within a window. Source: Chirikjian 2012, Eq. 10.86.
        """
        functional = self.signals["orientation"].functional
        window, centre = _windows(self.rotation, functional)
        local = _about(centre, window)
        middle = functional.weights[:, :1] @ local
        turned = skew(local - middle)
        return np.asarray(np.eye(3) - 0.5 * turned + turned @ turned / 12.0)

    def evaluate(self) -> Motion:
        """Kinematics at the grid times."""
        rotation, rate, rate_change = _differentiate_rotation(
            self.rotation, self.signals["orientation"].functional
        )
        omega, alpha = (np.einsum("nji,nj->ni", rotation, x) for x in (rate, rate_change))
        if self.gyro is not None:
            functional = self.signals["gyro"].functional
            omega, alpha = functional.apply(self.gyro, 0), functional.apply(self.gyro, 1)
        position = velocity = acceleration = np.zeros_like(omega)
        if self.position is not None:
            functional = self.signals["position"].functional
            position, velocity, acceleration = functional.apply_all(self.position)
        if self.specific_force is not None:
            body = self.signals["specific_force"].functional.apply(self.specific_force, 0)
            acceleration = np.einsum("nij,nj->ni", rotation, body) + self.gravity
        return Motion(rotation, position, velocity, acceleration, omega, alpha)


def _differentiate_rotation(
    rotation: Array, functional: LocalFunctional
) -> tuple[Array, Array, Array]:
    """R, world angular velocity and acceleration by a polynomial in local rotation vectors."""
    window, centre = _windows(rotation, functional)
    for _ in range(2):
        local = _about(centre, window)
        derivatives = np.moveaxis(functional.weights @ local, 1, 0)
        centre = exp_so3(derivatives[0]) @ centre
    return centre, derivatives[1], derivatives[2]


def _windows(rotation: Array, functional: LocalFunctional) -> tuple[Array, Array]:
    """Rotations (N, W, 3, 3) of all windows and (N, 3, 3) those in their middle."""
    middle = functional.start + np.argmax(functional.weights[:, 0], axis=1)
    return functional.gather(rotation), rotation[middle]


def _about(centre: Array, window: Array) -> Array:
    """Rotation vectors (N, W, 3) of windows (N, W, 3, 3) about centres (N, 3, 3), world axes."""
    rows = window.reshape(len(window), -1, 3)
    return log_so3((rows @ np.swapaxes(centre, 1, 2)).reshape(window.shape))


def motion_period(streams: Streams) -> float:
    """Period of the samples of the orientation, s; 0 if there are none."""
    rotating = streams.pose or streams.imu
    return typical_period(rotating.time) if rotating is not None else 0.0


def motion_signals(streams: Streams, grid: Array, window: Window, gravity: Array) -> MotionSignals:
    """Choose the kinematic signals of a recording: IMU where it measures, poses otherwise.

    Args:
        streams: needs an object pose, or an IMU with orientation.
        grid: (N,) s.
        window: window of the polynomials.
        gravity: (3,) m/s^2, world.

    Raises:
        BadInputError: there is no orientation of the object at all.
    """
    pose, imu = streams.pose, streams.imu
    if pose is None and (imu is None or imu.rotation is None):
        raise BadInputError("no orientation of the object: /object/pose and /object/imu are absent")
    signals: dict[str, LatentSignal] = {}
    unfollowed = 0.0
    if pose is not None:
        functional = local_polynomial(pose.time, grid, window)
        factors, unfollowed = _pose_noise(pose, window)
        signals["orientation"] = LatentSignal(functional, factors[0])
        rotation, position = pose.rotation, pose.position
        if imu is None:
            signals["position"] = LatentSignal(functional, factors[1])
    else:
        assert imu is not None and imu.rotation is not None
        rotation, position = imu.rotation, None
        functional = local_polynomial(imu.time, grid, window)
        std = white_noise_std(imu.time, accumulated_rotation(rotation)) or ASSUMED_ROTATION_STD
        signals["orientation"] = LatentSignal(functional, isotropic_factor(len(imu.time), std))
    if imu is not None:
        signals |= _imu_signals(imu, grid, window)
        if pose is not None:
            signals["position"] = LatentSignal(functional, factors[1])
    valid = np.all([signal.functional.valid for signal in signals.values()], axis=0)
    force = None if imu is None else imu.specific_force
    gyro = None if imu is None else imu.angular_velocity
    return MotionSignals(rotation, position, force, gyro, signals, gravity, valid, unfollowed)


def _imu_signals(imu: ImuStream, grid: Array, window: Window) -> dict[str, LatentSignal]:
    count = len(imu.time)
    std = imu.specific_force_std or white_noise_std(imu.time, imu.specific_force)
    factor = isotropic_factor(count, std or _FALLBACK_SPECIFIC_FORCE_STD)
    functional = local_polynomial(imu.time, grid, Window(IMU_HALF_WIDTH, 2), orders=1)
    signals = {"specific_force": LatentSignal(functional, factor)}
    if imu.angular_velocity is not None:
        gyro_std = white_noise_std(imu.time, imu.angular_velocity) or ASSUMED_ROTATION_STD
        of_rates = replace(window, degree=window.degree - 1)
        functional = local_polynomial(imu.time, grid, of_rates, orders=2)
        signals["gyro"] = LatentSignal(functional, isotropic_factor(count, gyro_std))
    return signals


def _pose_noise(pose: PoseStream, window: Window) -> tuple[tuple[Array, Array], float]:
    """White-noise factors (K, 3, 3) of both, and the share of poses that are not followed.

    Where poses are too far apart to show the motion, what they leave out counts as noise.
    """
    paths = accumulated_rotation(pose.rotation), pose.position
    found, lost = [], np.zeros(len(pose.time), dtype=bool)
    for factor, path in zip(_white_pose_noise(pose), paths, strict=True):
        level = float(np.sqrt(np.median(np.einsum("nij,nij->n", factor, factor) / 3.0)))
        scale = unfollowed_scale(pose.time, path, level, window)
        found.append(np.asarray(factor * scale[:, None, None]))
        lost |= scale > 1.0
    return (found[0], found[1]), float(np.mean(lost))


def _white_pose_noise(pose: PoseStream) -> tuple[Array, Array]:
    """White-noise factors (K, 3, 3) of orientation and position as stated or seen.

    The stated covariance is used unless the samples scatter clearly less: a tracker's covariance
    also covers slow errors, which differentiation does not see.
    """
    count = len(pose.time)
    seen = white_pose_noise_std(pose.time, pose.rotation, pose.position)
    said = None if pose.covariance is None else read_covariances(pose.covariance)
    factors = []
    for k, fallback in enumerate((ASSUMED_ROTATION_STD, ASSUMED_POSITION_STD)):
        if said is None or not said.stated.all():
            factors.append(isotropic_factor(count, seen[k] or fallback))
            continue
        stated = said.covariance[:, 3 * k : 3 * k + 3, 3 * k : 3 * k + 3]
        stated_level = float(np.sqrt(np.median(np.einsum("nii->ni", stated))))
        overstated = not pose.white and 0 < seen[k] < OVERSTATED * stated_level
        scale = seen[k] / stated_level if overstated else 1.0
        factors.append(np.asarray(scale * np.linalg.cholesky(stated)))
    return factors[0], factors[1]
