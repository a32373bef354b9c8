"""One object pushed over a table and followed: errors, honesty, occlusion, loss, time."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import product

import numpy as np

from benchmarks.following.script import PLACE, Moment, write_script
from benchmarks.following.stage import GRIPPER, LENS, Stage
from benchmarks.shape.camera import TableCamera, first_pose
from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.errors import TactileDynamicsError
from tactile_dynamics_ros.core.rigid_body.rotation import log_so3, pose_of
from tactile_dynamics_ros.core.shape.object_shape import MeshSurface, ObjectShape
from tactile_dynamics_ros.core.shape.superquadric.scene import read_scene
from tactile_dynamics_ros.core.shape.superquadric.views import looking_at
from tactile_dynamics_ros.core.tracking.depth_image import PinholeCamera
from tactile_dynamics_ros.core.tracking.links.link_tracker import Link
from tactile_dynamics_ros.core.tracking.links.table_tracker import TableTracker
from tactile_dynamics_ros.core.tracking.robot_volume import TreeVolume
from tactile_dynamics_ros.core.tracking.watch import Sighting, VisionTrackerConfig
from tactile_dynamics_ros.sim.objects import PlanarObject, PlanarPart, planar_object

Follower = Callable[[Array, PinholeCamera, float, Array], dict[str, Sighting]]

LOOKS = 3
"""Looks from which shapes are recovered."""
CAMERA_DISTANCE, CAMERA_SPEED = 0.6, 0.1
"""m; m/s, of every second object's camera, which circles to and fro."""
HALF_HIDDEN = 0.5
GRIPPER_URDF = """<robot name="gripper"><link name="world"/><link name="sledge"/>
<link name="slider"/><link name="lift"/><link name="tool"><collision><geometry>
<box size="{} {} {}"/></geometry></collision></link>
<joint name="x" type="prismatic"><parent link="world"/><child link="sledge"/><axis xyz="1 0 0"/>
<limit lower="-2" upper="2" effort="1" velocity="1"/></joint>
<joint name="y" type="prismatic"><parent link="sledge"/><child link="slider"/><axis xyz="0 1 0"/>
<limit lower="-2" upper="2" effort="1" velocity="1"/></joint>
<joint name="z" type="prismatic"><parent link="slider"/><child link="lift"/><axis xyz="0 0 1"/>
<limit lower="-2" upper="2" effort="1" velocity="1"/></joint>
<joint name="yaw" type="continuous"><parent link="lift"/><child link="tool"/><axis xyz="0 0 1"/>
<limit effort="1" velocity="1"/></joint></robot>""".format(*GRIPPER)
CONFIG = VisionTrackerConfig()
FOLDS = {"hexagon": 6, "box": 2, "ellipse": 2, "butterfly": 2, "cylinder": 36}
"""Turns in a circle that map an outline onto itself, as `sim.planar_objects` draws it."""


@dataclass
class Trial:
    """What came of one object.

    Attributes:
        number, kind: of the object. links: followed. moving: whether the camera moves.
        position, rotation, nees: by phase, lists of errors of all links, m, rad, -.
        told, images: by phase, poses told and links times images.
        freedom: of each link.
        hidden: share of the object hidden by the gripper in each image of the half.
        flagged: images after the removal in which a pose was still told.
        wrong: poses told that are off by more than 1 cm.
        found: images from the return of the object until every link is told again.
        seconds: processor time of each image without a search.
        longest: s, of any image.
    """

    number: int
    kind: str
    outlines: tuple[str, ...]
    moving: bool
    position: dict[str, list[float]] = field(default_factory=dict)
    rotation: dict[str, list[float]] = field(default_factory=dict)
    nees: dict[str, list[float]] = field(default_factory=dict)
    told: dict[str, int] = field(default_factory=dict)
    images: dict[str, int] = field(default_factory=dict)
    hidden: list[float] = field(default_factory=list)
    links: int = 0
    flagged: int = 0
    wrong: int = 0
    found: int | None = None
    seconds: list[float] = field(default_factory=list)
    longest: float = 0.0
    failure: str = ""


@dataclass(frozen=True)
class Followed:
    """A link, the part that it is on, and where it is on it.

    Attributes:
        link: as given to the tracker. part: index. offset: (4, 4) X_PL.
        turns: (4, 4) motions of the part that map its true outline onto itself.
        round: whether the true outline is a circle.
        symmetric: whether no camera sees its turn about the vertical.
    """

    link: Link
    part: int
    offset: Array
    turns: tuple[Array, ...] = (np.eye(4),)
    round: bool = False

    @property
    def symmetric(self) -> bool:
        """Whether no camera sees its turn about the vertical."""
        axes = self.link.shape.symmetry_axes
        return self.round or bool(len(axes) and np.abs(axes[:, 2]).max() > 0.5)


def run_trial(
    number: int, recovered: bool, seed: int, follow: Callable[[list[Link]], Follower] | None = None
) -> Trial:
    """Push an object through its script.

    Args:
        number: of the object.
        recovered: whether shapes are those that looks recover, or else the true meshes.
        seed: of script, noise and camera.
        follow: makes another follower from links; the tracker if None.
    """
    thing = planar_object(number)
    moments = write_script(thing, seed)
    outlines = tuple(part.outline for part in thing.parts)
    trial = Trial(number, thing.kind, outlines, number % 2 == 0)
    try:
        links = look(thing, moments[0], seed) if recovered else modelled(thing, moments[0])
    except TactileDynamicsError as error:
        trial.failure = str(error)
        return trial
    trial.links = len(links)
    if recovered and thing.kind == "jointed" and len(links) != 2:
        trial.failure = f"{len(links)} links recovered"
        return trial
    stage = Stage([part.solid() for part in thing.parts], seed * 1000 + number)
    make = follow or track
    try:
        perform(trial, stage, moments, links, make([each.link for each in links]))
    finally:
        stage.close()
    return trial


def track(links: list[Link]) -> Follower:
    """Return the tracker of links."""
    tracker = TableTracker(links, TreeVolume(GRIPPER_URDF), CONFIG)
    return lambda depth, camera, when, joints: tracker.update(depth, camera, when, joints)


def perform(
    trial: Trial, stage: Stage, moments: list[Moment], links: list[Followed], follow: Follower
) -> None:
    """Show the follower all images and keep what it says."""
    rng = np.random.default_rng([trial.number, 31])
    turn, height = rng.uniform(-np.pi, np.pi), rng.uniform(0.25, 0.45)
    aside, returned, gone = None, 0, 0
    for moment in moments:
        pose = camera_pose(turn, height, moment.time if trial.moving else 0.0)
        joints = away = np.array([0.5, 0.0, 2.0, 0.0])
        if moment.phase in ("open", "half"):
            joints = behind(moment, stage, pose)
        if moment.phase == "half":
            aside = shading(moment, stage, pose) if aside is None else aside
            joints = before(moment, pose, aside)
            trial.hidden.append(stage.hidden(pose, moment.parts, tool(joints)))
        joints = away if joints is None else joints
        stage.place(moment.parts if moment.phase != "gone" else (), tool(joints))
        depth = stage.measure(pose)
        camera = PinholeCamera(LENS.intrinsics, LENS.width, LENS.height, pose)
        began = time.process_time()
        told = follow(depth, camera, moment.time, joints)
        spent = time.process_time() - began
        trial.longest = max(trial.longest, spent)
        if moment.phase == "gone":
            gone += bool(told)
            continue
        if moment.phase == "back":
            returned += 1
            if trial.found is None and len(told) == len(links):
                trial.found = returned
        else:
            trial.seconds.append(spent)
        grade(trial, moment, links, told)
    trial.flagged = gone


def grade(trial: Trial, moment: Moment, links: list[Followed], told: dict[str, Sighting]) -> None:
    """Compare poses with the truth."""
    phase = moment.phase
    trial.images[phase] = trial.images.get(phase, 0) + len(links)
    trial.told[phase] = trial.told.get(phase, 0) + len(told)
    for each in links:
        seen = told.get(each.link.name)
        if seen is None:
            continue
        turned = alike(each, moment.parts[each.part], seen.pose)
        middle = each.link.shape.centre
        arm = (seen.pose - turned)[:3, :3] @ middle + (seen.pose - turned)[:3, 3]
        yaw = float(log_so3(seen.pose[:3, :3] @ turned[:3, :3].T)[2])
        shift = seen.pose[:3, 3] - turned[:3, 3]
        error = np.array([yaw, *shift[:2]])
        spread = seen.covariance[2:5, 2:5]
        if each.symmetric:
            error, spread = arm[:2], spread[1:, 1:]
        nees = float(error @ np.linalg.solve(spread, error) / len(error))
        trial.position.setdefault(phase, []).append(float(np.linalg.norm(arm[:2])))
        if not each.symmetric:
            trial.rotation.setdefault(phase, []).append(abs(yaw))
        trial.nees.setdefault(phase, []).append(nees)
        trial.wrong += bool(np.linalg.norm(arm[:2]) > 0.01)


def alike(each: Followed, part: Array, found: Array) -> Array:
    """Return the pose that looks as the truth does and is nearest to what was found."""
    shape = each.link.shape
    upright = [s for s in shape.symmetries if s[2, 2] > 0.99]
    poses = []
    for turn, own in product(each.turns, upright):
        pose = part @ turn @ each.offset
        pose[:3, 3] += pose[:3, :3] @ (shape.centre - own @ shape.centre)
        pose[:3, :3] = pose[:3, :3] @ own
        poses.append(pose)
    return max(poses, key=lambda pose: float(np.sum(found[:3, :3] * pose[:3, :3])))


def symmetry(part: PlanarPart) -> tuple[Array, ...]:
    """Return the motions (4, 4), object frame, that map the true outline of a part onto itself."""
    count = FOLDS.get(part.outline, 1)
    centre = np.array([*(0.5 * (part.corners.min(axis=0) + part.corners.max(axis=0))), 0.0])
    there = pose_of(centre, [0.0, 0.0, 0.0])
    turns = [pose_of(np.zeros(3), [0.0, 0.0, 2.0 * np.pi * k / count]) for k in range(count)]
    return tuple(there @ turn @ np.linalg.inv(there) for turn in turns)


def camera_pose(turn: float, height: float, when: float) -> Array:
    """Return X_WC on a circle about the table's middle."""
    swing = 0.3 * np.sin(CAMERA_SPEED / CAMERA_DISTANCE / 0.3 * when)
    reach = np.sqrt(CAMERA_DISTANCE**2 - height**2)
    across = reach * np.array([np.cos(turn + swing), np.sin(turn + swing)])
    target = np.array([*PLACE, 0.03])
    return looking_at(target + [*across, height], target)


def tool(joints: Array) -> Array:
    """Return the pose (4, 4) of the gripper at its joints."""
    return pose_of(joints[:3], [0.0, 0.0, joints[3]])


def behind(moment: Moment, stage: Stage, pose: Array) -> Array | None:
    """Return joints of the gripper that pushes from behind; None while nobody pushes."""
    if not np.any(moment.direction):
        return None
    direction = moment.direction / np.linalg.norm(moment.direction)
    reach = max(
        float(np.max(-(stage.corners[k] @ part[:2, :2].T + part[:2, 3]) @ direction))
        for k, part in enumerate(moment.parts)
    )
    centre = np.mean([middle(stage, moment, k) for k in range(len(moment.parts))], axis=0)
    along = -reach - 0.5 * GRIPPER[0]
    place = centre + (along - centre @ direction) * direction
    return np.array([*place, 0.02 + 0.5 * GRIPPER[2], np.arctan2(direction[1], direction[0])])


def middle(stage: Stage, moment: Moment, k: int) -> Array:
    """Return the middle (2,) of a part in the world."""
    part = moment.parts[k]
    return np.asarray(part[:2, :2] @ stage.corners[k].mean(axis=0) + part[:2, 3])


def before(moment: Moment, pose: Array, aside: float) -> Array:
    """Return joints of the gripper between camera and object, so far to the side, m."""
    centre = np.mean([part[:2, 3] for part in moment.parts], axis=0)
    away = pose[:2, 3] - centre
    away /= np.linalg.norm(away)
    place = centre + 0.11 * away + aside * np.array([-away[1], away[0]])
    return np.array([*place, 0.03 + 0.5 * GRIPPER[2], np.arctan2(away[1], away[0])])


def shading(moment: Moment, stage: Stage, pose: Array) -> float:
    """Return how far to the side the gripper hides half of the object, m."""
    places = np.linspace(-0.1, 0.1, 11)
    shares = [stage.hidden(pose, moment.parts, tool(before(moment, pose, p))) for p in places]
    return float(places[np.argmin(np.abs(np.array(shares) - HALF_HIDDEN))])


def modelled(thing: PlanarObject, moment: Moment) -> list[Followed]:
    """Return the parts with their true meshes; rigid parts are links of their own."""
    found = []
    for k, (part, pose) in enumerate(zip(thing.parts, moment.parts, strict=True)):
        solid = part.solid()
        offset = np.eye(4)
        offset[:3, 3] = solid.bounds.mean(axis=0)
        solid.apply_translation(-offset[:3, 3])
        start = pose @ offset
        shape = ObjectShape([MeshSurface(solid)], start[:3, :3])
        link = Link(f"link_{k + 1}", shape, start)
        found.append(Followed(link, k, offset))
    return found


def look(thing: PlanarObject, moment: Moment, seed: int) -> list[Followed]:
    """Return the links that looks recover."""
    solids = [
        part.solid().apply_transform(pose)
        for part, pose in zip(thing.parts, moment.parts, strict=True)
    ]
    rng = np.random.default_rng([seed, thing.number, 7])
    camera = TableCamera(solids, seed=seed * 1000 + thing.number)
    clouds: list[Array] = []
    pose = first_pose(np.array([*PLACE, 0.03]), rng)
    try:
        for _ in range(LOOKS):
            clouds.append(camera.look(pose))
            scene = read_scene(np.concatenate(clouds), 0.0)
            if scene.next_views[0] is None:
                break
            pose = scene.next_views[0].pose
    finally:
        camera.close()
    found = []
    centres = [np.asarray(solid.bounds.mean(axis=0))[:2] for solid in solids]
    parts = [part for each in scene.objects for part in each.parts]
    for k, part in enumerate(parts):
        shape = part.shape
        near = int(np.argmin([np.linalg.norm(shape.pose[:2, 3] - c) for c in centres]))
        link = Link.of_superquadric(f"link_{k + 1}", shape, part.std)
        offset = np.linalg.inv(moment.parts[near]) @ shape.pose
        if len(parts) == len(thing.parts):
            true = thing.parts[near]
            round_ = true.outline == "cylinder"
            found.append(Followed(link, near, offset, symmetry(true), round_))
        else:
            found.append(Followed(link, near, offset))
    return found


def images_per_second(trials: list[Trial]) -> float:
    """Return the images that one core takes per second."""
    return 1.0 / float(np.median([s for trial in trials for s in trial.seconds]))
