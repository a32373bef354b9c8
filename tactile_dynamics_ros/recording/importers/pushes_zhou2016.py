"""Slow pushes of a triangular block: its pose before and after, the pusher's path, the force."""

from __future__ import annotations

from argparse import ArgumentParser, Namespace
from pathlib import Path

import numpy as np

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.options import COUNT_OR_NONE
from tactile_dynamics_ros.core.planar.streams import LinkStream, PushContact, PushedStreams
from tactile_dynamics_ros.core.reading import open_arrays
from tactile_dynamics_ros.recording.importers.importer import Importer
from tactile_dynamics_ros.recording.pushed import PushedRecording

BLOCK = np.array([[0.0, 0.0], [0.15, 0.0], [0.0, 0.15]])
"""Corners in the frame that was tracked, m: legs of 150 mm at the right angle."""
_TURN = np.sqrt(0.5) * np.array([[1.0, 1.0], [1.0, -1.0]])
"""Axes of the force sensor in those of the tool."""
_UNLOADED = 30
"""First readings of each push, mostly before the tip touches: the median over all pushes of their
means is the sensor's offset. Five of 500 pushes begin in touch, and their own mean is up to 3 N."""


class PushesZhou2016Importer(Importer):
    """Poses are known before and after each push alone; each push is a session of its own.

    The path of the contact is that of the tip's centre, and its normal the direction of the push:
    where the tip touches was not measured.
    """

    name = "pushes-zhou2016"
    summary = "50 slow pushes of a block: poses before and after each, force and pusher's path"
    source_help = "one archive, such as pushes_zhou2016/hardboard_3pts_30_90.npz"

    def add_arguments(self, parser: ArgumentParser) -> None:
        """Add the choice of pushes."""
        parser.add_argument(
            "--pushes", type=COUNT_OR_NONE, nargs="+", metavar="N", help="from 0; default all"
        )

    def read(self, source: Path, options: Namespace) -> PushedRecording:
        """Read some pushes, or all.

        Raises:
            BadInputError: there is no such archive, or not that many pushes.
        """
        with open_arrays(source, "an archive of pushes") as archive:
            data = {name: np.asarray(archive[name], dtype=np.float64) for name in archive.files}
        count = len(data["pre"])
        chosen = options.pushes or list(range(count))
        if not all(0 <= k < count for k in chosen):
            raise BadInputError(f"{source}: --pushes from 0 to {count - 1}")
        return PushedRecording(_streams(data, chosen), str(source))


def _streams(data: dict[str, Array], chosen: list[int]) -> PushedStreams:
    offset = _sensor_offset(data)
    pushes = [_push(data, k, offset) for k in chosen]
    lengths = [max(force[-1, 0], path[-1, 0]) + 1.0 for force, path, _ in pushes]
    starts = np.concatenate([[0.0], np.cumsum(lengths)[:-1]])
    shifted = [
        (force + [start, 0, 0], path + [start, 0, 0, 0], ends + [start, 0, 0, 0])
        for (force, path, ends), start in zip(pushes, starts, strict=True)
    ]
    force, path, ends = (np.concatenate(parts) for parts in zip(*shifted, strict=True))
    yaw = np.unwrap(ends[:, 3])
    link = LinkStream(ends[:, 0], np.column_stack([ends[:, 1:3], yaw]), None, BLOCK)
    contact = PushContact(
        name="pusher",
        time=force[:, 0],
        force=np.pad(force[:, 1:], ((0, 0), (0, 1))),
        force_std=None,
        pose_time=path[:, 0],
        point=np.pad(path[:, 1:3], ((0, 0), (0, 1))),
        normal=np.stack([np.cos(path[:, 3]), np.sin(path[:, 3]), np.zeros(len(path))], axis=1),
    )
    return PushedStreams((link,), {"pusher": contact}, session_starts=tuple(map(float, starts)))


def _sensor_offset(data: dict[str, Array]) -> Array:
    """Return what the sensor reads under no load, (2,) N in its axes."""
    first = data["ft_offset"][:-1].astype(int)
    means = [data["ft"][row : row + _UNLOADED, 1:].mean(axis=0) for row in first]
    return np.asarray(np.median(means, axis=0))


def _push(data: dict[str, Array], k: int, offset: Array) -> tuple[Array, Array, Array]:
    """Return (N, 3) time and force, (M, 4) time, path and heading, (2, 4) time and pose."""
    raw = data["ft"][slice(*data["ft_offset"][k : k + 2].astype(int))]
    robot = data["rob"][slice(*data["rob_offset"][k : k + 2].astype(int))]
    robot = robot[np.concatenate([[True], np.diff(robot[:, 0]) > 0.0])]
    raw = raw[np.concatenate([[True], np.diff(raw[:, 0]) > 0.0])]
    sensed = raw[:, 1:] - offset
    tool = np.interp(raw[:, 0], robot[:, 0], np.unwrap(_yaw(robot[:, 4:])))
    c, s = np.cos(tool), np.sin(tool)
    turn = np.stack([np.stack([c, -s], axis=-1), np.stack([s, c], axis=-1)], axis=-2)
    force = -np.einsum("nij,jk,nk->ni", turn, _TURN, sensed)
    place = 1e-3 * robot[:, 1:3]
    way = place[-1] - place[0]
    heading = np.full(len(robot), np.arctan2(way[1], way[0]))
    times = [0.0, max(raw[-1, 0], robot[-1, 0])]
    poses = np.stack([data["pre"][k], data["post"][k]])
    ends = np.column_stack([times, 1e-3 * poses[:, :2], _yaw(poses[:, 3:])])
    return (
        np.column_stack([raw[:, 0], force]),
        np.column_stack([robot[:, 0], place, heading]),
        ends,
    )


def _yaw(quaternion: Array) -> Array:
    """Return the yaw (N,) of quaternions (N, 4) about the vertical, scalar first."""
    return np.asarray(2.0 * np.arctan2(quaternion[:, 3], quaternion[:, 0]))
