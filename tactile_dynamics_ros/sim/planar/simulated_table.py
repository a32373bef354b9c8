"""The stand-in for a table with objects, a moving camera and an arm that pushes."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.configuration import check_ranges, parameter
from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.sim.objects import PlanarObject, last_number, planar_object
from tactile_dynamics_ros.sim.planar.bed import Surface, uneven_friction
from tactile_dynamics_ros.sim.planar.hidden_effects import HiddenPushEffect, hide, known_effect
from tactile_dynamics_ros.sim.planar.looking import Carriage
from tactile_dynamics_ros.sim.planar.pusher import Pusher, PusherConfig
from tactile_dynamics_ros.sim.planar.table import (
    Outline,
    TableWorld,
    joint_truth,
    outlines,
    scattered,
)
from tactile_dynamics_ros.sim.planar.touch import TouchReading, TouchSensorConfig, TouchSensors
from tactile_dynamics_ros.sim.sensors.depth_camera import DepthCamera, DepthCameraConfig, look_at
from tactile_dynamics_ros.sim.sensors.fingertips import MarkerTracker, MarkerTrackerConfig
from tactile_dynamics_ros.sim.simulated_robot import is_due, silenced


@dataclass(frozen=True)
class SimulatedTableConfig:
    """Objects, camera, arm and friction of one run; everything random follows from the seed."""

    seed: int = parameter(0, "of placement, noise and friction", "", 0)
    object_number: int = parameter(1, "in config/planar_objects.yaml; 0 draws one", "", 0)
    object_count: int = parameter(1, "objects on the table; further ones are drawn", "", 0, 8)
    object_x: float = parameter(0.5, "middle of the object", "m", 0.25, 0.95)
    object_y: float = parameter(0.0, "middle of the object", "m", -0.5, 0.5)
    place_spread: float = parameter(0.03, "largest shift of the object along x and y", "m", 0, 0.2)
    turn_spread_deg: float = parameter(180.0, "largest turn about the vertical", "deg", 0.0, 180.0)
    table_height: float = parameter(0.0, "of its top in the world", "m", -2.0, 2.0)
    friction_spread: float = parameter(
        0.1, "standard deviation of friction from place to place, over its mean", "", 0.0, 0.3
    )
    time_step: float = parameter(1e-3, "simulation step", "s", 1e-4, 2e-3)
    noise: bool = parameter(True, "whether sensors have noise and offsets")
    camera_speed: float = parameter(0.25, "of the arm that carries the camera", "m/s", 1e-3, 2.0)
    camera_position: tuple[float, ...] = parameter((0.15, -0.3, 0.4), "at the start, world", "m")
    camera_target: tuple[float, ...] = parameter((0.5, 0.0, 0.0), "looked at, start, world", "m")
    depth_rate_hz: float = parameter(15.0, "rate of the depth camera, 0 is off", "Hz", 0.0, 30.0)
    vision_rate_hz: float = parameter(
        0.0, "rate of a tracker of markers on the parts, 0 is none", "Hz", 0.0, 100.0
    )
    hidden_effect: str = parameter("none", "disturbance by name, or none, random, outside")
    hidden_magnitude: float = parameter(1.0, "multiple of its typical size", "", 0.0, 100.0)
    hidden_time: float = parameter(30.0, "when an effect begins that is sudden", "s", 0.0)
    hidden_waits: bool = parameter(False, "whether the hidden effect begins only when asked to")
    camera: DepthCameraConfig = field(default_factory=DepthCameraConfig)
    marker: MarkerTrackerConfig = field(default_factory=MarkerTrackerConfig)
    pusher: PusherConfig = field(default_factory=PusherConfig)
    touch: TouchSensorConfig = field(default_factory=TouchSensorConfig)

    def __post_init__(self) -> None:
        check_ranges(self)


@dataclass(frozen=True)
class TableReadings:
    """What the sensors report after one period.

    Attributes:
        time: s. camera_pose: (4, 4) X_WC as the arm knows it. depth: (H, W) m, or None when no
            image is due.
        pusher: (4, 4) of the tip. width: m, of the jaws.
        joints, rates: (J,) of the pushing arm and its jaws, rad and m.
        touch: what tip and pads feel.
        links_time: s, stamp of the poses of parts.
        links: (4, 4) reported pose of each part of the first object; None where it is lost,
            empty when no frame is due.
    """

    time: float
    camera_pose: Array
    depth: NDArray[np.float32] | None
    pusher: Array
    width: float
    joints: Array
    rates: Array
    touch: list[TouchReading]
    links_time: float
    links: list[Array | None]


class SimulatedTable:
    """Table, objects, moving camera and pushing arm.

    Args:
        config: of everything.
        period: s between readings.
    """

    def __init__(self, config: SimulatedTableConfig | None = None, period: float = 0.01) -> None:
        config = config or SimulatedTableConfig()
        self.config = config = config if config.noise else _without_errors(config)
        self.period = period
        self.camera = DepthCamera(config.camera, config.seed)
        self.world = _world(config)
        self.carriage = Carriage(
            look_at(np.array(config.camera_position), np.array(config.camera_target)),
            config.camera_speed,
        )
        self.pusher = Pusher(self.world, config.pusher, period)
        self.outlines: list[Outline] = outlines(self.world.bodies[0]) if self.world.bodies else []
        self.effect = HiddenPushEffect()
        if config.hidden_waits:
            known_effect(config.hidden_effect)
        else:
            self._hide(config.hidden_time)
        self.sensors = TouchSensors(config.touch, config.seed)
        self.markers = [
            MarkerTracker(config.marker, config.seed + 1000 * k) for k in range(len(self.outlines))
        ]
        self._steps = max(1, round(period / config.time_step))
        self._joints = self.pusher.joints

    @property
    def support(self) -> Array:
        """Pose (4, 4) of the table in the world; z is its normal."""
        pose = np.eye(4)
        pose[2, 3] = self.config.table_height
        return pose

    def advance(self, looking: bool = True) -> TableReadings:
        """Simulate one period and read all sensors.

        Args:
            looking: whether images are taken; they cost most of the time.
        """
        before = self.world.time
        self.pusher.plan()
        self.world.step(self._steps)
        self.carriage.advance(self.period)
        now, pose, depth = self.world.time, self.carriage.pose.copy(), None
        if looking and is_due(before, now, self.config.depth_rate_hz):
            depth = self.camera.measure(self.world.client, pose)
        reading = self.pusher.read(now - 0.5 * (self.period - self.config.time_step))
        contacts = self.effect.feel(reading, self.pusher.frame[3], self.period)
        last, self._joints = self._joints, self.pusher.joints
        return TableReadings(
            time=now,
            camera_pose=pose,
            depth=depth,
            pusher=self.pusher.pose,
            width=self.pusher.width,
            joints=self._joints,
            rates=(self._joints - last) / self.period,
            touch=self.sensors.read(contacts, self.pusher.pose),
            links_time=now,
            links=self._track(before, now),
        )

    def begin(self) -> str:
        """Let a hidden effect begin now that was to wait; return what is said of it.

        Raises:
            BadInputError: none waits.
        """
        if not self.config.hidden_waits or self.effect.begins is not None:
            raise BadInputError(
                "no hidden effect waits: start robot_sim with hidden_effect and hidden_waits:=true"
            )
        self._hide(self.world.time)
        self.effect.begins = self.world.time
        self.world.wake()
        return f"from {self.world.time:.2f} s on something is different"

    def _hide(self, time: float) -> None:
        config = self.config
        self.effect = hide(
            config.hidden_effect, config.hidden_magnitude, config.seed, self.world, time
        )

    def reveal(self) -> dict[str, Any]:
        """Ground truth as plain numbers, ready for JSON."""
        return {
            "objects": [body.truth() for body in self.world.bodies],
            "links": [outline.truth() for outline in self.outlines],
            "joint": joint_truth(self.world.bodies[0]) if self.world.bodies else None,
            "support": self.support.tolist(),
            "hidden_effect": self.effect.describe(),
            "time": self.world.time,
        }

    def _track(self, before: float, now: float) -> list[Array | None]:
        """Return the poses of the parts that the tracker of markers reports."""
        if not is_due(before, now, self.config.vision_rate_hz):
            return []
        return [
            marker.read(outline.pose())
            for marker, outline in zip(self.markers, self.outlines, strict=True)
        ]


def _without_errors(config: SimulatedTableConfig) -> SimulatedTableConfig:
    quiet = {name: silenced(getattr(config, name)) for name in ("camera", "marker", "touch")}
    return replace(config, **quiet)


def _world(config: SimulatedTableConfig) -> TableWorld:
    rng = np.random.default_rng([config.seed, 43])
    numbers = rng.integers(1, last_number() + 1, max(config.object_count, 1))
    things: list[PlanarObject] = [planar_object(int(n)) for n in numbers[: config.object_count]]
    if things and config.object_number:
        things[0] = planar_object(config.object_number)
    shift = config.place_spread * rng.uniform(-1.0, 1.0, 2)
    turn = np.deg2rad(config.turn_spread_deg) * rng.uniform(-1.0, 1.0)
    first = np.array([config.object_x + shift[0], config.object_y + shift[1], turn])
    places = scattered(things, first, rng) if things else np.zeros((0, 3))
    surface = Surface(uneven_friction(config.friction_spread, config.seed))
    return TableWorld(things, places, config.table_height, surface, config.time_step)
