"""What effects of joints act on: the motion in blocks, and the torques of the model so far."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
from scipy.signal import savgol_filter

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.discrepancy.model.residual_model import Condition
from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.joints.arm import Motion
from tactile_dynamics_ros.core.joints.samples import JointSamples

_MOST_JOINTS = 3
"""Joints whose motion errors are held against: more would find by chance what goes together."""
_WINDOW, _DEGREE = 11, 4
"""Blocks over which loads are smoothed, and the degree of their polynomials: 0.44 s follow a motion
of 1.5 Hz to 3 %; half as long, noise of accelerations passed for elasticity in two of six clean
recordings of a heavy arm."""


@dataclass(frozen=True, eq=False)
class Situation:
    """A motion and the torques that a fitted model gives it.

    Effects that follow the torque, such as friction under load, follow that of this model and not
    the measured one, whose noise would stand on both sides.

    Attributes:
        samples: the motion.
        bodies: (n, 10) dynamic parameters of the links.
        payload: (10,) of the payload in the last link's frame, carried where samples are loaded.
        friction: (3, n) Coulomb friction, viscous friction and offset of each joint.
    """

    samples: JointSamples
    bodies: Array
    payload: Array
    friction: Array

    @cached_property
    def rigid(self) -> Array:
        """(K, 3, n) torques of the rigid bodies at three places of each block."""
        return np.stack([self._torque(motion) for motion in self.samples.motions], axis=1)

    def _torque(self, motion: Motion) -> Array:
        """(K, n) torques of links, and of the payload where it is carried."""
        arm, loaded = self.samples.arm, self.samples.loaded[:, None]
        last = np.zeros_like(self.bodies)
        last[-1] = self.payload
        return arm.torque(motion, self.bodies) + loaded * arm.torque(motion, last)

    @cached_property
    def load(self) -> Array:
        """(K, B, n) torques of the rigid bodies at each sample."""
        return self.samples.within(self.rigid, self.samples.places)

    @cached_property
    def rubbing(self) -> Array:
        """(K, B, n) plain friction at each sample."""
        coulomb, viscous, _ = self.friction
        return np.asarray(coulomb * self.samples.direction + viscous * self.samples.dq)

    @cached_property
    def total(self) -> Array:
        """(K, n) mean torque of each block."""
        return np.asarray((self.load + self.rubbing).mean(axis=1) + self.friction[2])

    def shifted(self, delay: float) -> Array:
        """(K, n) change of the mean torque of each block where torques are late by a delay, s."""
        samples = self.samples
        time, values = samples.t.reshape(-1), (self.load + self.rubbing)
        flat = values.reshape(len(time), -1)
        late = np.stack([np.interp(time - delay, time, one) for one in flat.T], axis=1)
        return np.asarray((late - flat).reshape(values.shape).mean(axis=1))

    @cached_property
    def wound_up(self) -> Array:
        """(K, n, n) change of torques (row) per compliance of a joint (column), (N m)^2/rad.

        Encoders on motors read q + c tau: links are where tau(q - c tau, ...) is. The derivative
        of the inverse dynamics along the load of one joint and its two rates.
        """
        samples = self.samples
        middle = samples.middle
        bend, way = self.rigid[:, 1], _smoothed(self.rigid[:, 1], samples)
        step = 1e-3 / max(float(np.abs(bend).max()), 1e-9)
        found = np.zeros((*bend.shape, bend.shape[1]))
        for j in range(bend.shape[1]):
            moved = middle.copy()
            moved[:, :, j] -= step * way[:, :, j]
            torque = self._torque(samples.arm.motion(*moved))
            found[:, :, j] = (torque - bend) / step
        return found

    def gravity_change(self, direction: Array) -> Array:
        """(K, n) torques that one more m/s^2 of gravity along a direction of the base makes."""
        middle = self.samples.middle[0]
        still = np.zeros_like(middle)
        return self._torque(self.samples.arm.motion(middle, still, still, direction))

    def pull_on(self, link: int) -> Array:
        """(K, n, 3) torques that the drives need where a force of 1 N pulls on a link's origin."""
        motion = self.samples.motions[1]
        felt = np.swapaxes(motion.twists[link][:, 3:], 1, 2) @ np.swapaxes(motion.turns[link], 1, 2)
        return np.asarray(-felt)


def _smoothed(values: Array, samples: JointSamples) -> Array:
    """(3, K, n) values of blocks (K, n) and two derivatives, by polynomials between gaps.

    Accelerations bring noise into loads that is also in the residual: differences from block to
    block would find it there. Rates are zero where less than a window lies between two gaps.
    """
    found = np.zeros((3, *values.shape))
    edges = [0, *(np.flatnonzero(~samples.follows) + 1), len(values)]
    for first, last in zip(edges[:-1], edges[1:], strict=True):
        part = values[first:last]
        found[0, first:last] = part
        for d in range(3 if len(part) >= _WINDOW else 0):
            found[d, first:last] = savgol_filter(
                part, _WINDOW, _DEGREE, deriv=d, delta=samples.length, axis=0
            )
    return found


@lru_cache(maxsize=4)
def joint_scalars(samples: JointSamples) -> dict[str, Condition]:
    """Scalars of blocks by symbol: `t`; `speed_`, `velocity_` and `position_` of each joint."""
    q, dq, _ = samples.middle
    found = [Condition("time", "s", samples.time, symbol="t")]
    for j, name in enumerate(samples.arm.names):
        unit = "m" if samples.arm.joints[j].slides else "rad"
        for kind, per, values in (
            ("speed", "/s", np.abs(dq[:, j])),
            ("velocity", "/s", dq[:, j]),
            ("position", "", q[:, j]),
        ):
            symbol = re.sub(r"\W", "_", f"{kind}_{name}")
            found.append(Condition(f"{kind} of {name}", unit + per, values, symbol=symbol))
    return {one.symbol: one for one in found}


def values_of(samples: JointSamples, symbol: str) -> Array:
    """Values (K,) of one scalar.

    Raises:
        BadInputError: there is none of that symbol.
    """
    known = joint_scalars(samples)
    if symbol not in known:
        raise BadInputError(f"regime: '{symbol}' is unknown; there are {', '.join(known)}")
    return known[symbol].values


def conditions_of(
    samples: JointSamples, white: Array, symbols: Sequence[str] = ()
) -> tuple[Condition, ...]:
    """What was going on: time; speed, velocity and position of the joints that err most.

    Args:
        samples: blocks.
        white: (K, n) residual.
        symbols: of scalars that are wanted too.
    """
    worst = np.argsort(-np.mean(white**2, axis=0), kind="stable")[:_MOST_JOINTS]
    scalars = joint_scalars(samples)
    each = list(scalars)[1:]
    wanted = ["t", *(each[3 * j + k] for j in worst for k in range(3)), *symbols]
    return tuple(scalars[symbol] for symbol in dict.fromkeys(wanted))
