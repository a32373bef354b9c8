"""What the sensors saw while the simulated hand grasped, lifted and moved an object.

The chain is that of the live nodes, in one process: raw counts to contact forces, depth images to
the first object pose, the grasp controller on both. Trackers replay the tape afterwards, so all of
them see the same.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.biotac_in_hand import ALOFT, Touch
from benchmarks.biotac_press_rig import calibrate_units
from benchmarks.kept import kept
from tactile_dynamics_ros.core.contact.contact_state import Contact
from tactile_dynamics_ros.core.manipulation.excitation import ExcitationConfig
from tactile_dynamics_ros.core.manipulation.grasp_controller import GraspConfig, GraspController
from tactile_dynamics_ros.core.robot.hand_kinematics import HandKinematics
from tactile_dynamics_ros.core.shape.object_shape import load_shape
from tactile_dynamics_ros.core.tracking.depth_image import PinholeCamera
from tactile_dynamics_ros.core.tracking.pose_fusion import average_poses
from tactile_dynamics_ros.core.tracking.vision_tracker import VisionTracker
from tactile_dynamics_ros.share import object_file
from tactile_dynamics_ros.sim.simulated_robot import SimulatedRobot, SimulatedRobotConfig
from tactile_dynamics_ros.sim.world import HandWorld, WorldConfig

RATE_HZ = 15.0
_STEP = 1e-4
_START_POSES = 10
_LIMIT_S = 90.0

Push = Callable[[HandWorld, GraspController], None]


@dataclass(frozen=True)
class Moment:
    """Sensors and truth at one time; the depth image in tenths of a millimetre, 0 is unknown."""

    time: float
    positions: np.ndarray
    truth: np.ndarray
    aloft: bool
    contacts: dict[str, Contact]
    touch_time: float
    image: np.ndarray | None

    def depth(self) -> np.ndarray:
        """Depth image (H, W), m, NaN where unknown."""
        assert self.image is not None
        depth = np.where(self.image == 0, np.nan, self.image * _STEP)
        return depth.astype(np.float32)


@dataclass(frozen=True)
class Tape:
    """One run.

    Attributes:
        name: of the object. seed: of everything random.
        camera: as calibrated. moments: every 10 ms. outcome: how the grasp ended.
        slipped: from when until when the object was pulled through the fingers, s.
    """

    name: str
    seed: int
    camera: PinholeCamera
    moments: list[Moment]
    outcome: str
    slipped: tuple[float, float] | None


class Slip:
    """Pulls the held object until it has moved 2 cm in the hand, harder while it is slow.

    Args:
        axis: (3,) of the object frame along which it is pulled.
        distance: m. start: time after the excitation has begun, s. speed: m/s, of the slip.
    """

    def __init__(
        self, axis: np.ndarray, distance: float = 0.02, start: float = 3.0, speed: float = 0.05
    ) -> None:
        self._axis, self._distance, self._start, self._speed = axis, distance, start, speed
        self._first: tuple[float, np.ndarray] | None = None
        self._force, self._moved, self._pulled = 0.0, 0.0, -np.inf
        self.span: tuple[float, float] | None = None
        self.controller: GraspController | None = None
        self._done = False

    def __call__(self, world: HandWorld) -> None:
        """Push before a simulation step."""
        if self._done or self.controller is None or self.controller.phase.value != "excite":
            return
        held = np.linalg.inv(world.link_pose("palm_link")) @ world.object_pose()
        if self._first is None:
            self._first = (world.time, held)
        began, first = self._first
        if world.time < began + self._start:
            self._first = (began, held)
            return
        moved = float(np.linalg.norm(held[:3, 3] - first[:3, 3]))
        if moved > self._distance:
            self.span, self._done = (began + self._start, world.time), True
            return
        pace = (moved - self._moved) / max(world.time - self._pulled, 1e-9)
        self._moved, self._pulled = moved, world.time
        self._force = float(
            np.clip(self._force + (0.02 if pace < self._speed else -0.2), 0.0, 40.0)
        )
        pose = world.object_pose()
        centre = pose[:3, :3] @ world.model.inertia.com + pose[:3, 3]
        world.apply_force(self._force * pose[:3, :3] @ self._axis, centre)


def record_tape(name: str, seed: int, duration: float, slip: Slip | None = None) -> Tape:
    """Simulate one run with the depth camera and the tracker's own first pose.

    Every seed has fingertips of its own, calibrated by warming up and a minute of presses.
    """
    world = WorldConfig(object_name=name, arm_meshes=True)
    robot = SimulatedRobot(
        SimulatedRobotConfig(seed=seed, unit_seed=seed, depth_rate_hz=RATE_HZ, world=world)
    )
    settings = robot.camera.config
    camera = PinholeCamera(settings.intrinsics, settings.width, settings.height, robot.camera_pose)
    kinematics = HandKinematics()
    excitation = ExcitationConfig(duration=duration, seed=seed)
    controller = GraspController(
        kinematics, robot.world.model.grasp, GraspConfig(excitation=excitation)
    )
    if slip is not None:
        slip.controller = controller
        robot.world.add_pre_step(slip)
    vision = VisionTracker(load_shape(object_file(name)), kinematics)
    touch, seen, moments = Touch(kinematics, "network", calibrate_units(seed)), [], []
    while robot.world.time < _LIMIT_S and not controller.done:
        readings = robot.advance()
        contacts = touch.update(readings)
        if readings.depth is not None and len(seen) < _START_POSES:
            found = vision.update(readings.depth, camera, readings.position, readings.time)
            seen += [] if found is None else [found.pose]
        known = average_poses(np.stack(seen))[0] if len(seen) == _START_POSES else None
        forces = {finger: contact.force for finger, contact in contacts.items()}
        robot.world.command(controller.update(readings.time, readings.position, forces, known))
        image = readings.depth
        if image is not None:
            image = np.where(np.isnan(image), 0.0, np.rint(image / _STEP)).astype(np.uint16)
        moments.append(
            Moment(
                readings.joint_time,
                readings.position,
                robot.world.object_pose(),
                controller.phase in ALOFT,
                contacts,
                readings.touch_time,
                image,
            )
        )
    robot.world.close()
    outcome = controller.outcome or controller.phase.value
    return Tape(name, seed, camera, moments, outcome, None if slip is None else slip.span)


def load_tape(
    folder: Path | None, name: str, seed: int, duration: float, slip: Slip | None = None
) -> Tape:
    """Return a tape from a folder of earlier ones, or record it (and keep it there)."""
    kind = "run" if slip is None else "slip"
    path = None if folder is None else folder / f"{kind}-{name}-{seed}-{duration:g}.pickle"
    tape: Tape = kept(path, lambda: record_tape(name, seed, duration, slip))
    return tape
