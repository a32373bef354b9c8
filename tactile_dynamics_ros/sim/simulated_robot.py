"""The stand-in for the hardware: world, sensors and a hidden effect behind one interface."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.configuration import check_ranges, parameter
from tactile_dynamics_ros.core.robot.hand_kinematics import HandKinematics
from tactile_dynamics_ros.core.robot.robot_file import DEFAULT_ROBOT, load_robot
from tactile_dynamics_ros.sim.bodies import ContactReading
from tactile_dynamics_ros.sim.hidden_effects import SensorView, create_hidden_effect
from tactile_dynamics_ros.sim.sensors.biotac import BioTacConfig
from tactile_dynamics_ros.sim.sensors.depth_camera import (
    DepthCamera,
    DepthCameraConfig,
    look_at,
)
from tactile_dynamics_ros.sim.sensors.fingertips import (
    EncoderConfig,
    Fingertips,
    ForceTorquePads,
    JointEncoders,
    MarkerTracker,
    MarkerTrackerConfig,
    PadConfig,
    WristSensor,
    WristSensorConfig,
)
from tactile_dynamics_ros.sim.world import HandWorld, WorldConfig

Config = TypeVar("Config")

ERROR_WORDS = ("noise", "drift", "offset", "bias", "wander", "play", "loss", "variation", "stray")


@dataclass(frozen=True)
class SimulatedRobotConfig:
    """Object, sensors and disturbance of one run; everything random follows from the seed."""

    robot: str = parameter(DEFAULT_ROBOT, "file in config/robots, or path of a yaml file")
    seed: int = parameter(0, "of object placement, noise and hidden effect", "", 0)
    unit_seed: int = parameter(0, "of the fingertips: the same hand has the same ones", "", 0)
    place_spread: float = parameter(0.02, "largest shift of the object along x and y", "m", 0, 0.1)
    turn_spread_deg: float = parameter(15.0, "largest turn about the vertical", "deg", 0.0, 180.0)
    noise: bool = parameter(True, "whether sensors have noise, offsets and drift")
    vision_rate_hz: float = parameter(30.0, "rate of the marker tracker", "Hz", 0.0, 100.0)
    depth_rate_hz: float = parameter(0.0, "rate of the depth camera, 0 is off", "Hz", 0.0, 30.0)
    camera_position: tuple[float, ...] = parameter((0.75, -0.6, 0.45), "depth camera, world", "m")
    camera_target: tuple[float, ...] = parameter((0.42, 0.0, 0.18), "what it looks at, world", "m")
    hidden_effect: str = parameter("none", "disturbance by name, or none, random, outside")
    hidden_magnitude: float = parameter(1.0, "multiple of its typical size", "", 0.0, 100.0)
    world: WorldConfig = field(default_factory=WorldConfig)
    biotac: BioTacConfig = field(default_factory=BioTacConfig)
    pad: PadConfig = field(default_factory=PadConfig)
    encoders: EncoderConfig = field(default_factory=EncoderConfig)
    wrist: WristSensorConfig = field(default_factory=WristSensorConfig)
    marker: MarkerTrackerConfig = field(default_factory=MarkerTrackerConfig)
    camera: DepthCameraConfig = field(default_factory=DepthCameraConfig)

    def __post_init__(self) -> None:
        check_ranges(self)


@dataclass(frozen=True)
class Readings:
    """What all sensors report after one period.

    Attributes:
        time: s, of joints, wrist and images.
        joint_time: s, stamp of the joint positions. touch_time: s, stamp of the counts.
        position, velocity, effort: (J,) in the robot's order; rad, rad/s, N m.
        counts: (F, 44) raw BioTac counts, or None where the fingertips are none.
        wrenches: (F, 6) [torque, force] on the object of pads, sensor frames, or None.
        wrist: (6,) [torque, force] of the hand on the flange; whether it is saturated.
        vision: (4, 4) reported X_WO, or None when no frame is due or the object is lost.
        depth: (H, W) m, or None when no image is due.
    """

    time: float
    joint_time: float
    touch_time: float
    position: Array
    velocity: Array
    effort: Array
    counts: NDArray[np.uint16] | None
    wrenches: Array | None
    wrist: Array
    wrist_saturated: bool
    vision: Array | None
    depth: NDArray[np.float32] | None


class SimulatedRobot:
    """Arm, hand, object and all sensors.

    Args:
        config: of everything.
        period: s between readings.
    """

    def __init__(self, config: SimulatedRobotConfig | None = None, period: float = 0.01) -> None:
        config = config or SimulatedRobotConfig()
        self.config = config if config.noise else _without_errors(config)
        self.period = period
        self.machine = load_robot(config.robot)
        self.world = HandWorld(_placed(self.config), machine=self.machine)
        self.world.reset(self.machine.start)
        self.effect = create_hidden_effect(
            config.hidden_effect, config.hidden_magnitude, config.seed
        )
        self.effect.attach(self.world)
        seed = config.seed
        self._kinematics = HandKinematics(self.machine)
        self.tips: Fingertips | ForceTorquePads
        if self.machine.tips.kind == "biotac":
            fingers = self.machine.fingers
            self.tips = Fingertips(fingers, self.config.biotac, seed, config.unit_seed)
        else:
            self.tips = ForceTorquePads(self.machine.fingers, self.config.pad, seed)
        self._encoders = JointEncoders(self.machine, self.config.encoders, seed)
        self._wrist = WristSensor(self.config.wrist, seed)
        self.marker = MarkerTracker(self.config.marker, seed)
        self.camera = DepthCamera(self.config.camera, seed)
        self.camera_pose = look_at(
            np.array(self.config.camera_position), np.array(self.config.camera_target)
        )
        if self.config.depth_rate_hz > 0.0:
            self.camera.place_backdrop(self.world.hide_table())
        self._steps = max(1, round(period / self.world.config.time_step))
        self._last_position: Array | None = None

    def advance(self) -> Readings:
        """Simulate one period and read all sensors."""
        before = self.world.time
        self.world.step(self._steps)
        time, state = self.world.time, self.world.joint_state()
        pose = self.world.object_pose()
        contacts = self.world.contacts()
        position = self._encoders.read(state.position, state.effort)
        last = position if self._last_position is None else self._last_position
        self._last_position = position
        counts, wrenches = self._touch(contacts, state.position, pose, time)
        wrist, saturated = self._wrist.read(self.world.wrist_wrench(), self.period)
        return Readings(
            time=time,
            joint_time=time + self.effect.delay("pose"),
            touch_time=contacts[self.machine.fingers[0]].time + self.effect.delay("touch"),
            position=position,
            velocity=(position - last) / self.period,
            effort=state.effort,
            counts=counts,
            wrenches=wrenches,
            wrist=wrist,
            wrist_saturated=saturated,
            vision=self._look(pose, before, time),
            depth=self._photograph(before, time),
        )

    def reveal(self) -> dict[str, Any]:
        """Ground truth as plain numbers, ready for JSON."""
        truth = self.world.truth()
        return {
            "robot": self.config.robot,
            "object": truth.object_name,
            "mass": truth.inertia.mass,
            "com": truth.inertia.com.tolist(),
            "inertia_com": truth.inertia.inertia_com.tolist(),
            "dynamic_parameters": truth.inertia.dynamic_parameters.tolist(),
            "object_pose": truth.object_pose.tolist(),
            "friction": truth.friction,
            "gravity": truth.gravity.tolist(),
            "hidden_effect": self.effect.describe(),
            "time": self.world.time,
        }

    def _touch(
        self, contacts: Mapping[str, ContactReading], positions: Array, pose: Array, time: float
    ) -> tuple[NDArray[np.uint16] | None, Array | None]:
        fingers = self.machine.fingers
        sensors = self._kinematics.locate(positions).sensors
        rotations = {finger: sensors[k, :3, :3] for k, finger in enumerate(fingers)}
        tips = {finger: contacts[finger] for finger in fingers}
        measured = self.effect.feel(SensorView(time, tips, rotations, pose))
        if isinstance(self.tips, ForceTorquePads):
            return None, self.tips.read(measured, sensors)
        twist = self.world.object_velocity()
        return self.tips.read(measured, sensors, pose, twist, self.period), None

    def _look(self, pose: Array, before: float, time: float) -> Array | None:
        if not is_due(before, time, self.config.vision_rate_hz):
            return None
        return self.marker.read(self.effect.see(pose, time))

    def _photograph(self, before: float, time: float) -> NDArray[np.float32] | None:
        if not is_due(before, time, self.config.depth_rate_hz):
            return None
        return self.camera.measure(self.world.client, self.camera_pose)


def is_due(before: float, now: float, rate: float) -> bool:
    """Whether a multiple of 1/rate lies in (before, now]."""
    return rate > 0.0 and int(now * rate + 1e-6) > int(before * rate + 1e-6)


def _placed(config: SimulatedRobotConfig) -> WorldConfig:
    """World with the object moved about at random."""
    rng = np.random.default_rng([config.seed, 3])
    shift = config.place_spread * rng.uniform(-1.0, 1.0, 2)
    turn = np.deg2rad(config.turn_spread_deg) * rng.uniform(-1.0, 1.0)
    world = config.world
    return dataclasses.replace(
        world,
        object_x=world.object_x + float(shift[0]),
        object_y=world.object_y + float(shift[1]),
        object_yaw=world.object_yaw + float(turn),
    )


def _without_errors(config: SimulatedRobotConfig) -> SimulatedRobotConfig:
    sensors = ("biotac", "pad", "encoders", "wrist", "marker", "camera")
    silent = {name: silenced(getattr(config, name)) for name in sensors}
    return dataclasses.replace(config, **silent)


def silenced(sensor: Config) -> Config:
    """Return a sensor's configuration with all its errors zero."""
    names = [f.name for f in dataclasses.fields(sensor)]  # type: ignore[arg-type]
    errors = {name: 0.0 for name in names if any(word in name for word in ERROR_WORDS)}
    return dataclasses.replace(sensor, **errors)  # type: ignore[type-var]
