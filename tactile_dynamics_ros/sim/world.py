"""The simulated robot: arm, hand, table and one object in Bullet at 1 kHz."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pybullet

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.configuration import check_ranges, parameter
from tactile_dynamics_ros.core.rigid_body.inertial_parameters import InertialParameters
from tactile_dynamics_ros.core.robot.robot import Robot
from tactile_dynamics_ros.core.robot.robot_file import load_robot
from tactile_dynamics_ros.sim.bodies import (
    ContactAccumulator,
    ContactReading,
    Engine,
    link_indices,
    spawn_robot,
    spawn_table,
    to_matrix,
)
from tactile_dynamics_ros.sim.drives import JointDrives
from tactile_dynamics_ros.sim.objects import ObjectModel, load_object
from tactile_dynamics_ros.sim.warping import spawn_warping_object


@dataclass(frozen=True)
class WorldConfig:
    """What stands on the table and how the simulated robot behaves."""

    object_name: str = parameter("box_0", "object: name of a file in config/objects, or a path")
    object_x: float = parameter(0.55, "grasp centre of the object at the start", "m", 0.3, 0.9)
    object_y: float = parameter(0.0, "grasp centre of the object at the start", "m", -0.5, 0.5)
    object_yaw: float = parameter(0.0, "turn of the object about the vertical", "rad", -3.2, 3.2)
    time_step: float = parameter(1e-3, "simulation step", "s", 1e-4, 2e-3)
    solver_iterations: int = parameter(60, "iterations of the contact solver", "", 10, 500)
    table_friction: float = parameter(0.4, "object on table", "", 0.0, 2.0)
    skin_stiffness: float = parameter(4000.0, "normal stiffness of a skin", "N/m", 500.0, 1e5)
    skin_damping: float = parameter(20.0, "normal damping of a skin", "N s/m", 0.0, 1e3)
    skin_torsion: float = parameter(
        0.0,
        "torque about the normal per newton of normal force that the skin can bear",
        "m",
        0,
        0.01,
    )
    rotor_inertia: float = parameter(
        1e-3, "reflected inertia of a hand joint's rotor", "kg m^2", 1e-4, 1e-2
    )
    command_smoothing: float = parameter(
        0.02, "time constant of the drives' command filter", "s", 0.002, 0.5
    )
    stiffness_scale: float = parameter(1.0, "factor on the hand's joint stiffness", "", 0.05, 3.0)
    warp_stiffness: float = parameter(
        0.0, "of the face that the fingers press, against turning; 0 is rigid", "N m/rad", 0.0, 100
    )
    arm_meshes: bool = parameter(False, "draw the arm for the cameras")

    def __post_init__(self) -> None:
        check_ranges(self)


@dataclass(frozen=True)
class JointState:
    """True joint positions, velocities and drive torques in the robot's order."""

    names: tuple[str, ...]
    position: Array
    velocity: Array
    effort: Array


@dataclass(frozen=True)
class GroundTruth:
    """What only a reveal may tell: the object's true inertia, pose, motion and friction."""

    object_name: str
    inertia: InertialParameters
    object_pose: Array
    angular_velocity: Array
    velocity: Array
    friction: float
    gravity: Array


class HandWorld(Engine):
    """Arm, hand, table and object; use as a context manager or call `close`.

    ``step`` advances by simulation steps. ``command`` sets joint targets that the drives
    follow with limited torque. ``contacts`` returns the mean contact forces since its last call.
    ``add_pre_step`` registers a callback that may push, pull or disturb before each step.

    Attributes:
        config: as given. model: the object's model. machine: arm and hand, as given.
        client, robot, table: Bullet ids. time: simulated seconds.
    """

    def __init__(
        self,
        config: WorldConfig | None = None,
        model: ObjectModel | None = None,
        machine: Robot | None = None,
    ) -> None:
        self.config = config or WorldConfig()
        self.machine = machine = machine or load_robot()
        self.joint_names, self.fingers = machine.joint_names, machine.fingers
        self.model = model or load_object(self.config.object_name)
        self.time = 0.0
        super().__init__()
        self._configure_engine()
        self.robot = spawn_robot(
            self.client, machine, self.config.rotor_inertia, self.config.arm_meshes
        )
        self.table = spawn_table(self.client, self.config.table_friction / self.model.friction)
        self._links = link_indices(self.client, self.robot)
        self._soften_skins()
        self._object, spring = spawn_warping_object(
            self.client, self.model, self.start_pose(), self.config.warp_stiffness
        )
        self._joints = [self._links[joint.child] for joint in machine.joints]
        self._drives = JointDrives(
            self.client,
            self.robot,
            machine,
            self._joints,
            self.config.command_smoothing,
            self.config.stiffness_scale,
            self.config.time_step,
        )
        tips = {(self.robot, self._links[tip.touches]): tip.name for tip in machine.hand}
        self._contacts = ContactAccumulator(self.client, self._object.body, tips)
        self._wrist = self._links[machine.flange]
        self._measured, self._wrist_steps = np.zeros(6), 0
        pybullet.enableJointForceTorqueSensor(self.robot, self._wrist, True, self.client)
        self._pre_step: list[Callable[[HandWorld], None]] = [] if spring is None else [spring]

    @property
    def object_id(self) -> int:
        """Bullet id of the object."""
        return self._object.body

    @property
    def gravity(self) -> Array:
        """(3,) m/s^2, world axes."""
        return self._gravity.copy()

    def start_pose(self) -> Array:
        """Pose X_WO (4, 4) in which the object stands on the table at the start."""
        config = self.config
        return self.model.resting_pose(config.object_x, config.object_y, config.object_yaw)

    def reset(self, joint_positions: Array, object_pose: Array | None = None) -> None:
        """Put joints (J,) and object X_WO at rest where told, with the targets there too."""
        for index, value in zip(self._joints, joint_positions, strict=True):
            pybullet.resetJointState(self.robot, index, float(value), 0.0, self.client)
        self._object.set_pose(self.start_pose() if object_pose is None else object_pose)
        self._drives.reset(np.asarray(joint_positions, dtype=float))

    def command(self, targets: Array, names: Sequence[str] | None = None) -> None:
        """Set joint targets, rad; with ``names`` only those joints change."""
        if names is None:
            self._drives.set_target(np.asarray(targets, dtype=float))
            return
        target = self._drives.target.copy()
        target[[self.joint_names.index(name) for name in names]] = targets
        self._drives.set_target(target)

    def step(self, count: int = 1) -> None:
        """Advance by ``count`` simulation steps."""
        for _ in range(count):
            self._drives.apply()
            for callback in self._pre_step:
                callback(self)
            pybullet.stepSimulation(self.client)
            self.time += self.config.time_step
            self._contacts.add(self.time)
            self._measured += pybullet.getJointState(self.robot, self._wrist, self.client)[2]
            self._wrist_steps += 1

    def joint_state(self) -> JointState:
        """Return true joint positions, velocities and torques."""
        states = pybullet.getJointStates(self.robot, self._joints, self.client)
        columns = np.array([(state[0], state[1], state[3]) for state in states])
        effort = np.concatenate([columns[: self.machine.arm_dof, 2], self._drives.torque])
        return JointState(self.joint_names, columns[:, 0], columns[:, 1], effort)

    def contacts(self) -> dict[str, ContactReading]:
        """Return mean contacts per finger, and "other", since the last call."""
        return self._contacts.read()

    def object_pose(self) -> Array:
        """Return the true pose X_WO (4, 4) of the object."""
        return self._object.pose()

    def object_velocity(self) -> tuple[Array, Array]:
        """Return (angular velocity, velocity of the body origin) in world axes."""
        return self._object.velocity()

    def link_pose(self, name: str) -> Array:
        """Return the pose (4, 4) of a link's frame in the world, for example "biotac_index"."""
        state = pybullet.getLinkState(
            self.robot, self._links[name], 0, 1, physicsClientId=self.client
        )
        return to_matrix(state[4], state[5])

    def wrist_wrench(self) -> Array:
        """Return [torque, force] (6,) of the hand on the flange, sensor axes, its mean since last.

        Drives take each target up within a few steps, so that at the end of a period the joints
        always slow down: the wrench of that instant is not the one that the motion has.

        Raises:
            ValueError: no step was made since the last call.
        """
        if not self._wrist_steps:
            raise ValueError("wrist wrench: no step since the last call; step the world first")
        reaction = self._measured / self._wrist_steps
        self._measured, self._wrist_steps = np.zeros(6), 0
        return -np.array([*reaction[3:], *reaction[:3]])

    def truth(self) -> GroundTruth:
        """Return what only a reveal may tell."""
        angular, linear = self.object_velocity()
        return GroundTruth(
            self.model.name,
            self.model.inertia,
            self.object_pose(),
            angular,
            linear,
            self.model.friction,
            self.gravity,
        )

    def add_pre_step(self, callback: Callable[[HandWorld], None]) -> None:
        """Call ``callback(world)`` before each simulation step, in the order of registration."""
        self._pre_step.append(callback)

    def apply_force(self, force: Array, point: Array) -> None:
        """Push the object during the coming step: force (3,) N at point (3,) m, world axes."""
        pybullet.applyExternalForce(
            self.object_id,
            -1,
            list(force),
            list(point),
            pybullet.WORLD_FRAME,
            physicsClientId=self.client,
        )

    def apply_torque(self, torque: Array) -> None:
        """Twist the object during the coming step: torque (3,) N m, world axes."""
        pybullet.applyExternalTorque(
            self.object_id, -1, list(torque), pybullet.WORLD_FRAME, physicsClientId=self.client
        )

    def set_gravity(self, gravity: Array) -> None:
        """Change gravity (3,) m/s^2, world axes, for everything."""
        self._gravity = np.array(gravity, dtype=float)
        pybullet.setGravity(*self._gravity.tolist(), physicsClientId=self.client)

    def hide_table(self) -> Callable[[int], int]:
        """Make the table invisible; return what creates one as it was in another Bullet client."""
        pybullet.changeVisualShape(
            self.table, -1, rgbaColor=(0.0, 0.0, 0.0, 0.0), physicsClientId=self.client
        )
        return lambda client: spawn_table(client, self.config.table_friction / self.model.friction)

    def _configure_engine(self) -> None:
        pybullet.setPhysicsEngineParameter(
            fixedTimeStep=self.config.time_step,
            numSolverIterations=self.config.solver_iterations,
            numSubSteps=0,
            physicsClientId=self.client,
        )
        self.set_gravity(np.array([0.0, 0.0, -9.81]))

    def _soften_skins(self) -> None:
        config = self.config
        skins = {self._links[finger.touches] for finger in self.machine.hand}
        for joint in self.machine.tree:
            link = self._links[joint.child]
            options: dict[str, Any] = {"lateralFriction": 0.6, "restitution": 0.0}
            if link in skins:
                options |= {
                    "lateralFriction": 1.0,
                    "spinningFriction": config.skin_torsion,
                    "contactStiffness": config.skin_stiffness,
                    "contactDamping": config.skin_damping,
                    "frictionAnchor": True,
                }
            pybullet.changeDynamics(self.robot, link, physicsClientId=self.client, **options)
