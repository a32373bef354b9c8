"""An object whose faces give way, as those of a thin-walled carton do."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pybullet

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.rigid_body.rotation import inverse_pose
from tactile_dynamics_ros.sim.bodies import (
    ObjectBody,
    from_matrix,
    principal_frame,
    spawn_object,
)
from tactile_dynamics_ros.sim.objects import ObjectModel

PANEL_MASS = 0.01
PANEL_INERTIA = 1e-4
"""About the hinge, kg m^2: more than that of the carton, so that the step of 1 ms is stable."""
DAMPING_TIME = 0.01
THICKNESS = 0.006
"""Of a panel and of what the body lacks under it, m."""
CLEARANCE = 2e-3
"""Of a panel from what the object stands on, m."""
IDENTITY = [0.0, 0.0, 0.0, 1.0]


def spawn_warping_object(
    client: int, model: ObjectModel, pose: Array, stiffness: float
) -> tuple[ObjectBody, Callable[[Any], None] | None]:
    """Create an object; with stiffness, the two faces that are pressed are panels on spring hinges.

    The hinges lie in the middle of the faces, along the object's approach direction. The object
    has to be one upright box about its centre of mass.

    Args:
        client: Bullet client.
        model: of the object.
        pose: (4, 4) X_WO.
        stiffness: of each hinge, N m/rad; 0 makes a rigid object.

    Returns:
        The body, and what drives the springs before every step, or None.
    """
    if stiffness == 0.0:
        return spawn_object(client, model, pose), None
    moments, com_pose = principal_frame(model.inertia.com, model.inertia.inertia_com)
    body = _create(client, model, pose @ com_pose, inverse_pose(com_pose))
    pybullet.changeDynamics(
        body,
        -1,
        localInertiaDiagonal=moments.tolist(),
        linearDamping=0.0,
        angularDamping=0.0,
        activationState=pybullet.ACTIVATION_STATE_DISABLE_SLEEPING,
        physicsClientId=client,
    )
    for link in (-1, 0, 1):
        pybullet.changeDynamics(
            body, link, lateralFriction=model.friction, restitution=0.0, physicsClientId=client
        )
    for link in (0, 1):
        inertia = [PANEL_INERTIA] * 3
        pybullet.changeDynamics(body, link, localInertiaDiagonal=inertia, physicsClientId=client)
    return ObjectBody(client, body, com_pose), _springs(client, body, stiffness)


def _create(client: int, model: ObjectModel, pose: Array, in_com: Array) -> int:
    """Create body and panels at the pose X_WC of the principal frame; ``in_com`` is X_CO."""
    shape = model.shapes[0]
    across = int(np.argmax(np.abs(model.grasp.pinch)))
    body_size, panel_size = shape.size.copy(), shape.size.copy()
    body_size[across] -= 2.0 * THICKNESS
    panel_size[across] = THICKNESS
    panel_size[int(np.argmax(np.abs(model.grasp.approach)))] -= 2.0 * CLEARANCE
    lever = 0.5 * (shape.size[across] - THICKNESS)
    faces = [shape.pose[:3, 3] + sign * lever * model.grasp.pinch for sign in (1.0, -1.0)]
    turned = np.eye(4)
    turned[:3, :3] = in_com[:3, :3]
    panel = _box(client, panel_size, turned)
    position, quaternion = from_matrix(pose)
    axis = (in_com[:3, :3] @ model.grasp.approach).tolist()
    hinges = [(in_com[:3, :3] @ face + in_com[:3, 3]).tolist() for face in faces]
    body = pybullet.createMultiBody(
        baseMass=model.inertia.mass - 2.0 * PANEL_MASS,
        baseCollisionShapeIndex=_box(client, body_size, in_com @ shape.pose),
        basePosition=position,
        baseOrientation=quaternion,
        linkMasses=[PANEL_MASS] * 2,
        linkCollisionShapeIndices=[panel] * 2,
        linkVisualShapeIndices=[-1] * 2,
        linkPositions=hinges,
        linkOrientations=[IDENTITY] * 2,
        linkInertialFramePositions=[[0.0, 0.0, 0.0]] * 2,
        linkInertialFrameOrientations=[IDENTITY] * 2,
        linkParentIndices=[0, 0],
        linkJointTypes=[pybullet.JOINT_REVOLUTE] * 2,
        linkJointAxis=[axis] * 2,
        physicsClientId=client,
    )
    pybullet.setJointMotorControlArray(
        body, [0, 1], pybullet.VELOCITY_CONTROL, forces=[0.0, 0.0], physicsClientId=client
    )
    return int(body)


def _box(client: int, size: Array, frame: Array) -> int:
    place, turn = from_matrix(frame)
    shape = pybullet.createCollisionShape(
        pybullet.GEOM_BOX,
        halfExtents=(0.5 * size).tolist(),
        collisionFramePosition=place,
        collisionFrameOrientation=turn,
        physicsClientId=client,
    )
    return int(shape)


def _springs(client: int, body: int, stiffness: float) -> Callable[[Any], None]:
    def push(_: Any) -> None:
        states = pybullet.getJointStates(body, [0, 1], client)
        torques = [-stiffness * (angle + DAMPING_TIME * rate) for angle, rate, *_ in states]
        pybullet.setJointMotorControlArray(
            body, [0, 1], pybullet.TORQUE_CONTROL, forces=torques, physicsClientId=client
        )

    return push
