"""Objects, table and robot as Bullet bodies, and the contact forces on the object."""

from __future__ import annotations

import math
import tempfile
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Self

import numpy as np
import pybullet

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.rigid_body.rotation import (
    cross,
    inverse_pose,
    matrix_to_quaternion,
    quaternion_to_matrix,
)
from tactile_dynamics_ros.core.robot.robot import Robot
from tactile_dynamics_ros.share import find_package_file
from tactile_dynamics_ros.sim.objects import ObjectModel, Shape


class Engine:
    """A Bullet engine without graphics; a context manager, or call `close`.

    Attributes:
        client: Bullet client, negative once it is closed.
    """

    def __init__(self) -> None:
        self.client: int = pybullet.connect(pybullet.DIRECT)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def close(self) -> None:
        """Free the engine; the world cannot be used afterwards."""
        if self.client >= 0:
            pybullet.disconnect(self.client)
            self.client = -1


def bullet_urdf(robot: Robot, meshes: bool = False) -> str:
    """Return the text of a robot's URDF with the paths of its meshes.

    Args:
        robot: arm and hand.
        meshes: draw links that are drawn as meshes (cameras see them); what collides always does.

    Raises:
        BadInputError: there is no file of a mesh.
    """
    root = ElementTree.fromstring(robot.urdf)
    for link in root.iter("link"):
        for visual in [each for each in link.findall("visual") if each.find(".//mesh") is not None]:
            if not meshes:
                link.remove(visual)
    for mesh in root.iter("mesh"):
        path = find_package_file(mesh.attrib["filename"], Path(robot.folder))
        if path is None:
            raise BadInputError(f"{robot.name}: no file of mesh {mesh.attrib['filename']}")
        mesh.attrib["filename"] = str(path)
    return ElementTree.tostring(root, encoding="unicode")


TABLE_HALF_SIZE = (0.4, 0.6, 0.02)
TABLE_CENTRE = (0.6, 0.0)
DRAWN_SECTIONS = 72
SHAPE_COLOUR = (0.8, 0.55, 0.25, 1.0)


@dataclass(frozen=True)
class ObjectBody:
    """A Bullet body that carries exactly the inertia of an object model.

    Bullet wants the principal axes: its body frame C sits in the centre of mass, turned so that
    the inertia is diagonal. ``com_pose`` X_OC converts between it and the object frame O.
    """

    client: int
    body: int
    com_pose: Array

    def pose(self) -> Array:
        """Return X_WO (4, 4)."""
        position, quaternion = pybullet.getBasePositionAndOrientation(self.body, self.client)
        return to_matrix(position, quaternion) @ inverse_pose(self.com_pose)

    def set_pose(self, pose: Array) -> None:
        """Place the object at rest at X_WO (4, 4)."""
        position, quaternion = from_matrix(pose @ self.com_pose)
        pybullet.resetBasePositionAndOrientation(self.body, position, quaternion, self.client)
        zero = (0.0, 0.0, 0.0)
        pybullet.resetBaseVelocity(self.body, zero, zero, self.client)

    def velocity(self) -> tuple[Array, Array]:
        """Return (angular velocity, velocity of the body origin), each (3,), world axes."""
        linear, angular = (np.array(v) for v in pybullet.getBaseVelocity(self.body, self.client))
        position, _ = pybullet.getBasePositionAndOrientation(self.body, self.client)
        arm = self.pose()[:3, 3] - np.array(position)
        return angular, linear + cross(angular, arm)

    def set_velocity(self, angular: Array, linear: Array) -> None:
        """Set angular velocity and velocity of the body origin, world axes."""
        position, _ = pybullet.getBasePositionAndOrientation(self.body, self.client)
        arm = np.array(position) - self.pose()[:3, 3]
        at_com = linear + cross(angular, arm)
        pybullet.resetBaseVelocity(self.body, at_com.tolist(), list(angular), self.client)


def to_matrix(position: tuple[float, ...], quaternion: tuple[float, ...]) -> Array:
    """Return the pose (4, 4) of a Bullet position and quaternion (xyzw)."""
    pose = np.eye(4)
    pose[:3, :3] = quaternion_to_matrix(np.asarray(quaternion))
    pose[:3, 3] = position
    return pose


def from_matrix(pose: Array) -> tuple[list[float], list[float]]:
    """Return Bullet's position and quaternion (xyzw) of a pose (4, 4)."""
    return pose[:3, 3].tolist(), matrix_to_quaternion(pose[:3, :3]).tolist()


def principal_frame(com: Array, inertia_com: Array) -> tuple[Array, Array]:
    """Return the principal moments (3,) and the pose X_OC (4, 4) of the principal frame."""
    moments, axes = np.linalg.eigh(inertia_com)
    if np.linalg.det(axes) < 0:
        axes[:, 2] = -axes[:, 2]
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = axes, com
    return moments, pose


def spawn_object(client: int, model: ObjectModel, pose: Array) -> ObjectBody:
    """Create the object at X_WO (4, 4), at rest."""
    moments, com_pose = principal_frame(model.inertia.com, model.inertia.inertia_com)
    in_com = [inverse_pose(com_pose) @ shape.pose for shape in model.shapes]
    position, quaternion = from_matrix(pose @ com_pose)
    body = pybullet.createMultiBody(
        baseMass=model.inertia.mass,
        baseCollisionShapeIndex=_compound(client, model.shapes, in_com, visual=False),
        baseVisualShapeIndex=_compound(client, model.shapes, in_com, visual=True),
        basePosition=position,
        baseOrientation=quaternion,
        physicsClientId=client,
    )
    pybullet.changeDynamics(
        body,
        -1,
        mass=model.inertia.mass,
        localInertiaDiagonal=moments.tolist(),
        lateralFriction=model.friction,
        linearDamping=0.0,
        angularDamping=0.0,
        rollingFriction=0.0,
        spinningFriction=0.0,
        restitution=0.0,
        activationState=pybullet.ACTIVATION_STATE_DISABLE_SLEEPING,
        physicsClientId=client,
    )
    return ObjectBody(client, body, com_pose)


def _compound(client: int, shapes: tuple[Shape, ...], poses: list[Array], visual: bool) -> int:
    positions, quaternions = zip(*(from_matrix(pose) for pose in poses), strict=True)
    prefix = "visual" if visual else "collision"
    arguments = {
        "halfExtents": [(shape.size / 2).tolist() for shape in shapes],
        "radii": [float(shape.size[0]) for shape in shapes],
        "lengths": [float(shape.size[2]) for shape in shapes],
        f"{prefix}FramePositions": list(positions),
        f"{prefix}FrameOrientations": list(quaternions),
        "physicsClientId": client,
    }
    if not visual:
        kinds = {"box": pybullet.GEOM_BOX, "cylinder": pybullet.GEOM_CYLINDER}
        types = [kinds[shape.kind] for shape in shapes]
        return int(pybullet.createCollisionShapeArray(shapeTypes=types, **arguments))
    kinds = {"box": pybullet.GEOM_BOX, "cylinder": pybullet.GEOM_MESH}
    arguments["shapeTypes"] = [kinds[shape.kind] for shape in shapes]
    arguments["rgbaColors"] = [SHAPE_COLOUR] * len(shapes)
    with tempfile.TemporaryDirectory() as folder:
        arguments["fileNames"] = [
            _write_cylinder(Path(folder) / f"{k}.obj", shape) if shape.kind == "cylinder" else ""
            for k, shape in enumerate(shapes)
        ]
        return int(pybullet.createVisualShapeArray(**arguments))


def _write_cylinder(path: Path, shape: Shape) -> str:
    """Write a finely faceted cylinder; Bullet's own is drawn a millimetre too large.

    The facets' mean distance from the axis is the radius.
    """
    angle = 2.0 * np.pi / DRAWN_SECTIONS * np.arange(DRAWN_SECTIONS)
    reach = shape.size[0] * (1.0 + (np.pi / DRAWN_SECTIONS) ** 2 / 6.0)
    half = 0.5 * shape.size[2]
    ring = reach * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    corners = [[*point, side] for side in (-half, half) for point in ring]
    corners += [[0.0, 0.0, -half], [0.0, 0.0, half]]
    n = DRAWN_SECTIONS
    faces = []
    for k in range(n):
        after = (k + 1) % n
        faces += [(k, after, n + after), (k, n + after, n + k)]
        faces += [(2 * n, after, k), (2 * n + 1, n + k, n + after)]
    lines = [f"v {x:.9g} {y:.9g} {z:.9g}" for x, y, z in corners]
    lines += [f"f {a + 1} {b + 1} {c + 1}" for a, b, c in faces]
    path.write_text("\n".join(lines) + "\n")
    return str(path)


def spawn_table(client: int, friction: float) -> int:
    """Create a fixed table whose top is the plane z = 0 in front of the arm."""
    half = TABLE_HALF_SIZE
    collision = pybullet.createCollisionShape(
        pybullet.GEOM_BOX, halfExtents=half, physicsClientId=client
    )
    visual = pybullet.createVisualShape(
        pybullet.GEOM_BOX, halfExtents=half, rgbaColor=(0.6, 0.6, 0.6, 1), physicsClientId=client
    )
    centre = (*TABLE_CENTRE, -half[2])
    table = pybullet.createMultiBody(0.0, collision, visual, centre, physicsClientId=client)
    pybullet.changeDynamics(
        table, -1, lateralFriction=friction, restitution=0.0, physicsClientId=client
    )
    return int(table)


def spawn_robot(client: int, robot: Robot, rotor_inertia: float, meshes: bool) -> int:
    """Create arm and hand with the arm's base fixed in the world's origin.

    Args:
        client: Bullet client.
        robot: arm and hand.
        rotor_inertia: reflected inertia of the rotor of each hand joint that turns, kg m^2. Bullet
            has no such term: it is added to the inertia of the driven link about the joint's axis.
        meshes: draw links that are drawn as meshes.
    """
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"{robot.name}.urdf"
        path.write_text(bullet_urdf(robot, meshes))
        flags = pybullet.URDF_USE_INERTIA_FROM_FILE | pybullet.URDF_USE_MATERIAL_COLORS_FROM_MTL
        body = pybullet.loadURDF(str(path), useFixedBase=True, flags=flags, physicsClientId=client)
    links = link_indices(client, body)
    for joint in robot.hand_joints:
        if joint.slides or joint.axis is None:
            continue
        own = pybullet.getDynamicsInfo(body, links[joint.child], client)[2]
        pybullet.changeDynamics(
            body,
            links[joint.child],
            localInertiaDiagonal=(np.array(own) + rotor_inertia * np.square(joint.axis)).tolist(),
            physicsClientId=client,
        )
    return int(body)


def link_indices(client: int, robot: int) -> dict[str, int]:
    """Return Bullet's index of every link (and of the joint that carries it) by link name."""
    count = pybullet.getNumJoints(robot, client)
    infos = (pybullet.getJointInfo(robot, index, client) for index in range(count))
    return {info[12].decode(): info[0] for info in infos}


OTHER = "other"


@dataclass(frozen=True)
class ContactReading:
    """What one finger (or everything else together) did to the object over a time window.

    Attributes:
        name: the finger, or "other" (table, palm, phalanges).
        time: centre of the window, s of simulated time.
        in_contact: whether there was a normal force at any time.
        force: (3,) mean force on the object, N, world axes.
        torque: (3,) mean torque about ``point``, N m, world axes; zero for one contact point.
        point: (3,) mean contact point weighted by normal force, m, world.
        normal: (3,) unit normal into the object, world axes.
        share: share of the window with contact, 0 to 1.
    """

    name: str
    time: float
    in_contact: bool
    force: Array
    torque: Array
    point: Array
    normal: Array
    share: float


class ContactAccumulator:
    """Collects the contacts of one body, step by step, and sums them per group of touching links.

    Bullet's columns, for a query with the object as body A: the normal points from B to A, so the
    normal force on the object is +normal f_n. The two friction columns act with + on the body of
    lower unique id, whichever way round it was asked.

    Args:
        client: Bullet client.
        body: the object's id.
        groups: name of the finger by (body id, link index); everything else is "other".
    """

    def __init__(self, client: int, body: int, groups: dict[tuple[int, int], str]) -> None:
        self._client = client
        self._body = body
        self._names = (*dict.fromkeys(groups.values()), OTHER)
        self._groups = {key: self._names.index(name) for key, name in groups.items()}
        self._rows: list[list[float]] = []
        self._times: list[float] = []

    def add(self, time: float) -> None:
        """Add the contacts of the simulation step that ended at ``time`` (s)."""
        points = pybullet.getContactPoints(bodyA=self._body, physicsClientId=self._client)
        step = len(self._times)
        self._times.append(time)
        other = len(self._names) - 1
        for point in points:
            if point[9] != 0.0:
                group = self._groups.get((point[2], point[4]), other)
                sign = 1.0 if self._body < point[2] else -1.0
                row = [group, step, *point[5], *point[7], *point[11], *point[13]]
                self._rows.append([*row, point[9], sign * point[10], sign * point[12]])

    def read(self) -> dict[str, ContactReading]:
        """Return the means since the last call and start anew."""
        rows = np.array(self._rows).reshape(-1, 17)
        steps = max(len(self._times), 1)
        time = 0.5 * (self._times[0] + self._times[-1]) if self._times else 0.0
        self._rows, self._times = [], []
        return {reading.name: reading for reading in _averages(self._names, rows, steps, time)}


def _averages(
    names: tuple[str, ...], rows: Array, steps: int, time: float
) -> Iterator[ContactReading]:
    """Means over a window of ``steps`` steps of contact rows (K, 17), for each group."""
    group = rows[:, 0].astype(int)
    own = (group == np.arange(len(names))[:, None]).astype(float)
    point, normal, first, second = (rows[:, k : k + 3] for k in (2, 5, 8, 11))
    pressure = rows[:, 14:15]
    forces = pressure * normal + rows[:, 15:16] * first + rows[:, 16:17] * second
    touched = np.unique(group * steps + rows[:, 1].astype(int)) // steps
    shares = np.bincount(touched, minlength=len(names)) / steps
    parts = (pressure, pressure * point, pressure * normal, forces, cross(point, forces))
    sums = own @ np.concatenate(parts, axis=1)
    for name, share, total in zip(names, shares.tolist(), sums, strict=True):
        if share == 0.0:
            zero = np.zeros(3)
            yield ContactReading(name, time, False, zero, zero, zero, zero, 0.0)
            continue
        weighted, mean_normal, force, torque = total[1:].reshape(4, 3)
        centre = weighted / total[0]
        yield ContactReading(
            name=name,
            time=time,
            in_contact=True,
            force=force / steps,
            torque=(torque - cross(centre, force)) / steps,
            point=centre,
            normal=mean_normal / max(math.sqrt(mean_normal @ mean_normal), 1e-12),
            share=share,
        )
