"""A Bullet body without robot, table or contacts, for tests of hidden effects."""

import numpy as np
import pybullet
from scipy.spatial.transform import Rotation

from tactile_dynamics_ros.core.robot.robot_file import load_robot
from tactile_dynamics_ros.sim.bodies import spawn_object
from tactile_dynamics_ros.sim.hidden_effects import create_hidden_effect
from tactile_dynamics_ros.sim.objects import load_object

OMEGA, VELOCITY = np.array([0.7, -1.1, 0.4]), np.array([0.3, 0.2, -0.25])
POSE = np.eye(4)
POSE[:3, :3] = Rotation.from_rotvec([0.4, 0.3, -0.5]).as_matrix()
POSE[:3, 3] = [0.5, 0.1, 0.6]
STEP = 1e-3


class FreeBody:
    """One object without robot, table or contacts."""

    def __init__(self, gravity=(0.0, 0.0, 0.0), pose=POSE):
        self.client = pybullet.connect(pybullet.DIRECT)
        self.model = load_object("box_0")
        self.body = spawn_object(self.client, self.model, pose)
        self.machine = load_robot()
        self.fingers = self.machine.fingers
        self.robot, self.table, self.time, self.callbacks = -1, -1, 0.0, []
        pybullet.setTimeStep(STEP, self.client)
        self.set_gravity(np.array(gravity))

    def __enter__(self):
        return self

    def __exit__(self, *_):
        pybullet.disconnect(self.client)

    object_id = property(lambda self: self.body.body)

    def object_pose(self):
        return self.body.pose()

    def object_velocity(self):
        return self.body.velocity()

    def apply_force(self, force, point):
        frame = pybullet.WORLD_FRAME
        pybullet.applyExternalForce(
            self.object_id, -1, list(force), list(point), frame, self.client
        )

    def apply_torque(self, torque):
        pybullet.applyExternalTorque(
            self.object_id, -1, list(torque), pybullet.WORLD_FRAME, self.client
        )

    def set_gravity(self, gravity):
        self.gravity = np.array(gravity, dtype=float)
        pybullet.setGravity(*self.gravity.tolist(), self.client)

    def add_pre_step(self, callback):
        self.callbacks.append(callback)

    def step(self, count=1):
        for _ in range(count):
            for callback in self.callbacks:
                callback(self)
            pybullet.stepSimulation(self.client)
            self.time += STEP

    def momenta(self):
        """Angular momentum about the centre of mass and linear momentum, world axes."""
        inertia = self.model.inertia
        angular, linear = self.object_velocity()
        rotation = self.object_pose()[:3, :3]
        com_velocity = linear + np.cross(angular, rotation @ inertia.com)
        spin = rotation @ inertia.inertia_com @ rotation.T @ angular
        return np.concatenate([spin, inertia.mass * com_velocity])


def wrench_in_one_step(effect, time=0.0):
    """Wrench [torque about the body origin, force] that Bullet's body feels in one step."""
    gained = []
    for attach in (True, False):
        with FreeBody() as body:
            body.time = time
            if attach:
                effect.attach(body)
            body.body.set_velocity(OMEGA, VELOCITY)
            body.step()
            gained.append(body.momenta())
    about_com, force = np.split((gained[0] - gained[1]) / STEP, 2)
    arm = POSE[:3, :3] @ load_object("box_0").inertia.com
    return np.concatenate([about_com + np.cross(arm, force), force])


def attached(name, magnitude=1.0, seed=6):
    """An effect that has met a free body."""
    effect = create_hidden_effect(name, magnitude, seed)
    with FreeBody() as body:
        effect.attach(body)
    return effect


def value(effect, name):
    return np.array(effect.truth()[name]["value"])
