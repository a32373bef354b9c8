"""One grasp from start to end in the simulator, with noisy pose and touch, and its verdict."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.manipulation.grasp_controller import (
    GraspConfig,
    GraspController,
    Phase,
)
from tactile_dynamics_ros.core.rigid_body.rotation import exp_so3, inverse_pose, log_so3
from tactile_dynamics_ros.core.robot.hand_kinematics import HandKinematics
from tactile_dynamics_ros.core.robot.robot_file import load_robot
from tactile_dynamics_ros.sim.world import HandWorld, WorldConfig

ROBOT = load_robot()


@dataclass(frozen=True)
class GraspTrial:
    """What to grasp, where it stands and how well it is seen and measured.

    Attributes:
        world: object and its place.
        behaviour: of the controller.
        position_std: m, rotation_std: rad, constant error of the object pose that is told.
        force_std: N, white noise of the forces that are told.
        rate_hz: of the controller.
        clearance: least height above the table that counts as off the table, m.
        seed: of the noise.
    """

    world: WorldConfig = field(default_factory=WorldConfig)
    behaviour: GraspConfig = field(default_factory=GraspConfig)
    position_std: float = 0.0015
    rotation_std: float = 0.015
    force_std: float = 0.03
    rate_hz: float = 100.0
    clearance: float = 0.02
    seed: int = 0


@dataclass(frozen=True)
class TrialResult:
    """How the grasp went.

    Attributes:
        success: off the table and in the hand through the whole excitation.
        phase: in which it ended. outcome: why it failed, or "".
        duration: simulated s. real_time_factor: simulated time per processor time.
        slip_mm, turn_deg: how far the object moved in the hand during the excitation.
        lowest: least height of the object above the table during the excitation, m.
        fingers: least number of fingers in contact during the excitation.
    """

    success: bool
    phase: str
    outcome: str
    duration: float
    real_time_factor: float
    slip_mm: float
    turn_deg: float
    lowest: float
    fingers: int


def draw_trials(
    objects: Sequence[str], count: int, seed: int, behaviour: GraspConfig | None = None
) -> list[GraspTrial]:
    """Return seeded trials that go through the objects in turn with random places and turns."""
    rng = np.random.default_rng(seed)
    trials = []
    for k in range(count):
        world = WorldConfig(
            object_name=objects[k % len(objects)],
            object_x=float(rng.uniform(0.48, 0.62)),
            object_y=float(rng.uniform(-0.12, 0.12)),
            object_yaw=float(rng.uniform(-np.pi, np.pi)),
        )
        trials.append(GraspTrial(world, behaviour or GraspConfig(), seed=seed + k))
    return trials


def run_trial(trial: GraspTrial, time_limit: float = 120.0) -> TrialResult:
    """Simulate a trial until the behaviour ends."""
    rng = np.random.default_rng(trial.seed)
    kinematics = HandKinematics()
    steps = max(1, round(1.0 / (trial.rate_hz * trial.world.time_step)))
    seen: list[Array] = []
    heights: list[float] = []
    touching: list[int] = []
    started = time.process_time()
    with HandWorld(trial.world) as world:
        world.reset(ROBOT.start)
        controller = GraspController(kinematics, world.model.grasp, trial.behaviour)
        while not controller.done and world.time < time_limit:
            told = _disturb_pose(world.object_pose(), trial)
            forces = _feel(world, trial, rng)
            state = world.joint_state()
            world.command(controller.update(world.time, state.position, forces, told))
            world.step(steps)
            if controller.phase is Phase.EXCITE:
                seen.append(inverse_pose(world.link_pose("palm_link")) @ world.object_pose())
                heights.append(_height(world))
                touching.append(len(forces))
        duration, centre = world.time, world.model.grasp.centre
    spent = time.process_time() - started
    slip, turn = _motion_in_hand(seen, centre)
    lowest = min(heights, default=0.0)
    success = controller.phase is Phase.DONE and lowest > trial.clearance and slip < 0.05
    return TrialResult(
        success,
        controller.phase.value,
        controller.outcome,
        duration,
        duration / spent,
        1e3 * slip,
        float(np.rad2deg(turn)),
        lowest,
        min(touching, default=0),
    )


def _disturb_pose(pose: Array, trial: GraspTrial) -> Array:
    """The pose as seen: off by an error that is constant over the trial."""
    rng = np.random.default_rng([trial.seed, 7])
    told = pose.copy()
    told[:3, :3] = exp_so3(rng.normal(0.0, trial.rotation_std, 3)) @ pose[:3, :3]
    told[:3, 3] += rng.normal(0.0, trial.position_std, 3)
    return told


def _feel(world: HandWorld, trial: GraspTrial, rng: np.random.Generator) -> dict[str, Array]:
    readings = world.contacts()
    noise = rng.normal(0.0, trial.force_std, (len(world.fingers), 3))
    return {
        finger: readings[finger].force + noise[k]
        for k, finger in enumerate(world.fingers)
        if readings[finger].in_contact
    }


def _height(world: HandWorld) -> float:
    pose = world.object_pose()
    return float((world.model.corners @ pose[2, :3] + pose[2, 3]).min())


def _motion_in_hand(poses: Sequence[Array], centre: Array) -> tuple[float, float]:
    """Greatest shift (m) of the grasp centre and turn (rad) against the first pose in the palm."""
    if not poses:
        return 0.0, 0.0
    first = inverse_pose(poses[0])
    relative = [first @ pose for pose in poses[:: max(1, len(poses) // 200)]]
    shifts = [np.linalg.norm(x[:3, :3] @ centre + x[:3, 3] - centre) for x in relative]
    turns = [np.linalg.norm(log_so3(x[:3, :3])) for x in relative]
    return float(max(shifts)), float(max(turns))
