"""Twenty workshop tools on a wrist sensor, with the noise of their authors.

Pose and wrench lie in a world whose z points down; they are turned here. The authors add noise to
accelerations; a robot has poses, so that the estimator gets poses whose smoothed accelerations are
as noisy. Peers get those accelerations, or, as in the paper, true ones with white noise.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.peers.with_shape import Rows
from tactile_dynamics_ros.core.inertia.residuals.newton_euler_residual import (
    ProblemConfig,
    WrenchProblem,
)
from tactile_dynamics_ros.core.rigid_body.inertial_parameters import InertialParameters
from tactile_dynamics_ros.core.rigid_body.rotation import exp_so3
from tactile_dynamics_ros.recording import Recording

Array = np.ndarray

DATA = Path(__file__).resolve().parents[2].parent / "shared" / "data" / "tools_nadeau2023"
"""Where the tools are."""
LEVELS = {
    "low": (0.025, 0.25, 0.05, 2.5e-3),
    "moderate": (0.05, 0.5, 0.1, 5e-3),
    "high": (0.1, 1.0, 0.2, 1e-2),
}
"""Standard deviations of linear and angular acceleration, m/s^2 and rad/s^2, and of force and
torque, N and N m."""
_SMOOTHING = ProblemConfig(regressor_half_width=0.12, regressor_degree=4)
"""Quartics over 25 poses, as in the benchmark of inertia."""
_TURN = np.diag([1.0, -1.0, -1.0])
"""From their world, z down, to one with z up."""


@dataclass(frozen=True)
class Case:
    """One tool at one level of noise, frame of the sensor.

    Attributes:
        name: of the tool. truth: its inertia. points: (N, 3) m of its surface.
        recording: poses and wrenches with noise.
        smoothed, given: white rows for peers, of smoothed poses and of accelerations with noise.
    """

    name: str
    truth: InertialParameters
    points: Array
    recording: Recording
    smoothed: Rows
    given: Rows


def tools(folder: Path) -> list[str]:
    """Names of the tools."""
    return sorted(json.loads((folder / "truth.json").read_text()))


def read_case(folder: Path, name: str, level: str, seed: int) -> Case:
    """Read a tool and add noise."""
    arrays = {
        key: one.astype(float) for key, one in np.load(folder / f"{name.lower()}.npz").items()
    }
    described = json.loads((folder / "truth.json").read_text())[name]
    grasp = np.array(described["grasp"])
    turn, shift = grasp[:3, :3], grasp[:3, 3]
    inertia = turn.T @ np.array(described["inertia_com"]) @ turn
    truth = InertialParameters(described["mass"], turn.T @ (described["com"] - shift), inertia)
    rng = np.random.default_rng([seed, *name.encode()])
    linear, angular, force, torque = LEVELS[level]
    time, pose = arrays["time"], arrays["sensor_pose"]
    place, rotation = pose[:, :3, 3] @ _TURN, _TURN @ pose[:, :3, :3]
    wrench = arrays["wrench_force_first"].reshape(-1, 2, 3) @ _TURN
    wrench = wrench + rng.normal(size=wrench.shape) * np.array([[force], [torque]])
    exact = _problem(_record(name, time, place, rotation, wrench, (1e-7, 1e-6, force)))
    stds = linear / _gain(time), angular / _gain(time), force
    place = place + stds[0] * rng.normal(size=place.shape)
    rotation = exp_so3(stds[1] * rng.normal(size=place.shape)) @ rotation
    recording = _record(name, time, place, rotation, wrench, stds)
    return Case(
        name,
        truth,
        (arrays["points"] - shift) @ turn,
        recording,
        _rows(_problem(recording), (torque, force)),
        _rows(exact, (torque, force), rng, (linear, angular)),
    )


def _gain(time: Array) -> float:
    """Standard deviation of a smoothed second derivative over that of a sample, 1/s^2."""
    step = float(np.median(np.diff(time)))
    half = round(_SMOOTHING.regressor_half_width / step)
    powers = np.vander(step * np.arange(-half, half + 1), _SMOOTHING.regressor_degree + 1)
    return float(2.0 * np.linalg.norm(np.linalg.pinv(powers)[-3]))


def _problem(recording: Recording) -> WrenchProblem:
    return WrenchProblem.from_streams(recording.streams, _SMOOTHING)


def _rows(
    problem: WrenchProblem,
    std: tuple[float, float],
    rng: np.random.Generator | None = None,
    noise: tuple[float, float] = (0.0, 0.0),
) -> Rows:
    """White rows, with white noise (linear, angular) on the accelerations if any."""
    samples = problem.samples
    specific = np.einsum("nji,nj->ni", samples.rotation, samples.acceleration - samples.gravity)
    angular = samples.angular_acceleration
    if rng is not None:
        specific = specific + noise[0] * rng.normal(size=specific.shape)
        angular = angular + noise[1] * rng.normal(size=angular.shape)
    motion = specific, samples.angular_velocity, angular
    return Rows.of(motion, samples.measured_wrench, std)


def _record(
    name: str, time: Array, place: Array, turn: Array, wrench: Array, stds: tuple[float, ...]
) -> Recording:
    """Wrenches (N, 2, 3) [force, torque] of a wrist sensor at its poses."""
    pose = {"time": time, "position": place, "rotation": turn}
    contact = {"time": time, "force": wrench[:, 0], "torque": wrench[:, 1], "force_std": stds[2]}
    contact |= {"position": place, "rotation": turn, "pose_time": time}
    pose |= {"position_std": stds[0], "rotation_std": stds[1]}
    return Recording.from_arrays({"wrist": contact}, pose, source=name)
