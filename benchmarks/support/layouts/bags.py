"""Recordings as drivers of robot arms publish: wrench in the sensor's frame, poses or /tf."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from rosbags.rosbag1 import Writer as Ros1Writer
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore
from scipy.spatial.transform import Rotation

from benchmarks.support.layouts.wrist_log import WristLog

EPOCH_NS = 1_717_000_000_000_000_000
"""Stamp of the first message, ns since 1970."""


class _Messages:
    """Makes messages of one ROS."""

    def __init__(self, store: Any) -> None:
        self.store = store

    def make(self, kind: str, **fields: Any) -> Any:
        """Return a message of geometry_msgs, or of another package with a slash in its name."""
        name = kind if "/" in kind else f"geometry_msgs/msg/{kind}"
        return self.store.types[name](**fields)

    def header(self, stamp_ns: int, frame: str, count: int) -> Any:
        """Return a header; that of ROS 1 counts."""
        time = self.make(
            "builtin_interfaces/msg/Time", sec=stamp_ns // 10**9, nanosec=stamp_ns % 10**9
        )
        kind = self.store.types["std_msgs/msg/Header"]
        counted = {"seq": count} if "seq" in kind.__dataclass_fields__ else {}
        return kind(stamp=time, frame_id=frame, **counted)

    def vector(self, values: np.ndarray, kind: str = "Vector3") -> Any:
        """Return a vector or a point."""
        return self.make(kind, **dict(zip("xyz", map(float, values), strict=True)))

    def quaternion(self, values: np.ndarray) -> Any:
        """Return a quaternion xyzw."""
        return self.make("Quaternion", **dict(zip("xyzw", map(float, values), strict=True)))

    def wrench(self, header: Any, force: np.ndarray, torque: np.ndarray) -> Any:
        """Return a stamped wrench."""
        inner = self.make("Wrench", force=self.vector(force), torque=self.vector(torque))
        return self.make("WrenchStamped", header=header, wrench=inner)

    def pose(self, header: Any, place: np.ndarray, named: np.ndarray) -> Any:
        """Return a stamped pose."""
        inner = self.make(
            "Pose", position=self.vector(place, "Point"), orientation=self.quaternion(named)
        )
        return self.make("PoseStamped", header=header, pose=inner)

    def transform(self, header: Any, child: str, place: np.ndarray, turn: Rotation) -> Any:
        """Return a stamped transform."""
        inner = self.make(
            "Transform", translation=self.vector(place), rotation=self.quaternion(turn.as_quat())
        )
        return self.make("TransformStamped", header=header, child_frame_id=child, transform=inner)


def panda_poses(log: WristLog, folder: Path) -> list[Path]:
    """Franka's pose and wrench: base `panda_link0`, wrench in `panda_K`."""
    messages = _Messages(get_typestore(Stores.ROS2_JAZZY))
    rows = []
    for k, stamp in enumerate(_stamps(log)):
        head = messages.header(stamp, "panda_link0", k)
        rows.append(
            ("/current_pose", stamp, messages.pose(head, log.position[k], log.quaternion[k]))
        )
        head = messages.header(stamp, "panda_K", k)
        wrench = messages.wrench(head, -log.force[k], -log.torque[k])
        rows.append(("/external_wrench", stamp, wrench))
    return [_write(folder / "panda", rows, messages.store)]


def ur_frames(log: WristLog, folder: Path) -> list[Path]:
    """Universal Robots' driver: frames on /tf, two that move, fixed ones between."""
    messages = _Messages(get_typestore(Stores.ROS2_JAZZY))
    half = Rotation.from_euler("z", 180.0, degrees=True)
    flange = Rotation.from_euler("xyz", [-90.0, -90.0, 0.0], degrees=True)
    elbow = Rotation.from_rotvec(0.4 * np.sin(log.time)[:, None] * [0.0, 1.0, 0.0])
    shoulder = np.array([0.0, 0.0, 0.16])
    rows: list[tuple[str, int, Any]] = []
    stamps = _stamps(log)
    fixed = [
        ("base_link", "base_link_inertia", np.zeros(3), half),
        ("wrist_3_link", "tool0", np.zeros(3), flange),
    ]
    parts = [
        messages.transform(messages.header(stamps[0], parent, 0), child, place, turn)
        for parent, child, place, turn in fixed
    ]
    rows.append(
        ("/tf_static", stamps[0], messages.make("tf2_msgs/msg/TFMessage", transforms=parts))
    )
    for k, stamp in enumerate(stamps):
        first = half.inv() * elbow[k]
        rest = (half * first).inv()
        place = rest.apply(log.position[k] - half.apply(shoulder))
        parts = [
            messages.transform(
                messages.header(stamp, "base_link_inertia", k), "upper_arm_link", shoulder, first
            ),
            messages.transform(
                messages.header(stamp, "upper_arm_link", k),
                "wrist_3_link",
                place,
                rest * log.rotation[k] * flange.inv(),
            ),
        ]
        rows.append(("/tf", stamp, messages.make("tf2_msgs/msg/TFMessage", transforms=parts)))
        head = messages.header(stamp + 1_000_000, "tool0", k)
        force, torque = log.force[k], log.torque[k]
        rows.append(("/ft/wrench", stamp + 1_000_000, messages.wrench(head, -force, -torque)))
    return [_write(folder / "ur", rows, messages.store)]


def kuka_ros1(log: WristLog, folder: Path) -> list[Path]:
    """iiwa_stack on ROS 1: a .bag with a pose in `iiwa_link_0` and a wrench of an ATI sensor."""
    messages = _Messages(get_typestore(Stores.ROS1_NOETIC))
    path = folder / "kuka.bag"
    with Ros1Writer(path) as writer:
        pose = writer.add_connection(
            "/iiwa/state/CartesianPose", "geometry_msgs/msg/PoseStamped", typestore=messages.store
        )
        wrench = writer.add_connection(
            "/ati/ft", "geometry_msgs/msg/WrenchStamped", typestore=messages.store
        )
        for k, stamp in enumerate(_stamps(log)):
            head = messages.header(stamp, "iiwa_link_0", k)
            message = messages.pose(head, log.position[k], log.quaternion[k])
            writer.write(pose, stamp, messages.store.serialize_ros1(message, pose.msgtype))
            head = messages.header(stamp, "ft_sensor", k)
            message = messages.wrench(head, -log.force[k], -log.torque[k])
            writer.write(wrench, stamp, messages.store.serialize_ros1(message, wrench.msgtype))
    return [path]


def _stamps(log: WristLog) -> list[int]:
    return [EPOCH_NS + round(1e9 * t) for t in log.time.tolist()]


def _write(directory: Path, rows: list[tuple[str, int, Any]], store: Any) -> Path:
    """Write messages to a rosbag2 directory."""
    with Writer(directory, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        connections: dict[str, Any] = {}
        for topic, stamp, message in rows:
            kind = message.__msgtype__
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, kind, typestore=store)
            writer.write(connections[topic], stamp, store.serialize_cdr(message, kind))
    return directory
