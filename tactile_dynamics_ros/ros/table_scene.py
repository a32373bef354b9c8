"""What a node that pushes has to hear: tip, object, outline, contact, table, estimate."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import (
    PolygonStamped,
    PoseStamped,
    PoseWithCovarianceStamped,
    WrenchStamped,
)
from numpy.typing import NDArray
from std_msgs.msg import Float64

from tactile_dynamics_ros.core.configuration import check_ranges, parameter
from tactile_dynamics_ros.core.errors import BadInputError, NotIdentifiableError
from tactile_dynamics_ros.core.planar.actions.information import Belief
from tactile_dynamics_ros.core.planar.control.guard import Seen
from tactile_dynamics_ros.core.planar.control.plan import Bounds
from tactile_dynamics_ros.core.planar.control.prediction import PushedBody
from tactile_dynamics_ros.core.planar.mechanics.simulation import GRAVITY
from tactile_dynamics_ros.core.rigid_body.rotation import exp_so3
from tactile_dynamics_ros.ros.conversions import MessageError, pose_to_core, to_seconds
from tactile_dynamics_ros.ros.diagnostics import status_values
from tactile_dynamics_ros.ros.names import (
    GRIPPER_WIDTH,
    OBJECT_POSE,
    PROPERTY_STATUS,
    PUSHER_POSE,
    SUPPORT_POSE,
    contact_topic,
    link_topic,
)
from tactile_dynamics_ros.ros.shell import LATCHED, Shell
from tactile_dynamics_ros.ros.wire import Stamp, Stamped

Array = NDArray[np.float64]

WORLD = "world"
CONTACTS = ("pusher", "pad_left", "pad_right")
"""Whose forces stop a motion: of the tip and of both pads."""
OPEN = 0.004
"""Width of the jaws from which they are not closed to a single tip, m: twice what closed grippers
tell of themselves, half of the narrowest that is gripped."""
UPRIGHT = 0.97
"""Cosine of the tilt up to which an object stands, 14 deg: what falls over does so at more, and
trackers are wrong by a few degrees."""
SILENT = 0.2
"""Age of a force beyond which nothing is felt, s: twenty messages at 100 Hz."""


@dataclass(frozen=True)
class TableSceneConfig:
    """Tip and room of an arm that pushes."""

    tip_radius: float = parameter(0.006, "of the tip", "m", 1e-3, 0.1)
    tip_friction: float = parameter(0.35, "between tip and objects", "", 0.01, 2.0)
    low: tuple[float, ...] = parameter((0.2, -0.45), "corner of where the tip may be, world", "m")
    high: tuple[float, ...] = parameter((0.85, 0.45), "opposite corner, world", "m")

    def __post_init__(self) -> None:
        check_ranges(self)
        if (
            len(self.low) != 2
            or len(self.high) != 2
            or np.any(np.subtract(self.high, self.low) <= 0)
        ):
            raise BadInputError(f"low {self.low}, high {self.high}: expected x, y each, low first")

    @property
    def bounds(self) -> Bounds:
        """Where the tip may be."""
        return Bounds(np.array(self.low), np.array(self.high))


class TableScene:
    """Keeps the newest of each, and calls back with each pose of the tip.

    Args:
        node: that listens.
        config: tip and room.

    Attributes:
        support: height of the table, m. properties: the newest estimate as numbers by name.
        undetermined: names of what it does not tell. fits: how often it was made anew.
        fallen: whether the object no longer stands. stamp: of the tip's newest pose.
        width: m, of the jaws; 0 where nobody tells.
    """

    def __init__(self, node: Shell, config: TableSceneConfig) -> None:
        self.config, self.support, self.fallen = config, 0.0, False
        self.properties: dict[str, float] = {}
        self.undetermined: list[str] = []
        self.fits = 0
        self._fit: tuple[str | None, str | None] = (None, None)
        self.stamp = Stamp(0, 0)
        self._tip: Array | None = None
        self._object: tuple[float, Array] | None = None
        self._footprint: Array | None = None
        self._forces = dict.fromkeys(CONTACTS, (-np.inf, 0.0))
        self.width = 0.0
        node.listen(PoseStamped, PUSHER_POSE, self._on_tip, skim=True)
        node.listen(PoseWithCovarianceStamped, OBJECT_POSE, self._on_object)
        node.listen(PolygonStamped, link_topic("link_1", "footprint"), self._on_outline, LATCHED)
        node.listen(PoseStamped, SUPPORT_POSE, self._on_support, LATCHED)
        for name in CONTACTS:
            take = partial(self._on_force, name)
            node.listen(WrenchStamped, contact_topic(name, "force"), take, skim=True)
        node.listen(Float64, GRIPPER_WIDTH, self._on_width, skim=True)
        node.listen(DiagnosticArray, PROPERTY_STATUS, self._on_properties, LATCHED)

    def properties_json(self) -> dict[str, object]:
        """The newest estimate as `tactile-dynamics estimate --json` tells it."""
        told = self.properties
        link: dict[str, Any] = {
            name: {"value": value, "std": told[f"{name}_std"]}
            for name, value in told.items()
            if f"{name}_std" in told
        }
        com = [link.pop(name) for name in ("com_x", "com_y") if name in link]
        if len(com) == 2:
            link["com"] = {key: [part[key] for part in com] for key in ("value", "std")}
        return {"links": [link] if link else [], "undetermined": self.undetermined}

    def belief(self, outline: Array) -> Belief:
        """What is known of product, mass and centre of mass; little if nobody tells.

        Args:
            outline: (V, 2) m, of the object.
        """
        unknown = Belief.unknown(outline)
        names = ("friction_force_n", "mass", "com_x", "com_y")
        values = np.array([self.properties.get(name, np.nan) for name in names])
        stds = np.array([self.properties.get(f"{name}_std", np.nan) for name in names])
        if not np.all(np.isfinite([values, stds])) or np.any(values[:2] <= 0.0):
            return unknown
        mean = np.array([np.log(values[0] / GRAVITY), np.log(values[1]), *values[2:]])
        std = np.array([*(stds[:2] / values[:2]), *stds[2:]])
        told = std < unknown.std
        mean, std = np.where(told, mean, unknown.mean), np.where(told, std, unknown.std)
        return Belief(mean, np.diag(np.square(np.maximum(std, 1e-4))))

    def body(self) -> PushedBody:
        """Return the object as it is known.

        Raises:
            NotIdentifiableError: something is not published.
        """
        self.seen()
        if self._footprint is None:
            raise NotIdentifiableError("no object/footprint yet: call /shape_estimator/start")
        config = self.config
        seen = PushedBody.from_footprint(
            self._footprint, None, config.tip_radius, config.tip_friction
        )
        return replace(seen, com=self.belief(seen.outline).mean[2:])

    def seen(self) -> Seen:
        """Return what is known now.

        Raises:
            NotIdentifiableError: something is not published.
        """
        if self._tip is None:
            raise NotIdentifiableError(f"no {PUSHER_POSE} yet: start the robot")
        if self._object is None:
            raise NotIdentifiableError(
                f"no {OBJECT_POSE} yet: call /shape_estimator/start, or start a tracker"
            )
        now = to_seconds(self.stamp)
        time, pose = self._object
        felt = [size for when, size in self._forces.values() if abs(now - when) < SILENT]
        return Seen(now, self._tip, pose, time, max(felt, default=0.0))

    def _on_tip(self, message: Stamped) -> None:
        pose = pose_to_core(message, PUSHER_POSE, WORLD)
        self.stamp = message.stamp
        self._tip = np.array([*pose[:3, 3], np.arctan2(pose[1, 0], pose[0, 0])])

    def _on_object(self, message: Stamped) -> None:
        pose = pose_to_core(message, OBJECT_POSE, WORLD)
        self.fallen = pose[2, 2] < UPRIGHT
        yaw = np.arctan2(pose[1, 0], pose[0, 0])
        self._object = to_seconds(message.stamp), np.array([*pose[:2, 3], yaw])

    def _on_outline(self, message: PolygonStamped) -> None:
        points = np.array([[p.x, p.y] for p in message.polygon.points]).reshape(-1, 2)
        if len(points) < 3 or not np.all(np.isfinite(points)):
            raise MessageError("bad_footprint", f"object/footprint: {len(points)} usable vertices")
        self._footprint = points

    def _on_support(self, message: Stamped) -> None:
        self.support = float(pose_to_core(message, SUPPORT_POSE, WORLD)[2, 3])

    def _on_force(self, name: str, message: Stamped) -> None:
        size = float(np.linalg.norm(message.values[:3]))
        self._forces[name] = to_seconds(message.stamp), size

    def _on_width(self, message: Float64) -> None:
        self.width = float(message.data)

    def _on_properties(self, message: DiagnosticArray) -> None:
        for status in message.status:
            values = status_values(status)
            told = values.get("fits"), values.get("refused")
            if told[0] is not None and told != self._fit:
                self._fit, self.fits = told, self.fits + 1
            if "com_x" in values:
                self.properties = {k: _number(v) for k, v in values.items()}
                self.undetermined = [*filter(None, values.get("undetermined", "").split(","))]


def tip_pose(frame: Array) -> Array:
    """Return the pose (4, 4) of an upright tip at x, y, z (m) and turn (rad)."""
    pose = np.eye(4)
    pose[:3, :3] = exp_so3(np.array([0.0, 0.0, frame[3]]))
    pose[:3, 3] = frame[:3]
    return pose


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        return float("nan")
