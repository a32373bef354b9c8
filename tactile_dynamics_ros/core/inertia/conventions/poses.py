"""Readings of poses and stamps: order, inverse, angles, units, direction of gravity."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np
from scipy.spatial.transform import Rotation

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.inertia.conventions.angles import angle_readings
from tactile_dynamics_ros.core.inertia.conventions.balance import net_force
from tactile_dynamics_ros.core.inertia.conventions.motions import Motions
from tactile_dynamics_ros.core.inertia.conventions.reading import (
    Reading,
    of_contacts,
    turned_world,
    with_pose,
)
from tactile_dynamics_ros.core.rigid_body.rotation import skew, upright
from tactile_dynamics_ros.core.streams.streams import ContactStream, PoseStream, Streams

_TILT = 0.3
"""Angle, rad, from -z up to which a world that leans is the effect `gravity_tilt`, whose prior has
this standard deviation. Below, cables and springs are held against it; at 0.1 they are called a
convention, at 1 worlds between are found by nothing."""
_AXIS = 0.05
"""Angle, rad, from an axis up to which gravity acts along it: 3 deg, as worlds are levelled to."""


def gravity_by_imu(streams: Streams) -> Array | None:
    """Direction (3,) of gravity that the forces show, recorded world.

    f = m (a - g) + R b + m R ([w'] + [w]^2) c is linear in m, m g, b and m c; the mass by the
    acceleration decides the sign.

    Args:
        streams: measurements whose contacts share their stamps.

    Returns:
        A unit vector; None near -z or an axis, and where no pose says the accelerations.
    """
    if streams.pose is None or streams.imu is not None:
        return None
    stamps = next(iter(streams.contacts.values())).time
    course = Motions().read(streams, stamps)
    motion, valid = course.motion, course.valid
    rate = skew(motion.angular_velocity_B)
    turning = motion.rotation @ (skew(motion.angular_acceleration_B) + rate @ rate)
    still = np.broadcast_to(np.eye(3), motion.rotation.shape)
    parts = [motion.acceleration[..., None], still, motion.rotation, turning]
    columns = np.concatenate(parts, axis=2)[valid]
    force = net_force(streams)[valid]
    if len(force) < columns.shape[2]:
        return None
    flat = columns.reshape(-1, columns.shape[2])
    found = np.linalg.lstsq(flat, force.ravel(), rcond=None)[0]
    down = -found[1:4] * np.sign(found[0])
    length = float(np.linalg.norm(down))
    if length == 0.0:
        return None
    down = down / length
    near = np.abs(down).max() > np.cos(_AXIS) or -down[2] > np.cos(_TILT)
    return None if near else np.asarray(down)


Turn = Callable[[Array], Array]

_LENGTHS = {"mm": 1e-3, "cm": 1e-2, "inches": 0.0254}
"""Metres per unit that trackers report, the commonest first. Definitions; a unit that is missing
here is not found, each costs three readings to be weighed."""
_TIMES = {"ms": 1e-3, "us": 1e-6, "ns": 1e-9}
"""Seconds per unit of stamps. Definitions: those of ROS headers and of loggers; a unit that is
missing here is not found."""
_GRAVITY = {
    "up": (0.0, 0.0, 1.0),
    "along x": (1.0, 0.0, 0.0),
    "along -x": (-1.0, 0.0, 0.0),
    "along y": (0.0, 1.0, 0.0),
    "along -y": (0.0, -1.0, 0.0),
}
"""Directions of gravity in a world whose z is not up, which people choose. Others are read off the
forces; each direction more costs a reading to be weighed."""
_WHERE = {True: "of contacts too", False: "contacts are right as they are"}
"""How a reading of the pose says whether contacts were put into the world by it. Words for people,
no number."""


def pose_readings(streams: Streams) -> list[Reading]:
    """Readings of the pose of the object and of all stamps."""
    found = [falling(where, np.array(direction)) for where, direction in _GRAVITY.items()]
    specific_force = gravity_by_imu(streams)
    if specific_force is not None:
        found.append(falling(f"along {write_direction(specific_force)}", specific_force))
    found += [
        Reading("time_unit", f"stamps are in {unit}, not s", partial(slower, scale=scale))
        for unit, scale in _TIMES.items()
    ]
    if streams.pose is None:
        return found
    for carried in (True, False):
        found += [
            _turned("quaternion_order", "quaternions are w, x, y, z", _from_wxyz, carried),
            _turned("quaternion_order", "quaternions are x, y, z, w", _from_xyzw, carried),
            _turned("inverse_rotation", "rotations are those of the world in the object", _inverse,
                    carried),
            _inverted(carried),
            *[_mirrored(axis, carried) for axis in range(3)],
        ]  # fmt: skip
        found += angle_readings(carried)
    return found + _lengths()


def slower(streams: Streams, scale: float) -> Streams:
    """Streams with all stamps multiplied, from the first on."""

    def timed(contact: ContactStream) -> ContactStream:
        return replace(contact, time=scale * contact.time, pose_time=scale * contact.pose_time)

    found = of_contacts(streams, timed)
    pose = found.pose and replace(found.pose, time=scale * found.pose.time)
    imu = found.imu and replace(found.imu, time=scale * found.imu.time)
    return replace(found, pose=pose, imu=imu)


def falling(where: str, direction: Array) -> Reading:
    """Gravity along a direction (3,) of the recorded world."""
    text = f"gravity acts {where} in the recorded world, whose z is not up"
    return Reading("gravity_direction", text, partial(turned_world, turn=upright(direction)))


def write_direction(direction: Array) -> str:
    """``(0.352, -0.763, 0.542)``, as `--assume gravity_direction=` takes it without brackets."""
    return f"({', '.join(f'{part:.3f}' for part in direction)})"


def _turned(name: str, text: str, turn: Turn, carried: bool) -> Reading:
    def apply(streams: Streams) -> Streams:
        assert streams.pose is not None
        pose = replace(streams.pose, rotation=turn(streams.pose.rotation))
        return with_pose(streams, pose, carried)

    return Reading(name, f"{text} ({_WHERE[carried]})", apply)


def _inverted(carried: bool) -> Reading:
    """The whole pose is that of the world in the object."""

    def apply(streams: Streams) -> Streams:
        pose = streams.pose
        assert pose is not None
        rotation = np.swapaxes(pose.rotation, 1, 2)
        position = -np.einsum("nij,nj->ni", rotation, pose.position)
        return with_pose(streams, replace(pose, rotation=rotation, position=position), carried)

    text = f"poses are those of the world in the object ({_WHERE[carried]})"
    return Reading("inverse_rotation", text, apply)


def _mirrored(axis: int, carried: bool) -> Reading:
    """A left-handed world."""
    mirror = np.eye(3)
    mirror[axis, axis] = -1.0

    def apply(streams: Streams) -> Streams:
        pose = streams.pose
        assert pose is not None
        turned = replace(
            pose, position=pose.position @ mirror, rotation=mirror @ pose.rotation @ mirror
        )
        return with_pose(streams, turned, carried)

    text = f"poses are in a left-handed world: mirror {'xyz'[axis]} ({_WHERE[carried]})"
    return Reading("mirrored_axes", text, apply)


def _inverse(rotation: Array) -> Array:
    return np.swapaxes(rotation, 1, 2)


def _from_wxyz(rotation: Array) -> Array:
    """Rotations whose quaternions w, x, y, z were taken as x, y, z, w."""
    w, x, y, z = Rotation.from_matrix(rotation).as_quat().T
    return np.asarray(Rotation.from_quat(np.stack([x, y, z, w], axis=1)).as_matrix())


def _from_xyzw(rotation: Array) -> Array:
    """Rotations whose quaternions x, y, z, w were taken as w, x, y, z."""
    x, y, z, w = Rotation.from_matrix(rotation).as_quat().T
    return np.asarray(Rotation.from_quat(np.stack([w, x, y, z], axis=1)).as_matrix())


def _lengths() -> list[Reading]:
    found = []
    for unit, scale in _LENGTHS.items():
        for pose, contacts in ((True, True), (True, False), (False, True)):
            what = {(True, True): "positions", (True, False): "positions of the object"}
            text = f"{what.get((pose, contacts), 'positions of contacts')} are in {unit}, not m"
            apply = partial(shorter, scale=scale, of_pose=pose, of_contacts_too=contacts)
            found.append(Reading("position_unit", text, apply))
    return found


def shorter(streams: Streams, scale: float, of_pose: bool, of_contacts_too: bool) -> Streams:
    """Streams with positions of the object, of contacts or of both multiplied."""
    found = streams
    if of_contacts_too:
        found = of_contacts(found, lambda c: replace(c, position=scale * c.position))
    if of_pose and found.pose is not None:
        found = replace(found, pose=_shorter_pose(found.pose, scale))
    return found


def _shorter_pose(pose: PoseStream, scale: float) -> PoseStream:
    covariance = pose.covariance
    if covariance is not None:
        factors = np.repeat([1.0, scale], 3)
        covariance = covariance * np.outer(factors, factors)
    return replace(pose, position=scale * pose.position, covariance=covariance)
