"""Guide a simulated arm's load by hand: an admittance controller takes the compensated wrench.

    python examples/35_admittance.py --seconds 12

A load hangs on a wrist sensor in PyBullet. The controller moves the wrist as if it were a mass in
honey, M a + D v = F, where F is the contact force. A hand pushes for two seconds, then lets go.
With the sensor's own wrench the load's weight drives the wrist away; with the compensated one it
stays where the hand has left it. On a robot the node `wrench_compensator` does this.
"""

import argparse

import numpy as np
import pybullet

from tactile_dynamics_ros.core.inertia.compensation import Compensator, ContactWrenches, Load
from tactile_dynamics_ros.core.rigid_body.inertial_parameters import InertialParameters, KnownBody

RATE = 500.0
LOAD = InertialParameters(1.2, np.array([0.01, -0.02, 0.06]), np.diag([4e-3, 4e-3, 2e-3]))
MASS, DAMPING = 5.0, 40.0  # of the controller, kg and N s/m
PUSH = np.array([6.0, 0.0, 3.0])  # of the hand, N
NOISE_N, NOISE_NM = 0.05, 0.003  # of the sensor, per axis


class Wrist:
    """A load that a fixed joint carries; the wrist is moved, its joint is the sensor."""

    def __init__(self):
        """Make the load of one link, without anything around it."""
        self.world = pybullet.connect(pybullet.DIRECT)
        pybullet.setGravity(0.0, 0.0, -9.81, physicsClientId=self.world)
        pybullet.setTimeStep(1.0 / RATE, physicsClientId=self.world)
        shape = pybullet.createCollisionShape(
            pybullet.GEOM_BOX, halfExtents=[0.03] * 3, physicsClientId=self.world
        )
        self.body = pybullet.createMultiBody(
            LOAD.mass,
            shape,
            basePosition=LOAD.com.tolist(),
            physicsClientId=self.world,
        )
        pybullet.changeDynamics(
            self.body,
            -1,
            localInertiaDiagonal=np.diag(LOAD.inertia_com).tolist(),
            linearDamping=0.0,
            angularDamping=0.0,
            physicsClientId=self.world,
        )
        self.place, self.velocity = np.zeros(3), np.zeros(3)

    def step(self, target, push):
        """Move the wrist at a velocity; return force and torque that it applies on the load.

        The joint does whatever it takes: the momentum that the load gains in the step, less what
        gravity and the hand give it.
        """
        before, _ = pybullet.getBaseVelocity(self.body, physicsClientId=self.world)
        force = LOAD.mass * ((target - before) * RATE - [0.0, 0.0, -9.81]) - push
        centre, _ = pybullet.getBasePositionAndOrientation(self.body, physicsClientId=self.world)
        for one in (force, push):
            pybullet.applyExternalForce(
                self.body, -1, one.tolist(), centre, pybullet.WORLD_FRAME, self.world
            )
        pybullet.stepSimulation(physicsClientId=self.world)
        centre, _ = pybullet.getBasePositionAndOrientation(self.body, physicsClientId=self.world)
        self.place, self.velocity = np.array(centre) - LOAD.com, target
        return force, np.cross(LOAD.com, force)


def guide(seconds, compensated):
    """Let the hand push for two seconds; return where the wrist is at every step, (N, 3) m."""
    rng, wrist, compensator = np.random.default_rng(0), Wrist(), Compensator()
    body = KnownBody(LOAD.dynamic_parameters, 1e-8 * np.eye(10), "tool")
    compensator.load = Load.of_body(body, ("wrist",))
    contact, places = np.zeros(3), []
    for k in range(round(seconds * RATE)):
        time = k / RATE
        push = PUSH if 3.0 < time < 5.0 else np.zeros(3)
        target = wrist.velocity + (contact - DAMPING * wrist.velocity) / MASS / RATE
        force, torque = wrist.step(target if time > 1.0 else np.zeros(3), push)
        force = force + NOISE_N * rng.normal(size=3)
        torque = torque + NOISE_NM * rng.normal(size=3)
        pose = np.eye(4)
        pose[:3, 3] = wrist.place + 2e-5 * rng.normal(size=3)
        compensator.motion.add(time, pose)
        if compensated:
            seen = ContactWrenches(
                np.array([time]), ("wrist",), pose[None, None, :3, 3], np.eye(3)[None, None],
                force[None, None], torque[None, None], np.ones((1, 1), bool),
                np.full((1, 3), NOISE_N),
            )  # fmt: skip
            contact = compensator.compensate(seen).wrench[0, 3:]
        else:
            contact = -force
        places.append(wrist.place.copy())
    pybullet.disconnect(wrist.world)
    return np.array(places)


def main(arguments=None):
    """Print how far the wrist goes while the hand pushes and after it."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=12.0)
    options = parser.parse_args(arguments)
    for name, compensated in (("compensated", True), ("as the sensor reads", False)):
        places = guide(options.seconds, compensated)
        free, left, end = (places[int(t * RATE)] for t in (2.9, 6.0, options.seconds - 0.1))
        moves = [1e3 * np.linalg.norm(move) for move in (free, left - free, end - left)]
        print(
            f"{name:20s} before the push {moves[0]:6.1f} mm, by the push {moves[1]:6.1f} mm, "
            f"then {moves[2]:6.1f} mm"
        )


if __name__ == "__main__":
    main()
