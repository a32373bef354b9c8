"""Other readings of joint torques: signs, units, and the drives' own units such as amperes."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.joints.arm import Arm
from tactile_dynamics_ros.core.joints.prior import dispersion
from tactile_dynamics_ros.core.joints.samples import JointSamples
from tactile_dynamics_ros.core.streams.joint_streams import JointStreams

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
_BY_BODIES, _BY_MAKER, _UNKNOWN = 0.3, 0.05, 1.0
"""Std of the logarithm of a gain of drives by the URDF, by the maker or a paper, and of joints that
no body loads; as much in common for all, as magnets lose 0.1 % per K. Of an arm whose load was
weighed gains by its URDF were 5 to 40 % off, those of its controller 2 to 9 %."""
_CREEP = 0.01
"""Speed at which the friction that a controller adds changes its sign, rad/s."""
_DEGREES = 25.0
"""Position beyond which it is no angle in rad, rad: four turns; no arm's joint turns so far."""


@dataclass(frozen=True, eq=False)
class JointReading:
    """Another reading of the efforts.

    Attributes:
        name: of the convention. change: what is done, in a few words.
        factors: (n,) by which efforts are multiplied to be N m (N).
        gain_std: (n,) std of their logarithms where they are gains of drives; None: exact.
    """

    name: str
    change: str
    factors: Array
    gain_std: Array | None = None


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
    sign = found.sign
    names = [name for name, one in zip(samples.arm.names, sign, strict=True) if one < 0.0]
    of = "all joints" if len(names) == len(sign) else ", ".join(names)
    flipped = f", those of {of} negated" if names else ""
    if np.abs(size).max() < _ALIKE:
        return JointReading("torque_sign", f"torques of {of} negated", sign) if names else None
    if np.abs(size - np.log(_MILLI)).max() < _ALIKE:
        return JointReading("torque_unit", f"torques in N mm{flipped}", sign / _MILLI)
    return _by_bodies(found)


def _by_bodies(found: _Scales) -> JointReading:
    """Gains by the URDF's bodies where they load a joint, else as of the usual of those."""
    told = found.told & found.loaded
    size = np.abs(np.where(told, found.scale, 1.0))
    usual = np.exp(np.median(np.log(size[told]))) if told.any() else 1.0
    std = np.where(told, _BY_BODIES, _UNKNOWN)
    return _of_drives(found.sign / np.where(told, size, usual), std, "by the URDF's masses")


def read_currents(
    streams: JointStreams, targets: tuple[Array, Array] | None = None
) -> JointReading:
    """How efforts that are currents are read as torques.

    Args:
        streams: as recorded.
        targets: (N, n) torques and currents that the controller wanted: their ratio is its gain.
    """
    arm = Arm.from_urdf(streams.urdf, streams.names, "the arm's URDF")
    if targets is not None:
        speed = np.gradient(streams.position, streams.time, axis=0)
        columns = zip(targets[0].T, targets[1].T, speed.T, strict=True)
        gains = np.array([_ratio(*column) for column in columns])
        if gains.min() > 0.0:
            return by_maker(gains, "by the controller's target torques and currents")
    return _by_bodies(_scales(JointSamples.from_streams(streams, arm)))


def _ratio(torque: Array, current: Array, speed: Array) -> float:
    """Target torque per target current beside the friction that the controller adds; 0 if none."""
    way = np.tanh(speed / _CREEP)
    columns = np.stack([torque, way, speed, np.ones(len(way))], axis=1)
    found, _, rank, _ = np.linalg.lstsq(columns, current, rcond=None)
    return 1.0 / float(found[0]) if rank == 4 and found[0] > 0.0 else 0.0


def by_maker(gains: Array, source: str) -> JointReading:
    """Efforts as currents whose gains (n,), N m per unit, a maker or a paper states."""
    return _of_drives(gains, np.full(len(gains), _BY_MAKER), source)


def _of_drives(factors: Array, std: Array, source: str) -> JointReading:
    listed = ", ".join(f"{f:.3g}" for f in factors)
    change = f"efforts in the drives' own units (currents); N m per unit {source}: {listed}"
    return JointReading("drive_units", change, factors, std)


def reread(samples: JointSamples, reading: JointReading) -> JointSamples:
    """Samples with efforts in N m."""
    std = samples.gain_std if reading.gain_std is None else reading.gain_std
    return replace(samples.scaled(reading.factors), gain_std=std)


def assumed(streams: JointStreams, name: str) -> tuple[JointStreams, JointReading]:
    """A recording as it reads by a convention, and what that is.

    Args:
        streams: as recorded.
        name: of the convention; `drive_units=12,12,9.8` states the gains of drives.

    Raises:
        BadInputError: there is no such convention, or it would change nothing here.
    """
    name, _, stated = name.partition("=")
    if name not in NAMES or (stated and name != NAMES[-1]):
        raise BadInputError(
            f"--assume {name}: expected one of {', '.join(NAMES)}, or drive_units=G1,G2,.. with "
            "N m per unit of each joint"
        )
    streams = streams.raw
    arm = Arm.from_urdf(streams.urdf, streams.names, "the arm's URDF")
    if stated:
        known = by_maker(_stated_gains(stated, arm), "as stated")
        return streams.of(arm.names).scaled(known.factors, known.gain_std), known
    reading = find_reading(JointSamples.from_streams(streams, arm))
    if reading is None or reading.name != name:
        found = "N m as they are" if reading is None else f"{reading.name} ({reading.change})"
        raise BadInputError(f"--assume {name}: efforts read as {found}; leave it out")
    return streams.of(arm.names).scaled(reading.factors, reading.gain_std), reading


def _stated_gains(text: str, arm: Arm) -> Array:
    try:
        gains = np.array([float(one) for one in text.split(",")])
    except ValueError:
        gains = np.zeros(0)
    if len(gains) != len(arm.names) or not (np.isfinite(gains) & (gains != 0.0)).all():
        raise BadInputError(
            f"--assume drive_units={text}: expected a number, not zero, for each of "
            f"{', '.join(arm.names)}"
        )
    return gains


def in_common_units(loaded: JointStreams, empty: JointStreams) -> tuple[JointStreams, JointStreams]:
    """Two recordings of one arm in the units of the first; gains by the one without a payload.

    Args:
        loaded: as it was read, perhaps by uncertain gains.
        empty: as it was recorded.
    """
    if loaded.gains is None or loaded.gain_std is None:
        return loaded, empty
    raw = empty.of(loaded.names).raw
    if not (loaded.gain_std > _BY_MAKER).any():
        return loaded, raw.scaled(loaded.gains, loaded.gain_std)
    arm = Arm.from_urdf(loaded.urdf, loaded.names, "the arm's URDF")
    found = find_reading(JointSamples.from_streams(raw, arm))
    if found is None or found.gain_std is None:
        return loaded, raw.scaled(loaded.gains, loaded.gain_std)
    other = found.factors / loaded.gains
    return loaded.scaled(other, found.gain_std), raw.scaled(found.factors, found.gain_std)


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
        error = samples.effort[:, j, None] - columns @ found[:, None]
        left = float(np.mean(error**2))
        left *= dispersion(error / np.sqrt(max(left, 1e-300)), samples.length)
        scale[j], told[j] = found[0], found[0] ** 2 > _CLEAR**2 * gram[0, 0] * left
        power = np.array([0.0, np.mean(np.abs(speed)), np.mean(speed**2), 0.0])
        clear = (power @ found) ** 2 > _CLEAR**2 * left * float(power @ gram @ power)
        rubs[j] = np.sign(power @ found) if clear else 0.0
    return _Scales(scale, told, size > _MOVED * size.max(), rubs)
