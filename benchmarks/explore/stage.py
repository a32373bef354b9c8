"""A simulated table on which a controller pushes without ROS; ways through the air take no work."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.planar.control.controller import Outcome, PushController
from tactile_dynamics_ros.core.planar.control.guard import Seen
from tactile_dynamics_ros.core.rigid_body.rotation import log_so3
from tactile_dynamics_ros.sim.planar.simulated_table import (
    SimulatedTable,
    SimulatedTableConfig,
    TableReadings,
)

Array = NDArray[np.float64]

LATENCY = 0.02
"""Delay of poses behind their stamp, s, as `robot_sim` has it by default."""
RATE = 30.0
"""Of the tracker, Hz: what depth cameras bring."""


class Stage:
    """A table, its clock with the time that skipped ways take, and what is seen of it.

    Args:
        config: of the table.

    Attributes:
        table: simulated. skipped: s that were not simulated.
    """

    def __init__(self, config: SimulatedTableConfig) -> None:
        self.table = SimulatedTable(replace(config, vision_rate_hz=RATE, depth_rate_hz=0.0))
        self.skipped = 0.0
        self._poses: list[tuple[float, Array]] = []
        self._force = 0.0
        while not self._poses:
            self._take(self.table.advance(looking=False))

    @property
    def footprint(self) -> Array:
        """Outline (V, 2) of the first part in its frame, m."""
        return self.table.outlines[0].corners

    def truth(self) -> Array:
        """True pose (3,) of the first part."""
        return planar(self.table.outlines[0].pose())

    def close(self) -> None:
        """Give the simulation's memory back."""
        self.table.world.close()

    def seen(self) -> Seen:
        """What the controller knows now."""
        now = self.table.world.time
        known = [entry for entry in self._poses if entry[0] <= now - LATENCY] or self._poses[:1]
        time, pose = known[-1]
        frame = self.table.pusher.frame.copy()
        return Seen(now + self.skipped, frame, pose, time + self.skipped, self._force)

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
        for link in readings.links[:1]:
            if link is not None:
                self._poses.append((readings.links_time, planar(link)))
        felt = [each for each in readings.touch if each.touching]
        self._force = max((float(np.linalg.norm(each.force)) for each in felt), default=0.0)


def planar(pose: Array) -> Array:
    """Return x, y and yaw (3,) of a pose (4, 4)."""
    return np.array([*pose[:2, 3], log_so3(pose[:3, :3])[2]])
