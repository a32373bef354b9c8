"""Pushes without ROS: simulated readings as streams of a pushed object, with the truth."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.planar.actions.straight import StraightAction, StraightConfig, Travel
from tactile_dynamics_ros.core.planar.actions.straight import straight_action as plan
from tactile_dynamics_ros.core.planar.streams import LinkStream, PushContact, PushedStreams
from tactile_dynamics_ros.core.rigid_body.rotation import log_so3
from tactile_dynamics_ros.sim.planar.simulated_table import (
    SimulatedTable,
    SimulatedTableConfig,
    TableReadings,
)
from tactile_dynamics_ros.sim.planar.table import Outline, outlines

COM_HEIGHT_STD = 0.003
"""Standard deviation stated for the height of a centre of mass, m: cameras see the height of a part
to 2 mm, and what is inside is seldom even."""


@dataclass(frozen=True)
class PushOptions:
    """How pushes are drawn.

    Attributes:
        count: of pushes; they go round the object.
        speed: (2,) m/s, drawn between these on a logarithmic scale.
        travel: (2,) m, each way along the object.
        gap: m from tip to object at the start.
        tilt_deg: largest angle of a push to the outline's normal.
        off_centre: share of a side along which pushes are off its middle at most.
        pull: grip and pull instead.
        height_share: height of the push over that of the lowest part.
    """

    count: int = 6
    speed: tuple[float, float] = (0.03, 0.2)
    travel: tuple[float, float] = (0.05, 0.09)
    gap: float = 0.002
    tilt_deg: float = 15.0
    off_centre: float = 0.6
    pull: bool = False
    height_share: float = 0.5


@dataclass
class SimulatedPushes:
    """Streams as an estimator gets them, and what it should find.

    Attributes:
        streams: measurements. truth: links, joint and hidden effect.
        faults: why the arm stopped, if it did.
    """

    streams: PushedStreams
    truth: dict[str, Any]
    faults: list[str] = field(default_factory=list)


def simulate_pushes(
    config: SimulatedTableConfig, options: PushOptions | None = None
) -> SimulatedPushes:
    """Push the first object of a simulated table about, without ROS.

    Args:
        config: of the table; its seed draws the pushes too. Images are not taken.
        options: of the pushes.
    """
    options = options or PushOptions()
    rate = config.vision_rate_hz or 100.0
    table = SimulatedTable(replace(config, vision_rate_hz=rate, depth_rate_hz=0.0))
    rng = np.random.default_rng([config.seed, 97])
    log = ReadingLog(table.outlines)
    faults = []
    try:
        for k in range(options.count):
            action = drawn_action(table, options, k, rng)
            table.pusher.place(action.legs[0].start, action.legs[0].width)
            for readings in perform(table, action):
                log.add(readings)
            faults += [table.pusher.fault] if table.pusher.fault else []
        return SimulatedPushes(log.streams(table), table.reveal(), faults)
    finally:
        table.world.close()


def perform(table: SimulatedTable, action: StraightAction) -> list[TableReadings]:
    """Let the arm carry out an action; return what the sensors read meanwhile."""
    found = []
    for k in range(int(action.duration / table.period) + 10):
        moment = action.at(k * table.period)
        table.pusher.go_to(moment.pose)
        table.pusher.open_to(moment.width)
        found.append(table.advance(looking=False))
    return found


def drawn_action(
    table: SimulatedTable, options: PushOptions, k: int, rng: np.random.Generator
) -> StraightAction:
    """Draw a push at a side of the object, from where the tip already is beside it."""
    outline = table.outlines[k % len(table.outlines)]
    others = [other for other in table.outlines if other is not outline]
    beside = [one for body in table.world.bodies[1:] for one in outlines(body)]
    speed = float(np.exp(rng.uniform(*np.log(options.speed))))
    height = options.height_share * min(each.part.height for each in table.outlines)
    config = StraightConfig(height=height, clearance=height, hold=0.15, acceleration=2.0)
    start, way = _beside(outline, others, beside, options, table.config.pusher.tip_radius, rng)
    end = start + rng.uniform(*options.travel) * way + options.gap * way
    now = np.array([*start, table.config.table_height + height, 0.0])
    travel = Travel(speed, config.acceleration)
    return plan(now, start, end, travel, config, table.config.table_height, options.pull)


def _beside(
    outline: Outline,
    others: Sequence[Outline],
    beside: Sequence[Outline],
    options: PushOptions,
    radius: float,
    rng: np.random.Generator,
) -> tuple[Array, Array]:
    """Draw a place (2,) beside the object that is free and the direction (2,) of the push."""
    pose = outline.pose()
    corners = outline.corners @ pose[:2, :2].T + pose[:2, 3]
    if options.pull:
        angle = np.arctan2(pose[1, 0], pose[0, 0])
        return pose[:2, 3], np.array([np.cos(angle), np.sin(angle)])
    edge = np.roll(corners, -1, axis=0) - corners
    lengths = np.linalg.norm(edge, axis=1)
    for _ in range(200):
        n = rng.choice(len(edge), p=lengths / lengths.sum())
        inward = np.array([-edge[n, 1], edge[n, 0]]) / lengths[n]
        share = 0.5 + 0.5 * options.off_centre * rng.uniform(-1.0, 1.0)
        tilt = np.deg2rad(options.tilt_deg) * rng.uniform(-1.0, 1.0)
        way = np.array([[np.cos(tilt), -np.sin(tilt)], [np.sin(tilt), np.cos(tilt)]]) @ inward
        start = corners[n] + share * edge[n] - (radius + options.gap) * inward
        if way @ (np.array([0.5, 0.0]) - start) < 0.0:
            continue  # it would push the object away from where the arm reaches
        if any(_distance(other, start) < 2.0 * radius for other in beside):
            continue
        if all(_gap(other, start) > 2.0 * radius for other in others):
            break
    return start, way


def _gap(outline: Outline, place: Array) -> float:
    """Return the distance of a place (2,) from the corners and middles of edges of a part."""
    pose = outline.pose()
    corners = outline.corners @ pose[:2, :2].T + pose[:2, 3]
    points = np.concatenate([corners, 0.5 * (corners + np.roll(corners, -1, axis=0))])
    return float(np.linalg.norm(points - place, axis=1).min())


def _distance(outline: Outline, place: Array) -> float:
    """Return the distance of a place (2,) from the edges of an object that lies beside."""
    pose = outline.pose()
    corners = outline.corners @ pose[:2, :2].T + pose[:2, 3]
    edge, arm = np.roll(corners, -1, axis=0) - corners, place - corners
    share = np.clip(np.sum(arm * edge, axis=1) / np.sum(edge * edge, axis=1), 0.0, 1.0)
    return float(np.linalg.norm(arm - share[:, None] * edge, axis=1).min())


class ReadingLog:
    """Collects readings of a table for `PushedStreams`.

    Args:
        outlines: of the parts that are tracked.
    """

    def __init__(self, outlines: Sequence[Outline]) -> None:
        self._outlines = tuple(outlines)
        self._links: list[list[tuple[float, Array]]] = [[] for _ in outlines]
        self._measured: dict[str, list[tuple[float, Array, Array]]] = {}

    def add(self, readings: TableReadings) -> None:
        """Add what was read at one time."""
        for rows, pose in zip(self._links, readings.links, strict=False):
            if pose is not None:
                yaw = float(log_so3(pose[:3, :3])[2])
                rows.append((readings.links_time, np.array([*pose[:2, 3], yaw])))
        for measured in readings.touch:
            if measured.touching:
                row = (measured.time, measured.force, measured.pose)
                self._measured.setdefault(measured.name, []).append(row)

    def streams(self, table: SimulatedTable) -> PushedStreams:
        """Return all that was added, relative to the table's top."""
        marker, touch = table.markers[0].covariance, table.sensors
        pose_std = np.sqrt([marker[3, 3], marker[4, 4], marker[2, 2]])
        links = tuple(
            _link(rows, pose_std, outline)
            for rows, outline in zip(self._links, self._outlines, strict=True)
        )
        height = np.array([0.0, 0.0, table.config.table_height])
        contacts = {}
        for name, rows in sorted(self._measured.items()):
            time = np.array([row[0] for row in rows])
            poses = np.stack([row[2] for row in rows])
            contacts[name] = PushContact(
                name=name,
                time=time,
                force=np.stack([row[1] for row in rows]),
                force_std=touch.force_std,
                pose_time=time,
                point=poses[:, :3, 3] - height,
                normal=poses[:, :3, 2],
                point_std=max(touch.config.point_noise, 1e-5),
            )
        com_height = tuple(0.5 * outline.part.height for outline in self._outlines)
        stated = (COM_HEIGHT_STD,) * len(links)
        return PushedStreams(links, contacts, com_height=com_height, com_height_std=stated)


def _link(rows: Sequence[tuple[float, Array]], std: Array, outline: Outline) -> LinkStream:
    """Return the stream of one part."""
    pose = np.stack([row[1] for row in rows])
    pose[:, 2] = np.unwrap(pose[:, 2])
    time = np.array([row[0] for row in rows])
    return LinkStream(time, pose, np.maximum(std, 1e-6), outline.corners)
