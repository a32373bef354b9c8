"""Other readings of joint torques: signs, units, and the drives' own units such as amperes."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.joints.arm import Arm
from tactile_dynamics_ros.core.joints.samples import JointSamples
from tactile_dynamics_ros.core.streams.joint_streams import JointStreams

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

NAMES = ("torque_sign", "torque_unit", "drive_units")
"""Names of the conventions, as `--assume` has them; they are API."""
_MILLI = 1e3
"""N mm in a N m: the one other unit of torque that drivers report."""
_ALIKE = 1.1
"""Logarithm of a scale up to which it is one: a factor of three. A payload may double the torques
that gravity makes, and a URDF may lack a hand; amperes per N m are a tenth, milliamperes a hundred.
Half of it would call a payload a unit."""
_CLEAR = 8.0
"""Scale of a joint over its std from which the recording tells it."""
_MOVED = 0.15
"""Torque of the bodies about a joint, over that of the joint with most, below which its scale is
not asked: friction and what the URDF leaves out are as large there."""
_DEGREES = 25.0
"""Position beyond which it is no angle in rad, rad: four turns; no arm's joint turns so far."""


@dataclass(frozen=True, eq=False)
class JointReading:
    """Another reading of the efforts.

    Attributes:
        name: of the convention. change: what is done, in a few words.
        factors: (n,) by which efforts are multiplied to be N m (N).
        gains_known: whether the factors are exact; those by the URDF's masses are not.
    """

    name: str
    change: str
    factors: Array
    gains_known: bool = True


def refuse_degrees(streams: JointStreams, arm: Arm) -> None:
    """Check that positions can be radians.

    Raises:
        BadInputError: they look like degrees.
    """
    turning = [k for k, joint in enumerate(arm.joints) if not joint.slides]
    position = streams.of(arm.names).position[:, turning]
    largest = float(np.nanmax(np.abs(position), initial=0.0))
    if largest > _DEGREES:
        raise BadInputError(
            f"joint positions reach {largest:.0f}; expected rad: they look like degrees, convert "
            "them (deg x 0.01745)"
        )


def find_reading(samples: JointSamples) -> JointReading | None:
    """The reading that the URDF's bodies ask for; None if efforts are N m as they are.

    Each joint's effort is regressed on the torque of the URDF's bodies and plain friction.
    """
    found = _scales(samples)
    scale, told = found.scale, found.told
    if not (told & found.loaded).any():
        return None
    size = np.log(np.abs(scale[told & found.loaded]))
    usual, sign = float(np.median(size)), found.sign
    names = [name for name, one in zip(samples.arm.names, sign, strict=True) if one < 0.0]
    of = "all joints" if len(names) == len(sign) else ", ".join(names)
    flipped = f", those of {of} negated" if names else ""
    if np.abs(size).max() < _ALIKE:
        return JointReading("torque_sign", f"torques of {of} negated", sign) if names else None
    if np.abs(size - np.log(_MILLI)).max() < _ALIKE:
        return JointReading("torque_unit", f"torques in N mm{flipped}", sign / _MILLI)
    factors = sign / np.where(told, np.abs(scale), np.exp(usual))
    listed = ", ".join(f"{f:.3g}" for f in factors)
    change = (
        f"efforts in the drives' own units (currents); N m per unit by the URDF's masses: {listed}"
    )
    return JointReading("drive_units", change, factors, gains_known=False)


def reread(samples: JointSamples, reading: JointReading) -> JointSamples:
    """Samples with efforts in N m."""
    known = samples.gains_known and reading.gains_known
    return replace(samples.scaled(reading.factors), gains_known=known)


def assumed(streams: JointStreams, name: str) -> tuple[JointStreams, JointReading]:
    """A recording as it reads by a convention, and what that is.

    Raises:
        BadInputError: there is no such convention, or it would change nothing here.
    """
    if name not in NAMES:
        raise BadInputError(f"--assume {name}: expected one of {', '.join(NAMES)}")
    arm = Arm.from_urdf(streams.urdf, streams.names, "the arm's URDF")
    reading = find_reading(JointSamples.from_streams(streams, arm))
    if reading is None or reading.name != name:
        found = "N m as they are" if reading is None else f"{reading.name} ({reading.change})"
        raise BadInputError(f"--assume {name}: efforts read as {found}; leave it out")
    return streams.of(arm.names).scaled(reading.factors, not reading.gains_known), reading


def in_common_units(loaded: JointStreams, empty: JointStreams) -> tuple[JointStreams, JointStreams]:
    """Two recordings of one arm in the units of the first; gains by the one without a payload.

    Args:
        loaded: as it was read, perhaps by uncertain gains.
        empty: as it was recorded.
    """
    if loaded.gains is None or empty.gains is not None:
        return loaded, empty
    arm = Arm.from_urdf(loaded.urdf, loaded.names, "the arm's URDF")
    first = empty.of(loaded.names).scaled(loaded.gains, uncertain=True)
    found = _scales(JointSamples.from_streams(first, arm))
    scale, told = found.scale, found.told
    usual = float(np.median(np.abs(scale[told]))) if told.any() else 1.0
    factors = 1.0 / np.where(told, np.abs(scale), usual)
    return loaded.scaled(factors, uncertain=True), first.scaled(factors, uncertain=True)


@dataclass(frozen=True, eq=False)
class _Scales:
    """Efforts of each joint over the torques of the URDF's bodies.

    Attributes:
        scale: (n,) effort per N m. told: (n,) where the recording tells it.
        loaded: (n,) joints that bodies load most: no payload turns their torque round.
        rubs: (n,) 1 where friction clearly resists motion, -1 where it clearly helps, else 0.
    """

    scale: Array
    told: Mask
    loaded: Mask
    rubs: Array

    @property
    def sign(self) -> Array:
        """(n,) -1 where efforts are negated: by the bodies, or by friction where those say little.

        Joints of which nothing is told go with the others.
        """
        by_bodies = np.where(self.told & self.loaded, np.sign(self.scale), 0.0)
        known = np.where(by_bodies != 0.0, by_bodies, self.rubs)
        others = -1.0 if (known[known != 0.0] < 0.0).all() else 1.0
        return np.where(known != 0.0, known, others)


def _scales(samples: JointSamples) -> _Scales:
    """Regress each joint's effort on the torque of the URDF's bodies and plain friction."""
    torque = samples.arm.torque(samples.motions[1], samples.arm.inertia)
    size, n = torque.std(axis=0), torque.shape[1]
    scale, rubs, told = np.ones(n), np.zeros(n), np.zeros(n, dtype=np.bool_)
    for j in range(n):
        way, speed = samples.direction[:, :, j].mean(axis=1), samples.dq[:, :, j].mean(axis=1)
        columns = np.stack([torque[:, j], way, speed, np.ones(len(way))], axis=1)
        gram = np.linalg.pinv(columns.T @ columns)
        found = gram @ (columns.T @ samples.effort[:, j])
        left = float(np.mean((samples.effort[:, j] - columns @ found) ** 2))
        scale[j], told[j] = found[0], found[0] ** 2 > _CLEAR**2 * gram[0, 0] * left
        power = np.array([0.0, np.mean(np.abs(speed)), np.mean(speed**2), 0.0])
        clear = (power @ found) ** 2 > _CLEAR**2 * left * float(power @ gram @ power)
        rubs[j] = np.sign(power @ found) if clear else 0.0
    return _Scales(scale, told, size > _MOVED * size.max(), rubs)
