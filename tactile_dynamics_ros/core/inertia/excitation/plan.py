"""An excitation for the object, grip and estimate that a fitted recording shows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.inertia.batch.fitted_model import FittedModel
from tactile_dynamics_ros.core.inertia.batch.inertial_estimate import PARAMETER_NAMES
from tactile_dynamics_ros.core.inertia.excitation.criterion import (
    InertiaCriterion,
    wrench_information,
)
from tactile_dynamics_ros.core.inertia.excitation.design import DesignConfig, design_motion
from tactile_dynamics_ros.core.inertia.excitation.grip import Grip
from tactile_dynamics_ros.core.inertia.excitation.limits import (
    ArmLimits,
    MotionLimits,
    usage_at_rest,
)
from tactile_dynamics_ros.core.inertia.excitation.trajectory import FourierOffsets, HeldPose
from tactile_dynamics_ros.core.rigid_body.inertial_parameters import com_inertia_jacobian
from tactile_dynamics_ros.core.robot.hand_kinematics import HandKinematics
from tactile_dynamics_ros.core.robot.robot import Robot

Array = NDArray[np.float64]

RECORDED_HZ = 100.0
"""Rate of the recording that is foreseen, Hz, as the nodes publish poses; expected deviations fall
with its root. Twice the true rate promises deviations that are too small by 1.4; the chosen motion
is about the same."""
_TABLE_RATE_HZ = 100.0
"""Rate, Hz, of the motion as samples in the plan; the controller interpolates them. A hundred per
second are 40 per period of the fastest sine (2.5 Hz), by which a line is off by 0.3 %. Lower cuts
its peaks, higher makes plans longer and no smoother."""
_UNITS = ("kg", *("m",) * 3, *("kg m^2",) * 6)
"""Units of PARAMETER_NAMES. They follow the names."""


@dataclass(frozen=True)
class ExcitationPlan:
    """A designed motion and what it is expected to bring.

    Attributes:
        offsets: the motion.
        grip_usage: largest share of the friction cones that it needs.
        std_before: (10,) standard deviations of [m, com, inertia about the com] now.
        std_after: (10,) expected after the motion.
        expected_before: expected affine-invariant distance to the truth now.
        expected_after: after the motion.
    """

    offsets: FourierOffsets
    grip_usage: float
    std_before: Array
    std_after: Array
    expected_before: float
    expected_after: float

    def deviations(self) -> dict[str, tuple[float, float, str]]:
        """Standard deviation now, expected after the motion, and unit, by parameter."""
        columns = (PARAMETER_NAMES, self.std_before, self.std_after, _UNITS)
        return {
            name: (float(now), float(after), unit)
            for name, now, after, unit in zip(*columns, strict=True)
        }

    def motion_table(self) -> dict[str, Any]:
        """The motion as samples: {"time": [N], "offsets": [[6] x N]}."""
        time = np.arange(0.0, self.offsets.duration + 0.5 / _TABLE_RATE_HZ, 1.0 / _TABLE_RATE_HZ)
        offsets = np.round(self.offsets.evaluate(time), 7)
        return {"time": np.round(time, 4).tolist(), "offsets": offsets.tolist()}

    def to_json(self) -> dict[str, Any]:
        """The document that `tactile-dynamics excite --json` prints."""
        peak = np.abs(self.offsets.evaluate(np.linspace(0.0, self.offsets.duration, 2000)))
        return {
            "duration_s": self.offsets.duration,
            "frequency_hz": self.offsets.frequency_hz.tolist(),
            "largest_offsets": peak.max(axis=0).tolist(),
            "grip_usage": self.grip_usage,
            "expected_distance": {"before": self.expected_before, "after": self.expected_after},
            "std": {
                name: {"before": now, "after": after, "unit": unit}
                for name, (now, after, unit) in self.deviations().items()
            },
        }


def plan_excitation(
    model: FittedModel,
    config: DesignConfig | None = None,
    limits: MotionLimits | None = None,
    friction: float = 0.6,
    kind: Literal["A", "D"] = "A",
    arm: Sequence[float] | None = None,
    robot: Robot | None = None,
) -> ExcitationPlan:
    """Design the next motion for what a recording shows.

    Args:
        model: fitted to the recording; it gives the estimate, its covariance and the grip.
        config: duration and effort of the search.
        limits: amplitudes and margins.
        friction: coefficient between fingertips and object; raised to what holding it takes.
        kind: kind of criterion, see `InertiaCriterion`.
        arm: (A,) rad, joints at the start; those in which the robot carries if None.
        robot: that moves; a KUKA iiwa with a right Allegro hand if None.
    """
    config = config or DesignConfig()
    samples, phi = model.samples[-1], model.phi
    grip = Grip.from_samples(samples, phi, friction)
    kinematics = HandKinematics(robot)
    robot = kinematics.robot
    joints = np.concatenate([robot.carry if arm is None else arm, robot.hand_seed])
    palm = kinematics.locate(joints).palm
    reach = ArmLimits.of_robot(kinematics, joints, palm[:3, 3] + palm[:3, :3] @ robot.grasp.pivot)
    pivot = samples.position[-1] + samples.rotation[-1] @ grip.point.mean(axis=0)
    start = HeldPose(samples.rotation[-1], samples.position[-1], pivot)
    grip = replace(grip, friction=grip.friction * max(usage_at_rest(start, grip, phi), 1.0))
    known = Knowledge(phi, model.covariance[:10, :10], _force_std(model))
    return plan_motion(known, start, grip, reach, config, limits, kind)


@dataclass(frozen=True)
class Knowledge:
    """What is known before a motion.

    Attributes:
        phi: (10,) present dynamic parameters.
        covariance: (10, 10) covariance of phi.
        force_std: N per axis and contact.
    """

    phi: Array
    covariance: Array
    force_std: float


def plan_motion(
    known: Knowledge,
    start: HeldPose,
    grip: Grip,
    reach: ArmLimits,
    config: DesignConfig,
    limits: MotionLimits | None = None,
    kind: Literal["A", "D"] = "A",
) -> ExcitationPlan:
    """Design a motion and say what it is expected to bring.

    Args:
        known: before the motion.
        start: pose of the held object.
        grip: grip of the hand.
        reach: limits of the arm.
        config: duration and effort of the search.
        limits: amplitudes and margins.
        kind: kind of criterion, see `InertiaCriterion`.
    """
    phi, before = known.phi, known.covariance
    information = np.linalg.inv(before)
    information = 0.5 * (information + information.T)
    ratio = RECORDED_HZ / config.grid_rate_hz
    criterion = InertiaCriterion(phi, information, known.force_std, ratio, kind)
    designed = design_motion(criterion, start, grip, phi, limits, reach, config)
    time = np.arange(0.0, config.duration, 1.0 / config.grid_rate_hz)
    moved = grip.load(start.follow(designed.offsets, time), phi)
    after = np.linalg.inv(information + ratio * wrench_information(moved, known.force_std))
    mapping = com_inertia_jacobian(phi)
    return ExcitationPlan(
        designed.offsets,
        designed.grip_usage,
        np.sqrt(np.diag(mapping @ before @ mapping.T)),
        np.sqrt(np.diag(mapping @ after @ mapping.T)),
        float(np.sqrt(np.trace(criterion.metric @ before))),
        float(np.sqrt(np.trace(criterion.metric @ after))),
    )


def _force_std(model: FittedModel) -> float:
    """Median standard deviation of the forces, N."""
    factors = [
        contact.signals["force"].noise_factor
        for stretch in model.stretches
        for contact in stretch.problem.contacts
    ]
    stds = np.concatenate([np.sqrt(np.einsum("kij,kij->k", f, f) / 3.0) for f in factors])
    return max(float(np.median(stds)), 1e-4)
