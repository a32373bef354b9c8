"""Held objects with exact inertia: a homogeneous box or cylinder with a dense ball inside."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tactile_dynamics_ros.synthetic.motion import MotionSamples


@dataclass(frozen=True)
class HeldObject:
    """A rigid body; the body origin is the centre of its shape, not its centre of mass.

    Attributes:
        shape: "box" or "cylinder" (axis z).
        size: (3,) full extents in m.
        mass: kg.
        com: (3,) centre of mass in the body frame, m.
        inertia_com: (3, 3) about the centre of mass, body axes, kg m^2.
    """

    shape: str
    size: np.ndarray
    mass: float
    com: np.ndarray
    inertia_com: np.ndarray

    def inertial_wrench(self, motion: MotionSamples, gravity: np.ndarray) -> np.ndarray:
        """Wrench besides gravity that the motion needs, (N, 6) about the origin, world axes.

        Newton and Euler about the centre of mass: F = m (a_c - g), T_c = d(R I R^T w)/dt.
        """
        force = self.mass * (motion.point_acceleration(self.com) - gravity)
        omega, alpha = (
            motion.to_body(motion.angular_velocity),
            motion.to_body(motion.angular_acceleration),
        )
        about_com = alpha @ self.inertia_com + np.cross(omega, omega @ self.inertia_com)
        torque = motion.to_world(about_com) + np.cross(motion.to_world(self.com), force)
        return np.concatenate([torque, force], axis=1)


def shifted_inertia(mass: float, offset: np.ndarray) -> np.ndarray:
    """Inertia of a point mass about a point at distance -offset from it."""
    return mass * (offset @ offset * np.eye(3) - np.outer(offset, offset))


def draw_object(rng: np.random.Generator) -> HeldObject:
    """Draw a box or a cylinder of 0.1 to 1 kg with a ball inside that moves the centre of mass."""
    shape = str(rng.choice(["box", "cylinder"]))
    width = rng.uniform(0.045, 0.075)
    depth = width if shape == "cylinder" else rng.uniform(0.045, 0.085)
    size = np.array([width, depth, rng.uniform(0.08, 0.15)])
    mass = float(np.exp(rng.uniform(np.log(0.1), np.log(1.0))))
    ball_mass, radius = mass * rng.uniform(0.15, 0.4), 0.008
    ball_at = rng.uniform(-0.3, 0.3, size=3) * size
    shell_mass = mass - ball_mass
    com = ball_mass * ball_at / mass
    inertia = np.diag(_shell_inertia(shape, shell_mass, size)) + shifted_inertia(shell_mass, com)
    inertia += 0.4 * ball_mass * radius**2 * np.eye(3) + shifted_inertia(ball_mass, ball_at - com)
    return HeldObject(shape, size, mass, com, inertia)


def _shell_inertia(shape: str, mass: float, size: np.ndarray) -> np.ndarray:
    if shape == "box":
        return mass / 12 * (size @ size - size**2)
    radius, height = size[0] / 2, size[2]
    across = mass * (3 * radius**2 + height**2) / 12
    return np.array([across, across, mass * radius**2 / 2])
