"""A sensor that /tf_static says is turned against the frame whose pose was recorded."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from tactile_dynamics_ros.core.rigid_body.rotation import quaternion_to_matrix
from tactile_dynamics_ros.recording.cleaning import ProblemLog
from tactile_dynamics_ros.recording.importers.guess.bag_links import (
    Mount,
    fitting_mount,
    mounts_of,
)
from tactile_dynamics_ros.recording.importers.guess.weight import Measured, Scene, Weighing
from tactile_dynamics_ros.recording.topics import PoseColumns, WrenchColumns


def pose_of_sensor(
    path: Path, sensor: str, pose: PoseColumns, wrench: WrenchColumns, log: ProblemLog
) -> PoseColumns:
    """Return the poses of a sensor, from those of a frame that carries it and bears no name.

    Which frame it is, the weight tells; where it does not, the sensor is taken to be in it.

    Args:
        path: of the recording.
        sensor: frame of the wrench.
        pose: as recorded.
        wrench: in axes of the sensor.
        log: where it is said.
    """
    mounts = mounts_of(path, sensor)
    if all(mount.is_none for mount in mounts):
        return pose
    position, quaternion = pose.position, pose.quaternion

    def weighed(mount: Mount) -> Weighing | None:
        place, named = mount.carried(position, quaternion)
        known = np.isfinite(named).all(axis=1) & np.isfinite(pose.time)
        turn = quaternion_to_matrix(named[known])
        time, at = pose.time[known], place[known]
        return Scene(Measured(wrench.force, wrench.time, turn, time, at)).weigh("sensor")

    mount = fitting_mount(mounts, weighed)
    if mount is None:
        frames = ", ".join(one.frame for one in mounts)
        log[f"{pose.label}: of one of {frames}, which are turned; taken as that of '{sensor}'"] += 1
        return pose
    if mount.is_none:
        return pose
    log[f"{pose.label}: of '{mount.frame}', on which '{sensor}' sits {mount.words}"] += 1
    place, named = mount.carried(position, quaternion)
    return replace(pose, position=place, quaternion=named)
