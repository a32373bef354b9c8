"""What does the world push on a tool with, once its own weight and inertia are taken away?

    python examples/22_contact_wrench.py

Prints the force that the wrist sensor reads, and the contact force, while a simulated tool of
1.2 kg is pushed with 5 N along x after one second. The node `wrench_compensator` does it live.
"""

import numpy as np

from tactile_dynamics_ros.core.inertia.compensation import Compensator, ContactWrenches, Load
from tactile_dynamics_ros.core.rigid_body.inertial_parameters import InertialParameters, KnownBody

TOOL = InertialParameters(1.2, np.array([0.0, 0.01, 0.06]), np.diag([4e-3, 4e-3, 2e-3]))

random, compensator = np.random.default_rng(0), Compensator()
body = KnownBody(TOOL.dynamic_parameters, 1e-8 * np.eye(10), "tool")
compensator.load = Load.of_body(body, ("wrist",))
for k in range(1000):
    time, pose = 2e-3 * k, np.eye(4)
    push = np.array([5.0 if time > 1.0 else 0.0, 0.0, 0.0])
    pose[:3, 3] = 1e-5 * random.normal(size=3)
    compensator.motion.add(time, pose)
    force = TOOL.mass * np.array([0.0, 0.0, 9.81]) - push + 0.05 * random.normal(size=3)
    torque = np.cross(TOOL.com, force)
    shape = np.eye(3)[None, None], force[None, None], torque[None, None], np.ones((1, 1), bool)
    place = pose[None, None, :3, 3]
    read = ContactWrenches(np.array([time]), ("wrist",), place, *shape, np.full((1, 3), 0.05))
    found = compensator.compensate(read).wrench[0, 3:]
    if k % 250 == 249:
        print(f"{time:.1f} s: sensor {np.round(force, 1)} N, contact {np.round(found, 1)} N")
