"""Recordings with exactly known inertia: paper A's Table I object, and four-finger grasps."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np

from tactile_dynamics_ros.core.rigid_body.inertial_parameters import (
    InertialParameters,
    inertia_matrix,
)
from tactile_dynamics_ros.core.streams.streams import Streams
from tactile_dynamics_ros.synthetic.grasp import Grasp, Placement
from tactile_dynamics_ros.synthetic.motion import Motion, SumOfSines
from tactile_dynamics_ros.synthetic.objects import HeldObject
from tactile_dynamics_ros.synthetic.recordings import HiddenRecording, generate
from tactile_dynamics_ros.synthetic.scenario import Scenario, ScenarioOptions, Scene
from tactile_dynamics_ros.synthetic.sensors import SensorOptions, read_sensors

TABLE_ONE_VARIANCES = (0.0, 0.1, 0.25, 0.5, 1.0)
TABLE_ONE_DURATION = 30.0

_TABLE_ONE_MASS = 1.3
_TABLE_ONE_COM = np.array([0.2, 0.5, 0.1])
_TABLE_ONE_INERTIA = 1e-2 * np.array([40.15, -12.97, 12.92, -2.59, -6.49, 47.99])
_TABLE_ONE_POINTS = np.array([[0.0, 0.0, 0.0], [0.4, 0.0, 0.2], [0.4, 1.0, 0.0], [0.0, 1.0, 0.2]])


@dataclass(frozen=True)
class Case:
    """A recording and its truth.

    Attributes:
        streams: what estimators get.
        truth: inertia.
        scenario: for the exact motion and contacts.
        sensors: what noise was added.
    """

    streams: Streams
    truth: InertialParameters
    scenario: Scenario
    sensors: SensorOptions

    @property
    def scene(self) -> Scene:
        """Exact motion and contacts at the stamps of the poses."""
        return self.scenario.scene(self.streams.pose.time)

    @property
    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Corners of a box around the object, body frame, m."""
        body = self.scenario.body
        if body.shape == "table one":
            return np.zeros(3), body.size
        return -0.5 * body.size, 0.5 * body.size


def table_one(variance: float, seed: int, duration: float = TABLE_ONE_DURATION) -> Case:
    """Paper A's simulated object: forces at four points, noise on the forces only.

    The object is 0.4 x 1.0 x 0.2 m with the body frame at a corner, so that its centre of mass is
    where Table I has it; inertia about the origin with tensor signs.
    """
    centred = InertialParameters.from_dynamic_parameters(
        np.concatenate([[_TABLE_ONE_MASS], _TABLE_ONE_MASS * _TABLE_ONE_COM, _TABLE_ONE_INERTIA])
    )
    body = HeldObject(
        "table one",
        np.array([0.4, 1.0, 0.2]),
        centred.mass,
        centred.com,
        centred.inertia_com,
    )
    options = ScenarioOptions(duration=duration)
    drawn = Scenario.draw(seed, options)
    scenario = Scenario(seed, options, body, drawn.motion, _four_points(body, drawn.grasp))
    sensors = SensorOptions(
        force_std=float(np.sqrt(variance)),
        position_std=0.0,
        rotation_std_deg=0.0,
        state_force_std=variance > 0.0,
    )
    streams = read_sensors(scenario.simulate(stride=10), (), sensors, seed)
    streams = dataclasses.replace(streams, pose=dataclasses.replace(streams.pose, covariance=None))
    return Case(streams, centred, scenario, sensors)


def _four_points(body: HeldObject, drawn: Grasp) -> Grasp:
    inward = np.array(body.com) - _TABLE_ONE_POINTS
    normal = inward / np.linalg.norm(inward, axis=1, keepdims=True)
    place = Placement(_TABLE_ONE_POINTS, normal, np.zeros((4, 3)))
    still = SumOfSines(np.zeros((4, 1)), np.ones((4, 1)), np.zeros((4, 1)))
    return dataclasses.replace(
        drawn, placements=(place, place), lifts=(), roll=still, squeeze=still, grip=0.0
    )


def four_fingers(
    seed: int,
    duration: float = 30.0,
    effects: dict[str, float] | None = None,
    options: ScenarioOptions | None = None,
) -> Case:
    """A held object of 0.1 to 1 kg: 0.03 N, 0.5 mm, 0.2 deg, 100 Hz."""
    options = dataclasses.replace(options or ScenarioOptions(), duration=duration)
    return from_recording(generate(seed, effects, options))


def from_recording(recording: HiddenRecording) -> Case:
    """Wrap a generated recording."""
    body = recording.scenario.body
    truth = InertialParameters(body.mass, body.com, body.inertia_com)
    return Case(recording.streams, truth, recording.scenario, SensorOptions())


def with_motion(case: Case, motion: Motion, seed: int) -> Case:
    """The same object and grasp, moved otherwise."""
    scenario = dataclasses.replace(case.scenario, motion=motion)
    streams = read_sensors(scenario.simulate(), (), case.sensors, seed)
    return Case(streams, case.truth, scenario, case.sensors)


__all__ = [
    "TABLE_ONE_VARIANCES",
    "Case",
    "four_fingers",
    "from_recording",
    "inertia_matrix",
    "table_one",
    "with_motion",
]
