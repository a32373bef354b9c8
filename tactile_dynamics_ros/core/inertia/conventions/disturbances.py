"""What may act on an object besides its load, linear in unknown numbers, so that it hides nothing.

A mistaken convention beside an effect leaves an error to which the effect contributes: readings are
then held against each other with pushes, drags, springs and rotors of any size admitted.
"""

from __future__ import annotations

import numpy as np

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.inertia.residuals.motion import Motion
from tactile_dynamics_ros.core.rigid_body.rotation import skew


def disturbance_columns(motion: Motion) -> Array:
    """Wrenches (N, 6, 19) about the origin, body axes, per unit of each unknown number.

    A drag and a spring on the origin, a constant world force at any point of the body (3 and 9),
    drag of the turning (1), a rotor (3), drag that grows with the square of the speed (1).
    """
    to_body = np.swapaxes(motion.rotation, 1, 2)
    middle = motion.position.mean(axis=0)
    speed = np.linalg.norm(motion.velocity, axis=1, keepdims=True)
    pushes = np.stack([motion.velocity, motion.position - middle, speed * motion.velocity], axis=2)
    force = np.concatenate([to_body @ pushes, to_body], axis=2)
    omega = motion.angular_velocity_B
    arms = np.einsum("kij,njl->nikl", skew(np.eye(3)), to_body).reshape(len(omega), 3, 9)
    torque = np.concatenate([omega[:, :, None], skew(omega), arms], axis=2)
    columns = np.zeros((len(omega), 6, force.shape[2] + torque.shape[2]))
    columns[:, 3:, : force.shape[2]] = force
    columns[:, :3, force.shape[2] :] = torque
    return columns
