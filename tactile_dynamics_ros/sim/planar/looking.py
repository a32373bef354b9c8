"""What a depth camera that is carried about, and a tracker, make of an object in motion.

The motion comes from anywhere, such as a recording without a camera; here it is only drawn.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pybullet
from numpy.typing import NDArray

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.planar.network.noise import CROP, depth_crop
from tactile_dynamics_ros.core.planar.network.noise_features import Looked
from tactile_dynamics_ros.core.rigid_body.rotation import (
    exp_so3,
    log_so3,
    matrix_to_quaternion,
    pose_of,
)
from tactile_dynamics_ros.core.shape.object_shape import MeshSurface, ObjectShape
from tactile_dynamics_ros.core.tracking.depth_image import PinholeCamera
from tactile_dynamics_ros.core.tracking.links.link_tracker import Link
from tactile_dynamics_ros.core.tracking.links.table_tracker import TableTracker
from tactile_dynamics_ros.core.tracking.watch import Sighting, VisionTrackerConfig
from tactile_dynamics_ros.sim.objects import prism
from tactile_dynamics_ros.sim.sensors.depth_camera import DepthCamera, DepthCameraConfig, look_at

TURN_RATE = 1.0
"""Largest rate at which the camera turns, rad/s: as arms turn a wrist. Half of it doubles the time
of moves that only turn."""


class Carriage:
    """Moves straight to its target and turns evenly on the way.

    Args:
        pose: (4, 4) at the start.
        speed: m/s.

    Attributes:
        pose: (4, 4) now.
    """

    def __init__(self, pose: Array, speed: float) -> None:
        self.pose, self._target, self._speed = pose.copy(), pose.copy(), speed

    def go_to(self, target: Array) -> None:
        """Set where to be, (4, 4)."""
        self._target = target.copy()

    def advance(self, duration: float) -> None:
        """Move for so many seconds."""
        way = self._target[:3, 3] - self.pose[:3, 3]
        turn = log_so3(self.pose[:3, :3].T @ self._target[:3, :3])
        needed = max(np.linalg.norm(way) / self._speed, np.linalg.norm(turn) / TURN_RATE)
        if needed <= duration:
            self.pose = self._target.copy()
            return
        share = duration / needed
        self.pose[:3, 3] += share * way
        self.pose[:3, :3] = self.pose[:3, :3] @ exp_so3(share * turn)


Image = NDArray[np.float32]

_DISTANCE, _HEIGHT = 0.75, (0.35, 0.6)
"""m from the camera to the middle of the motion, and its height above the table: what passes stays
beyond the 45 cm from which a structured-light camera sees anything."""
_PASSING = np.array([0.04, 0.04, 0.2])
"""Half edges of what passes, m: a forearm. It hides most of an object of 10 cm, not the table."""
_BEFORE = 0.22
"""m by which it is nearer to the camera than the object: farther than the object's own radius, so
that no tracker takes it for a part of it."""
_SWING, _PERIOD = 0.12, (3.0, 6.0)
"""m to each side and s of its way to and fro: free at the ends, hidden in the middle. Farther, and
objects are hidden for too short a time to matter."""
_SHAPE_STD = 5e-4
"""m by which half extents of a shape that a camera recovers are off, in the mean. At none the
tracker would be better than on any object whose shape it had to see first."""
_FAR = np.array([0.0, 0.0, -5.0])
"""Place of bodies that are out of sight, m: below the table."""


@dataclass(frozen=True)
class Look:
    """One image, and what the tracker told of it.

    Attributes:
        time: s. depth: (H, W) m. camera: that took it.
        seen: None where nothing was reported. shape: of the object, as the tracker knows it.
    """

    time: float
    depth: Image
    camera: PinholeCamera
    seen: Sighting | None
    shape: ObjectShape


class _Stage:
    """Table, object and what passes, drawn by Bullet."""

    def __init__(self, corners: Array, height: float) -> None:
        self.client = pybullet.connect(pybullet.DIRECT)
        solid = prism(corners, height)
        shape = pybullet.createVisualShape(
            pybullet.GEOM_MESH,
            vertices=solid.vertices.tolist(),
            indices=solid.faces.ravel().tolist(),
            physicsClientId=self.client,
        )
        self.thing = self._body(shape)
        self.passing = self._box(_PASSING)
        self.put(self._box(np.array([1.5, 1.5, 0.05])), pose_of([0.0, 0.0, -0.05], [0, 0, 0]))

    def _box(self, half: Array) -> int:
        shape = pybullet.createVisualShape(
            pybullet.GEOM_BOX, halfExtents=half.tolist(), physicsClientId=self.client
        )
        return self._body(shape)

    def _body(self, shape: int) -> int:
        return int(
            pybullet.createMultiBody(0, -1, shape, _FAR.tolist(), physicsClientId=self.client)
        )

    def put(self, body: int, pose: Array) -> None:
        pybullet.resetBasePositionAndOrientation(
            body,
            pose[:3, 3].tolist(),
            matrix_to_quaternion(pose[:3, :3]).tolist(),
            physicsClientId=self.client,
        )


def looked_at(
    corners: Array, height: float, times: Array, frames: Array, seed: int, passing: bool = True
) -> list[Look]:
    """Draw, degrade and track images of one object, from a camera that stands still.

    Args:
        corners: (V, 2) m of the outline, link frame.
        height: m.
        times: (K,) s, of the images.
        frames: (K, 3) x, y (m) and yaw (rad) of the link then.
        seed: of camera, noise, shape and what passes.
        passing: whether something passes before the object.
    """
    rng = np.random.default_rng([seed, 83])
    middle = np.append(0.5 * (frames[:, :2].min(axis=0) + frames[:, :2].max(axis=0)), 0.02)
    turn, up = rng.uniform(-np.pi, np.pi), rng.uniform(*_HEIGHT)
    level = np.array([np.cos(turn), np.sin(turn)])
    eye = middle + np.append(np.sqrt(_DISTANCE**2 - up**2) * level, up)
    phase, period = rng.uniform(0.0, 2.0 * np.pi), rng.uniform(*_PERIOD)
    lens = DepthCamera(DepthCameraConfig(), seed)
    pose, config = look_at(eye, middle), lens.config
    link = _link(corners, height, frames[0], rng)
    tracker = TableTracker([link], None, VisionTrackerConfig())
    camera = PinholeCamera(config.intrinsics, config.width, config.height, pose)
    stage, looks = _Stage(corners, height), []
    try:
        for time, frame in zip(times.tolist(), frames, strict=True):
            stage.put(stage.thing, _standing(frame))
            if passing:
                aside = _SWING * np.sin(2.0 * np.pi * time / period + phase)
                to_eye = eye - np.append(frame[:2], 0.0)
                place = np.append(frame[:2], 0.0) + _BEFORE * to_eye / np.linalg.norm(to_eye)
                place[:2] += aside * np.array([-level[1], level[0]])
                stage.put(stage.passing, pose_of(place, [0.0, 0.0, turn]))
            depth = lens.measure(stage.client, pose)
            seen = tracker.update(depth, camera, time).get(link.name)
            looks.append(Look(time, depth, camera, seen, link.shape))
    finally:
        pybullet.disconnect(stage.client)
    return looks


@dataclass(frozen=True, eq=False)
class Told:
    """The N images of which a pose was reported.

    Attributes:
        rows: (N,) which images. poses: (N, 3) x, y (m) and yaw (rad), near the true turn.
        looked: what is known of them. crops: (N, CROP, CROP) of depth.
    """

    rows: NDArray[np.intp]
    poses: Array
    looked: Looked
    crops: Array


def told_of(looks: Sequence[Look], yaw: Array) -> Told:
    """Return what was reported of images.

    Args:
        looks: all images.
        yaw: (K,) rad, near which turns are taken: they come without whole ones.
    """
    rows = np.array([k for k, look in enumerate(looks) if look.seen is not None], dtype=int)
    seen = [(looks[k], looks[k].seen) for k in rows]
    sights = [sight for _, sight in seen if sight is not None]
    pose = np.array([sight.pose for sight in sights]).reshape(-1, 4, 4)
    turn = np.arctan2(pose[:, 1, 0], pose[:, 0, 0]) - yaw[rows]
    near = yaw[rows] + (turn + np.pi) % (2.0 * np.pi) - np.pi
    std = [np.sqrt(np.diag(sight.covariance)[[3, 4, 2]]) for sight in sights]
    columns = [
        np.array([getattr(sight, name) for sight in sights], dtype=float)
        for name in ("visible", "score", "points", "misfit")
    ]
    crops = np.array(
        [_crop(look, sight.pose) for (look, _), sight in zip(seen, sights, strict=True)]
    )
    looked = Looked(*columns, np.array(std).reshape(-1, 3))
    poses = np.column_stack([pose[:, :2, 3], near])
    return Told(rows, poses, looked, crops.reshape(-1, CROP, CROP))


def _crop(look: Look, pose: Array) -> NDArray[np.float32]:
    """Depth around the object where it was told to be."""
    camera = look.camera
    to_camera = np.linalg.inv(camera.pose) @ pose
    centre = to_camera[:3, :3] @ look.shape.centre + to_camera[:3, 3]
    crop = depth_crop(look.depth, camera.intrinsics, centre, look.shape.radius)
    return crop.astype(np.float32)


def _standing(frame: Array) -> Array:
    return pose_of([frame[0], frame[1], 0.0], [0.0, 0.0, frame[2]])


def _link(corners: Array, height: float, frame: Array, rng: np.random.Generator) -> Link:
    """The object as a camera knows it: an outline that is not quite right, where it is at first."""
    half = np.abs(corners).max(axis=0)
    off = _SHAPE_STD * rng.standard_normal(2)
    solid = prism(corners * (1.0 + off / half), height)
    start = _standing(frame)
    shape = ObjectShape([MeshSurface(solid)], start[:3, :3])
    return Link("link_1", shape, start, np.array([_SHAPE_STD, _SHAPE_STD, 0.0]))
