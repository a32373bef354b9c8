"""Links of `/object/shape` followed by a node: camera, robot and shapes as messages bring them."""

from __future__ import annotations

from collections import deque
from dataclasses import replace
from pathlib import Path

from diagnostic_msgs.msg import DiagnosticArray

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.reading import read_text
from tactile_dynamics_ros.core.rigid_body.rotation import exp_so3, log_so3
from tactile_dynamics_ros.core.tracking.links.link_tracker import Link
from tactile_dynamics_ros.core.tracking.links.table_tracker import TableTracker
from tactile_dynamics_ros.core.tracking.robot_volume import TreeVolume
from tactile_dynamics_ros.core.tracking.watch import VisionTrackerConfig
from tactile_dynamics_ros.ros.shape_messages import shape_from_message


class PoseHistory:
    """Poses of the last moments, read at any time in between.

    Args:
        length: number of poses kept.
    """

    def __init__(self, length: int = 100) -> None:
        self._samples: deque[tuple[float, Array]] = deque(maxlen=length)

    def __len__(self) -> int:
        return len(self._samples)

    def add(self, time: float, pose: Array) -> None:
        """Keep a pose (4, 4); one that is earlier than the last begins anew."""
        if self._samples and time <= self._samples[-1][0]:
            self._samples.clear()
        self._samples.append((time, pose))

    def at(self, time: float) -> Array | None:
        """Return the pose at a time, interpolated; None outside of what is kept."""
        for (begin, first), (end, then) in zip(
            self._samples, list(self._samples)[1:], strict=False
        ):
            if begin <= time <= end:
                share = (time - begin) / (end - begin)
                pose = first.copy()
                pose[:3, 3] += share * (then[:3, 3] - first[:3, 3])
                turn = log_so3(then[:3, :3] @ first[:3, :3].T)
                pose[:3, :3] = exp_so3(share * turn) @ first[:3, :3]
                return pose
        return None


def tracker_of(
    message: DiagnosticArray, volume: TreeVolume | None, config: VisionTrackerConfig
) -> TableTracker:
    """Return the tracker of the links of `/object/shape`; the table is where they stand.

    Raises:
        MessageError: the message is wrong.
    """
    told = shape_from_message(message)
    foot = min(float(link.shape.pose[2, 3] - link.shape.semi_axes[2]) for link in told)
    links = [Link.of_superquadric(link.name, link.shape, link.std) for link in told]
    return TableTracker(links, volume, replace(config, support_height=foot))


def load_volume(path: str, margin: float) -> TreeVolume | None:
    """Return the robot of a URDF file, None without a path.

    Raises:
        BadInputError: there is no such file, or it holds no robot.
    """
    if not path:
        return None
    urdf = read_text(path, "the URDF of parameter table_robot")
    return TreeVolume(urdf, str(Path(path).parent), margin=margin)
