"""Pushes at 80 to 150 mm/s by an arm with a force sensor: a steel hexagon, two square blocks."""

from __future__ import annotations

from argparse import ArgumentParser, Namespace
from pathlib import Path

import numpy as np

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.planar.mechanics.linkage import turned
from tactile_dynamics_ros.core.planar.mechanics.outline import edge_normals, nearest_edge
from tactile_dynamics_ros.core.planar.streams import LinkStream, PushContact, PushedStreams
from tactile_dynamics_ros.core.reading import open_arrays, read_json
from tactile_dynamics_ros.recording.importers.importer import Importer
from tactile_dynamics_ros.recording.pushed import PushedRecording

TIP_RADIUS = 0.00475
"""Radius of the pusher, m, documented for the hexagon; assumed for the blocks, where twice as much
would make them 10 mm smaller."""
_TURN = np.radians(60.0) * np.arange(6)
HEXAGON = 0.0605 * np.stack([np.cos(_TURN), np.sin(_TURN)], axis=1)
"""Corners, m: documented circumradius, and corners on the x axis as touched edges show."""
BLOCKS = {
    "Al": np.array([[-0.0495, -0.0495], [0.0515, -0.0495], [0.0515, 0.0515], [-0.0495, 0.0515]]),
    "St": np.array([[-0.0424, -0.0424], [0.0412, -0.0424], [0.0412, 0.0412], [-0.0424, 0.0412]]),
}
"""Corners in the tracked frame, m; documented nowhere: where the tip is while it presses, less its
radius. Sides of the steel block that were never pushed are taken to be as far as the others."""
_TIP_IN_TRACKER = np.array([-0.3909, 0.0075])
"""Origin of the arm's frame in the tracker's, m; documented nowhere: with it the pressing tip keeps
its distance from the sides of both blocks to 1 mm in twelve pushes."""
_MOVES = 0.02
"""Speed from which the object moves, m/s; noise of resting poses is 5 mm/s."""
_UNLOADED = 30
"""First readings, before the tip touches: their median is the sensor's offset."""


class PushesMitImporter(Importer):
    """Poses and forces are dense; the contact lies where the tip is nearest to the outline."""

    name = "pushes-mit"
    summary = "pushes at 80 to 150 mm/s: hexagon (JSON) or square blocks (NPZ)"
    source_help = "hex_....json, or prelim_al_st_blocks.npz with --push"

    def add_arguments(self, parser: ArgumentParser) -> None:
        """Add the choice of a push of the blocks."""
        parser.add_argument("--push", metavar="NAME", help="Al_1 to Al_6 or St_1 to St_6")

    def read(self, source: Path, options: Namespace) -> PushedRecording:
        """Read one push.

        Raises:
            BadInputError: there is no such file, or no such push in it.
        """
        if source.suffix == ".json":
            return PushedRecording(
                _hexagon(read_json(source, "a push as JSON or NPZ")), str(source)
            )
        with open_arrays(source, "a push as JSON or NPZ") as archive:
            name = options.push
            if f"{name}_obj" not in archive.files:
                raise BadInputError(
                    f"{source}: --push {name}; expected Al_1 to Al_6 or St_1 to St_6"
                )
            parts = [np.asarray(archive[f"{name}_{k}"], np.float64) for k in ("obj", "tip", "ft")]
        return PushedRecording(_block(*parts, BLOCKS[name[:2]]), f"{source} {name}")


def _hexagon(data: dict[str, list[list[float]]]) -> PushedStreams:
    pose, tip, force = (
        np.array(data[name], dtype=np.float64) for name in ("object_pose", "tip_pose", "ft_wrench")
    )
    start = pose[0, 0]
    for table in (pose, tip, force):
        table[:, 0] -= start
    return _streams(pose[:, :4], tip[:, :3], -force[:, 1:3], force[:, 0], HEXAGON)


def _block(pose: Array, tip: Array, force: Array, outline: Array) -> PushedStreams:
    sensed = force[:, 1:] - np.median(force[:_UNLOADED, 1:], axis=0)
    place = np.column_stack([tip[:, 0], tip[:, 1:3] + _TIP_IN_TRACKER])
    turns = [_yaw(np.clip(pose[:, 6], -1.0, 1.0), way) for way in (0, 1)]
    readings = [
        _streams(np.column_stack([pose[:, :3], yaw]), place, -sensed[:, ::-1], force[:, 0], outline)
        for yaw in turns
    ]
    return min(readings, key=_distance_while_moving)


def _yaw(sine: Array, way: int) -> Array:
    """Return yaws of quaternions (N,) whose scalar was dropped: one of two continuous readings."""
    first = 2.0 * np.arcsin(sine)
    choices = np.stack([first, 2.0 * np.pi - first], axis=1)
    yaw = np.empty(len(sine))
    yaw[0] = choices[0, way]
    for k in range(1, len(sine)):
        away = choices[k] - yaw[k - 1]
        away -= 2.0 * np.pi * np.round(away / (2.0 * np.pi))
        yaw[k] = yaw[k - 1] + away[np.argmin(np.abs(away))]
    return yaw


def _distance_while_moving(streams: PushedStreams) -> float:
    """Return the median distance of the contact from the outline while the object moves, m."""
    link, contact = streams.links[0], streams.contacts["pusher"]
    speed = np.linalg.norm(np.gradient(link.pose[:, :2], link.time, axis=0), axis=1)
    moves = (speed > _MOVES) & (link.time < contact.pose_time[-1])
    pose = link.pose[moves]
    tip = np.stack(
        [np.interp(link.time[moves], contact.pose_time, part) for part in contact.point.T], axis=1
    )
    own = turned(tip[:, :2] - pose[:, :2], -pose[:, 2])
    depth, _ = nearest_edge(link.footprint, edge_normals(link.footprint), own)
    return float(np.median(np.abs(depth)))


def _streams(pose: Array, tip: Array, force: Array, time: Array, outline: Array) -> PushedStreams:
    """Return streams of (N, 4) stamped poses, (M, 3) stamped places of the tip, and forces."""
    pose, tip = _increasing(pose), _increasing(tip)
    yaw = np.unwrap(pose[:, 3])
    link = LinkStream(pose[:, 0], np.column_stack([pose[:, 1:3], yaw]), None, outline)
    at = np.stack([np.interp(tip[:, 0], link.time, part) for part in link.pose.T], axis=1)
    own = turned(tip[:, 1:] - at[:, :2], -at[:, 2])
    _, normal = nearest_edge(outline, edge_normals(outline), own)
    into = turned(normal, at[:, 2])
    kept = np.append(True, np.diff(time) > 0.0)
    contact = PushContact(
        name="pusher",
        time=time[kept],
        force=np.pad(force[kept], ((0, 0), (0, 1))),
        force_std=None,
        pose_time=tip[:, 0],
        point=np.pad(tip[:, 1:] + TIP_RADIUS * into, ((0, 0), (0, 1))),
        normal=np.pad(into, ((0, 0), (0, 1))),
    )
    return PushedStreams((link,), {"pusher": contact})


def _increasing(table: Array) -> Array:
    """Return the rows whose stamps, in the first column, are later than the one before."""
    latest = np.maximum.accumulate(table[:, 0])
    return table[np.append(True, table[1:, 0] > latest[:-1])]
