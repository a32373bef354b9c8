"""What a real arm does beside rigid bodies and plain friction: hidden laws, one function each."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.synthetic.joints.dynamics import Dynamics


@dataclass
class Drives:
    """What the drives of an arm do while it moves; effects change it in place.

    Attributes:
        time: (N,) s. q, dq, ddq: (N, n) true motion of the links.
        dynamics: of the rigid bodies, with gravity as it is.
        tilted: gives the torques of the rigid bodies for another gravity (3,).
        coulomb, viscous: (n,) friction.
        torque: (N, n) of the drives so far, N m.
        seen: (N, n) positions that encoders tell, rad.
        size: (n,) typical torque of the friction of each joint.
        magnitude: multiple of a typical size.
        random: draws joints and sizes.
        truth: what was done, for the file beside the recording.
    """

    time: Array
    q: Array
    dq: Array
    ddq: Array
    dynamics: Dynamics
    tilted: Callable[[Array], Array]
    coulomb: Array
    viscous: Array
    torque: Array
    seen: Array
    size: Array
    magnitude: float
    random: np.random.Generator
    truth: dict[str, Any] = field(default_factory=dict)

    @property
    def friction(self) -> Array:
        """(N, n) plain friction."""
        return self.coulomb * np.sign(self.dq) + self.viscous * self.dq

    def joint(self, first: int = 0, last: int | None = None) -> int:
        """Draw the joint that has the effect."""
        return int(self.random.integers(first, last or self.q.shape[1]))

    def around(self, value: float) -> float:
        """Draw a size between 0.7 and 1.4 times a typical one."""
        return float(self.magnitude * value * np.exp(self.random.uniform(-0.35, 0.35)))


def stribeck_friction(drives: Drives) -> None:
    """Friction rises towards standstill, on one joint."""
    j = drives.joint()
    rise = drives.around(0.8) * drives.coulomb[j]
    speed = float(drives.random.uniform(0.06, 0.15))
    slow = np.exp(-((drives.dq[:, j] / speed) ** 2))
    drives.torque[:, j] += rise * slow * np.sign(drives.dq[:, j])
    drives.truth = {"joint": j, "torque": rise, "speed": speed}


def load_dependent_friction(drives: Drives) -> None:
    """Friction grows with the torque that the gears carry, on all joints alike."""
    share = drives.around(0.05)
    drives.torque += share * np.abs(drives.dynamics.torque) * np.sign(drives.dq)
    drives.truth = {"share": share}


def friction_warming(drives: Drives) -> None:
    """Cold gears rub more: all friction falls towards its warm value."""
    share, after = drives.around(0.5), float(drives.random.uniform(12.0, 30.0))
    cold = share * np.exp(-(drives.time - drives.time[0]) / after)
    drives.torque += cold[:, None] * drives.friction
    drives.truth = {"share": share, "time_constant": after}


def directional_friction(drives: Drives) -> None:
    """Viscous friction differs between the two directions, on one joint."""
    j = drives.joint()
    slope = drives.around(0.8) * drives.viscous[j]
    forward = drives.dq[:, j] > 0.0
    drives.torque[:, j] += slope * np.where(forward, drives.dq[:, j], -drives.dq[:, j])
    drives.truth = {"joint": j, "slope": slope}


def torque_drift(drives: Drives) -> None:
    """The zero of one torque sensor wanders steadily."""
    j = drives.joint()
    rate = drives.around(1.5) * drives.size[j] / (drives.time[-1] - drives.time[0])
    drives.torque[:, j] += rate * (drives.time - drives.time.mean())
    drives.truth = {"joint": j, "rate": rate}


def torque_gain(drives: Drives) -> None:
    """One torque reads too much."""
    j = drives.joint(1, drives.q.shape[1] - 2)
    gain = drives.around(0.12)
    drives.torque[:, j] *= 1.0 + gain
    drives.truth = {"joint": j, "gain": gain}


def torque_ripple(drives: Drives) -> None:
    """Torque rises and falls many times in a turn of one joint."""
    j = drives.joint()
    times, size = int(drives.random.integers(8, 40)), drives.around(0.3) * drives.size[j]
    phase = drives.random.uniform(0.0, 2.0 * np.pi)
    drives.torque[:, j] += size * np.sin(times * drives.q[:, j] + phase)
    drives.truth = {"joint": j, "per_turn": times, "torque": size}


def backlash(drives: Drives) -> None:
    """After each reversal friction turns only once a width has been travelled, on one joint."""
    j = drives.joint()
    width = drives.around(0.06)
    q, sign = drives.q[:, j], np.sign(drives.dq[:, j])
    turns = np.flatnonzero(np.diff(sign) != 0) + 1
    since = np.full(len(q), np.inf)
    for start, stop in zip(turns, [*turns[1:], len(q)], strict=True):
        since[start:stop] = np.abs(q[start:stop] - q[start])
    missing = np.clip(1.0 - since / width, 0.0, 1.0)
    drives.torque[:, j] -= 2.0 * drives.coulomb[j] * sign * missing
    drives.truth = {"joint": j, "width": width}


def joint_elasticity(drives: Drives) -> None:
    """Encoders sit on the motors; links lag behind as gears wind up."""
    compliance = drives.around(4e-4)
    wound = compliance * drives.dynamics.torque
    drives.seen += wound
    motor = drives.dq + np.gradient(wound, drives.time, axis=0)
    drives.torque += drives.coulomb * (np.sign(motor) - np.sign(drives.dq))
    drives.torque += drives.viscous * (motor - drives.dq)
    drives.truth = {"compliance": compliance}


def rotor_inertia(drives: Drives) -> None:
    """The motors' rotors, geared, are accelerated as well."""
    j = drives.joint(1)
    inertia = drives.around(1.0) * drives.size[j] / 2.0
    drives.torque[:, j] += inertia * drives.ddq[:, j]
    drives.truth = {"joint": j, "inertia": inertia}


def joint_coupling(drives: Drives) -> None:
    """The motion of a neighbour drags on a joint, as in a differential wrist."""
    j = drives.joint(1)
    rub = drives.around(0.6) * drives.size[j]
    neighbour = drives.dq[:, j - 1]
    drives.torque[:, j] += rub * np.sign(neighbour) + 0.5 * rub * neighbour
    drives.truth = {"joint": j, "by": j - 1, "torque": rub}


def link_cable(drives: Drives) -> None:
    """A cable pulls with a constant force on one of the outer links."""
    at = drives.joint(3)
    level = drives.random.uniform(-np.pi, np.pi)
    force = drives.around(12.0) * np.array([np.cos(level), np.sin(level), 0.0])
    where = drives.dynamics.places[at]
    for k in range(at + 1):
        arm = np.cross(where - drives.dynamics.places[k], force)
        drives.torque[:, k] -= np.sum(drives.dynamics.axes[k] * arm, axis=1)
    drives.truth = {"joint": at, "force": force.tolist()}


def base_tilt(drives: Drives) -> None:
    """The base leans: gravity is not along its z axis."""
    lean, way = drives.around(np.deg2rad(3.0)), drives.random.uniform(-np.pi, np.pi)
    gravity = 9.81 * np.array(
        [np.sin(lean) * np.cos(way), np.sin(lean) * np.sin(way), -np.cos(lean)]
    )
    drives.torque += drives.tilted(gravity) - drives.dynamics.torque
    drives.truth = {"lean_deg": float(np.rad2deg(lean)), "towards_deg": float(np.rad2deg(way))}


def torque_delay(drives: Drives) -> None:
    """Torques are stamped later than positions."""
    late = drives.around(0.012)
    shifted = [np.interp(drives.time - late, drives.time, one) for one in drives.torque.T]
    drives.torque[:] = np.stack(shifted, axis=1)
    drives.truth = {"delay": late}


CATALOGUE: dict[str, Callable[[Drives], None]] = {
    law.__name__: law
    for law in (
        stribeck_friction,
        load_dependent_friction,
        friction_warming,
        directional_friction,
        rotor_inertia,
        joint_elasticity,
        backlash,
        joint_coupling,
        link_cable,
        base_tilt,
        torque_drift,
        torque_gain,
        torque_ripple,
        torque_delay,
    )
}
"""Hidden laws by the names of the effects that they are."""
LAST = ("torque_gain", "torque_delay")
"""What acts on the whole torque that is read, and so after all others."""


def sticky_patch(drives: Drives) -> None:
    """One joint rubs harder in a part of its range; no effect of the catalogue."""
    j = drives.joint()
    middle, width = np.median(drives.q[:, j]), 0.25 * np.std(drives.q[:, j])
    bump = np.exp(-0.5 * ((drives.q[:, j] - middle) / width) ** 2)
    drives.torque[:, j] += drives.around(1.0) * drives.coulomb[j] * bump * np.sign(drives.dq[:, j])
    drives.truth = {"joint": j}


def swinging_load(drives: Drives) -> None:
    """Something hangs from the last links and swings at a frequency of its own."""
    swing = np.sin(2.0 * np.pi * 1.7 * drives.time)
    drives.torque[:, -3:] += drives.around(1.0) * drives.size[-3:] * swing[:, None]
    drives.truth = {"hz": 1.7}


OUTSIDE: dict[str, Callable[[Drives], None]] = {
    law.__name__: law for law in (sticky_patch, swinging_load)
}
"""Laws that no effect of the catalogue is: a diagnosis must call them unexplained, or name what
they truly look like."""
