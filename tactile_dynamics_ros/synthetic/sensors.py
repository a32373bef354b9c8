"""What sensors make of the truth: sampling, noise, stamps, gaps; the result is `Streams`."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from tactile_dynamics_ros.core.streams.streams import ContactStream, PoseStream, Streams
from tactile_dynamics_ros.synthetic import randomness
from tactile_dynamics_ros.synthetic.scenario import FINGERS, Truth


@dataclass(frozen=True)
class SensorOptions:
    """Rates, noise and defects of the sensors.

    Attributes:
        force_rate_hz, pose_rate_hz: sampling rates.
        force_std: white noise per force axis, N.
        position_std: white noise per axis of the object position, m.
        rotation_std_deg: white noise per axis of the object rotation.
        contact_position_std: white noise per axis of the contact points, m.
        stagger: fingers and poses are sampled at different phases of the period.
        pose_gaps: how many gaps of up to 0.3 s the pose stream has.
        state_force_std: whether the force noise is stated in the recording.
        zero_when_lifted: a lifted finger sends zeros instead of nothing.
        frames: contact frames turn with the "finger", or show the "normal" only.
    """

    force_rate_hz: float = 100.0
    pose_rate_hz: float = 100.0
    force_std: float = 0.03
    position_std: float = 0.0005
    rotation_std_deg: float = 0.2
    contact_position_std: float = 0.0
    stagger: bool = False
    pose_gaps: int = 0
    state_force_std: bool = True
    zero_when_lifted: bool = False
    frames: str = "finger"


@dataclass(frozen=True)
class Readings:
    """What the sensors report at every instant of the physical clock, before sampling.

    Attributes:
        time: (N,) s.
        weight: (N, C) contact weight, 0 without contact.
        force: (N, C, 3) on the object, axes of the contact frame (the sensor's axes).
        contact_position: (N, C, 3) world, m.
        contact_rotation: (N, C, 3, 3) R_WC.
        position: (N, 3) of the object, m.
        rotation: (N, 3, 3) R_WO.
        force_delay, contact_delay, pose_delay: s added to the stamps.
        frames: what the reported contact frames show, "finger" or "normal".
    """

    time: np.ndarray
    weight: np.ndarray
    force: np.ndarray
    contact_position: np.ndarray
    contact_rotation: np.ndarray
    position: np.ndarray
    rotation: np.ndarray
    force_delay: float = 0.0
    contact_delay: float = 0.0
    pose_delay: float = 0.0
    frames: str = "finger"

    @property
    def period(self) -> float:
        """Period of the physical clock, s."""
        return float(self.time[1] - self.time[0])


def perfect_readings(truth: Truth) -> Readings:
    """Return the readings of sensors without any error."""
    motion, contacts = truth.scene.motion, truth.scene.contacts
    world_rotation = motion.rotation[:, None] @ contacts.rotation
    arm = np.einsum("nij,ncj->nci", motion.rotation, contacts.point)
    return Readings(
        time=motion.time,
        weight=contacts.weight,
        force=np.einsum("ncji,ncj->nci", contacts.rotation, truth.contact_force),
        contact_position=motion.position[:, None] + arm,
        contact_rotation=world_rotation,
        position=motion.position,
        rotation=motion.rotation,
    )


def read_sensors(truth: Truth, effects: tuple, options: SensorOptions, seed: int) -> Streams:
    """Return what is recorded: transduction, noise, the sensors' outputs, sampling."""
    readings = perfect_readings(truth)
    for effect in effects:
        readings = effect.transduce(readings)
    rng = randomness.stream(seed, "noise")
    poses = _sample_pose(readings, options, rng)
    contacts = {}
    noise = options.force_std * rng.normal(size=readings.force.shape)
    noisy = _replace_force(readings, readings.force + noise)
    for effect in effects:
        noisy = effect.output(noisy)
    for index, name in enumerate(FINGERS):
        contacts[name] = _sample_contact(noisy, index, name, options, rng)
    return Streams(pose=poses, contacts=contacts)


def frame_from_normal(normal: np.ndarray) -> np.ndarray:
    """(N, 3, 3) the smallest rotation that takes world z to the normal (N, 3)."""
    x, y, z = normal.T
    half = np.sqrt(np.maximum(0.5 * (1 + z), 1e-12))
    quaternion = np.stack([-y / (2 * half), x / (2 * half), np.zeros_like(x), half], axis=-1)
    return Rotation.from_quat(quaternion).as_matrix()


def _replace_force(readings: Readings, force: np.ndarray) -> Readings:
    silent = readings.weight[..., None] == 0.0
    return Readings(**{**vars(readings), "force": np.where(silent, 0.0, force)})


def _ticks(readings: Readings, rate_hz: float, phase: float) -> np.ndarray:
    """Indices of the physical clock at which a sensor of the given rate samples."""
    step = 1.0 / (rate_hz * readings.period)
    ticks = np.round(np.arange(phase * step, len(readings.time), step)).astype(int)
    return np.unique(ticks[ticks < len(readings.time)])


def _sample_pose(
    readings: Readings, options: SensorOptions, rng: np.random.Generator
) -> PoseStream:
    phase = rng.uniform() if options.stagger else 0.0
    ticks = _ticks(readings, options.pose_rate_hz, phase)
    keep = np.ones(len(ticks), dtype=bool)
    for start in rng.uniform(0, readings.time[-1], size=options.pose_gaps):
        length = rng.uniform(0.05, 0.3)
        keep &= (readings.time[ticks] < start) | (readings.time[ticks] > start + length)
    ticks = ticks[keep]
    sigma = np.radians(options.rotation_std_deg)
    tilt = Rotation.from_rotvec(sigma * rng.normal(size=(len(ticks), 3))).as_matrix()
    variance = np.repeat([sigma**2, options.position_std**2], 3)
    return PoseStream(
        time=readings.time[ticks] + readings.pose_delay,
        position=readings.position[ticks] + options.position_std * rng.normal(size=(len(ticks), 3)),
        rotation=tilt @ readings.rotation[ticks],
        covariance=np.broadcast_to(np.diag(variance), (len(ticks), 6, 6)).copy(),
    )


def _sample_contact(
    readings: Readings, index: int, name: str, options: SensorOptions, rng: np.random.Generator
) -> ContactStream:
    phase = rng.uniform() if options.stagger else 0.0
    ticks = _ticks(readings, options.force_rate_hz, phase)
    if not options.zero_when_lifted:
        ticks = ticks[readings.weight[ticks, index] > 0.0]
    rotation = readings.contact_rotation[ticks, index]
    force = np.einsum("nij,nj->ni", rotation, readings.force[ticks, index])
    if "normal" in (options.frames, readings.frames):
        rotation = frame_from_normal(rotation[..., 2])
    scatter = options.contact_position_std * rng.normal(size=(len(ticks), 3))
    std = np.full(force.shape, options.force_std) if options.state_force_std else None
    return ContactStream(
        name=name,
        time=readings.time[ticks] + readings.force_delay,
        force=force,
        torque=np.zeros_like(force),
        force_std=std,
        pose_time=readings.time[ticks] + readings.contact_delay,
        position=readings.contact_position[ticks, index] + scatter,
        rotation=rotation,
    )
