"""The stand-in for a table, its objects and a depth camera on an arm, behind one interface."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.configuration import check_ranges, parameter
from tactile_dynamics_ros.sim.planar.bed import Surface, uneven_friction
from tactile_dynamics_ros.sim.planar.carriage import Carriage
from tactile_dynamics_ros.sim.planar.table import TableWorld, scattered
from tactile_dynamics_ros.sim.planar_objects import PlanarObject, last_number, planar_object
from tactile_dynamics_ros.sim.sensors.depth_camera import DepthCamera, DepthCameraConfig, look_at
from tactile_dynamics_ros.sim.simulated_robot import is_due, silenced

Array = NDArray[np.float64]


@dataclass(frozen=True)
class SimulatedTableConfig:
    """Objects, camera and friction of one run; everything random follows from the seed."""

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
    time_step: float = parameter(1e-3, "simulation step", "s", 1e-4, 1e-3)
    noise: bool = parameter(True, "whether the camera has noise and offsets")
    camera_speed: float = parameter(0.25, "of the arm that carries the camera", "m/s", 1e-3, 2.0)
    camera_position: tuple[float, ...] = parameter((0.15, -0.3, 0.4), "at the start, world", "m")
    camera_target: tuple[float, ...] = parameter((0.5, 0.0, 0.0), "looked at, start, world", "m")
    depth_rate_hz: float = parameter(15.0, "rate of the depth camera, 0 is off", "Hz", 0.0, 30.0)
    camera: DepthCameraConfig = field(default_factory=DepthCameraConfig)

    def __post_init__(self) -> None:
        check_ranges(self)


@dataclass(frozen=True)
class TableReadings:
    """What the sensors report after one period.

    Attributes:
        time: s. camera_pose: (4, 4) X_WC as the arm knows it. depth: (H, W) m, or None when no
            image is due.
    """

    time: float
    camera_pose: Array
    depth: NDArray[np.float32] | None


class SimulatedTable:
    """Table, objects and moving camera.

    Args:
        config: of everything.
        period: s between readings.
    """

    def __init__(self, config: SimulatedTableConfig | None = None, period: float = 0.01) -> None:
        self.config = config = config or SimulatedTableConfig()
        self.period = period
        self.camera = DepthCamera(
            config.camera if config.noise else silenced(config.camera), config.seed
        )
        self.world = _world(config)
        self.carriage = Carriage(
            look_at(np.array(config.camera_position), np.array(config.camera_target)),
            config.camera_speed,
        )
        self._steps = max(1, round(period / config.time_step))

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
        self.world.step(self._steps)
        self.carriage.advance(self.period)
        now, pose, depth = self.world.time, self.carriage.pose.copy(), None
        if looking and is_due(before, now, self.config.depth_rate_hz):
            depth = self.camera.measure(self.world.client, pose)
        return TableReadings(now, pose, depth)

    def reveal(self) -> dict[str, Any]:
        """Ground truth as plain numbers, ready for JSON."""
        return {
            "objects": [body.truth() for body in self.world.bodies],
            "support": self.support.tolist(),
            "time": self.world.time,
        }


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
