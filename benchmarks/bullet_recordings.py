"""Recordings from the Bullet simulator with its own hidden effects, without nodes between.

The hand grasps, lifts and shakes an object; contacts come straight from the engine with white
noise, so that what is tested is the physics of an effect and not the fingertip sensors.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from tactile_dynamics_ros.core.manipulation.grasp_controller import (
    GraspConfig,
    GraspController,
    Phase,
)
from tactile_dynamics_ros.core.robot.hand_kinematics import HandKinematics
from tactile_dynamics_ros.core.robot.robot_file import DEFAULT_ROBOT, load_robot
from tactile_dynamics_ros.core.streams.streams import ContactStream, PoseStream, Streams
from tactile_dynamics_ros.sim.bodies import ContactReading
from tactile_dynamics_ros.sim.hidden_effects import HiddenEffect, SensorView, create_hidden_effect
from tactile_dynamics_ros.sim.world import HandWorld, WorldConfig
from tactile_dynamics_ros.synthetic import randomness
from tactile_dynamics_ros.synthetic.sensors import SensorOptions

PERIOD_S = 0.01


@dataclass(frozen=True)
class SimulatedRecording:
    """Streams of the shaking, the truth, and how the behaviour ended."""

    streams: Streams
    effect: HiddenEffect
    truth: dict[str, Any]
    phase: str


@dataclass
class _Log:
    pose_time: list[float] = field(default_factory=list)
    pose: list[np.ndarray] = field(default_factory=list)
    rows: dict[str, list[tuple]] = field(default_factory=dict)


def record_in_bullet(
    effect: str = "none",
    magnitude: float = 1.0,
    seed: int = 0,
    object_name: str = "potted_meat_can",
    sensors: SensorOptions | None = None,
    time_limit: float = 90.0,
    robot_name: str = DEFAULT_ROBOT,
    behaviour: GraspConfig | None = None,
) -> SimulatedRecording:
    """Grasp, lift and shake the object with the hidden effect; keep the shaking.

    Raises:
        RuntimeError: the hand never came to shake the object; tells why.
    """
    sensors = sensors or SensorOptions()
    hidden = create_hidden_effect(effect, magnitude, seed)
    log = _Log()
    robot = load_robot(robot_name)
    with HandWorld(WorldConfig(object_name=object_name), machine=robot) as world:
        world.reset(robot.start)
        hidden.attach(world)
        controller = GraspController(HandKinematics(robot), world.model.grasp, behaviour)
        steps = round(PERIOD_S / world.config.time_step)
        readings = world.contacts()
        while not controller.done and world.time < time_limit:
            forces = {
                name: readings[name].force for name in world.fingers if readings[name].in_contact
            }
            positions = world.joint_state().position
            pose = world.object_pose()
            world.command(controller.update(world.time, positions, forces, pose))
            world.step(steps)
            readings = world.contacts()
            if controller.phase is Phase.EXCITE:
                _note(log, world, hidden, readings)
        if not log.pose:
            raise RuntimeError(
                f"{object_name} with {hidden.name}: {controller.outcome or 'no shaking'}"
            )
        inertia = world.model.inertia
        truth = {"mass": inertia.mass, "com": inertia.com.tolist(), **hidden.describe()}
    return SimulatedRecording(
        _to_streams(log, sensors, seed), hidden, truth, controller.phase.value
    )


def _note(
    log: _Log, world: HandWorld, effect: HiddenEffect, readings: dict[str, ContactReading]
) -> None:
    pose = world.object_pose()
    frames = {
        name: world.link_pose(world.machine.sensor_frame(name))[:3, :3] for name in world.fingers
    }
    tips = {name: readings[name] for name in world.fingers}
    measured = effect.feel(SensorView(world.time, tips, frames, pose))
    log.pose_time.append(world.time + effect.delay("pose"))
    log.pose.append(effect.see(pose, world.time))
    for name, reading in measured.items():
        if reading.share == 1.0:
            rotation = _contact_frame(reading.normal, frames[name])
            stamp = reading.time + effect.delay("touch")
            row = (stamp, reading.force, reading.torque, reading.point, rotation)
            log.rows.setdefault(name, []).append(row)


def _contact_frame(normal: np.ndarray, sensor: np.ndarray) -> np.ndarray:
    """R_WC with z along the normal and x as near as possible to the sensor's x axis."""
    x = sensor[:, 0] - normal * (normal @ sensor[:, 0])
    x = x / np.linalg.norm(x)
    return np.stack([x, np.cross(normal, x), normal], axis=1)


def _to_streams(log: _Log, sensors: SensorOptions, seed: int) -> Streams:
    rng = randomness.stream(seed, "bullet noise")
    pose = np.array(log.pose)
    sigma = np.radians(sensors.rotation_std_deg)
    tilt = Rotation.from_rotvec(sigma * rng.normal(size=(len(pose), 3))).as_matrix()
    variance = np.diag(np.repeat([sigma**2, sensors.position_std**2], 3))
    poses = PoseStream(
        time=np.array(log.pose_time),
        position=pose[:, :3, 3] + sensors.position_std * rng.normal(size=(len(pose), 3)),
        rotation=tilt @ pose[:, :3, :3],
        covariance=np.broadcast_to(variance, (len(pose), 6, 6)).copy(),
    )
    contacts = {}
    for name, rows in log.rows.items():
        stamp, force, torque, point, rotation = map(np.array, zip(*rows, strict=True))
        noisy = force + sensors.force_std * rng.normal(size=force.shape)
        std = np.full(force.shape, sensors.force_std)
        contacts[name] = ContactStream(
            name, stamp, noisy, np.zeros_like(torque), std, stamp, point, rotation
        )
    return Streams(pose=poses, contacts=contacts)
