"""Messages of ROS to arrays of the core and back; bad messages are refused here.

The core orders spatial vectors [rotational, translational]; messages carry the force (position)
first. Live data are swapped in this module only.
"""

from __future__ import annotations

import array
import math
from collections.abc import Sequence

import numpy as np
from builtin_interfaces.msg import Time
from geometry_msgs.msg import (
    InertiaStamped,
    Pose,
    PoseStamped,
    PoseWithCovarianceStamped,
    Vector3,
    Vector3Stamped,
    Wrench,
    WrenchStamped,
)
from numpy.typing import NDArray
from sensor_msgs.msg import CameraInfo, Image, JointState
from std_msgs.msg import Header

from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.rigid_body.inertial_parameters import InertialParameters
from tactile_dynamics_ros.core.rigid_body.rotation import (
    matrix_to_quaternion,
    quaternion_to_matrix,
)
from tactile_dynamics_ros.core.tracking.depth_image import PinholeCamera

Array = NDArray[np.float64]

SWAP_HALVES = np.array([3, 4, 5, 0, 1, 2])
BIOTAC_ENCODING = "16UC1"
DEPTH_ENCODING = "32FC1"
RESTART_AFTER = 1.0


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

    def check(self, stamp: Time) -> bool:
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


def to_seconds(stamp: Time) -> float:
    """Return a stamp in seconds."""
    return float(stamp.sec + 1e-9 * stamp.nanosec)


def to_stamp(seconds: float) -> Time:
    """Return the stamp of a time in seconds."""
    sec, nanosec = divmod(round(seconds * 1e9), 1_000_000_000)
    return Time(sec=sec, nanosec=nanosec)


def header(time: float | Time, frame_id: str) -> Header:
    """Return a header; `time` is a stamp or seconds."""
    stamp = time if isinstance(time, Time) else to_stamp(time)
    return Header(stamp=stamp, frame_id=frame_id)


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
    if not np.isfinite(values).all():
        raise MessageError("not_finite", f"{topic}: value {values.tolist()} is not finite")
    return values


def vector_to_array(vector: Vector3) -> Array:
    """Return a vector message as (3,)."""
    return np.array([vector.x, vector.y, vector.z])


def array_to_vector(values: Array) -> Vector3:
    """Return (3,) as a vector message."""
    x, y, z = values.tolist()
    return Vector3(x=x, y=y, z=z)


def wrench_to_core(message: WrenchStamped, topic: str, frame: str | None = None) -> Array:
    """Return a wrench (6,) [torque, force].

    Args:
        message: force first, as all ROS messages.
        topic: for the error text.
        frame: that the header has to name, or None if any will do.

    Raises:
        MessageError: wrong frame, or a value is not finite.
    """
    if frame is not None:
        check_frame_id(topic, message.header.frame_id, frame)
    torque, force = message.wrench.torque, message.wrench.force
    return _finite(topic, np.array([torque.x, torque.y, torque.z, force.x, force.y, force.z]))


def wrench_to_message(wrench: Array, time: float | Time, frame: str) -> WrenchStamped:
    """Return the message of a wrench (6,) [torque, force]."""
    return WrenchStamped(
        header=header(time, frame),
        wrench=Wrench(torque=array_to_vector(wrench[:3]), force=array_to_vector(wrench[3:])),
    )


def std_to_core(message: Vector3Stamped, topic: str) -> Array:
    """Return standard deviations (3,).

    Raises:
        MessageError: one is not finite or negative.
    """
    values = _finite(topic, vector_to_array(message.vector))
    if (values < 0).any():
        raise MessageError("negative_std", f"{topic}: {values.tolist()}, expected none negative")
    return values


def std_to_message(values: Array, time: float | Time, frame: str) -> Vector3Stamped:
    """Return the message of standard deviations (3,)."""
    return Vector3Stamped(header=header(time, frame), vector=array_to_vector(values))


def slip_to_message(
    score: float, level: float, slipping: bool, time: float | Time, frame: str
) -> Vector3Stamped:
    """Return a slip as message: x the score, y the level over rest, z whether it slips (0 or 1)."""
    return std_to_message(np.array([score, level, float(slipping)]), time, frame)


def pose_to_matrix(pose: Pose, topic: str) -> Array:
    """Return a pose as (4, 4).

    Raises:
        MessageError: a value is not finite, or the quaternion is not of unit length.
    """
    p, q = pose.position, pose.orientation
    values = _finite(topic, np.array([p.x, p.y, p.z, q.x, q.y, q.z, q.w]))
    norm = math.sqrt(float(values[3:] @ values[3:]))
    if abs(norm - 1.0) > 1e-2:
        raise MessageError(
            "bad_quaternion", f"{topic}: orientation {values[3:].tolist()} has length {norm:.3g}"
        )
    matrix = np.eye(4)
    matrix[:3, :3] = quaternion_to_matrix(values[3:] / norm)
    matrix[:3, 3] = values[:3]
    return matrix


def matrix_to_pose(matrix: Array) -> Pose:
    """Return the message of a pose (4, 4)."""
    pose = Pose()
    pose.position.x, pose.position.y, pose.position.z = matrix[:3, 3].tolist()
    quaternion = matrix_to_quaternion(matrix[:3, :3]).tolist()
    o = pose.orientation
    o.x, o.y, o.z, o.w = quaternion
    return pose


def pose_to_message(matrix: Array, time: float | Time, frame: str) -> PoseStamped:
    """Return the stamped message of a pose (4, 4)."""
    return PoseStamped(header=header(time, frame), pose=matrix_to_pose(matrix))


def uncertain_pose_to_core(
    message: PoseWithCovarianceStamped, topic: str, frame: str
) -> tuple[Array, Array | None]:
    """Return pose (4, 4) and covariance (6, 6) [rotation, position], None where it is all zero.

    Raises:
        MessageError: wrong frame, not finite, bad quaternion or a negative variance.
    """
    check_frame_id(topic, message.header.frame_id, frame)
    matrix = pose_to_matrix(message.pose.pose, topic)
    covariance = _finite(topic, np.array(message.pose.covariance).reshape(6, 6))
    if (np.diag(covariance) < 0).any():
        raise MessageError("negative_std", f"{topic}: covariance has a negative variance")
    if not covariance.any():
        return matrix, None
    return matrix, covariance[np.ix_(SWAP_HALVES, SWAP_HALVES)]


def uncertain_pose_to_message(
    matrix: Array, covariance: Array, time: float | Time, frame: str
) -> PoseWithCovarianceStamped:
    """Return the message of a pose (4, 4) with covariance (6, 6) [rotation, position]."""
    message = PoseWithCovarianceStamped(header=header(time, frame))
    message.pose.pose = matrix_to_pose(matrix)
    message.pose.covariance = covariance[np.ix_(SWAP_HALVES, SWAP_HALVES)].ravel()
    return message


class JointReader:
    """Reads joint states into the order of the robot's table, whatever order they come in.

    Args:
        names: of the joints, in the wanted order.
        topic: for error texts.
    """

    def __init__(self, names: Sequence[str], topic: str = "/joint_states") -> None:
        self._names = tuple(names)
        self._topic = topic
        self._seen: tuple[str, ...] = ()
        self._order = np.zeros(0, dtype=int)

    def positions(self, message: JointState) -> Array:
        """Return joint positions in rad.

        Raises:
            MessageError: a joint is missing, the sizes differ, or a value is not finite.
        """
        names = tuple(message.name)
        if names != self._seen:
            self._learn(names)
        if len(message.position) != len(names):
            raise MessageError(
                "wrong_shape",
                f"{self._topic}: {len(message.position)} positions for {len(names)} names",
            )
        return _finite(self._topic, np.array(message.position)[self._order])

    def _learn(self, names: tuple[str, ...]) -> None:
        missing = [name for name in self._names if name not in names]
        if missing:
            raise MessageError(
                "missing_joint",
                f"{self._topic}: lacks {len(missing)} of {len(self._names)} joints "
                f"(first: {missing[0]}); publish arm and hand together",
            )
        self._order = np.array([names.index(name) for name in self._names])
        self._seen = names


def joints_to_message(
    names: Sequence[str],
    time: float | Time,
    position: Array,
    velocity: Array | None = None,
    effort: Array | None = None,
) -> JointState:
    """Return a joint state or joint command."""
    message = JointState(header=header(time, ""), name=list(names), position=position.tolist())
    if velocity is not None:
        message.velocity = velocity.tolist()
    if effort is not None:
        message.effort = effort.tolist()
    return message


def biotac_to_core(message: Image, topic: str, rows: int = 4, columns: int = 44) -> Array:
    """Return raw counts (rows, columns) of all BioTacs.

    Raises:
        MessageError: another encoding, size or row length.
    """
    _check_image(message, topic, BIOTAC_ENCODING, rows, columns, 2)
    kind = ">u2" if message.is_bigendian else "<u2"
    return np.frombuffer(message.data, dtype=kind).reshape(rows, columns).astype(float)


def biotac_to_message(counts: NDArray[np.uint16], time: float | Time, frame: str) -> Image:
    """Return the image message of raw counts (4, 44)."""
    return _image(np.ascontiguousarray(counts, dtype="<u2"), BIOTAC_ENCODING, time, frame)


def depth_to_core(message: Image, topic: str) -> NDArray[np.float32]:
    """Return a depth image (H, W) in m; unknown depth is NaN.

    Raises:
        MessageError: another encoding or size.
    """
    height, width = message.height, message.width
    _check_image(message, topic, DEPTH_ENCODING, height, width, 4)
    kind = ">f4" if message.is_bigendian else "<f4"
    return np.frombuffer(message.data, dtype=kind).reshape(height, width).astype(np.float32)


def depth_to_message(depth: NDArray[np.float32], time: float | Time, frame: str) -> Image:
    """Return the image message of a depth image (H, W) in m."""
    return _image(np.ascontiguousarray(depth, dtype="<f4"), DEPTH_ENCODING, time, frame)


def camera_info(
    intrinsics: Array, width: int, height: int, time: float | Time, frame: str
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
    parameters: InertialParameters, time: float | Time, frame: str
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
    message: Image, topic: str, encoding: str, height: int, width: int, item: int
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


def _image(values: NDArray[np.generic], encoding: str, time: float | Time, frame: str) -> Image:
    height, width = values.shape
    message = Image(header=header(time, frame), height=height, width=width, encoding=encoding)
    message.is_bigendian = 0
    message.step = width * values.itemsize
    message.data = array.array("B", values.tobytes())
    return message
