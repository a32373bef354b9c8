"""Streams from columns of numbers: faulty samples are dropped and counted on the way."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.rigid_body.rotation import (
    are_rotations,
    matrix_to_quaternion,
    quaternion_to_matrix,
)
from tactile_dynamics_ros.core.streams.pose_noise import read_covariances
from tactile_dynamics_ros.core.streams.streams import ContactStream, ImuStream, PoseStream
from tactile_dynamics_ros.recording.cleaning import (
    ANGULAR_VELOCITY_LIMIT,
    FORCE_LIMIT,
    POSITION_LIMIT,
    QUATERNION_TOLERANCE,
    SPECIFIC_FORCE_LIMIT,
    TORQUE_LIMIT,
    Mask,
    ProblemLog,
    align_signs,
    count_gaps,
    find_absurd,
    find_bad_quaternions,
    find_glitches,
    find_held,
    find_not_finite,
    find_not_increasing,
    find_saturated,
    find_seams,
    scale_quaternions,
    select,
)
from tactile_dynamics_ros.recording.topics import (
    ImuColumns,
    PoseColumns,
    StdColumns,
    WrenchColumns,
)

STANDARD_GRAVITY = 9.81
HELD = "sample of a slower sensor repeated"


def assemble_pose(columns: PoseColumns, log: ProblemLog, planar: bool = False) -> PoseStream:
    """Return the object's pose stream without faulty samples.

    Args:
        columns: as measured.
        log: where faults are counted.
        planar: whether the object lies on a table, so that x, y and yaw alone count.

    Raises:
        BadInputError: fewer than two usable poses remain.
    """
    kept = _clean_poses(columns, log, planar)
    bad = find_glitches(kept.position, 2.0 * align_signs(kept.quaternion))
    kept = _drop_leaps(kept, bad, log)
    if len(kept.time) < 2:
        raise BadInputError(
            f"{kept.label}: {len(kept.time)} usable poses of {len(columns.time)}; expected finite "
            f"values and increasing stamps{_worst(log, columns.label)}"
        )
    log.note(kept.label, "gap in the stream", count_gaps(kept.time))
    return PoseStream(
        time=kept.time,
        position=kept.position,
        rotation=quaternion_to_matrix(kept.quaternion),
        covariance=_clean_covariance(kept.covariance, kept.label, log, planar),
    )


def _clean_poses(columns: PoseColumns, log: ProblemLog, planar: bool = False) -> PoseColumns:
    """Drop poses that are not finite, absurd, out of order or without rotation."""
    label = columns.label
    fields: tuple[Array, ...] = (columns.time, columns.position, columns.quaternion)
    if columns.covariance is not None:
        fields = (*fields, columns.covariance)
    fields = select(log.drop(label, "sample is not finite", find_not_finite(*fields[:3])), fields)
    fields = select(
        log.drop(label, "position is absurd", find_absurd(fields[1], POSITION_LIMIT)), fields
    )
    named = scale_quaternions(fields[2])
    fields = select(
        log.drop(label, "quaternion is not a rotation", find_bad_quaternions(named)), fields
    )
    if columns.covariance is not None:
        lost = read_covariances(fields[3], planar).lost
        fields = select(log.drop(label, "pose lost by its tracker", lost), fields)
    fields = select(_drop_disorder(label, fields[0], log), fields)
    fields = select(log.drop(label, HELD, find_held(fields[1], fields[2])), fields)
    norm = np.asarray(np.linalg.norm(fields[2], axis=1, keepdims=True))
    off = int(np.count_nonzero(np.abs(norm - 1.0) > QUATERNION_TOLERANCE))
    log.note(label, "quaternion is not of unit length (normalised)", off)
    unit = fields[2] / norm
    return PoseColumns(label, fields[0], fields[1], unit, fields[3] if len(fields) > 3 else None)


def _drop_leaps(columns: PoseColumns, bad: Mask, log: ProblemLog) -> PoseColumns:
    """Drop and count poses that leap away from their neighbours and back."""
    good = log.drop(columns.label, "pose leaps away and back", bad)
    return PoseColumns(
        columns.label,
        columns.time[good],
        columns.position[good],
        columns.quaternion[good],
        None if columns.covariance is None else columns.covariance[good],
    )


def _drop_disorder(label: str, time: Array, log: ProblemLog) -> Mask:
    """Drop and count stamps that repeat or jump."""
    bad = find_not_increasing(time)
    repeated = bad & np.isin(time, time[~bad])
    log.drop(label, "stamp repeats", repeated)
    log.drop(label, "stamp jumps", bad & ~repeated)
    seams = find_seams(time, bad)
    log.drop(label, "clock stepped, next samples are not joined with those before", seams)
    return ~bad & ~seams


def _clean_covariance(
    covariance: Array | None, label: str, log: ProblemLog, planar: bool
) -> Array | None:
    """Return usable covariances, None where most are not; the median stands for one that is not."""
    if covariance is None:
        return None
    said = read_covariances(covariance, planar)
    rare = 2 * np.count_nonzero(said.stated) >= len(covariance)
    for mistake, count in said.mistakes.items():
        log.note(label, f"{mistake} ({'median used' if rare else 'taken as not stated'})", count)
    if not rare:
        return None
    usual = np.median(said.covariance[said.stated], axis=0)
    return np.where(said.stated[:, None, None], said.covariance, usual)


def assemble_contact(
    name: str,
    wrench: WrenchColumns,
    pose: PoseColumns,
    std: StdColumns | None,
    log: ProblemLog,
    sensor_axes: bool = False,
) -> ContactStream | None:
    """Return one contact's stream without faulty samples, or None if it never touches.

    Args:
        name: of the contact.
        wrench: as measured.
        pose: of the contact.
        std: of the force, where it is stated.
        log: where faults are counted.
        sensor_axes: whether the wrench is in axes that the pose turns; then it is turned by it.

    Raises:
        BadInputError: the contact pushes, but where it does is not known.
    """
    kept = _clean_wrenches(wrench, log)
    if sensor_axes:
        kept = kept.in_world_axes(pose)
    if not len(kept.time) or not np.any(kept.force):
        log.note(wrench.label, "no force at all (contact left out)", 1)
        return None
    poses = _clean_poses(_with_some_orientation(pose, log), log)
    normal = quaternion_to_matrix(poses.quaternion)[:, :, 2]
    poses = _drop_leaps(poses, find_glitches(poses.position, normal), log)
    if not len(poses.time):
        raise BadInputError(
            f"{poses.label}: no usable pose of {len(pose.time)}, but {wrench.label} has "
            f"{len(kept.time)} forces; record the contact's pose too"
        )
    return ContactStream(
        name=name,
        time=kept.time,
        force=kept.force,
        torque=kept.torque,
        force_std=_align_std(std, kept.time, log),
        pose_time=poses.time,
        position=poses.position,
        rotation=quaternion_to_matrix(poses.quaternion),
        carries_torque=bool(np.any(kept.torque)),
    )


def _with_some_orientation(pose: PoseColumns, log: ProblemLog) -> PoseColumns:
    """Return contact poses with the world's axes where no orientation was ever set."""
    if not len(pose.time) or np.any(pose.quaternion):
        return pose
    log.note(pose.label, "orientation not set (normal not known)", len(pose.time))
    return replace(pose, quaternion=np.tile([0.0, 0.0, 0.0, 1.0], (len(pose.time), 1)))


def _clean_wrenches(columns: WrenchColumns, log: ProblemLog) -> WrenchColumns:
    """Drop wrenches that are not finite, absurd, out of order or on the sensor's rail."""
    label = columns.label
    fields: tuple[Array, ...] = (columns.time, columns.force, columns.torque)
    fields = select(log.drop(label, "sample is not finite", find_not_finite(*fields)), fields)
    absurd = find_absurd(fields[1], FORCE_LIMIT) | find_absurd(fields[2], TORQUE_LIMIT)
    fields = select(log.drop(label, "force or torque is absurd", absurd), fields)
    fields = select(_drop_disorder(label, fields[0], log), fields)
    saturated = find_saturated(np.concatenate([fields[1], fields[2]], axis=1))
    fields = select(log.drop(label, "sensor saturated", saturated), fields)
    loaded = np.flatnonzero(fields[1].any(axis=1) | fields[2].any(axis=1))
    held = np.zeros(len(fields[0]), dtype=bool)
    held[loaded] = find_held(fields[1][loaded], fields[2][loaded])
    fields = select(log.drop(label, HELD, held), fields)
    return WrenchColumns(label, *fields)


def _align_std(std: StdColumns | None, time: Array, log: ProblemLog) -> Array | None:
    """Return the standard deviation stated nearest in time to each force."""
    if std is None or not len(std.time):
        return None
    usable = np.asarray(~find_not_finite(std.time, std.std) & np.all(std.std > 0.0, axis=1))
    log.drop(std.label, "standard deviation is not positive", ~usable)
    if not usable.any():
        return None
    order = np.flatnonzero(usable)[np.argsort(std.time[usable], kind="stable")]
    stamps = std.time[order]
    after = np.clip(np.searchsorted(stamps, time), 1, max(1, len(stamps) - 1))
    if len(stamps) == 1:
        return np.repeat(std.std[order], len(time), axis=0)
    nearer_before = time - stamps[after - 1] < stamps[after] - time
    return np.asarray(std.std[order[after - nearer_before.astype(int)]])


def assemble_imu(columns: ImuColumns, log: ProblemLog, any_unit: bool = False) -> ImuStream | None:
    """Return the IMU stream without faulty samples, or None if nothing usable remains.

    Args:
        columns: readings.
        log: of what had to be cleaned.
        any_unit: whether accelerations that look like units of g are taken as they are.

    Raises:
        BadInputError: the accelerometer reads in units of g.
    """
    label, size = columns.label, len(columns.time)
    gyroscope = columns.angular_velocity
    turn = np.zeros((size, 3)) if gyroscope is None else gyroscope
    still = np.tile([0.0, 0.0, 0.0, 1.0], (size, 1))
    quaternion = still if columns.quaternion is None else columns.quaternion
    fields: tuple[Array, ...] = (columns.time, columns.specific_force, turn, quaternion)
    fields = select(log.drop(label, "sample is not finite", find_not_finite(*fields)), fields)
    absurd = find_absurd(fields[1], SPECIFIC_FORCE_LIMIT)
    absurd |= find_absurd(fields[2], ANGULAR_VELOCITY_LIMIT)
    fields = select(log.drop(label, "reading is absurd", absurd), fields)
    fields = select(
        log.drop(
            label,
            "quaternion is not a rotation",
            find_bad_quaternions(scale_quaternions(fields[3])),
        ),
        fields,
    )
    fields = select(_drop_disorder(label, fields[0], log), fields)
    fields = select(log.drop(label, "sensor saturated", find_saturated(fields[1])), fields)
    if len(fields[0]) < 2:
        log.note(label, "too few usable samples (IMU left out)", 1)
        return None
    if not any_unit:
        _refuse_units_of_g(label, fields[1])
    log.note(label, "gap in the stream", count_gaps(fields[0]))
    unit = fields[3] / np.linalg.norm(fields[3], axis=1, keepdims=True)
    return ImuStream(
        time=fields[0],
        rotation=None if columns.quaternion is None else quaternion_to_matrix(unit),
        angular_velocity=None if gyroscope is None else fields[2],
        specific_force=fields[1],
        specific_force_std=columns.specific_force_std,
    )


def _refuse_units_of_g(label: str, specific_force: Array) -> None:
    """Refuse an accelerometer that reads about 1 where it should read about 9.81."""
    typical = float(np.median(np.linalg.norm(specific_force, axis=1)))
    if 0.5 < typical < 2.0:
        raise BadInputError(
            f"{label}: linear_acceleration has a typical size of {typical:.2f}; expected about "
            f"{STANDARD_GRAVITY} m/s^2 at rest. It seems to be in units of g: multiply by 9.80665, "
            "or read it with --assume acceleration_unit"
        )


def quaternions_of(rotation: Array, label: str) -> Array:
    """Return the quaternions of rotation matrices; a matrix that is no rotation becomes NaN.

    Args:
        rotation: (N, 3, 3).
        label: array name for messages to the user.

    Raises:
        BadInputError: the matrices mirror space.
    """
    good = are_rotations(rotation)
    if np.any(np.linalg.det(rotation[good]) < 0.0):
        raise BadInputError(f"{label}: rotation has determinant -1; expected a right-handed frame")
    quaternion = np.full((len(rotation), 4), np.nan)
    quaternion[good] = matrix_to_quaternion(rotation[good])
    return quaternion


def _worst(log: ProblemLog, label: str) -> str:
    """Return the most frequent problem of a stream as an addition to an error message."""
    own = [(count, text) for text, count in log.items() if text.startswith(f"{label}: ")]
    return f"; {max(own)[1].removeprefix(f'{label}: ')} x {max(own)[0]}" if own else ""
