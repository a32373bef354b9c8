"""Streams from named arrays: shapes checked, constants spread, object axes turned to the world."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.rigid_body.rotation import (
    matrix_to_quaternion,
    skew,
)
from tactile_dynamics_ros.core.streams.streams import ContactStream, Streams, between_turns
from tactile_dynamics_ros.recording.assembly import (
    assemble_contact,
    assemble_imu,
    assemble_pose,
    quaternions_of,
)
from tactile_dynamics_ros.recording.cleaning import ProblemLog
from tactile_dynamics_ros.recording.topics import (
    ImuColumns,
    PoseColumns,
    StdColumns,
    WrenchColumns,
)

_DOWN = -0.999

POSE_KEYS = frozenset(
    ["time", "position", "quaternion", "rotation", "position_std", "rotation_std", "covariance"]
)
CONTACT_KEYS = frozenset(
    [
        "time",
        "force",
        "torque",
        "force_std",
        "pose_time",
        "position",
        "normal",
        "quaternion",
        "rotation",
    ]
)
IMU_KEYS = frozenset(
    ["time", "specific_force", "quaternion", "rotation", "angular_velocity", "specific_force_std"]
)


def streams_from_arrays(
    contacts: Mapping[str, Mapping[str, Any]],
    pose: Mapping[str, Any] | None,
    imu: Mapping[str, Any] | None,
    contact_frame: str,
    source: str,
) -> tuple[Streams, ProblemLog]:
    """Return cleaned streams and what had to be cleaned; see `Recording.from_arrays`.

    Raises:
        BadInputError: an array is missing, unknown or of the wrong shape.
    """
    if contact_frame not in ("world", "object"):
        raise BadInputError(f"contact_frame = '{contact_frame}'; expected 'world' or 'object'")
    log = ProblemLog()
    pose_stream = (
        None if pose is None else assemble_pose(_pose(_Group("pose", pose, POSE_KEYS)), log)
    )
    imu_stream = None if imu is None else assemble_imu(_imu(_Group("imu", imu, IMU_KEYS)), log)
    motion = pose_stream or imu_stream
    if motion is None:
        raise BadInputError(
            f"{source}: neither pose nor imu is given; expected the object's motion"
        )
    if contact_frame == "object" and motion.rotation is None:
        raise BadInputError(f"{source}: contact_frame 'object' needs the object's orientation")
    streams: dict[str, ContactStream] = {}
    for name, arrays in contacts.items():
        wrench, where, std = _contact(name, _Group(f"contacts.{name}", arrays, CONTACT_KEYS))
        stream = assemble_contact(name, wrench, where, std, log)
        if stream is not None:
            to_world = contact_frame == "object"
            streams[name] = _in_world(stream, motion) if to_world else stream
    return Streams(pose_stream, streams, imu_stream), log


class _Group:
    """Named arrays of one stream; every access checks the shape."""

    def __init__(self, label: str, arrays: Mapping[str, Any], known: frozenset[str]) -> None:
        self.label = label
        self._arrays = {k: v for k, v in arrays.items() if v is not None}
        unknown = sorted(set(self._arrays) - known)
        if unknown:
            raise BadInputError(
                f"{label}: unknown array '{unknown[0]}'; expected {', '.join(sorted(known))}"
            )

    def __contains__(self, key: str) -> bool:
        return key in self._arrays

    def get(self, key: str, *shape: int) -> Array:
        """Return an array of N rows (N = -1 for any); one row is spread over all.

        Raises:
            BadInputError: it is missing, not numeric or of another shape.
        """
        if key not in self._arrays:
            raise BadInputError(f"{self.label}.{key} is missing; expected shape {_shape(shape)}")
        try:
            value = np.asarray(self._arrays[key], dtype=np.float64)
        except (TypeError, ValueError) as error:
            raise BadInputError(f"{self.label}.{key} is not numeric: {error}") from error
        rows = shape[0]
        if rows >= 0 and value.shape in ((), shape[1:]):
            return np.broadcast_to(value, shape).copy()
        if value.ndim != len(shape) or value.shape[1:] != shape[1:] or rows not in (-1, len(value)):
            raise BadInputError(
                f"{self.label}.{key} has shape {value.shape}; expected {_shape(shape)}"
            )
        return value

    def rotation(self, rows: int) -> Array:
        """Return (rows, 4) quaternions from `quaternion` or `rotation`."""
        if "quaternion" in self:
            return self.get("quaternion", rows, 4)
        if "rotation" in self:
            return quaternions_of(self.get("rotation", rows, 3, 3), f"{self.label}.rotation")
        raise BadInputError(
            f"{self.label}: neither quaternion (N, 4) xyzw nor rotation (N, 3, 3) is given"
        )


def _shape(shape: tuple[int, ...]) -> str:
    """Return a shape with N for the number of rows."""
    sizes = [("N" if s < 0 else str(s)) for s in shape]
    return f"({', '.join(sizes)}{',' if len(sizes) == 1 else ''})"


def _pose(group: _Group) -> PoseColumns:
    """Return the columns of the object's poses."""
    time = group.get("time", -1)
    rows = len(time)
    covariance = None
    if "covariance" in group:
        covariance = group.get("covariance", rows, 6, 6)
    elif "position_std" in group and "rotation_std" in group:
        std = [group.get(key, rows, 3) for key in ("rotation_std", "position_std")]
        covariance = np.concatenate(std, axis=1)[:, :, None] ** 2 * np.eye(6)
    elif "position_std" in group or "rotation_std" in group:
        raise BadInputError(f"{group.label}: position_std and rotation_std must be given together")
    position = group.get("position", rows, 3)
    return PoseColumns(group.label, time, position, group.rotation(rows), covariance)


def _contact(name: str, group: _Group) -> tuple[WrenchColumns, PoseColumns, StdColumns | None]:
    """Return the columns of one contact; a contact frame that is not given is the world's axes."""
    time = group.get("time", -1)
    rows = len(time)
    torque = group.get("torque", rows, 3) if "torque" in group else np.zeros((rows, 3))
    wrench = WrenchColumns(group.label, time, group.get("force", rows, 3), torque)
    pose_time = group.get("pose_time", -1) if "pose_time" in group else time
    poses = len(pose_time)
    if "normal" in group:
        quaternion = matrix_to_quaternion(frame_of_normal(group.get("normal", poses, 3)))
    elif "quaternion" in group or "rotation" in group:
        quaternion = group.rotation(poses)
    else:
        quaternion = np.tile([0.0, 0.0, 0.0, 1.0], (poses, 1))
    where = PoseColumns(group.label, pose_time, group.get("position", poses, 3), quaternion)
    std = None
    if "force_std" in group:
        std = StdColumns(group.label, time, group.get("force_std", rows, 3))
    return wrench, where, std


def frame_of_normal(normal: Array) -> Array:
    """Return contact frames whose z axis is the normal, by the least rotation from world's z.

    R = I + [v] + [v]^2 / (1 + n_z) with v = e_z x n.

    Args:
        normal: (N, 3), any length but zero.

    Returns:
        (N, 3, 3); with half a turn about x first where the normal points nearly straight down.
    """
    n = normal / np.linalg.norm(normal, axis=1, keepdims=True)
    half_turn = np.diag([1.0, -1.0, -1.0])
    down = n[:, 2] < _DOWN
    n = np.where(down[:, None], n @ half_turn, n)
    cross = skew(np.cross([0.0, 0.0, 1.0], n))
    frames = np.eye(3) + cross + (cross @ cross) / (1.0 + n[:, 2])[:, None, None]
    return np.where(down[:, None, None], half_turn @ frames, frames)


def _imu(group: _Group) -> ImuColumns:
    """Return the columns of the IMU."""
    time = group.get("time", -1)
    rows = len(time)
    has_rotation = "quaternion" in group or "rotation" in group
    has_gyroscope = "angular_velocity" in group
    has_std = "specific_force_std" in group
    return ImuColumns(
        label=group.label,
        time=time,
        specific_force=group.get("specific_force", rows, 3),
        quaternion=group.rotation(rows) if has_rotation else None,
        angular_velocity=group.get("angular_velocity", rows, 3) if has_gyroscope else None,
        specific_force_std=float(group.get("specific_force_std", 1)[0]) if has_std else None,
    )


def _in_world(contact: ContactStream, motion: Any) -> ContactStream:
    """Turn a contact that was measured in object axes to world axes."""
    wrench_R = between_turns(motion.time, motion.rotation, contact.time)
    pose_R = between_turns(motion.time, motion.rotation, contact.pose_time)
    origin = getattr(motion, "position", np.zeros((len(motion.time), 3)))
    moved = [np.interp(contact.pose_time, motion.time, axis) for axis in origin.T]
    return ContactStream(
        name=contact.name,
        time=contact.time,
        force=np.einsum("nij,nj->ni", wrench_R, contact.force),
        torque=np.einsum("nij,nj->ni", wrench_R, contact.torque),
        force_std=contact.force_std,
        pose_time=contact.pose_time,
        position=np.einsum("nij,nj->ni", pose_R, contact.position) + np.stack(moved, axis=1),
        rotation=pose_R @ contact.rotation,
        carries_torque=contact.carries_torque,
    )


def start_at_zero(streams: Streams) -> tuple[Streams, float]:
    """Return streams whose first motion sample is at time zero, and the time taken off."""
    motion = streams.pose or streams.imu
    start = float(motion.time[0]) if motion else 0.0
    contacts = {
        name: replace(c, time=c.time - start, pose_time=c.pose_time - start)
        for name, c in streams.contacts.items()
    }
    pose, imu = streams.pose, streams.imu
    pose = pose and replace(pose, time=pose.time - start)
    imu = imu and replace(imu, time=imu.time - start)
    return Streams(pose, contacts, imu), start
