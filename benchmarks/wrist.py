"""Does a wrist sensor beside the fingertips tell the inertia of what the hand holds?

The simulated hand grasps, lifts and moves each of five boxes, with fingertips of its own. Then it
makes the same motion without a box, from which the hand is known; nothing of the simulator's truth
is used but to score.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

import tactile_dynamics_ros as td
from benchmarks.inertia.boxes import BOXES
from benchmarks.inertia.in_hand import record_in_hand
from benchmarks.page_section import compose_section, section_parser, show
from tactile_dynamics_ros.core.inertia.batch.inertial_estimate import InertialEstimate
from tactile_dynamics_ros.core.rigid_body.inertial_parameters import (
    InertialParameters,
    inertia_vector,
)
from tactile_dynamics_ros.core.robot.robot_file import load_robot
from tactile_dynamics_ros.recording import Recording
from tactile_dynamics_ros.recording.wrist import wrist_recording
from tactile_dynamics_ros.sim.simulated_robot import (
    Readings,
    SimulatedRobot,
    SimulatedRobotConfig,
)
from tactile_dynamics_ros.sim.world import WorldConfig

FIRST_SEED = 27000
"""Seeds from here on were not used for tuning."""
WAYS = ("fingertips", "wrist", "both")
"""What an estimate is made of."""
_FAR = np.array([3.0, 3.0, 0.3])
"""Where the box lies while the hand moves without it, m."""
_WRIST_HAS = "force_bias,sensor_lag"
"""Effects of the wrist sensor, which its data sheet names."""
_OTHER_RUN = 5000
"""Added to the seed of the sensors' noise in the motion without a box."""


@dataclass(frozen=True)
class Outcome:
    """Estimates of one box in one hand.

    Attributes:
        box, seed: which. way: of WAYS.
        error: (10,) of mass, centre (m) and inertia, over mass, 1 m and sqrt(I_ii I_jj).
        std: (10,) likewise.
    """

    box: str
    seed: int
    way: str
    error: np.ndarray
    std: np.ndarray


def record(box: str, seed: int) -> tuple[Recording, Recording, Recording, InertialParameters]:
    """Fingertips, wrist, wrist of the same motion without the box, and the truth."""
    held: list[Readings] = []
    streams, truth, _ = record_in_hand(box, seed, watch=held.append)
    empty = list(_without_box(box, seed, held))
    start, stop = streams.pose.time[0], streams.pose.time[-1]
    parts = [[r for r in part if start <= r.time <= stop] for part in (held, empty)]
    return Recording(streams, box), *[_wrist(part) for part in parts], truth


def _without_box(box: str, seed: int, held: Sequence[Readings]) -> Iterator[Readings]:
    """Readings of the motion again, the box far away."""
    config = SimulatedRobotConfig(
        seed=seed + _OTHER_RUN, unit_seed=seed, world=WorldConfig(object_name=box)
    )
    robot = SimulatedRobot(config)
    away = robot.world.start_pose()
    away[:3, 3] = _FAR
    robot.world.reset(robot.machine.start, away)
    for one in held:
        robot.world.command(one.position)
        yield robot.advance()
    robot.world.close()


def _wrist(readings: Sequence[Readings]) -> Recording:
    """What `read_wrist` makes of a bag."""
    robot = load_robot()
    time = np.array([one.time for one in readings])
    angles = np.array([one.position for one in readings]).T
    wrench = np.array([one.wrist for one in readings])[:, [3, 4, 5, 0, 1, 2]]
    named = dict(zip(robot.joint_names, angles, strict=True))
    return wrist_recording((time, wrench), (time, named), robot, "wrist")


def outcomes(boxes: Sequence[str], start: int, count: int) -> Iterator[Outcome]:
    """Estimate every box in every hand in all ways."""
    with TemporaryDirectory() as folder:
        for seed in range(start, start + count):
            for box in boxes:
                fingers, wrist, empty, truth = record(box, seed)
                file = Path(folder) / f"{box}_{seed}.yaml"
                td.estimate(empty, _WRIST_HAS).save(file)
                both = td.estimate(fingers, wrist=wrist, hand=file)
                alone = td.estimate(fingers).found
                for way, found in zip(WAYS, (alone, both.wrist.body, both.found), strict=True):
                    yield Outcome(box, seed, way, *_errors(found, truth))


def _errors(found: InertialEstimate, truth: InertialParameters) -> tuple[np.ndarray, np.ndarray]:
    radii = np.sqrt(np.diag(truth.inertia_com))
    scale = np.concatenate([[truth.mass], np.ones(3), inertia_vector(np.outer(radii, radii))])
    own, true = (
        np.concatenate([[body.mass], body.com, inertia_vector(body.inertia_com)])
        for body in (found.inertia, truth)
    )
    return (own - true) / scale, found.parameter_std / scale


def table(found: Sequence[Outcome]) -> list[str]:
    """Rows of the table, one for each way."""
    lines = [
        "| estimate of | n | mass | centre | moments of inertia, median; largest | 90 % intervals "
        "that hold | largest error in std |",
        "|---|---|---|---|---|---|---|",
    ]
    for way in WAYS:
        own = [one for one in found if one.way == way]
        error, std = (np.abs([getattr(one, name) for one in own]) for name in ("error", "std"))
        moments = error[:, [4, 6, 9]]
        lines.append(
            f"| {way} | {len(own)} | {np.median(error[:, 0]):.2%} | "
            f"{1e3 * np.median(np.linalg.norm(error[:, 1:4], axis=1)):.2f} mm | "
            f"{np.median(moments):.1%}; {moments.max():.0%} | {np.mean(error < 1.645 * std):.0%} | "
            f"{np.max(error / std):.1f} |"
        )
    return lines


def section(found: Sequence[Outcome], command: str) -> str:
    """The section of the page."""
    text = [
        "## A wrist sensor beside the fingertips",
        "",
        "Five boxes in the simulated hand (1.07 kg), lifted and turned for 40 s, fingertips of",
        "each hand from raw counts; the wrist sensor has 0.035 to 0.13 N, 0.35 to 1.7 N mm of",
        "noise, drift and a filter of 15 Hz. The hand is known from the same motion without.",
    ]
    return compose_section("wrist", text, command, table(found))


def main(arguments: Sequence[str] | None = None) -> int:
    """Estimate; print the table and write it."""
    parser = section_parser(__doc__, FIRST_SEED)
    parser.add_argument("--hands", type=int, default=5, help="hands for every box")
    parser.add_argument("--boxes", nargs="+", default=list(BOXES), choices=BOXES)
    options = parser.parse_args(arguments)
    boxes = " ".join(options.boxes)
    command = f"./dev bench wrist --start {options.start} --hands {options.hands} --boxes {boxes}"
    found = outcomes(options.boxes, options.start, options.hands)
    return show(found, table, lambda found: section(found, command), options.write)
