"""Clean recordings whose contacts stay at their places on the object.

Their points are published through the tracked pose, so that the pose's noise is common to both
(`carried`), or are measured with noise of their own, as by the joints of a hand.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from tactile_dynamics_ros.core.streams.streams import ContactStream, PoseStream, Streams
from tactile_dynamics_ros.synthetic import randomness
from tactile_dynamics_ros.synthetic.motion import MotionSamples
from tactile_dynamics_ros.synthetic.objects import HeldObject

Push = Callable[[MotionSamples], np.ndarray]

_GRAVITY = np.array([0.0, 0.0, -9.81])
_STEP_S = 1e-3
_ROUNDS = 3


@dataclass(frozen=True)
class CarriedOptions:
    """How the object is held and measured.

    Attributes:
        carried: contact points and frames are those of the object, put into the world by the
            tracked pose; if not, they are exact but for `point_std`.
        fingers: number of contacts, 3 or more.
        duration: s. rate_hz: of all streams, which share their stamps.
        force_std: N per axis. position_std: m, rotation_std: rad, white noise of the pose.
        point_std: m per axis, noise that the points have of their own.
        squeeze: N, with which each finger presses towards the middle of the contacts.
        torsion: m, largest torque of each finger about its normal over its normal force; the
            fingers keep their attitude in the world while the object turns. Empty for none.
        twist_stiffness: N m/rad, of the elastic twist before a finger slips.
        drawn: body, motion and places are drawn from the seed; if not, they are always the same.
    """

    carried: bool = True
    fingers: int = 3
    duration: float = 20.0
    rate_hz: float = 50.0
    force_std: float = 0.03
    position_std: float = 2e-4
    rotation_std: float = 1e-3
    point_std: float = 0.0
    squeeze: float = 3.0
    torsion: tuple[float, ...] = ()
    twist_stiffness: float = 0.06
    drawn: bool = True


@dataclass(frozen=True)
class CarriedRecording:
    """What was recorded, and the truth that the estimation side never sees."""

    streams: Streams
    body: HeldObject
    options: CarriedOptions

    def truth(self) -> dict[str, Any]:
        """The body as plain numbers."""
        return {
            "mass": self.body.mass,
            "com": self.body.com.tolist(),
            "inertia_com": self.body.inertia_com.tolist(),
        }


@dataclass(frozen=True)
class _Tones:
    """offset + size sin(rate t + phase) per axis, of position (m) and of the rotation vector."""

    offset: np.ndarray
    size: np.ndarray
    rate: np.ndarray
    phase: np.ndarray

    def at(self, time: np.ndarray) -> np.ndarray:
        return self.offset + self.size * np.sin(self.rate * time[:, None] + self.phase)


def generate_carried(
    seed: int, options: CarriedOptions | None = None, hidden: Push | None = None
) -> CarriedRecording:
    """Generate a recording of a body that nothing but its contacts and gravity acts on.

    Args:
        seed: of everything that is drawn.
        options: how the object is held and measured.
        hidden: wrench (N, 6) [torque about the origin, force], world axes, that acts besides.
    """
    options = options or CarriedOptions()
    rng = randomness.stream(seed, "carried")
    body, points, position, turn = _draw(rng, options) if options.drawn else _always(options)
    time = np.arange(round(options.duration * options.rate_hz)) / options.rate_hz
    motion = _motion(time, position, turn)
    wrench = body.inertial_wrench(motion, _GRAVITY)
    if hidden is not None:
        wrench = wrench - hidden(motion)
    arms = np.stack([motion.to_world(point) for point in points], axis=1)
    squeeze = _squeeze(arms, options)
    force = _shares(arms, wrench) - squeeze
    if options.torsion:
        normal = np.stack([motion.to_world(_frame(points, k)[:, 2]) for k in range(len(points))], 1)
        for _ in range(_ROUNDS):
            torque = _torsion(time, normal, turn, np.einsum("nci,nci->nc", force, normal), options)
            held = np.concatenate([torque, np.zeros_like(torque)], axis=1)
            force = _shares(arms, wrench - held) - squeeze
    noise = randomness.stream(seed, "carried noise")
    streams = _measure(motion, points, force, options, noise)
    return CarriedRecording(streams, body, options)


def _always(options: CarriedOptions) -> tuple[HeldObject, np.ndarray, _Tones, _Tones]:
    points = 1e-3 * np.array(
        [[40.0, 0.0, 0.0], [-20.0, 35.0, 10.0], [-20.0, -35.0, -10.0], [0.0, 0.0, 40.0]]
    )
    inertia = 1e-4 * np.diag([3.0, 2.5, 2.0])
    body = HeldObject("box", 0.08 * np.ones(3), 0.25, 1e-3 * np.array([5.0, -3.0, 20.0]), inertia)
    place = np.array([0.5, 0.0, 0.6])
    position = _Tones(place, 0.05 * np.ones(3), np.array([2.1, 1.7, 1.1]), np.zeros(3))
    rates, phases = np.array([1.3, 1.9, 0.7]), np.array([0.0, 0.4, 1.0])
    return body, points[: options.fingers], position, _Tones(0 * place, 0.8, rates, phases)


def _draw(
    rng: np.random.Generator, options: CarriedOptions
) -> tuple[HeldObject, np.ndarray, _Tones, _Tones]:
    mass, size = float(rng.uniform(0.15, 0.8)), rng.uniform(0.06, 0.1, size=3)
    inertia = mass / 12.0 * np.diag(size @ size - size**2) * rng.uniform(0.8, 1.2)
    axes = Rotation.random(random_state=int(rng.integers(2**31))).as_matrix()
    body = HeldObject("box", size, mass, rng.uniform(-0.02, 0.02, size=3), axes @ inertia @ axes.T)
    around = np.linspace(0.0, 2.0 * np.pi, options.fingers, endpoint=False)
    around = around + rng.uniform(-0.3, 0.3, size=options.fingers)
    height = rng.uniform(-0.015, 0.015, size=options.fingers)
    radius = rng.uniform(0.03, 0.045, size=options.fingers)
    points = np.stack([radius * np.cos(around), radius * np.sin(around), height], axis=1)
    place, zero = np.array([0.5, 0.0, 0.6]), np.zeros(3)
    phases = rng.uniform(0.0, 2.0 * np.pi, size=(2, 3))
    shift = _Tones(place, rng.uniform(0.03, 0.07, size=3), rng.uniform(1.0, 5.0, size=3), phases[0])
    turn = _Tones(zero, rng.uniform(0.4, 0.9, size=3), rng.uniform(0.8, 3.0, size=3), phases[1])
    return body, points, shift, turn


def _motion(time: np.ndarray, position: _Tones, turn: _Tones) -> MotionSamples:
    """Rates by differences over a millisecond; they are exact to 1e-6."""
    before, now, after = (position.at(time + k * _STEP_S) for k in (-1, 0, 1))
    frames = [Rotation.from_rotvec(turn.at(time + k * _STEP_S)) for k in (-1, 0, 1)]
    left = (frames[1] * frames[0].inv()).as_rotvec() / _STEP_S
    right = (frames[2] * frames[1].inv()).as_rotvec() / _STEP_S
    return MotionSamples(
        time=time,
        position=now,
        velocity=(after - before) / (2.0 * _STEP_S),
        acceleration=(after - 2.0 * now + before) / _STEP_S**2,
        rotation=frames[1].as_matrix(),
        angular_velocity=0.5 * (left + right),
        angular_acceleration=(right - left) / _STEP_S,
    )


def _shares(arms: np.ndarray, wrench: np.ndarray) -> np.ndarray:
    """(N, C, 3) smallest forces at the arms (N, C, 3) with this wrench (N, 6) [torque, force]."""
    count, fingers = arms.shape[:2]
    grasp = np.zeros((count, 6, fingers, 3))
    for axis in range(3):
        unit = np.eye(3)[axis]
        grasp[:, :3, :, axis] = np.swapaxes(np.cross(arms, unit), 1, 2)
        grasp[:, 3 + axis, :, axis] = 1.0
    flat = grasp.reshape(count, 6, 3 * fingers)
    force = np.linalg.pinv(flat) @ wrench[:, :, None]
    return force.reshape(count, fingers, 3)


def _frame(points: np.ndarray, index: int) -> np.ndarray:
    """(3, 3) contact frame on the object; z points to the middle of the contacts."""
    inward = points.mean(axis=0) - points[index]
    return Rotation.align_vectors([inward], [[0.0, 0.0, 1.0]])[0].as_matrix()


def _torsion(
    time: np.ndarray,
    normal: np.ndarray,
    turn: _Tones,
    pressing: np.ndarray,
    options: CarriedOptions,
) -> np.ndarray:
    """(N, 3) torque of all fingers on the object, world axes.

    The twist of a finger is what it has turned less what it has slipped; it slips as much as keeps
    the elastic torque within its limit. Followed at a millisecond.
    """
    fine = np.arange(time[0], time[-1] + 0.5 * _STEP_S, _STEP_S)
    frames = Rotation.from_rotvec(turn.at(fine))
    turned = (frames[1:] * frames[:-1].inv()).as_rotvec()
    total = np.zeros((len(time), 3))
    for finger, coefficient in enumerate(options.torsion):
        axis = np.stack([np.interp(fine, time, column) for column in normal[:, finger].T], axis=1)
        angle = np.append(0.0, np.cumsum(np.einsum("ni,ni->n", turned, axis[:-1])))
        reach = coefficient * np.interp(fine, time, np.maximum(pressing[:, finger], 0.0))
        reach = reach / options.twist_stiffness
        slipped, twist = 0.0, np.zeros(len(fine))
        for k in range(len(fine)):
            slipped = min(max(slipped, angle[k] - reach[k]), angle[k] + reach[k])
            twist[k] = angle[k] - slipped
        torque = -options.twist_stiffness * np.interp(time, fine, twist)
        total += torque[:, None] * normal[:, finger]
    return total


def _squeeze(arms: np.ndarray, options: CarriedOptions) -> np.ndarray:
    """(N, C, 3) forces away from the middle, without a wrench together."""
    return options.squeeze * (arms - arms.mean(axis=1, keepdims=True)) / 0.04


def _measure(
    motion: MotionSamples,
    points: np.ndarray,
    force: np.ndarray,
    options: CarriedOptions,
    rng: np.random.Generator,
) -> Streams:
    count = len(motion.time)
    turned = Rotation.from_rotvec(options.rotation_std * rng.normal(size=(count, 3))).as_matrix()
    rotation = turned @ motion.rotation
    position = motion.position + options.position_std * rng.normal(size=(count, 3))
    variances = np.repeat([options.rotation_std**2, options.position_std**2], 3)
    covariance = np.broadcast_to(np.diag(variances), (count, 6, 6)).copy()
    pose = PoseStream(motion.time, position, rotation, covariance)
    contacts = {}
    for index, point in enumerate(points):
        name = f"finger_{index + 1}"
        shown = (rotation, position) if options.carried else (motion.rotation, motion.position)
        contacts[name] = ContactStream(
            name=name,
            time=motion.time,
            force=force[:, index] + options.force_std * rng.normal(size=(count, 3)),
            torque=np.zeros((count, 3)),
            force_std=np.full((count, 3), options.force_std),
            pose_time=motion.time,
            position=shown[1] + shown[0] @ point + options.point_std * rng.normal(size=(count, 3)),
            rotation=shown[0] @ _frame(points, index),
        )
    return Streams(pose, contacts)
