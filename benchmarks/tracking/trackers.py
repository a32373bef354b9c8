"""The trackers that are compared: each turns a tape into poses."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
import small_gicp

from benchmarks.tracking.tape import Moment, Tape
from tactile_dynamics_ros.core.robot.hand_kinematics import HandKinematics
from tactile_dynamics_ros.core.shape.object_shape import ObjectShape
from tactile_dynamics_ros.core.tracking.depth_image import DepthNoiseConfig
from tactile_dynamics_ros.core.tracking.kinematic_tracker import KinematicTracker
from tactile_dynamics_ros.core.tracking.pose_fusion import PoseFusion, average_poses
from tactile_dynamics_ros.core.tracking.robot_volume import RobotVolume
from tactile_dynamics_ros.core.tracking.scene import view_sphere
from tactile_dynamics_ros.core.tracking.vision_tracker import Sighting, TrackingState, VisionTracker

LATENCY_S = 0.06
"""From exposure to pose: 20 ms of the camera and 40 ms of computing."""
_SIGHTINGS = 15
_REFUTING_SCORE = 0.5
_REFUTATIONS = 2
_WAITING_S = 1.2

Change = Callable[[Moment, np.ndarray], np.ndarray]
"""What happens to a depth image before a tracker gets it."""


@dataclass
class Track:
    """Poses of one tracker.

    Attributes:
        time, pose, covariance: of each pose; covariance None where the tracker has none.
        flagged: whether the tracker said that it does not know.
        seconds: spent per update.
    """

    time: list[float] = field(default_factory=list)
    pose: list[np.ndarray] = field(default_factory=list)
    covariance: list[np.ndarray | None] = field(default_factory=list)
    flagged: list[bool] = field(default_factory=list)
    seconds: list[float] = field(default_factory=list)

    def add(self, when: float, pose: np.ndarray, covariance: np.ndarray | None, flagged: bool):
        """Append a pose."""
        self.time.append(when)
        self.pose.append(pose)
        self.covariance.append(covariance)
        self.flagged.append(flagged)


@dataclass
class Replay:
    """The live chain of kinematic tracker, vision tracker and fusion on a tape.

    Attributes:
        fused, kinematic, vision: what each says; vision at the time of its images.
        states: (time, state of the vision tracker, score) per image.
    """

    fused: Track = field(default_factory=Track)
    kinematic: Track = field(default_factory=Track)
    vision: Track = field(default_factory=Track)
    states: list[tuple[float, TrackingState, float]] = field(default_factory=list)


@dataclass(frozen=True)
class Upset:
    """A wrong belief that all trackers are given at one time, X_WO."""

    time: float
    error: np.ndarray


class LiveChain:
    """Kinematic tracker, vision tracker and fusion, coupled as the nodes are.

    Args:
        shape: of the object. kinematics: of the robot.
        hints: whether the vision tracker is told the fused pose.
    """

    def __init__(self, shape: ObjectShape, kinematics: HandKinematics, hints: bool = True) -> None:
        self.replay = Replay()
        self._kinematics = kinematics
        self._vision = VisionTracker(shape, kinematics)
        self._tracker = KinematicTracker(kinematics)
        self._fusion = PoseFusion()
        self._hints = hints
        self._waiting: deque[tuple[float, Moment, Sighting]] = deque()
        self._seen: deque[np.ndarray] = deque(maxlen=_SIGHTINGS)
        self._fused: np.ndarray | None = None
        self._covariance: np.ndarray | None = None
        self._refuting = 0

    def run(self, tape: Tape, change: Change | None = None, upset: Upset | None = None) -> Replay:
        """Play a tape; while nothing touches the waiting object, images are left out."""
        last = max(k for k, moment in enumerate(tape.moments) if moment.aloft)
        for moment in tape.moments[: last + 1]:
            if upset is not None and moment.time >= upset.time:
                self._mislead(moment, upset)
                upset = None
            if moment.image is not None and (moment.time < _WAITING_S or moment.contacts):
                self._look(tape, moment, change)
            self._deliver(moment)
            if moment.aloft:
                self._follow(moment)
        return self.replay

    def _mislead(self, moment: Moment, upset: Upset) -> None:
        assert self._fused is not None
        wrong = self._fused @ upset.error
        self._vision.reset(wrong)
        self._tracker.initialise(wrong, moment.positions, None, moment.time)
        self._fusion.reset()
        self._waiting.clear()

    def _look(self, tape: Tape, moment: Moment, change: Change | None) -> None:
        depth = moment.depth()
        if change is not None:
            depth = change(moment, depth)
        hints = [] if self._fused is None or not self._hints else [self._fused]
        began = time.process_time()
        seen = self._vision.update(depth, tape.camera, moment.positions, moment.time, hints)
        self.replay.vision.seconds.append(time.process_time() - began)
        self._note(moment)
        if seen is None:
            return
        self._waiting.append((moment.time + LATENCY_S, moment, seen))
        if moment.aloft:
            self.replay.vision.add(moment.time, seen.pose, seen.covariance, False)

    def _note(self, moment: Moment) -> None:
        vision = self._vision
        self.replay.states.append((moment.time, vision.state, vision.score))
        visible = vision.visible >= vision.config.least_visible
        refuting = visible and vision.score < _REFUTING_SCORE
        self._refuting = self._refuting + 1 if refuting else 0
        if self._refuting >= _REFUTATIONS and self._tracker.initialised:
            self._fusion.refute()

    def _deliver(self, moment: Moment) -> None:
        while self._waiting and self._waiting[0][0] <= moment.time:
            _, then, seen = self._waiting.popleft()
            if self._tracker.initialised:
                self._fusion.correct(seen.pose, seen.covariance, then.time)
            elif then.aloft:
                anchor = self._kinematics.sensor_pose(
                    self._kinematics.robot.reference, then.positions
                )
                self._seen.append(np.linalg.inv(anchor) @ seen.pose)
                self._covariance = seen.covariance

    def _follow(self, moment: Moment) -> None:
        if not self._tracker.initialised:
            if len(self._seen) < _SIGHTINGS:
                return
            anchor = self._kinematics.sensor_pose(
                self._kinematics.robot.reference, moment.positions
            )
            mean, _ = average_poses(np.stack(self._seen))
            self._tracker.initialise(anchor @ mean, moment.positions, self._covariance, moment.time)
        began = time.process_time()
        pose, covariance = self._tracker.update(
            moment.positions, moment.time, self._skin_points(moment)
        )
        self.replay.kinematic.seconds.append(time.process_time() - began)
        self.replay.kinematic.add(moment.time, pose, covariance, False)
        fused, spread = self._fusion.predict(pose, covariance, moment.time)
        self.replay.fused.add(moment.time, fused, spread, self._fusion.doubtful)
        self._fused = fused

    def _skin_points(self, moment: Moment) -> dict[str, np.ndarray]:
        """Contact points in the sensor frames."""
        place = self._kinematics.in_sensor_frame
        return {f: place(f, moment.positions, c.point) for f, c in moment.contacts.items()}


def follow_plain_icp(tape: Tape, shape: ObjectShape, start: Track) -> Track:
    """Frame-to-model point-to-plane ICP as it comes: depths around the last pose but the robot's.

    Args:
        tape: to play.
        shape: of the object.
        start: whose first pose this tracker is given.
    """
    volume = RobotVolume(HandKinematics())
    model = small_gicp.PointCloud(shape.points)
    tree = small_gicp.KdTree(model)
    small_gicp.estimate_normals_covariances(model, tree)
    track, pose = Track(), None
    for moment in tape.moments:
        if not moment.aloft or moment.image is None or not start.time:
            continue
        if moment.time < start.time[0]:
            continue
        pose = start.pose[0] if pose is None else pose
        began = time.process_time()
        points = _around(tape, moment, pose, shape, volume)
        if len(points) > 20:
            found = small_gicp.align(
                model,
                small_gicp.PointCloud(points),
                tree,
                np.linalg.inv(pose),
                registration_type="PLANE_ICP",
                max_correspondence_distance=0.02,
                max_iterations=50,
                rotation_epsilon=1e-4,
                translation_epsilon=1e-5,
            )
            pose = np.linalg.inv(found.T_target_source)
        track.seconds.append(time.process_time() - began)
        track.add(moment.time, pose, None, False)
    return track


def _around(
    tape: Tape, moment: Moment, pose: np.ndarray, shape: ObjectShape, volume: RobotVolume
) -> np.ndarray:
    """Measured points (N, 3) in the world, not the robot's, within the object's bounding sphere."""
    place = tape.camera.pose
    centre = pose[:3, :3] @ shape.centre + pose[:3, 3]
    scene = view_sphere(
        tape.camera, moment.depth(), place[:3, :3].T @ (centre - place[:3, 3]), shape.radius,
        volume, moment.positions, DepthNoiseConfig(), 0.0,
    )  # fmt: skip
    if scene is None:
        return np.zeros((0, 3))
    points = scene.window.points[scene.free] @ place[:3, :3].T + place[:3, 3]
    return points[np.linalg.norm(points - centre, axis=1) < shape.radius + 0.01]
