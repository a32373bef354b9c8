"""Pushes of objects to a goal with two points at once: poses with drop-outs, no force."""

from __future__ import annotations

from argparse import ArgumentParser, Namespace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.options import COUNT_OR_NONE
from tactile_dynamics_ros.core.planar.mechanics.linkage import turned
from tactile_dynamics_ros.core.planar.streams import LinkStream, PushContact, PushedStreams
from tactile_dynamics_ros.core.reading import open_arrays
from tactile_dynamics_ros.recording.importers.importer import Importer
from tactile_dynamics_ros.recording.pushed import PushedRecording

_LOST = "poses lost by the tracker (stored as zeros), left out"
_LEAST_SIDE = 0.02
"""Side of the outline, m, where pushes from one side tell none."""


class GoalPushesZhou2017Importer(Importer):
    """Outlines are not documented: the rectangle around all places of the pusher stands for them.

    The pusher has two points, so that the object does not turn about it.
    """

    name = "goal-pushes-zhou2017"
    summary = "pushes of an object to a goal: poses with drop-outs and the pusher's path, no force"
    source_help = "goal_pushes_zhou2017/logs.npz"

    def add_arguments(self, parser: ArgumentParser) -> None:
        """Add the choice of a log."""
        parser.add_argument(
            "--log", type=COUNT_OR_NONE, default=0, metavar="N", help="from 0; default 0"
        )

    def read(self, source: Path, options: Namespace) -> PushedRecording:
        """Read one log.

        Raises:
            BadInputError: there is no such file, no such log, or no pose in it.
        """
        with open_arrays(source, "logs.npz") as archive:
            names, offset = archive["names"], archive["offset"].astype(int)
            if not 0 <= options.log < len(names):
                raise BadInputError(f"{source}: --log from 0 to {len(names) - 1}")
            rows = slice(*offset[options.log : options.log + 2])
            table = np.asarray(archive["data"][rows], dtype=np.float64)
        tracked = np.any(table[:, 1:3] != 0.0, axis=1)
        if not tracked.any():
            raise BadInputError(f"{source}: log {options.log} has no pose")
        lost = int((~tracked).sum())
        problems = {_LOST: lost} if lost else {}
        return PushedRecording(_streams(table, tracked), f"{source} {names[options.log]}", problems)


def _streams(table: Array, tracked: NDArray[np.bool_]) -> PushedStreams:
    seen = table[tracked]
    pose = np.column_stack([1e-3 * seen[:, 1:3], np.unwrap(seen[:, 3])])
    place = 1e-3 * table[:, 4:6]
    own = turned(place[tracked] - pose[:, :2], -pose[:, 2])
    low, high = np.minimum(own.min(axis=0), -_LEAST_SIDE), np.maximum(own.max(axis=0), _LEAST_SIDE)
    outline = np.array([low, [high[0], low[1]], high, [low[0], high[1]]])
    heading = table[:, 6]
    contact = PushContact(
        name="pusher",
        time=np.zeros(0),
        force=np.zeros((0, 3)),
        force_std=None,
        pose_time=table[:, 0],
        point=np.pad(place, ((0, 0), (0, 1))),
        normal=np.stack([np.cos(heading), np.sin(heading), np.zeros_like(heading)], axis=1),
    )
    return PushedStreams((LinkStream(seen[:, 0], pose, None, outline),), {"pusher": contact})
