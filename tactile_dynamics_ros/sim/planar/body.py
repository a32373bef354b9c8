"""A planar object as a Bullet body: what the camera sees, what a pusher meets, how it rests."""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pybullet
import trimesh

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.rigid_body.rotation import inverse_pose
from tactile_dynamics_ros.sim.bodies import (
    SHAPE_COLOUR,
    from_matrix,
    principal_frame,
)
from tactile_dynamics_ros.sim.objects import PlanarObject, PlanarPart, prism
from tactile_dynamics_ros.sim.planar.bed import SINK, Bed, Surface, feet_of, gathered

BASE = -1
LEVER = np.array([0.05, 0.0, 0.0])
"""Where the pair of forces acts that stands for a torque about the vertical, m. Bullet takes
torques of links in their own frame whatever it is told; the size changes nothing."""
WEIGHT_RADIUS = 0.01
"""Radius of gyration of a weight that is put on an object, m: small beside the object's."""
SKIN_FRICTION = 0.4
"""Coefficient between the object's sides and what pushes it."""


@dataclass(frozen=True)
class _Rigid:
    """Parts that move as one: mass, centre of mass (3,), inertia about it (3, 3), object frame."""

    parts: tuple[PlanarPart, ...]
    mass: float
    com: Array
    inertia: Array

    @classmethod
    def of(cls, parts: Sequence[PlanarPart]) -> _Rigid:
        """Put parts together.

        The inertia of each is that of an even prism, moved to its centre of mass.
        """
        mass = sum(part.mass for part in parts)
        places = [np.array([*part.com, 0.5 * part.height]) for part in parts]
        weighted = [part.mass * place for part, place in zip(parts, places, strict=True)]
        com = np.sum(weighted, axis=0) / mass
        inertia = np.zeros((3, 3))
        for part, place in zip(parts, places, strict=True):
            solid = part.solid()
            arm = place - com
            inertia += part.mass / solid.volume * np.asarray(solid.moment_inertia)
            inertia += part.mass * (arm @ arm * np.eye(3) - np.outer(arm, arm))
        return cls(tuple(parts), mass, com, inertia)


class PlanarBody:
    """An object on the table; parts that are joined rigidly are one Bullet link.

    Args:
        client: Bullet client.
        thing: what it is.
        pose: (4, 4) of its frame, whose z = 0 is the table.
        surface: of the table.

    Attributes:
        body: Bullet id. thing: as given. links: Bullet's index of each rigid part.
        beds: the table under each rigid part.
    """

    def __init__(self, client: int, thing: PlanarObject, pose: Array, surface: Surface) -> None:
        self.client, self.thing = client, thing
        groups = [(part,) for part in thing.parts] if thing.joint is not None else [thing.parts]
        self._rigid = [_Rigid.of(group) for group in groups]
        self._frames = [_principal(rigid) for rigid in self._rigid]
        self._inverse = [inverse_pose(frame) for _, frame in self._frames]
        self.links = [BASE, 0][: len(groups)]
        self._states: dict[int, tuple[Array, Array, Array]] = {}
        self.body = self._spawn(pose)
        height = float(pose[2, 3])
        self.beds = [_bed(rigid, height, surface) for rigid in self._rigid]

    def pose(self, k: int = 0) -> Array:
        """Return the pose (4, 4) of the object's frame, as its k-th rigid part carries it."""
        return self.state(k)[0].copy()

    def velocity(self, k: int = 0) -> tuple[Array, Array]:
        """Return (angular velocity, velocity of the frame's origin), each (3,), world axes."""
        return self.state(k)[1:]

    def rest_on_table(self, step: float) -> None:
        """Let the table act during the coming step of `step` s."""
        for k, bed in enumerate(self.beds):
            support = bed.press(*self.state(k), step)
            if support is None:
                continue
            couple = np.array([0.0, 0.5 * support.torque / LEVER[0], 0.0])
            self.push(k, support.force, support.point)
            self.push(k, couple, support.point + LEVER)
            self.push(k, -couple, support.point - LEVER)

    def push(self, k: int, force: Array, point: Array) -> None:
        """Push a rigid part during the coming step: force (3,) N at point (3,) m, world."""
        pybullet.applyExternalForce(
            self.body,
            self.links[k],
            force.tolist(),
            point.tolist(),
            pybullet.WORLD_FRAME,
            physicsClientId=self.client,
        )

    def load(self, mass: float, place: Array) -> None:
        """Put a small weight, kg, on the first part and fix it there.

        Args:
            mass: kg.
            place: (3,) m, object's frame.
        """
        pose = self.pose()
        at = pose[:3, 3] + pose[:3, :3] @ place
        weight = pybullet.createMultiBody(
            mass, basePosition=at.tolist(), physicsClientId=self.client
        )
        pybullet.changeDynamics(
            weight,
            BASE,
            localInertiaDiagonal=(mass * WEIGHT_RADIUS**2 * np.ones(3)).tolist(),
            linearDamping=0.0,
            angularDamping=0.0,
            activationState=pybullet.ACTIVATION_STATE_DISABLE_SLEEPING,
            physicsClientId=self.client,
        )
        linear = self.velocity()[1]
        pybullet.resetBaseVelocity(weight, linear.tolist(), physicsClientId=self.client)
        pybullet.createConstraint(
            self.body,
            BASE,
            weight,
            BASE,
            pybullet.JOINT_POINT2POINT,
            [0.0, 0.0, 0.0],
            (self._inverse[0] @ [*place, 1.0])[:3].tolist(),
            [0.0, 0.0, 0.0],
            physicsClientId=self.client,
        )

    def truth(self) -> dict[str, object]:
        """Return number, pose, mass, parts and joint, ready for JSON."""
        thing = self.thing
        return {
            "number": thing.number,
            "kind": thing.kind,
            "pose": self.pose().tolist(),
            "mass": sum(rigid.mass for rigid in self._rigid),
            "parts": [
                _part_truth(part, self.pose(k))
                for k, rigid in enumerate(self._rigid)
                for part in rigid.parts
            ],
            "joint": None if thing.joint is None else thing.joint.tolist(),
            "joint_friction_nm": thing.joint_friction,
        }

    def forget(self) -> None:
        """Read the motion anew: a step was simulated."""
        self._states.clear()

    def state(self, k: int) -> tuple[Array, Array, Array]:
        """Return pose, angular velocity and velocity of the object's frame on a rigid part."""
        if k not in self._states:
            self._states[k] = self._read(k)
        return self._states[k]

    def _read(self, k: int) -> tuple[Array, Array, Array]:
        """Ask Bullet for the state of a rigid part."""
        if self.links[k] == BASE:
            place = pybullet.getBasePositionAndOrientation(self.body, self.client)
            linear, angular = pybullet.getBaseVelocity(self.body, self.client)
        else:
            state = pybullet.getLinkState(
                self.body, self.links[k], 1, 1, physicsClientId=self.client
            )
            place, (linear, angular) = state[:2], state[6:8]
        pose = np.empty((4, 4))
        pose[:3, :3] = np.reshape(pybullet.getMatrixFromQuaternion(place[1]), (3, 3))
        pose[:3, 3], pose[3] = place[0], (0.0, 0.0, 0.0, 1.0)
        pose = pose @ self._inverse[k]
        turning = np.array(angular)
        (x, y, z), (a, b, c) = angular, (pose[:3, 3] - place[0]).tolist()
        around = [y * c - z * b, z * a - x * c, x * b - y * a]
        return pose, turning, np.array(linear) + around

    def _spawn(self, pose: Array) -> int:
        """Create the body, sunk into the table as deep as it rests."""
        sunk = pose.copy()
        sunk[2, 3] -= SINK
        position, quaternion = from_matrix(sunk @ self._frames[0][1])
        visual, collision = self._shapes(0, self._frames[0][1])
        body = int(
            pybullet.createMultiBody(
                self._rigid[0].mass,
                collision,
                visual,
                position,
                quaternion,
                physicsClientId=self.client,
                **({} if self.thing.joint is None else self._hinged(self.thing.joint)),
            )
        )
        for link, (moments, _) in zip(self.links, self._frames, strict=True):
            pybullet.changeDynamics(
                body,
                link,
                localInertiaDiagonal=moments.tolist(),
                lateralFriction=SKIN_FRICTION,
                linearDamping=0.0,
                angularDamping=0.0,
                jointDamping=0.0,
                restitution=0.0,
                activationState=pybullet.ACTIVATION_STATE_DISABLE_SLEEPING,
                physicsClientId=self.client,
            )
        if self.thing.joint is not None:  # a motor that holds still with a torque is dry friction
            pybullet.setJointMotorControl2(
                body,
                0,
                pybullet.VELOCITY_CONTROL,
                targetVelocity=0.0,
                force=self.thing.joint_friction,
                physicsClientId=self.client,
            )
        return body

    def _hinged(self, joint: Array) -> dict[str, list[object]]:
        """Return Bullet's arguments of a second link that turns about the vertical at (2,) m."""
        hinge = np.eye(4)
        hinge[:2, 3] = joint
        place, turn = from_matrix(inverse_pose(self._frames[0][1]) @ hinge)
        centre, axes = from_matrix(inverse_pose(hinge) @ self._frames[1][1])
        visual, collision = self._shapes(1, hinge)
        return {
            "linkMasses": [self._rigid[1].mass],
            "linkCollisionShapeIndices": [collision],
            "linkVisualShapeIndices": [visual],
            "linkPositions": [place],
            "linkOrientations": [turn],
            "linkInertialFramePositions": [centre],
            "linkInertialFrameOrientations": [axes],
            "linkParentIndices": [0],
            "linkJointTypes": [pybullet.JOINT_REVOLUTE],
            "linkJointAxis": [[0.0, 0.0, 1.0]],
        }

    def _shapes(self, k: int, frame: Array) -> tuple[int, int]:
        """Return Bullet's visual and collision shape of a rigid part.

        Args:
            k: which rigid part.
            frame: (4, 4) of the shape's frame in the object's.
        """
        inverse = inverse_pose(frame)
        solids = [part.solid().apply_transform(inverse) for part in self._rigid[k].parts]
        solid = trimesh.util.concatenate(solids)
        visual = pybullet.createVisualShape(
            pybullet.GEOM_MESH,
            vertices=solid.vertices.tolist(),
            indices=solid.faces.ravel().tolist(),
            rgbaColor=SHAPE_COLOUR,
            physicsClientId=self.client,
        )
        pieces = [piece for part in self._rigid[k].parts for piece in _convex_pieces(part)]
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "pieces.obj"
            path.write_text(_obj([piece.apply_transform(inverse) for piece in pieces]))
            collision = pybullet.createCollisionShape(
                pybullet.GEOM_MESH, fileName=str(path), physicsClientId=self.client
            )
        return int(visual), int(collision)


def _principal(rigid: _Rigid) -> tuple[Array, Array]:
    return principal_frame(rigid.com, rigid.inertia)


def _bed(rigid: _Rigid, height: float, surface: Surface) -> Bed:
    """Return the table under a rigid part."""
    found = [feet_of(part.corners) for part in rigid.parts]
    areas = [part.solid().volume / part.height for part in rigid.parts]
    flat, shares = gathered(found, areas)
    friction = np.concatenate(
        [
            np.full(len(places), part.friction)
            for (places, _), part in zip(found, rigid.parts, strict=True)
        ]
    )
    feet = np.column_stack([flat, np.zeros(len(flat))])
    return Bed(feet, shares, friction, rigid.mass, height, surface)


def _convex_pieces(part: PlanarPart) -> list[Any]:
    """Return prisms that together are a part: halves of a waisted one, else itself."""
    if part.outline != "butterfly":
        return [part.solid()]
    corners = part.corners
    halves = corners[[0, 1, 4, 5]], corners[[1, 2, 3, 4]]
    return [prism(half, part.height) for half in halves]


def _obj(pieces: Sequence[Any]) -> str:
    """Return Wavefront text with one object for each convex piece, as Bullet reads compounds."""
    lines, before = [], 1
    for k, piece in enumerate(pieces):
        lines.append(f"o piece_{k}")
        lines += [f"v {x:.9g} {y:.9g} {z:.9g}" for x, y, z in piece.vertices]
        lines += [f"f {a + before} {b + before} {c + before}" for a, b, c in piece.faces]
        before += len(piece.vertices)
    return "\n".join(lines) + "\n"


def _part_truth(part: PlanarPart, pose: Array) -> dict[str, object]:
    """Return a part; corners and centre of mass are in the object's frame, which moves with it."""
    return {
        "outline": part.outline,
        "corners": part.corners.tolist(),
        "height": part.height,
        "mass": part.mass,
        "friction": part.friction,
        "com": part.com.tolist(),
        "pose": pose.tolist(),
    }
