"""Section `excitation`: a designed motion beside the fixed sum of sines, equal in duration."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any

import numpy as np

from benchmarks.inertia.scenarios import Case, four_fingers, with_motion
from benchmarks.inertia.scores import Score, medians
from tactile_dynamics_ros.core.inertia.estimate import estimate as estimate_body
from tactile_dynamics_ros.core.inertia.excitation import (
    ArmLimits,
    DesignConfig,
    FourierOffsets,
    Grip,
    HeldPose,
    InertiaCriterion,
    MotionLimits,
    design_motion,
)
from tactile_dynamics_ros.core.inertia.excitation.limits import fit_to_limits
from tactile_dynamics_ros.core.manipulation.excitation import ExcitationConfig, SumOfSines
from tactile_dynamics_ros.core.robot.hand_kinematics import HandKinematics
from tactile_dynamics_ros.core.robot.robot_file import load_robot
from tactile_dynamics_ros.synthetic.motion import MotionSamples

ROBOT = load_robot()

_FINGERS = ("index", "middle", "ring", "thumb")
_GRID_HZ = 20.0
_GRIP_N = 5.0


@dataclasses.dataclass(frozen=True)
class _Followed:
    """A motion of the held object as the generator takes it."""

    start: HeldPose
    offsets: FourierOffsets

    def evaluate(self, time: np.ndarray) -> MotionSamples:
        """Return the motion and its derivatives at the given instants, world axes."""
        found = self.start.follow(self.offsets, time)
        return MotionSamples(
            time=time,
            position=found.position,
            velocity=found.velocity,
            acceleration=found.acceleration,
            rotation=found.rotation,
            angular_velocity=np.einsum("nij,nj->ni", found.rotation, found.angular_velocity),
            angular_acceleration=np.einsum(
                "nij,nj->ni", found.rotation, found.angular_acceleration
            ),
        )


def run_excitation(seeds: int, duration: float, say: Callable[[str], None]) -> dict[str, Any]:
    """Errors after the fixed and the designed motion, same limits, grip and duration.

    "same band" designs use no higher frequency than the fixed motion; "free" ones what joint
    speeds and grip allow up to 1.5 Hz. The designer knows the inertia only to about 30 %.
    """
    scores: dict[str, list[Score]] = {"fixed": [], "same band": [], "free": []}
    expected: dict[str, list[float]] = {name: [] for name in scores}
    usage: dict[str, list[float]] = {name: [] for name in scores}
    for seed in range(seeds):
        say(f"excitation, object {seed}")
        case = four_fingers(seed, 2.0)
        setting = _Setting.of(case, duration)
        for name, offsets in setting.candidates(seed).items():
            moved = with_motion(_lasting(case, duration), _Followed(setting.start, offsets), seed)
            estimate = estimate_body(moved.streams).to_estimate()
            scores[name].append(Score.of(case.truth, estimate.inertia.dynamic_parameters, 0.0))
            expected[name].append(setting.expected(offsets))
            usage[name].append(setting.usage(offsets))
    return {
        "seeds": seeds,
        "duration_s": duration,
        "methods": {name: medians(values) for name, values in scores.items()},
        "expected_distance": {name: float(np.median(v)) for name, v in expected.items()},
        "largest_grip_usage": {name: float(np.max(v)) for name, v in usage.items()},
        "gain": {
            name: medians(scores["fixed"])["distance"] / medians(scores[name])["distance"]
            for name in ("same band", "free")
        },
    }


@dataclasses.dataclass(frozen=True)
class _Setting:
    """An object in the hand at the arm's home."""

    case: Case
    duration: float
    start: HeldPose
    grip: Grip
    arm: ArmLimits
    guess: np.ndarray
    time: np.ndarray

    @classmethod
    def of(cls, case: Case, duration: float) -> _Setting:
        kinematics = HandKinematics()
        positions = np.concatenate([ROBOT.home, np.full(16, 0.5)])
        palm = kinematics.locate(positions).palm
        pivot = palm[:3, 3] + 0.1 * palm[:3, 0]
        start = HeldPose(case.scenario.motion.mean_rotation, pivot, pivot)
        place = case.scenario.grasp.placements[0]
        squeeze = place.squeeze * max(case.scenario.grasp.grip, _GRIP_N)
        grip = Grip(_FINGERS, place.point, place.normal, squeeze, 0.9)
        rng = np.random.default_rng(case.scenario.seed)
        body = case.truth
        guess = dataclasses.replace(
            body,
            mass=body.mass * np.exp(0.3 * rng.normal()),
            com=body.com + 0.005 * rng.normal(size=3),
            inertia_com=body.inertia_com * np.exp(0.3 * rng.normal()),
        )
        arm = ArmLimits.of_robot(kinematics, positions, pivot)
        time = np.arange(0.0, duration, 1.0 / _GRID_HZ)
        return cls(case, duration, start, grip, arm, guess.dynamic_parameters, time)

    def candidates(self, seed: int) -> dict[str, FourierOffsets]:
        fixed = _as_fourier(SumOfSines(ExcitationConfig(duration=self.duration)))
        criterion = InertiaCriterion(self.guess, 1e-6 * np.eye(10), 0.03, 100.0 / _GRID_HZ, "A")
        found = {"fixed": self._fitted(fixed)}
        for name, highest in (("same band", 0.75), ("free", 1.5)):
            config = DesignConfig(duration=self.duration, highest_hz=highest, seed=seed, ramp=2.0)
            designed = design_motion(
                criterion, self.start, self.grip, self.guess, MotionLimits(), self.arm, config
            )
            found[name] = designed.offsets
        return found

    def expected(self, offsets: FourierOffsets) -> float:
        truth = self.case.truth.dynamic_parameters
        criterion = InertiaCriterion(truth, 1e-9 * np.eye(10), 0.03, 100.0 / _GRID_HZ, "A")
        samples = self.grip.load(self.start.follow(offsets, self.time), truth)
        return float(np.sqrt(criterion(samples)))

    def usage(self, offsets: FourierOffsets) -> float:
        truth = self.case.truth.dynamic_parameters
        return self.grip.usage(self.grip.load(self.start.follow(offsets, self.time), truth))

    def _fitted(self, offsets: FourierOffsets) -> FourierOffsets:
        return fit_to_limits(
            offsets, self.start, self.grip, self.guess, MotionLimits(), self.arm, self.time
        )


def _lasting(case: Case, duration: float) -> Case:
    scenario = case.scenario
    options = dataclasses.replace(scenario.options, duration=duration)
    grasp = dataclasses.replace(scenario.grasp, grip=max(scenario.grasp.grip, _GRIP_N))
    changed = dataclasses.replace(scenario, options=options, grasp=grasp)
    return dataclasses.replace(case, scenario=changed)


def _as_fourier(fixed: SumOfSines) -> FourierOffsets:
    """The fixed motion in the same form, one block of frequencies per axis."""
    frequency, phase = fixed._frequency, fixed._phase
    count = frequency.shape[1]
    sine, cosine = np.zeros((6, 6 * count)), np.zeros((6, 6 * count))
    for axis in range(6):
        block = slice(axis * count, (axis + 1) * count)
        sine[axis, block] = fixed._scale[axis] * np.cos(phase[axis])
        cosine[axis, block] = fixed._scale[axis] * np.sin(phase[axis])
    return FourierOffsets(fixed.duration, frequency.ravel(), sine, cosine, fixed.config.ramp)
