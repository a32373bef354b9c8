"""What a logger writes before it gets a meaning: poses, readings in sensor axes, an IMU."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from tactile_dynamics_ros.core.streams.streams import ContactStream, ImuStream, PoseStream, Streams
from tactile_dynamics_ros.synthetic import randomness
from tactile_dynamics_ros.synthetic.effects import create_hidden_effect
from tactile_dynamics_ros.synthetic.objects import HeldObject
from tactile_dynamics_ros.synthetic.scenario import Scenario, ScenarioOptions, Truth

_GYRATION = 0.06
"""Radius of gyration of the load, m."""


@dataclass(frozen=True)
class SensorTable:
    """Readings of one force sensor on the object.

    Attributes:
        force: (N, 3) N on the object, sensor axes. torque: (N, 3) N m, or None.
        point: (N, 3) m, where it is, body frame. axes: (N, 3, 3) R_OS.
        force_std: N per axis.
    """

    force: np.ndarray
    torque: np.ndarray | None
    point: np.ndarray
    axes: np.ndarray
    force_std: float


@dataclass(frozen=True)
class Table:
    """Rows of a recording.

    Attributes:
        time: (N,) s.
        position: (N, 3) m. rotation: (N, 3, 3) R_WO: the pose as it is published.
        carrier: position and rotation by which contacts are put into the world.
        sensors: by name.
        specific_force: (N, 3) m/s^2 and gyro: (N, 3) rad/s of an IMU, or None.
        position_std: m. rotation_std: rad.
        turned: how often forces are turned from sensor to world axes: once is right.
    """

    time: np.ndarray
    position: np.ndarray
    rotation: np.ndarray
    carrier: tuple[np.ndarray, np.ndarray]
    sensors: dict[str, SensorTable]
    position_std: float
    rotation_std: float
    specific_force: np.ndarray | None = None
    gyro: np.ndarray | None = None
    turned: int = 1

    def streams(self) -> Streams:
        """Publish the rows as the product takes them."""
        count = len(self.time)
        variance = np.repeat([self.rotation_std**2, self.position_std**2], 3)
        covariance = np.broadcast_to(np.diag(variance), (count, 6, 6)).copy()
        imu = None
        if self.specific_force is not None:
            imu = ImuStream(self.time, None, self.gyro, self.specific_force)
        contacts = {name: self._contact(name, sensor) for name, sensor in self.sensors.items()}
        return Streams(
            PoseStream(self.time, self.position, self.rotation, covariance), contacts, imu
        )

    def _contact(self, name: str, sensor: SensorTable) -> ContactStream:
        position, rotation = self.carrier
        frame = rotation @ sensor.axes
        force = sensor.force
        torque = np.zeros_like(force) if sensor.torque is None else sensor.torque
        for _ in range(self.turned):
            force, torque = (np.einsum("nij,nj->ni", frame, v) for v in (force, torque))
        return ContactStream(
            name=name,
            time=self.time,
            force=force,
            torque=torque,
            force_std=np.full(force.shape, sensor.force_std),
            pose_time=self.time,
            position=position + np.einsum("nij,nj->ni", rotation, sensor.point),
            rotation=frame,
            carries_torque=sensor.torque is not None,
        )


@dataclass(frozen=True)
class WristOptions:
    """A load on the force/torque sensor of a robot's wrist.

    Attributes:
        duration: s. rate_hz: of all rows.
        effects: hidden effects with magnitudes; those that push the load.
        bias_n, bias_nm: size of a constant bias of the sensor.
        zeroed_at: s, when what the sensor reads then is taken for zero; None for never.
        imu: whether an IMU is recorded.
        force_std: N, torque_std: N m, position_std: m, rotation_std: rad, white noise per axis.
        acceleration_std: m/s^2, gyro_std: rad/s, of the IMU.
        band_hz: lowest and highest frequency of the motion.
    """

    duration: float = 20.0
    rate_hz: float = 50.0
    effects: tuple[tuple[str, float], ...] = ()
    bias_n: float = 0.0
    bias_nm: float = 0.0
    zeroed_at: float | None = None
    imu: bool = False
    force_std: float = 0.05
    torque_std: float = 0.003
    position_std: float = 1e-4
    rotation_std: float = 5e-4
    acceleration_std: float = 0.03
    gyro_std: float = 0.003
    band_hz: tuple[float, float] = (0.1, 0.6)


def wrist_load(seed: int) -> HeldObject:
    """Draw a load of about 1.1 kg whose centre is about (10, -20, 60) mm from the sensor."""
    rng = randomness.stream(seed, "wrist load")
    mass = 1.1 * float(np.exp(rng.uniform(-0.5, 0.5)))
    com = np.array([0.010, -0.020, 0.060]) + rng.uniform(-0.008, 0.008, 3)
    inertia = mass * _GYRATION**2 * np.diag(rng.uniform(0.5, 1.0, 3))
    inertia[2, 2] = min(inertia[2, 2], 0.95 * (inertia[0, 0] + inertia[1, 1]))
    return HeldObject("box", np.array([0.12, 0.1, 0.15]), mass, com, inertia)


def wrist_scenario(seed: int, options: WristOptions) -> Scenario:
    """Draw a load on the wrist of a robot that moves as robots do."""
    asked = ScenarioOptions(
        duration=options.duration,
        physics_rate_hz=options.rate_hz,
        band_hz=options.band_hz,
        position_peak=(0.05, 0.15),
        angle_peak_deg=(30.0, 60.0),
        finger_roll=False,
    )
    drawn = Scenario.draw(seed, asked)
    motion = replace(drawn.motion, mean_rotation=_mean_attitude(seed))
    return replace(drawn, motion=motion, body=wrist_load(seed))


def wrist_truth(seed: int, options: WristOptions) -> tuple[Truth, HeldObject]:
    """Simulate the load on the wrist."""
    scenario = wrist_scenario(seed, options)
    hidden = tuple(create_hidden_effect(n, size, seed, scenario) for n, size in options.effects)
    return scenario.simulate(hidden), scenario.body


def _mean_attitude(seed: int) -> np.ndarray:
    """A flange that looks down or forward, turned about the vertical: no axis is upside down."""
    rng = randomness.stream(seed, "attitude")
    turns = np.concatenate([rng.uniform(-0.5, 0.5, 2), rng.uniform(-1.2, 1.2, 1)])
    return np.asarray(Rotation.from_euler("xyz", turns).as_matrix())


def wrist_table(seed: int, options: WristOptions | None = None) -> tuple[Table, HeldObject]:
    """Rows of a wrist sensor, and the load."""
    options = options or WristOptions()
    truth, body = wrist_truth(seed, options)
    motion = truth.scene.motion
    rng = randomness.stream(seed, "wrist noise")
    count = len(motion.time)
    axes, place = _mounting(seed)
    moment = np.cross(truth.scene.contacts.point, truth.contact_force) + truth.contact_torque
    force, about = truth.contact_force.sum(1), moment.sum(1)
    torque = about - np.cross(place, force)
    bias = randomness.unit_vector(rng), randomness.unit_vector(rng)
    force = force @ axes + options.bias_n * bias[0]
    torque = torque @ axes + options.bias_nm * bias[1]
    if options.zeroed_at is not None:
        later = motion.time >= motion.time[0] + options.zeroed_at
        first = int(np.argmax(later))
        force, torque = (v - later[:, None] * v[first] for v in (force, torque))
    sensor = SensorTable(
        force=force + options.force_std * rng.normal(size=(count, 3)),
        torque=torque + options.torque_std * rng.normal(size=(count, 3)),
        point=np.broadcast_to(place, (count, 3)),
        axes=np.broadcast_to(axes, (count, 3, 3)),
        force_std=options.force_std,
    )
    tilt = Rotation.from_rotvec(options.rotation_std * rng.normal(size=(count, 3))).as_matrix()
    position = motion.position + options.position_std * rng.normal(size=(count, 3))
    rotation = tilt @ motion.rotation
    measured = gyro = None
    if options.imu:
        measured = motion.to_body(motion.acceleration - truth.scene.gravity)
        measured = measured + options.acceleration_std * rng.normal(size=(count, 3))
        gyro = motion.to_body(motion.angular_velocity)
        gyro = gyro + options.gyro_std * rng.normal(size=(count, 3))
    table = Table(
        motion.time, position, rotation, (position, rotation), {"wrist": sensor},
        options.position_std, options.rotation_std, measured, gyro,
    )  # fmt: skip
    return table, body


def _mounting(seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Axes and place of the sensor in the body frame: the frame itself, or turned and 5 cm off."""
    if seed % 2 == 0:
        return np.eye(3), np.zeros(3)
    rng = randomness.stream(seed, "mounting")
    axes = Rotation.from_rotvec([0.0, 0.0, rng.uniform(-1.0, 1.0)]).as_matrix()
    return axes, np.array([0.0, 0.0, -0.05])


def finger_table(
    seed: int, effects: tuple[tuple[str, float], ...] = (), duration: float = 20.0
) -> tuple[Table, HeldObject]:
    """Rows of four fingertips that hold an object, at 50 Hz."""
    asked = ScenarioOptions(
        duration=duration,
        physics_rate_hz=50.0,
        band_hz=(0.15, 1.0),
        angle_peak_deg=(20.0, 50.0),
        finger_roll=True,
    )
    scenario = Scenario.draw(seed, asked)
    hidden = tuple(create_hidden_effect(name, size, seed, scenario) for name, size in effects)
    truth = scenario.simulate(hidden)
    motion, contacts = truth.scene.motion, truth.scene.contacts
    rng = randomness.stream(seed, "finger noise")
    count, std, place_std, turn_std = len(motion.time), 0.03, 2e-4, 1e-3
    sensors = {}
    for index, name in enumerate(("index", "middle", "ring", "thumb")):
        axes = contacts.rotation[:, index]
        force = np.einsum("nji,nj->ni", axes, truth.contact_force[:, index])
        noisy = force + std * rng.normal(size=(count, 3))
        sensors[name] = SensorTable(noisy, None, contacts.point[:, index], axes, std)
    tilt = Rotation.from_rotvec(turn_std * rng.normal(size=(count, 3))).as_matrix()
    position = motion.position + place_std * rng.normal(size=(count, 3))
    exact = (motion.position, motion.rotation)
    rotation = tilt @ motion.rotation
    table = Table(motion.time, position, rotation, exact, sensors, place_std, turn_std)
    return table, scenario.body
