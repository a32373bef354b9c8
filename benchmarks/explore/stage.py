"""A simulated table on which a controller pushes without ROS; ways through the air take no work."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.planar.control.controller import Outcome, PushController
from tactile_dynamics_ros.core.planar.control.joint_watch import LOW, JointWatch, body_of_two
from tactile_dynamics_ros.core.planar.control.jointed import Hinge
from tactile_dynamics_ros.core.planar.control.performance import Seen
from tactile_dynamics_ros.core.planar.control.prediction import Pushable, PushedBody
from tactile_dynamics_ros.core.rigid_body.rotation import log_so3
from tactile_dynamics_ros.sim.planar.simulated_table import (
    SimulatedTable,
    SimulatedTableConfig,
    TableReadings,
)

LATENCY = 0.02
"""Delay of poses behind their stamp, s, as `robot_sim` has it by default."""
TIP_RADIUS, TIP_FRICTION = 0.006, 0.35
"""m, radius of the simulated tip, and the coefficient that controllers take, as by default."""
RATE = 30.0
"""Of the tracker, Hz: what depth cameras bring."""


class Stage:
    """A table, its clock with the time that skipped ways take, and what is seen of it.

    Args:
        config: of the table.
        joints: whether the joint of two parts is looked for.

    Attributes:
        table: simulated. skipped: s that were not simulated. watch: of two parts.
    """

    def __init__(self, config: SimulatedTableConfig, joints: bool = True) -> None:
        self.table = SimulatedTable(replace(config, vision_rate_hz=RATE, depth_rate_hz=0.0))
        self.skipped = 0.0
        self._poses: list[tuple[float, Array]] = []
        self._second: list[tuple[float, Array]] = []
        self.watch = JointWatch() if joints else _Jointless()
        self._parts = [
            PushedBody.from_footprint(outline.corners, None, TIP_RADIUS, TIP_FRICTION)
            for outline in self.table.outlines
        ]
        self._force = 0.0
        while not self._poses:
            self._take(self.table.advance(looking=False))

    def body(self, centre: Array | None) -> Pushable:
        """Return the object as it is known now; of two parts neither centre is.

        Args:
            centre: (2,) m, of mass of an object of one part; None: in the middle of its outline.
        """
        parts = self._parts
        if len(parts) == 1:
            return parts[0] if centre is None else replace(parts[0], com=centre)
        seen = [self._newest(poses)[1] for poses in (self._poses, self._second)]
        return body_of_two((parts[0], parts[1]), (seen[0], seen[1]), self.watch)

    def truth(self) -> Array:
        """True pose (3,) of the first part."""
        return planar(self.table.outlines[0].pose())

    def close(self) -> None:
        """Give the simulation's memory back."""
        self.table.world.close()

    def seen(self) -> Seen:
        """What the controller knows now."""
        now = self.table.world.time
        time, pose = self._newest(self._poses)
        frame = self.table.pusher.frame.copy()
        return Seen(now + self.skipped, frame, pose, time + self.skipped, self._force)

    def _newest(self, poses: list[tuple[float, Array]]) -> tuple[float, Array]:
        """Newest of some poses that has arrived by now."""
        late = self.table.world.time - LATENCY
        return ([entry for entry in poses[-9:] if entry[0] <= late] or poses[:1])[-1]

    def run(
        self,
        controller: PushController,
        note: Callable[[TableReadings], None] = lambda _: None,
    ) -> Outcome:
        """Let a controller push until it ends.

        Args:
            controller: that answers what is seen.
            note: gets all readings.
        """
        while controller.outcome is None:
            way = controller.skip_way()
            if way is not None:
                end, duration = way
                self.table.pusher.place(end)
                self.skipped += duration
                self._hold(0.1)
            if len(self.table.outlines) > 1 and controller.phase in ("look", "push"):
                controller.planner.body = self.body(None)
            target = controller.advance(self.seen())
            pose = np.eye(4)
            pose[:3, 3] = target[:3]
            self.table.pusher.go_to(pose)
            readings = self.table.advance(looking=False)
            note(readings)
            self._take(readings)
        return controller.outcome

    def _hold(self, duration: float) -> None:
        """Let time pass until poses are as new as they would be."""
        for _ in range(round(duration / self.table.period)):
            self._take(self.table.advance(looking=False))

    def _take(self, readings: TableReadings) -> None:
        for link, poses in zip(readings.links, (self._poses, self._second), strict=False):
            if link is not None:
                poses.append((readings.links_time, planar(link)))
        if self._second and readings.links:
            tip = self.table.pusher.frame
            low = tip[2] < self.table.config.table_height + LOW
            self.watch.add(self._poses[-1], self._second[-1], tip[:2].copy() if low else None)
        measured = [each for each in readings.touch if each.touching]
        self._force = max((float(np.linalg.norm(each.force)) for each in measured), default=0.0)


class _Jointless(JointWatch):
    """Tells that parts turn, and never about which place."""

    def hinge(self, first: Array, second: Array) -> Hinge | None:
        """Return None, whatever was seen."""
        return None


def planar(pose: Array) -> Array:
    """Return x, y and yaw (3,) of a pose (4, 4)."""
    return np.array([*pose[:2, 3], log_so3(pose[:3, :3])[2]])
