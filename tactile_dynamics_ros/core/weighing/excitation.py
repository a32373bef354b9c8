"""The motion of an arm's joints that tells most about what its wrist sensor carries."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.configuration import check_ranges, parameter
from tactile_dynamics_ros.core.errors import BadInputError, NotIdentifiableError
from tactile_dynamics_ros.core.inertia.excitation.design import InertiaCriterion, search_motion
from tactile_dynamics_ros.core.inertia.excitation.trajectory import (
    FourierOffsets,
    ObjectMotion,
    follow,
)
from tactile_dynamics_ros.core.rigid_body.inertial_parameters import InertialParameters
from tactile_dynamics_ros.core.rigid_body.newton_euler import regressor
from tactile_dynamics_ros.core.weighing.arm import Nearest, Plane, SerialArm, nearest

_SINES = 3
"""Frequencies of each joint. One alone would move the joints in step; five make the plan slower and
tell as much (duration 20 s, seeds 0 to 2)."""
_RAMP = 2.0
"""Time over which a motion fades in and out, s: joints start and end at rest without a jerk."""
_GRID_HZ = 10.0
"""Rate at which candidates are judged, Hz, ten times the highest frequency. Twice as much chooses
the same motions in twice the time."""
_CHECK_HZ = 10.0
"""Rate at which clearance is checked, Hz: at 1 m/s a link moves by 0.1 m meanwhile, at the usual
share of speeds by 20 mm, which is the margin."""
_SAMPLED_HZ = 100.0
"""Rate of the recording that is presumed when saying what a motion will tell, Hz. A sensor of 500
Hz tells 2.2 times as well; the chosen motion is the same."""
_PRESUMED = InertialParameters(1.0, np.array([0.0, 0.0, 0.05]), 2e-3 * np.eye(3))
"""A load before anything of it is known: 1 kg, 5 cm before the flange, of 5 cm radius of gyration.
A light one is turned in the same way: the criterion is relative to it."""
_METRIC = InertiaCriterion(_PRESUMED.dynamic_parameters, np.eye(10)).metric
"""Affine-invariant metric (10, 10) at the presumed load; it also stands for knowing nothing, a
relative error of one. It follows from the load."""
_NOISE = np.repeat([5e-3, 0.1], 3)
"""Noise of a wrist sensor per axis [N m, N], as of the usual ones (ATI Mini, UR e, Bota). It scales
what a motion is expected to tell, and weighs torque against force."""
_LEAST_SHARE = 0.15
"""Smallest share of a motion that is worth making once it is cut to what clearance allows. A motion
of fewer than 6 deg tells little but noise."""
_SHRINK = 0.85
"""Factor by which a motion is made smaller until it keeps clear; nearer to 1 finds a larger one in
more steps."""


@dataclass(frozen=True)
class WeighingConfig:
    """What an arm may do to weigh what it carries."""

    duration: float = parameter(20.0, "length of the motion", "s", 5.0, 600.0)
    amplitude: float = parameter(0.6, "largest turn of a joint either way", "rad", 0.05, 3.0)
    speed_share: float = parameter(
        0.25, "share of the joints' largest speeds that is used", "", 0.01, 1.0
    )
    acceleration: float = parameter(3.0, "largest of a joint", "rad/s^2", 0.1, 50.0)
    tip_speed: float = parameter(0.5, "largest of the sensor's frame", "m/s", 0.01, 3.0)
    lowest_hz: float = parameter(0.1, "lowest frequency", "Hz", 0.02, 2.0)
    highest_hz: float = parameter(0.7, "highest frequency", "Hz", 0.05, 5.0)
    margin: float = parameter(0.02, "distance of links from each other and from planes", "m", 0.0)
    planes: tuple[float, ...] = parameter(
        (0.0, 0.0, 1.0, 0.0),
        "what the arm stays above, four numbers each: normal and offset, frame of the base",
    )
    reach: float = parameter(
        0.15, "length of what is carried, along z of the sensor's frame", "m", 0.0, 3.0
    )
    radius: float = parameter(0.08, "its largest distance from that axis", "m", 0.0, 2.0)
    ignored_links: tuple[str, ...] = parameter((), "links whose shape is not known or not checked")
    evaluations: int = parameter(300, "candidate motions tried", "", 8, 100000)
    seed: int = parameter(0, "seed of the search", "", 0, 2**31 - 1)

    def __post_init__(self) -> None:
        check_ranges(self)
        if self.lowest_hz >= self.highest_hz:
            raise BadInputError(
                f"lowest_hz = {self.lowest_hz:g}: expected below highest_hz = {self.highest_hz:g}"
            )
        normals = np.reshape(self.planes, (-1, 4)) if len(self.planes) % 4 == 0 else None
        if normals is None or not np.linalg.norm(normals[:, :3], axis=1).all():
            raise BadInputError(
                f"planes: {len(self.planes)} numbers, expected four for each plane, normal and "
                "offset; leave the parameter out for the plane of the base"
            )

    def plane_list(self) -> tuple[Plane, ...]:
        """Return the planes, with unit normals."""
        rows = np.reshape(np.array(self.planes, dtype=float), (-1, 4))
        lengths = np.linalg.norm(rows[:, :3], axis=1)
        return tuple(
            Plane(row[:3] / n, float(row[3] / n)) for row, n in zip(rows, lengths, strict=True)
        )


@dataclass(frozen=True)
class WeighingMotion:
    """A motion of the joints from where they are and back.

    Attributes:
        names: of the J joints.
        start: (J,) rad, where it starts and ends.
        offsets: what is added.
        room: how near the arm comes to what it must not touch.
        cut: share of the amplitudes that clearance has left.
        speed: (J,) largest speeds, rad/s. tip_speed: of the sensor's frame, m/s.
        expected: standard deviations of mass (kg), centre (3, m) and moments of inertia (3, kg m^2)
            that it is expected to leave of a load of 1 kg, relative to what is presumed.
    """

    names: tuple[str, ...]
    start: Array
    offsets: FourierOffsets
    room: Nearest
    cut: float
    speed: Array
    tip_speed: float
    expected: Array

    @property
    def duration(self) -> float:
        """Length, s."""
        return self.offsets.duration

    def table(self, rate_hz: float) -> tuple[Array, Array, Array]:
        """Return times (N,), positions (N, J) and velocities (N, J) of the joints."""
        count = max(2, round(self.duration * rate_hz) + 1)
        time = np.linspace(0.0, self.duration, count)
        step = 1e-4
        ahead, behind = (self.offsets.evaluate(np.clip(time + d, 0, self.duration))
                         for d in (step, -step))  # fmt: skip
        span = np.clip(time + step, 0, self.duration) - np.clip(time - step, 0, self.duration)
        velocity = (ahead - behind) / span[:, None]
        velocity[[0, -1]] = 0.0
        return time, self.start + self.offsets.evaluate(time), velocity

    def to_json(self) -> dict[str, Any]:
        """Return the plan for programs."""
        peak = np.abs(self.offsets.evaluate(np.linspace(0.0, self.duration, 2000))).max(axis=0)
        return {
            "duration_s": self.duration,
            "joints": list(self.names),
            "start_rad": self.start.tolist(),
            "largest_turn_rad": peak.tolist(),
            "largest_speed_rad_s": self.speed.tolist(),
            "tip_speed_m_s": self.tip_speed,
            "share_left_by_clearance": self.cut,
            "nearest": {"room_m": self.room.room, "what": self.room.what},
            "expected_std": {
                "mass": float(self.expected[0]),
                "com": self.expected[1:4].tolist(),
                "inertia": self.expected[4:].tolist(),
            },
        }


def plan_weighing(arm: SerialArm, start: Array, config: WeighingConfig) -> WeighingMotion:
    """Design a motion that starts and ends where the arm is.

    Minimises tr(G Cov), the expected squared affine-invariant distance to the truth of a body on a
    sensor of unknown zero, over sums of sines of the joints; then makes the motion smaller until
    the arm keeps clear of itself and of the planes.

    Args:
        arm: with its hulls.
        start: (J,) joint positions, rad.
        config: limits.

    Raises:
        BadInputError: the arm stands outside its limits, or the shape of a link is not known.
        NotIdentifiableError: clearance leaves too small a motion.
    """
    _require_known(arm, start, config)
    loaded = arm.carrying(config.reach, config.radius)
    time = np.arange(0.0, config.duration, 1.0 / _GRID_HZ)
    frequency = np.geomspace(config.lowest_hz, config.highest_hz, _SINES)
    empty = np.zeros((len(start), _SINES))
    family = FourierOffsets(config.duration, frequency, empty, empty, _RAMP)

    def judge(genes: Array) -> tuple[float, FourierOffsets]:
        candidate = family.with_coefficients(genes * (config.amplitude / _SINES))
        motion = _within_limits(arm, start, candidate, config, time)
        return _expected_distance(_flange_motion(arm, start, motion, time)), motion

    rng = np.random.default_rng(config.seed)
    _, motion, _ = search_motion(judge, 2 * empty.size, config.evaluations, rng)
    motion, room, cut = _keep_clear(loaded, start, motion, config)
    seen = _flange_motion(arm, start, motion, time)
    rates = _rates(motion, time)
    return WeighingMotion(
        arm.names,
        np.asarray(start, dtype=float),
        motion,
        room,
        cut,
        np.abs(rates).max(axis=0),
        float(np.linalg.norm(seen.velocity, axis=1).max()),
        _expected_std(seen),
    )


def _require_known(arm: SerialArm, start: Array, config: WeighingConfig) -> None:
    unknown = [text for text in arm.unknown if text.split()[0] not in config.ignored_links]
    if unknown:
        raise BadInputError(
            f"the shape of link {unknown[0]} cannot be read, so that nothing keeps it from "
            "collisions; install its package, or name the link in ignored_links"
        )
    lower, upper = arm.limits("lower"), arm.limits("upper")
    outside = np.flatnonzero((start < lower) | (start > upper))
    if len(outside):
        k = int(outside[0])
        raise BadInputError(
            f"joint {arm.names[k]} stands at {start[k]:.3g}, outside its limits {lower[k]:.3g} to "
            f"{upper[k]:.3g}"
        )


def _rates(motion: FourierOffsets, time: Array) -> Array:
    step = 1e-3
    return np.asarray((motion.evaluate(time + step) - motion.evaluate(time - step)) / (2.0 * step))


def _within_limits(
    arm: SerialArm, start: Array, motion: FourierOffsets, config: WeighingConfig, time: Array
) -> FourierOffsets:
    """Scale each joint to its amplitude, range, speed and acceleration, and all to the tip's speed.

    Args:
        arm: whose limits they are.
        start: (J,) rad.
        motion: candidate.
        config: shares.
        time: (N,) s at which they are checked.
    """
    tiny = 1e-12
    offsets, rates = motion.evaluate(time), _rates(motion, time)
    step = 1e-2
    bend = (motion.evaluate(time + step) - 2.0 * offsets + motion.evaluate(time - step)) / step**2
    limits = [
        config.amplitude / np.maximum(np.abs(offsets).max(axis=0), tiny),
        (arm.limits("upper") - start) / np.maximum(offsets.max(axis=0), tiny),
        (start - arm.limits("lower")) / np.maximum(-offsets.min(axis=0), tiny),
        config.acceleration / np.maximum(np.abs(bend).max(axis=0), tiny),
    ]
    speed = arm.limits("velocity")
    allowed = np.where(speed > 0.0, config.speed_share * speed, np.inf)
    limits.append(allowed / np.maximum(np.abs(rates).max(axis=0), tiny))
    fitted = motion.scaled(np.minimum(np.min(limits, axis=0), 1.0))
    tip = _flange_motion(arm, start, fitted, time)
    fastest = float(np.linalg.norm(tip.velocity, axis=1).max())
    return fitted.scaled(min(1.0, config.tip_speed / max(fastest, tiny)))


def _flange_motion(
    arm: SerialArm, start: Array, motion: FourierOffsets, time: Array
) -> ObjectMotion:
    """Return the kinematics of the tip."""

    def poses(times: Array) -> tuple[Array, Array]:
        found = arm.tip_poses(start + motion.evaluate(times))
        return found[:, :3, :3], found[:, :3, 3]

    return follow(poses, time)


def _covariance(seen: ObjectMotion) -> Array:
    """Expected covariance (10, 10) of the dynamic parameters, the sensor's zero unknown."""
    columns = regressor(
        seen.specific_acceleration, seen.angular_velocity, seen.angular_acceleration
    )
    white = columns / _NOISE[:, None]
    zero = np.eye(6) / _NOISE[:, None]
    count = _SAMPLED_HZ / _GRID_HZ
    own = count * np.einsum("nki,nkj->ij", white, white)
    cross = count * np.einsum("nki,kj->ij", white, zero)
    zeros = count * len(seen.time) * zero.T @ zero
    information = own - cross @ np.linalg.solve(zeros, cross.T) + _METRIC
    return np.linalg.inv(information)


def _expected_distance(seen: ObjectMotion) -> float:
    return float(np.trace(_METRIC @ _covariance(seen)))


def _expected_std(seen: ObjectMotion) -> Array:
    """Standard deviations (7,) of mass, centre and moments of inertia about the sensor."""
    std = np.sqrt(np.diag(_covariance(seen)))
    centre = std[1:4] / _PRESUMED.mass
    return np.concatenate([std[:1], centre, std[[4, 6, 9]]])


def _keep_clear(
    arm: SerialArm, start: Array, motion: FourierOffsets, config: WeighingConfig
) -> tuple[FourierOffsets, Nearest, float]:
    """Make a motion smaller until it keeps clear.

    Args:
        arm: with what it carries.
        start: (J,) rad.
        motion: within the limits of the joints.
        config: margin and planes.

    Returns:
        The motion, how near it comes, and the share of it that is left.
    """
    time = np.arange(0.0, config.duration, 1.0 / _CHECK_HZ)
    share = 1.0
    while True:
        tried = motion.scaled(share)
        room = nearest(arm, config.plane_list(), start + tried.evaluate(time), start, config.margin)
        if room.room >= 0.0:
            return tried, room, share
        share *= _SHRINK
        if share < _LEAST_SHARE:
            raise NotIdentifiableError(
                f"no motion keeps clear: {room.what} come too near by {-1e3 * room.room:.0f} mm "
                "even in a small one; move the arm to a freer place, or state planes, reach and "
                "radius as they are"
            )
