"""Recordings of the simulated hand through the whole chain, from raw counts to contact forces.

The simulated hand grasps, lifts and moves an object; forces come from the fingertips' raw counts,
contact points and object pose from the joints (and, for the pose, slow corrections from vision).
The same core objects run as in the nodes.
"""

from __future__ import annotations

from collections import defaultdict, deque
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from benchmarks.biotac_in_hand import ALOFT, PadTouch, Touch
from benchmarks.biotac_press_rig import calibrate_units
from tactile_dynamics_ros.core.contact.contact_state import Contact
from tactile_dynamics_ros.core.manipulation.grasp_controller import GraspConfig, GraspController
from tactile_dynamics_ros.core.rigid_body.inertial_parameters import InertialParameters
from tactile_dynamics_ros.core.robot.hand_kinematics import HandKinematics
from tactile_dynamics_ros.core.robot.robot_file import DEFAULT_ROBOT
from tactile_dynamics_ros.core.streams.streams import ContactStream, PoseStream, Streams
from tactile_dynamics_ros.core.tracking.kinematic_tracker import KinematicTracker
from tactile_dynamics_ros.core.tracking.pose_fusion import PoseFusion, average_poses
from tactile_dynamics_ros.sim.sensors.fingertips import ForceTorquePads
from tactile_dynamics_ros.sim.simulated_robot import (
    Readings,
    SimulatedRobot,
    SimulatedRobotConfig,
)
from tactile_dynamics_ros.sim.world import WorldConfig

_SIGHTINGS = 15
_TARE_S = 0.5
_LIMIT_S = 90.0
_FORCE_MODEL = "network"
_PAD_TOUCH = 0.2
"""N, as in config/panda_gripper.yaml: seven standard deviations of a pad's noise."""


@dataclass
class _Tracking:
    """Pose of the object while it is held, as the tracker's node follows it."""

    kinematics: HandKinematics
    tracker: KinematicTracker = field(init=False)
    fusion: PoseFusion = field(default_factory=PoseFusion)
    seen: deque[np.ndarray] = field(default_factory=lambda: deque(maxlen=_SIGHTINGS))

    def __post_init__(self) -> None:
        self.tracker = KinematicTracker(self.kinematics)

    def update(
        self,
        time: float,
        positions: np.ndarray,
        vision: np.ndarray | None,
        contacts: dict[str, Contact],
    ) -> tuple[np.ndarray, np.ndarray] | None:
        """Fused pose and covariance, or None until enough has been seen."""
        anchor = self.kinematics.sensor_pose(self.kinematics.robot.reference, positions)
        if vision is not None:
            self.seen.append(np.linalg.inv(anchor) @ vision)
        if not self.tracker.initialised:
            if len(self.seen) < _SIGHTINGS:
                return None
            mean, _ = average_poses(np.stack(self.seen))
            self.tracker.initialise(anchor @ mean, positions, None, time)
        place = self.kinematics.in_sensor_frame
        points = {f: place(f, positions, contact.point) for f, contact in contacts.items()}
        fused = self.fusion.predict(*self.tracker.update(positions, time, points), time)
        if vision is not None:
            self.fusion.correct(vision, self.tracker.vision_covariance(), time)
        return fused


@dataclass
class _Tape:
    """What the estimator's topics carry, while the object is aloft."""

    poses: list[tuple[float, np.ndarray, np.ndarray]] = field(default_factory=list)
    contacts: dict[str, list[tuple[float, Contact]]] = field(
        default_factory=lambda: defaultdict(list)
    )

    def streams(self) -> Streams:
        """As a recording."""
        time, pose, covariance = (np.array(column) for column in zip(*self.poses, strict=True))
        contacts = {name: contact_stream(name, rows) for name, rows in self.contacts.items()}
        return Streams(PoseStream(time, pose[:, :3, 3], pose[:, :3, :3], covariance), contacts)


def contact_stream(name: str, rows: list[tuple[float, Contact]]) -> ContactStream:
    """A finger's readings with their stamps (s) as a stream."""
    stamps = np.array([stamp for stamp, _ in rows])
    force = np.array([contact.force for _, contact in rows])
    return ContactStream(
        name,
        stamps,
        force,
        np.array([contact.torque for _, contact in rows]),
        np.array([contact.force_std for _, contact in rows]),
        stamps,
        np.array([contact.point for _, contact in rows]),
        np.array([contact.rotation for _, contact in rows]),
        carries_torque=any(contact.torque.any() for _, contact in rows),
    )


def _touch_of(robot: SimulatedRobot, kinematics: HandKinematics, seed: int) -> Touch | PadTouch:
    if isinstance(robot.tips, ForceTorquePads):
        return PadTouch(kinematics, robot.tips.force_std, _PAD_TOUCH)
    return Touch(kinematics, _FORCE_MODEL, calibrate_units(seed))


def record_in_hand(
    box: str,
    seed: int,
    behaviour: GraspConfig | None = None,
    hidden: str = "none",
    robot_name: str = DEFAULT_ROBOT,
    skin_torsion: float = 0.0,
    watch: Callable[[Readings], None] = lambda readings: None,
) -> tuple[Streams, InertialParameters, str]:
    """Grasp, lift and move a box; return what was published, the truth and the outcome.

    Every seed has fingertips of its own, calibrated by a minute of presses on a known force.

    Args:
        box: object by name.
        seed: of everything random.
        behaviour: of the grasp.
        hidden: effect of the simulated robot that nobody is told.
        robot_name: file in config/robots.
        skin_torsion: largest torque of the skin about its normal over its normal force, m.
        watch: is shown all readings.
    """
    world = WorldConfig(object_name=box, skin_torsion=skin_torsion)
    config = SimulatedRobotConfig(
        robot=robot_name, seed=seed, unit_seed=seed, world=world, hidden_effect=hidden
    )
    robot = SimulatedRobot(config)
    kinematics, truth = HandKinematics(robot.machine), robot.world.model.inertia
    controller = GraspController(kinematics, robot.world.model.grasp, behaviour)
    touch = _touch_of(robot, kinematics, seed)
    tracking, tape, pose = None, _Tape(), None
    while robot.world.time < _LIMIT_S and not controller.done:
        readings = robot.advance()
        watch(readings)
        contacts = touch.update(readings)
        pose = readings.vision if readings.vision is not None else pose
        forces = {name: contact.force for name, contact in contacts.items()}
        known = pose if readings.time > _TARE_S else None
        robot.world.command(controller.update(readings.time, readings.position, forces, known))
        if controller.phase not in ALOFT:
            continue
        tracking = tracking or _Tracking(kinematics)
        fused = tracking.update(readings.joint_time, readings.position, readings.vision, contacts)
        if fused is not None:
            tape.poses.append((readings.joint_time, *fused))
            for name, contact in contacts.items():
                tape.contacts[name].append((readings.touch_time, contact))
    robot.world.close()
    return tape.streams(), truth, controller.outcome or controller.phase.value
