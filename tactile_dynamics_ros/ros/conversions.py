"""Messages of ROS to arrays of the core and back; bad messages are refused here.

Types that come by the hundred per second are read and written as bytes (`wire`). The core orders
spatial vectors [rotational, translational]; messages carry the force (position) first. Live data
are swapped in this module only.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np
from builtin_interfaces.msg import Time
from geometry_msgs.msg import InertiaStamped, Vector3
from numpy.typing import NDArray
from sensor_msgs.msg import CameraInfo
from std_msgs.msg import Header

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.rigid_body.inertial_parameters import InertialParameters
from tactile_dynamics_ros.core.rigid_body.rotation import (
    matrix_to_quaternion,
    quaternion_to_matrix,
)
from tactile_dynamics_ros.core.robot.robot import Following
from tactile_dynamics_ros.core.streams.pose_noise import read_covariances
from tactile_dynamics_ros.core.tracking.depth_image import PinholeCamera
from tactile_dynamics_ros.recording.cdr import BIOTAC_ENCODING
from tactile_dynamics_ros.ros.names import JOINT_STATES
from tactile_dynamics_ros.ros.wire import (
    AnyStamp,
    Joints,
    Picture,
    Stamped,
    encode_image,
    encode_joint_state,
    encode_stamped,
    to_stamp,
)

IDENTITY = np.eye(4)
SWAP_HALVES = np.array([3, 4, 5, 0, 1, 2])
DEPTH_ENCODING = "32FC1"
RESTART_AFTER = 1.0
LARGEST_WRENCH = 1e4
"""N and N m beyond which no hand, arm or sensor of one measures: such a number is a fault."""
LARGEST_DISTANCE = 1e3
"""Metres from the world's origin beyond which no robot in a room has anything."""


class MessageError(BadInputError):
    """A message that cannot be used.

    Args:
        kind: short name under which it is counted, for example "not_finite".
        message: what, where, value and expectation.
    """

    def __init__(self, kind: str, message: str) -> None:
        super().__init__(message)
        self.kind = kind


class StampGate:
    """Passes stamps of one stream that increase; tells a jump back from a restarted clock."""

    def __init__(self, topic: str) -> None:
        self.topic = topic
        self.last = -math.inf

    def check(self, stamp: AnyStamp) -> bool:
        """Return True if the clock was restarted (a jump back by more than a second).

        Raises:
            MessageError: the stamp repeats or jumps back by less.
        """
        time = to_seconds(stamp)
        back = self.last - time
        if 0.0 <= back <= RESTART_AFTER:
            raise MessageError(
                "stamp_jumped_back",
                f"{self.topic}: stamp {time:.6f} s after {self.last:.6f} s, expected increasing",
            )
        self.last = time
        return back > RESTART_AFTER and math.isfinite(back)


def to_seconds(stamp: AnyStamp) -> float:
    """Return a stamp in seconds."""
    return float(stamp.sec + 1e-9 * stamp.nanosec)


def header(time: float | AnyStamp, frame_id: str) -> Header:
    """Return a header; `time` is a stamp or seconds."""
    return Header(stamp=to_time(time), frame_id=frame_id)


def to_time(time: float | AnyStamp) -> Time:
    """Return the time message of a stamp or of seconds."""
    stamp = _stamp(time)
    return Time(sec=stamp.sec, nanosec=stamp.nanosec)


def _stamp(time: float | AnyStamp) -> AnyStamp:
    return to_stamp(time) if isinstance(time, float | int) else time


def check_frame_id(topic: str, found: str, expected: str) -> None:
    """Check the frame in which a message is expressed.

    Raises:
        MessageError: it is another one.
    """
    if found != expected:
        raise MessageError(
            "wrong_frame", f"{topic}: frame_id '{found}', expected '{expected}'; transform it first"
        )


def _finite(topic: str, values: Array) -> Array:
    if not math.isfinite(sum(values.tolist())):
        raise MessageError("not_finite", f"{topic}: value {values.tolist()} is not finite")
    return values


def _within(topic: str, values: Array, limit: float, unit: str) -> Array:
    if max(map(abs, values.tolist())) > limit:
        raise MessageError(
            "implausible", f"{topic}: value {values.tolist()}, expected less than {limit:g} {unit}"
        )
    return values


def array_to_vector(values: Array) -> Vector3:
    """Return (3,) as a vector message."""
    x, y, z = values.tolist()
    return Vector3(x=x, y=y, z=z)


def wrench_to_core(message: Stamped, topic: str, frame: str | None = None) -> Array:
    """Return a wrench (6,) [torque, force].

    Args:
        message: WrenchStamped; force first, as in all ROS messages.
        topic: for the error text.
        frame: that the header has to name, or None if any will do.

    Raises:
        MessageError: wrong frame, or a value is not finite or beyond what is measured anywhere.
    """
    if frame is not None:
        check_frame_id(topic, message.frame_id, frame)
    values = _within(topic, _finite(topic, message.values), LARGEST_WRENCH, "N and N m")
    return values[SWAP_HALVES]


def wrench_to_message(wrench: Array, time: float | AnyStamp, frame: str) -> bytes:
    """Return the WrenchStamped of a wrench (6,) [torque, force]."""
    return encode_stamped(_stamp(time), frame, wrench[SWAP_HALVES])


def std_to_core(message: Stamped, topic: str) -> Array:
    """Return standard deviations (3,) of a Vector3Stamped.

    Raises:
        MessageError: one is not finite or negative.
    """
    values = _finite(topic, message.values)
    if min(values.tolist()) < 0.0:
        raise MessageError("negative_std", f"{topic}: {values.tolist()}, expected none negative")
    return values


def std_to_message(values: Array, time: float | AnyStamp, frame: str) -> bytes:
    """Return the Vector3Stamped of standard deviations (3,)."""
    return encode_stamped(_stamp(time), frame, values)


def pose_to_core(message: Stamped, topic: str, frame: str) -> Array:
    """Return the pose (4, 4) of a PoseStamped or PoseWithCovarianceStamped.

    Raises:
        MessageError: wrong frame, not finite, far outside any room, or the quaternion is not of
            unit length.
    """
    check_frame_id(topic, message.frame_id, frame)
    values = _finite(topic, message.values[:7])
    _within(topic, values[:3], LARGEST_DISTANCE, "m")
    norm = math.hypot(*values[3:].tolist())
    if abs(norm - 1.0) > 1e-2:
        raise MessageError(
            "bad_quaternion", f"{topic}: orientation {values[3:].tolist()} has length {norm:.3g}"
        )
    matrix = IDENTITY.copy()
    matrix[:3, :3] = quaternion_to_matrix(values[3:] / norm)
    matrix[:3, 3] = values[:3]
    return matrix


def pose_to_message(matrix: Array, time: float | AnyStamp, frame: str) -> bytes:
    """Return the PoseStamped of a pose (4, 4)."""
    return encode_stamped(_stamp(time), frame, _pose_values(matrix))


def _pose_values(matrix: Array) -> Array:
    """Return position and quaternion xyzw (7,)."""
    return np.concatenate([matrix[:3, 3], matrix_to_quaternion(matrix[:3, :3])])


def uncertain_pose_to_core(message: Stamped, topic: str, frame: str) -> tuple[Array, Array | None]:
    """Return pose (4, 4) and covariance (6, 6) [rotation, position], None where none is stated.

    A covariance that cannot be meant (`core.streams.pose_noise`) costs the statement, not the pose.

    Args:
        message: PoseWithCovarianceStamped; position first.
        topic: for the error text.
        frame: that the header has to name.

    Raises:
        MessageError: wrong frame, pose not finite or bad quaternion.
    """
    matrix = pose_to_core(message, topic, frame)
    said = read_covariances(covariance_to_core(message)[None])
    return matrix, said.covariance[0] if said.stated[0] else None


def covariance_to_core(message: Stamped) -> Array:
    """Return the covariance (6, 6) [rotation, position] of a PoseWithCovarianceStamped as it is."""
    return np.asarray(message.values[7:].reshape(6, 6)[SWAP_HALVES[:, None], SWAP_HALVES])


def uncertain_pose_to_message(
    matrix: Array, covariance: Array, time: float | AnyStamp, frame: str
) -> bytes:
    """Return the PoseWithCovarianceStamped of a pose and its covariance [rotation, position]."""
    swapped = covariance[SWAP_HALVES[:, None], SWAP_HALVES].ravel()
    return encode_stamped(_stamp(time), frame, np.concatenate([_pose_values(matrix), swapped]))


class JointReader:
    """Reads joint states into the order of the robot's table, whatever order they come in.

    Args:
        names: names of the joints, in the wanted order.
        topic: for error texts.
        followers: joints that need not be in a message, by what they follow.
    """

    def __init__(
        self,
        names: Sequence[str],
        topic: str = JOINT_STATES,
        followers: Mapping[str, Following] | None = None,
    ) -> None:
        self._names = tuple(names)
        self._topic = topic
        self._follows = {name: Following(name) for name in names} | dict(followers or {})
        self._seen: tuple[str, ...] = ()
        self._order = np.zeros(0, dtype=int)
        self._factor, self._offset = np.ones(0), np.zeros(0)

    def positions(self, message: Joints) -> Array:
        """Return joint positions in rad.

        Raises:
            MessageError: a joint is missing, the sizes differ, or a value is not finite.
        """
        names = message.names
        if names != self._seen:
            self._learn(names)
        if len(message.positions) != len(names):
            raise MessageError(
                "wrong_shape",
                f"{self._topic}: {len(message.positions)} positions for {len(names)} names",
            )
        positions = self._factor * message.positions[self._order] + self._offset
        return _finite(self._topic, positions)

    def _learn(self, names: tuple[str, ...]) -> None:
        told = [Following(n) if n in names else self._follows[n] for n in self._names]
        missing = [one.leader for one in told if one.leader not in names]
        if missing:
            raise MessageError(
                "missing_joint",
                f"{self._topic}: {len(missing)} of {len(self._names)} joints are missing "
                f"(first: {missing[0]}); publish arm and hand together",
            )
        self._order = np.array([names.index(one.leader) for one in told])
        self._factor = np.array([one.factor for one in told])
        self._offset = np.array([one.offset for one in told])
        self._seen = names


def joints_to_message(
    names: Sequence[str],
    time: float | AnyStamp,
    position: Array,
    velocity: Array | None = None,
    effort: Array | None = None,
) -> bytes:
    """Return the JointState of a joint state or joint command."""
    return encode_joint_state(names, _stamp(time), position, velocity, effort)


def biotac_to_core(message: Picture, topic: str, rows: int = 4, columns: int = 44) -> Array:
    """Return raw counts (rows, columns) of all BioTacs.

    Raises:
        MessageError: another encoding, size or row length.
    """
    _check_image(message, topic, BIOTAC_ENCODING, rows, columns, 2)
    kind = ">u2" if message.is_bigendian else "<u2"
    return np.frombuffer(message.data, dtype=kind).reshape(rows, columns).astype(float)


def biotac_to_message(counts: NDArray[np.uint16], time: float | AnyStamp, frame: str) -> bytes:
    """Return the Image of raw counts (4, 44)."""
    return encode_image(_stamp(time), frame, BIOTAC_ENCODING, counts.astype("<u2", copy=False))


def depth_to_core(message: Picture, topic: str) -> NDArray[np.float32]:
    """Return a depth image (H, W) in m; unknown depth is NaN.

    Raises:
        MessageError: another encoding or size.
    """
    height, width = message.height, message.width
    _check_image(message, topic, DEPTH_ENCODING, height, width, 4)
    kind = ">f4" if message.is_bigendian else "<f4"
    return np.frombuffer(message.data, dtype=kind).reshape(height, width).astype(np.float32)


def depth_to_message(depth: NDArray[np.float32], time: float | AnyStamp, frame: str) -> bytes:
    """Return the Image of a depth image (H, W) in m."""
    return encode_image(_stamp(time), frame, DEPTH_ENCODING, depth.astype("<f4", copy=False))


def camera_info(
    intrinsics: Array, width: int, height: int, time: float | AnyStamp, frame: str
) -> CameraInfo:
    """Return the camera info of an ideal pinhole camera with intrinsics K (3, 3)."""
    message = CameraInfo(header=header(time, frame), width=width, height=height)
    message.distortion_model = "plumb_bob"
    message.d = [0.0] * 5
    message.k = intrinsics.ravel()
    message.r = np.eye(3).ravel()
    message.p = np.hstack([intrinsics, np.zeros((3, 1))]).ravel()
    return message


def camera_to_core(message: CameraInfo, topic: str, pose: Array) -> PinholeCamera:
    """Return the pinhole camera of a rectified image, whose optical frame is at X_WC (4, 4).

    Raises:
        MessageError: no focal length or no size.
    """
    projection = np.asarray(message.p, dtype=float).reshape(3, 4)[:, :3]
    k = projection if projection[0, 0] > 0.0 else np.asarray(message.k).reshape(3, 3)
    if not (k[0, 0] > 0.0 and message.width > 0 and message.height > 0):
        raise MessageError(
            "bad_camera_info",
            f"{topic}: focal length {k[0, 0]:g} px and size {message.width} x "
            f"{message.height}; expected a calibrated camera",
        )
    return PinholeCamera(k, message.width, message.height, pose)


def inertia_to_message(
    parameters: InertialParameters, time: float | AnyStamp, frame: str
) -> InertiaStamped:
    """Return the message of mass, centre of mass and inertia *about the centre of mass*."""
    message = InertiaStamped(header=header(time, frame))
    inertia, tensor = message.inertia, parameters.inertia_com
    inertia.m = float(parameters.mass)
    inertia.com = array_to_vector(parameters.com)
    inertia.ixx, inertia.ixy, inertia.ixz = tensor[0].tolist()
    inertia.iyy, inertia.iyz, inertia.izz = (
        float(tensor[1, 1]),
        float(tensor[1, 2]),
        float(tensor[2, 2]),
    )
    return message


def _check_image(
    message: Picture, topic: str, encoding: str, height: int, width: int, item: int
) -> None:
    if message.encoding != encoding:
        raise MessageError(
            "wrong_encoding", f"{topic}: encoding '{message.encoding}', expected '{encoding}'"
        )
    size = (message.height, message.width, message.step, len(message.data))
    expected = (height, width, width * item, height * width * item)
    if size != expected:
        raise MessageError(
            "wrong_shape", f"{topic}: (height, width, step, bytes) {size}, expected {expected}"
        )
