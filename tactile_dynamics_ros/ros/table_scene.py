"""What a node that pushes has to hear: tip, object, outline, contact, table, estimate."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping
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
from std_msgs.msg import Float64

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.configuration import check_ranges, parameter
from tactile_dynamics_ros.core.errors import BadInputError, NotIdentifiableError
from tactile_dynamics_ros.core.planar.actions.information import Belief
from tactile_dynamics_ros.core.planar.control.joint_watch import LOW, JointWatch, body_of_two
from tactile_dynamics_ros.core.planar.control.performance import Seen
from tactile_dynamics_ros.core.planar.control.plan import Bounds
from tactile_dynamics_ros.core.planar.control.prediction import Pushable, PushedBody
from tactile_dynamics_ros.core.planar.mechanics.linkage import in_frame, placed
from tactile_dynamics_ros.core.planar.mechanics.simulation import GRAVITY
from tactile_dynamics_ros.core.rigid_body.rotation import exp_so3
from tactile_dynamics_ros.ros.conversions import MessageError, pose_to_core, to_seconds
from tactile_dynamics_ros.ros.diagnostics import Statuses, to_number
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

WORLD = "world"
CONTACTS = ("pusher", "pad_left", "pad_right")
"""Whose forces stop a motion: of the tip and of both pads."""
_REMEMBERED = 50
"""Poses of the tip that are kept, half a second of 100 Hz: those of parts are 20 to 100 ms late."""
_NEAR = 0.03
"""s by which a pose of the tip may miss those of parts: beyond, a tip at 5 cm/s is 1.5 mm off, and
it is not known where it pushed."""
_ANSWERED = 4
"""Poses of the tip taken together of which each is answered: as many as come at 100 Hz within the
delay of an arm, 30 ms, and one. Where only the newest were, a motion would have holes where the
machine is busy, and jerk what it pushes; more would be answered too late, and the tip leap."""
AT_REST = Stamp(0, 0)
"""Stamp of the last target of a motion: executed at once, and a simulation waits for no other."""
OPEN = 0.004
"""Width of the jaws from which they are not closed to a single tip, m: twice what closed grippers
tell of themselves, half of the narrowest that is gripped."""
UPRIGHT = 0.97
"""Cosine of the tilt up to which an object stands, 14 deg: what falls over does so at more, and
trackers are wrong by a few degrees."""
SILENT = 0.2
"""Age of a force beyond which nothing is measured, s: twenty messages at 100 Hz."""


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
        node: that listens, to messages by their arrival.
        config: tip and room.
        answer: called with each pose of the tip, when all that came before it is known.

    Attributes:
        support: height of the table, m. properties: the newest estimate as numbers by name.
        undetermined: names of what it does not tell. error: of its fit over the noise; None
            without one. fits: how often it was made anew.
        fallen: whether the object no longer stands. stamp: of the tip's newest pose.
        width: m, of the jaws; 0 where nobody tells.
        watch: of a second part that turns against the first.
    """

    def __init__(self, node: Shell, config: TableSceneConfig, answer: Callable[[], None]) -> None:
        self._answer = answer
        self.config, self.support, self.fallen = config, 0.0, False
        self.properties: dict[str, float] = {}
        self.undetermined: list[str] = []
        self.error: float | None = None
        self.fits = 0
        self._fit: tuple[str | None, str | None] = (None, None)
        self.stamp = Stamp(0, 0)
        self._tip: Array | None = None
        self._object: tuple[float, Array] | None = None
        self._footprint: Array | None = None
        self.watch = JointWatch()
        self._tips: deque[tuple[float, Array]] = deque(maxlen=_REMEMBERED)
        self._parts: list[PushedBody] = []
        self._second: tuple[float, Array] | None = None
        self._second_outline: Array | None = None
        self._forces = dict.fromkeys(CONTACTS, (-np.inf, 0.0))
        self.width = 0.0
        node.listen(PoseStamped, PUSHER_POSE, self._on_tip, skim=_ANSWERED)
        node.listen(PoseWithCovarianceStamped, OBJECT_POSE, self._on_object)
        node.listen(PolygonStamped, link_topic("link_1", "footprint"), self._on_outline, LATCHED)
        pose, outline = (link_topic("link_2", kind) for kind in ("pose", "footprint"))
        node.listen(PoseWithCovarianceStamped, pose, self._on_second)
        node.listen(PolygonStamped, outline, self._on_second_outline, LATCHED)
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
        known = {"links": [link] if link else [], "undetermined": self.undetermined}
        return known if self.error is None else known | {"error": self.error}

    def belief(self, outline: Array, told: Mapping[str, float] | None = None) -> Belief:
        """What is known of product, mass and centre of mass; little if nobody tells.

        Args:
            outline: (V, 2) m, of the object.
            told: numbers by name; None: those of property_estimator.
        """
        unknown = Belief.unknown(outline)
        told = self.properties if told is None else told
        names = ("friction_force_n", "mass", "com_x", "com_y")
        values = np.array([told.get(name, np.nan) for name in names])
        stds = np.array([told.get(f"{name}_std", np.nan) for name in names])
        if not np.all(np.isfinite([values, stds])) or np.any(values[:2] <= 0.0):
            return unknown
        mean = np.array([np.log(values[0] / GRAVITY), np.log(values[1]), *values[2:]])
        std = np.array([*(stds[:2] / values[:2]), *stds[2:]])
        known = std < unknown.std
        mean, std = np.where(known, mean, unknown.mean), np.where(known, std, unknown.std)
        return Belief(mean, np.diag(np.square(np.maximum(std, 1e-4))))

    def body(self) -> Pushable:
        """Return the object as it is known.

        Raises:
            NotIdentifiableError: something is not published.
        """
        first = self.first_part()
        if self._second is None or self._object is None or len(self._parts) < 2:
            return replace(first, com=self.belief(first.outline).mean[2:])
        poses = self._object[1], self._second[1]
        return body_of_two((first, self._parts[1]), poses, self.watch)

    def first_part(self) -> PushedBody:
        """Return the first part as cameras tell it.

        Raises:
            NotIdentifiableError: something is not published.
        """
        self.seen()
        if self._footprint is None:
            raise NotIdentifiableError("no object/footprint yet: call /shape_estimator/start")
        if not self._parts:
            tip = self.config.tip_radius, self.config.tip_friction
            told = [each for each in (self._footprint, self._second_outline) if each is not None]
            self._parts = [PushedBody.from_footprint(each, None, *tip) for each in told]
        return self._parts[0]

    def second_outline(self) -> Array | None:
        """Return the outline (V, 2) of a second part in the object's frame, m; None without one."""
        if self._second is None or self._second_outline is None or self._object is None:
            return None
        return in_frame(placed(self._second_outline, self._second[1]), self._object[1])

    def of_second(self) -> tuple[Seen, Array, Array]:
        """Return what is seen if the second part is the object, its outline, and that of the first.

        Raises:
            NotIdentifiableError: there is no second part, or something is not published.
        """
        seen = self.seen()
        if self._second is None or self._second_outline is None or self._footprint is None:
            raise NotIdentifiableError("there is no second part")
        time, pose = self._second
        beside = in_frame(placed(self._footprint, seen.pose), pose)
        return replace(seen, pose=pose, pose_time=time), self._second_outline, beside

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
        sizes = [size for when, size in self._forces.values() if abs(now - when) < SILENT]
        return Seen(now, self._tip, pose, time, max(sizes, default=0.0))

    def _on_tip(self, message: Stamped) -> None:
        pose = pose_to_core(message, PUSHER_POSE, WORLD)
        self.stamp = message.stamp
        self._tip = np.array([*pose[:3, 3], np.arctan2(pose[1, 0], pose[0, 0])])
        self._tips.append((to_seconds(message.stamp), self._tip))
        self._answer()

    def _on_object(self, message: Stamped) -> None:
        pose = pose_to_core(message, OBJECT_POSE, WORLD)
        self.fallen = pose[2, 2] < UPRIGHT
        self._object = to_seconds(message.stamp), _flat(pose)
        self._compare()

    def _on_second(self, message: Stamped) -> None:
        pose = pose_to_core(message, link_topic("link_2", "pose"), WORLD)
        self._second = to_seconds(message.stamp), _flat(pose)
        self._compare()

    def _compare(self) -> None:
        """Note how the second part lies beside the first."""
        if self._object is None or self._second is None:
            return
        tip = self._tip_at(self._second[0])
        low = None if tip is None or tip[2] > self.support + LOW else tip[:2]
        self.watch.add(self._object, self._second, low)

    def _tip_at(self, time: float) -> Array | None:
        """Place (3,) of the tip at a time, m; None where no pose of it is near that time."""
        times = np.array([when for when, _ in self._tips])
        if len(times) == 0 or np.abs(times - time).min() > _NEAR:
            return None
        places = np.array([tip[:3] for _, tip in self._tips])
        return np.array([np.interp(time, times, places[:, k]) for k in range(3)])

    def _on_outline(self, message: PolygonStamped) -> None:
        self._footprint, self._parts = _corners(message), []

    def _on_second_outline(self, message: PolygonStamped) -> None:
        self._second_outline, self._parts = _corners(message), []

    def _on_support(self, message: Stamped) -> None:
        self.support = float(pose_to_core(message, SUPPORT_POSE, WORLD)[2, 3])

    def _on_force(self, name: str, message: Stamped) -> None:
        size = float(np.linalg.norm(message.values[:3]))
        self._forces[name] = to_seconds(message.stamp), size

    def _on_width(self, message: Float64) -> None:
        self.width = float(message.data)

    def _on_properties(self, message: DiagnosticArray) -> None:
        read = Statuses(message.status)
        solver, link = read.values("solver"), read.values("link_1")
        told = solver.get("fits"), solver.get("refused")
        error = to_number(solver.get("whitened_rms"))
        self.error = error if np.isfinite(error) else None
        if told[0] is not None and told != self._fit:
            self._fit, self.fits = told, self.fits + 1
        if "com_x" in link:
            self.properties = {key: to_number(text) for key, text in link.items()}
            self.undetermined = [*read.words("link_1", "undetermined")]


def tip_pose(frame: Array) -> Array:
    """Return the pose (4, 4) of an upright tip at x, y, z (m) and turn (rad)."""
    pose = np.eye(4)
    pose[:3, :3] = exp_so3(np.array([0.0, 0.0, frame[3]]))
    pose[:3, 3] = frame[:3]
    return pose


def _flat(pose: Array) -> Array:
    """x, y, yaw (3,) of a pose (4, 4)."""
    return np.array([*pose[:2, 3], np.arctan2(pose[1, 0], pose[0, 0])])


def _corners(message: PolygonStamped) -> Array:
    points = np.array([[p.x, p.y] for p in message.polygon.points]).reshape(-1, 2)
    if len(points) < 3 or not np.all(np.isfinite(points)):
        raise MessageError("bad_footprint", f"object/footprint: {len(points)} usable vertices")
    return points
