"""One friction probe from grasp to result in the simulator, through raw BioTac counts."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from benchmarks.support.hand_contacts import hand_contacts
from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.contact.contact_state import ContactState
from tactile_dynamics_ros.core.errors import NotIdentifiableError
from tactile_dynamics_ros.core.friction.estimate import FrictionEstimate, SlipEvent
from tactile_dynamics_ros.core.friction.probe import FrictionProbe
from tactile_dynamics_ros.core.friction.probe_config import (
    FrictionProbeConfig,
    ProbeContact,
    ProbeInput,
)
from tactile_dynamics_ros.core.friction.slip_detection import ElectrodeMotion
from tactile_dynamics_ros.core.manipulation.grasp_controller import (
    GraspConfig,
    GraspController,
    Phase,
)
from tactile_dynamics_ros.core.manipulation.grasp_planner import GraspSite
from tactile_dynamics_ros.core.robot.hand_kinematics import HandKinematics
from tactile_dynamics_ros.core.robot.robot_file import load_robot
from tactile_dynamics_ros.core.shape.friction_regions import ObjectSurface
from tactile_dynamics_ros.core.tactile.analytic_force import create_force_estimator
from tactile_dynamics_ros.core.tactile.fingertip import FingertipConfig
from tactile_dynamics_ros.core.tactile.slip import SlipDetector
from tactile_dynamics_ros.core.tracking.pose_fusion import average_poses
from tactile_dynamics_ros.sim.simulated_robot import SimulatedRobot, SimulatedRobotConfig
from tactile_dynamics_ros.sim.skin_friction import SkinFriction, SurfaceFriction

ROBOT = load_robot()


PERIOD = 0.01
TARE_FRAMES = 30
SETTLE_FRAMES = 70


@dataclass(frozen=True)
class ProbeTrial:
    """What is probed, and what the surface really is.

    Attributes:
        robot: object, sensors, seed.
        surfaces: true friction by region.
        regions: boxes (lower, upper) by region, object frame, m.
        site: where to grasp, or None for that of the object's file.
        surface: mesh that the probe is told.
        probe: its configuration.
        in_air: probe in the lifted object instead of the standing one.
        tell: changes the object pose that the probe is told, X -> X, or None.
        tips: configurations of the four fingertips from their calibration, or None without one.
    """

    robot: SimulatedRobotConfig
    surfaces: dict[str, SurfaceFriction]
    surface: ObjectSurface
    regions: dict[str, tuple[Array, Array]] = field(default_factory=dict)
    site: GraspSite | None = None
    probe: FrictionProbeConfig = field(default_factory=FrictionProbeConfig)
    in_air: bool = False
    tell: Callable[[Array], Array] | None = None
    tips: Sequence[FingertipConfig] | None = None


@dataclass
class ProbeRecord:
    """What was measured and what was true at each instant of the probe, for scoring.

    Attributes:
        rows: dictionaries of plain numbers, one per 10 ms.
    """

    rows: list[dict[str, Any]] = field(default_factory=list)

    def column(self, name: str) -> Array:
        """Values of one key, (T, ...)."""
        return np.array([row[name] for row in self.rows])


@dataclass(frozen=True)
class ProbeResult:
    """How the probe went.

    Attributes:
        estimates: by region. events: the slips. outcome: why it failed, or "".
        duration: of the probe, simulated s. dropped: whether the object left the hand.
        strongest: greatest true force of a fingertip, N. moved: of the object, m.
        record: time series.
    """

    estimates: dict[str, FrictionEstimate]
    events: list[SlipEvent]
    outcome: str
    duration: float
    dropped: bool
    strongest: float
    moved: float
    record: ProbeRecord


def run_probe_trial(trial: ProbeTrial, time_limit: float = 60.0) -> ProbeResult:
    """Grasp, probe and score."""
    chain = _Chain(trial)
    try:
        chain.grasp()
        return chain.probe(time_limit)
    finally:
        chain.robot.world.close()


class _Chain:
    """Simulated robot, fingertip estimators and controllers in one process."""

    def __init__(self, trial: ProbeTrial) -> None:
        self.trial = trial
        self.robot = SimulatedRobot(trial.robot, PERIOD)
        world = self.robot.world
        self.friction = SkinFriction(world, trial.regions, trial.surfaces, trial.probe.finger)
        self.kinematics = HandKinematics()
        self._contact_state = ContactState(self.kinematics)
        tips = trial.tips or [FingertipConfig()] * len(ROBOT.fingers)
        self._tips = create_force_estimator(config=tips)
        self._finger = ROBOT.fingers.index(trial.probe.finger)
        self._vibration = SlipDetector()
        self._motion = ElectrodeMotion()
        self._poses: list[Array] = []
        self._told = np.eye(4)
        self._strongest = 0.0

    def grasp(self) -> None:
        """Tare, grasp and squeeze, or lift too.

        Raises:
            NotIdentifiableError: the grasp failed.
        """
        self._tare()
        site = self.trial.site or self.robot.world.model.grasp
        goal = Phase.EXCITE if self.trial.in_air else Phase.LIFT
        self._grasper = GraspController(self.kinematics, site, GraspConfig())
        self.target = np.zeros(23)
        while self._grasper.phase is not goal:
            if self._grasper.done or self.robot.world.time > 60.0:
                raise NotIdentifiableError(f"grasp failed: {self._grasper.outcome}")
            seen = self._sense()
            forces = {finger: c.force for finger, c in seen.contacts.items()}
            pose = seen.object_pose if len(self._poses) >= 10 else None
            target = self._grasper.update(seen.time, seen.positions, forces, pose)
            if self._grasper.phase is not goal:
                self.target = target
                self.robot.world.command(target)

    def probe(self, time_limit: float) -> ProbeResult:
        """Run the probe and return what came of it."""
        trial, world = self.trial, self.robot.world
        probe = FrictionProbe(self.kinematics, trial.surface, trial.probe)
        record = ProbeRecord()
        self._strongest = 0.0
        for _ in range(SETTLE_FRAMES):
            seen = self._sense()
        start, pose = seen.time, world.object_pose()
        probe.start(seen, self.target)
        while not probe.done and seen.time - start < time_limit:
            world.command(probe.update(seen))
            record.rows.append(self._row(probe, seen))
            seen = self._sense()
        moved = float(np.linalg.norm(world.object_pose()[:3, 3] - pose[:3, 3]))
        drop = float(pose[2, 3] - world.object_pose()[2, 3])
        return ProbeResult(
            estimates=probe.estimates(),
            events=list(probe.events),
            outcome=probe.outcome,
            duration=seen.time - start,
            dropped=drop > 0.01 or len(seen.contacts) < 3,
            strongest=self._strongest,
            moved=moved,
            record=record,
        )

    def _tare(self) -> None:
        frames = np.stack([self.robot.advance().counts for _ in range(TARE_FRAMES)]).astype(float)
        self._tips.tare(frames)
        self._vibration.tare(frames[:, self._finger])
        self._motion.tare(frames[:, self._finger])

    def _sense(self) -> ProbeInput:
        """Advance by one period and return what the probe may know."""
        readings = self.robot.advance()
        if readings.vision is not None:
            self._look(readings.vision)
        tips = self._tips.observe(readings.counts)
        found = hand_contacts(self._contact_state, readings.position, tips)
        contacts = {f: ProbeContact(c.point, c.force, c.force_std) for f, c in found.items()}
        counts = readings.counts[self._finger].astype(float)
        return ProbeInput(
            time=readings.time,
            touch_time=readings.touch_time,
            positions=readings.position,
            contacts=contacts,
            object_pose=self._told,
            vibration=self._vibration.update(counts).level,
            electrodes=self._motion.update(counts),
        )

    def _look(self, pose: Array) -> None:
        """Average the last poses that were seen."""
        self._poses = [*self._poses[-19:], pose]
        if len(self._poses) > 1:
            mean = np.asarray(average_poses(np.stack(self._poses))[0])
            self._told = mean if self.trial.tell is None else self.trial.tell(mean)

    def _row(self, probe: FrictionProbe, seen: ProbeInput) -> dict[str, Any]:
        truth = self.friction.truth
        own = seen.contacts.get(self.trial.probe.finger)
        measured = np.zeros(3) if own is None else own.force
        self._strongest = max(self._strongest, float(np.hypot(truth.press, truth.pull)))
        return {
            "time": seen.time,
            "pose": self.robot.world.object_pose(),
            "phase": probe.phase.value,
            "measured": probe.components(measured),
            "wanted": probe.wanted.copy(),
            "press": truth.press,
            "pull": truth.pull,
            "speed": truth.speed,
            "coefficient": truth.coefficient,
            "score": probe.slip_state.score,
            "slipping": probe.slip_state.slipping,
            "path": probe.path,
            "vibration": seen.vibration,
            "electrodes": seen.electrodes,
        }
