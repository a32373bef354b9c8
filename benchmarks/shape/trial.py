"""One object looked at several times: chamfer distance, parts, intervals, time."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, TypeAlias

import numpy as np
import trimesh
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from benchmarks.shape.camera import TableCamera, first_pose
from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.errors import TactileDynamicsError
from tactile_dynamics_ros.core.shape.superquadric.scene import Scene, read_scene
from tactile_dynamics_ros.core.shape.superquadric.views import (
    View,
    ViewConfig,
    candidate_poses,
)
from tactile_dynamics_ros.sim.objects import PlanarObject, planar_object

Peers: TypeAlias = Callable[[Array, Array], dict[str, float]]

SAMPLES = 60_000
COMPARED = 3000
PLACE = np.array([0.5, 0.0, 0.0])
MOST_VIEWS = 8


@dataclass
class Trial:
    """What was found after each look.

    Attributes:
        number: of the object.
        kind, outline: family and outline of the first part.
        differ: whether a camera can see its parts.
        wanted: true number of parts.
        chamfer: m, after each look. parts: found after each look. entropy: after each look.
        stopped: looks after which another promised too little.
        axes_error: m, of the sorted half extents of a homogeneous object, after the last look.
        z: errors of half extents and pose over their std, after the last look.
        peers: chamfer distances, m, of others on the points of all looks.
        fit_s: s.
    """

    number: int
    kind: str
    outline: str
    differ: bool
    wanted: int
    chamfer: list[float] = field(default_factory=list)
    parts: list[int] = field(default_factory=list)
    entropy: list[float] = field(default_factory=list)
    stopped: int = MOST_VIEWS
    axes_error: list[float] = field(default_factory=list)
    z: list[float] = field(default_factory=list)
    fit_s: list[float] = field(default_factory=list)
    peers: dict[str, float] = field(default_factory=dict)
    failure: str = ""


def run_trial(
    number: int,
    strategy: str = "active",
    looks: int = MOST_VIEWS,
    peers: Peers | None = None,
    watch: Callable[[Array, Scene], None] | None = None,
) -> Trial:
    """Look at an object until it is known, or as often as asked for.

    Args:
        number: of the object.
        strategy: "active", "random" or "uniform".
        looks: at most; active stops by itself where another look promises too little.
        peers: gives chamfer distances of others from points and truth.
        watch: is called with all points (N, 3) and the scene after each look.
    """
    thing = planar_object(number)
    trial = Trial(number, thing.kind, thing.parts[0].outline, thing.parts_differ, len(thing.parts))
    rng = np.random.default_rng([77, number])
    turn = rng.uniform(0.0, 2.0 * np.pi)
    solids = placed(thing, turn)
    truth = outer_points(solids)
    camera = TableCamera(solids, seed=number)
    clouds: list[Array] = []
    pose = first_pose(PLACE + [0, 0, 0.03], rng)
    try:
        for k in range(looks):
            clouds.append(camera.look(pose))
            scene, seconds = timed(np.concatenate(clouds))
            trial.fit_s.append(seconds)
            if watch is not None:
                watch(np.concatenate(clouds), scene)
            shapes = [part.shape for found in scene.objects for part in found.parts]
            trial.chamfer.append(chamfer(shapes, truth))
            trial.parts.append(len(shapes))
            trial.entropy.append(scene.entropies[0].mean)
            view = scene.next_views[0]
            if view is None:
                trial.stopped = min(trial.stopped, k + 1)
                if strategy == "active":
                    break
            pose = next_pose(strategy, k, view, rng)
        grade(trial, thing, scene, turn)
        if peers is not None:
            trial.peers = peers(np.concatenate(clouds), truth)
    except TactileDynamicsError as error:
        trial.failure = str(error)
    finally:
        camera.close()
    return trial


def placed(thing: PlanarObject, turn: float) -> list[Any]:
    """Solids of an object in the world."""
    motion = trimesh.transformations.rotation_matrix(turn, [0, 0, 1])
    motion[:3, 3] = PLACE
    return [part.solid().apply_transform(motion) for part in thing.parts]


def timed(points: Array) -> tuple[Scene, float]:
    """The scene, and how long it took on this thread, s."""
    started = time.thread_time()
    scene = read_scene(points, 0.0)
    return scene, time.thread_time() - started


def next_pose(strategy: str, k: int, view: View | None, rng: np.random.Generator) -> Array:
    """Where a strategy looks from next."""
    poses = candidate_poses(PLACE + [0, 0, 0.03], ViewConfig())
    if strategy == "active" and view is not None:
        return view.pose
    if strategy == "uniform":
        order = np.linspace(0, len(poses) - 1, MOST_VIEWS).astype(int)
        return poses[order[k % MOST_VIEWS]]
    return poses[int(rng.integers(len(poses)))]


def outer_points(solids: list[Any]) -> Array:
    """Points spread evenly over the surfaces of solids, base and faces that touch included."""
    area = sum(solid.area for solid in solids)
    points = [
        trimesh.sample.sample_surface(solid, int(SAMPLES * solid.area / area), seed=0)[0]
        for solid in solids
    ]
    return np.concatenate([np.asarray(part) for part in points])


def chamfer(shapes: list[Any], truth: Array) -> float:
    """Mean of both mean distances between surfaces, m, unsquared.

    From the truth to the fitted surfaces it is exact, back it is that to the nearest of many
    points, which is a tenth of a millimetre too much.
    """
    few = truth[:: len(truth) // COMPARED]
    there = np.min([np.abs(shape.distance(few)) for shape in shapes], axis=0)
    area = sum(shape.area for shape in shapes)
    found = np.concatenate(
        [s.sample(max(int(COMPARED * s.area / area), 50), seed=1)[0] for s in shapes]
    )
    return float(0.5 * (there.mean() + cKDTree(truth).query(found)[0].mean()))


def grade(trial: Trial, thing: PlanarObject, scene: Scene, turn: float) -> None:
    """Errors of half extents and pose of a homogeneous box, ellipse or cylinder."""
    part = thing.parts[0]
    if thing.kind != "homogeneous" or len(scene.objects[0].parts) != 1:
        return
    found = scene.objects[0].parts[0]
    shape, std = found.shape, found.std
    true = np.array([*(0.5 * np.ptp(part.corners, axis=0)), 0.5 * part.height])
    if part.outline not in ("box", "ellipse", "cylinder"):
        extents = 0.5 * np.ptp(shape.to_body(shape.mesh().vertices), axis=0)
        trial.axes_error = np.abs(np.sort(extents) - np.sort(true)).tolist()
        return
    yaw = Rotation.from_matrix(shape.pose[:3, :3]).as_euler("xyz")[2]
    swapped = abs(np.sin(yaw - turn)) > np.sqrt(0.5)
    if part.outline == "cylinder":
        swapped = False
    order = [1, 0, 2] if swapped else [0, 1, 2]
    error = shape.semi_axes[order] - true
    names = np.array(["ax", "ay", "az"])[order]
    trial.axes_error = np.abs(error).tolist()
    trial.z = [float(e / std[name]) for e, name in zip(error, names, strict=True)]
    trial.z += [float((shape.pose[k, 3] - PLACE[k]) / std[n]) for k, n in enumerate("xy")]
    if part.outline == "box":
        off = yaw - turn - (0.5 * np.pi if swapped else 0.0)
        trial.z.append(float(((off + 0.5 * np.pi) % np.pi - 0.5 * np.pi) / std["yaw"]))
