"""An excitation for an object that a fitted recording shows, or that was never held."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.contact.wrench_samples import GRAVITY_W
from tactile_dynamics_ros.core.inertia.batch.fitted_model import FittedModel
from tactile_dynamics_ros.core.inertia.batch.inertial_estimate import PARAMETER_NAMES
from tactile_dynamics_ros.core.inertia.batch.prior import LogCholeskyPrior, body_prior
from tactile_dynamics_ros.core.inertia.excitation.design import (
    DesignConfig,
    InertiaCriterion,
    design_motion,
    wrench_information,
)
from tactile_dynamics_ros.core.inertia.excitation.limits import (
    ArmLimits,
    Grip,
    MotionLimits,
    usage_at_rest,
)
from tactile_dynamics_ros.core.inertia.excitation.trajectory import FourierOffsets, HeldPose
from tactile_dynamics_ros.core.manipulation.grasp_planner import (
    GraspSite,
    plan_grasp,
    squeeze_forces,
)
from tactile_dynamics_ros.core.manipulation.squeeze import SqueezeConfig
from tactile_dynamics_ros.core.rigid_body.inertial_parameters import (
    com_inertia_jacobian,
    dynamic_parameters_from_log_cholesky,
    log_cholesky_jacobian,
)
from tactile_dynamics_ros.core.robot.hand_kinematics import HandKinematics
from tactile_dynamics_ros.core.robot.robot import Robot

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


_GRAVITY = float(-GRAVITY_W[2])
"""Weight of a kilogram, N. It follows from `GRAVITY_W`; a larger one presumes a firmer grip in
proportion."""
_FORCE_STD = 0.03
"""Standard deviation of a force axis, N, that is presumed before anything is measured: the live
estimator's default. It scales what the motion is expected to bring; the best motion is the same.
Twice as much promises deviations twice as large."""
_IN_FRONT = np.array([0.55, 0.0, 0.1])
"""Where the grasp is presumed to be, m from the arm's base: 55 cm before it, in reach of the iiwa.
Only the grasp of hand and object is kept of it, not the place. Farther out fewer motions are within
the joints' limits, nearer the arm folds; a plan for a known place does not use it."""


def plan_first_excitation(
    site: GraspSite,
    config: DesignConfig | None = None,
    limits: MotionLimits | None = None,
    mass: float = 0.3,
    friction: float = 0.6,
    kind: Literal["A", "D"] = "A",
    robot: Robot | None = None,
) -> ExcitationPlan:
    """Design the motion that follows the first grasp, before anything of the object is measured.

    The hand is presumed to hold the site as planned, in the posture in which it carries, with the
    force that it gives a body of the presumed mass; of the body no more is known than the prior of
    the estimators. The body frame of the plan is the palm's.

    Args:
        site: where the object is taken.
        config: duration and effort of the search.
        limits: amplitudes and margins.
        mass: kg, presumed.
        friction: coefficient presumed between fingertips and object.
        kind: kind of criterion, see `InertiaCriterion`.
        robot: that takes it; a KUKA iiwa with a right Allegro hand if None.

    Raises:
        NotIdentifiableError: hand or arm cannot take the site, or the grip would slip at rest.
    """
    kinematics, squeeze = HandKinematics(robot), SqueezeConfig()
    robot = kinematics.robot
    grasp = plan_grasp(kinematics, site, _standing(site))
    joints = np.concatenate([robot.carry, grasp.touch])
    palm = kinematics.locate(joints).palm
    pivot = palm[:3, 3] + palm[:3, :3] @ grasp.points.mean(axis=0)
    start = HeldPose(palm[:3, :3], palm[:3, 3], pivot)
    thumb = max(squeeze.least, squeeze.load_factor * mass * _GRAVITY)
    forces = squeeze_forces(grasp.points, grasp.normals, robot.sides, thumb)
    grip = Grip(robot.fingers, grasp.points, grasp.normals, forces, friction)
    reach = ArmLimits.of_robot(kinematics, joints, pivot)
    known = _presume(body_prior(mass, grasp.points))
    return plan_motion(known, start, grip, reach, config or DesignConfig(), limits, kind)


def _standing(site: GraspSite) -> Array:
    """Pose X_WO (4, 4) of the object in front of the arm, to be taken from above."""
    grasp = np.eye(4)
    grasp[:3, :3], grasp[:3, 3] = np.diag([1.0, -1.0, -1.0]), _IN_FRONT
    return np.asarray(grasp @ np.linalg.inv(site.frame()))


def _presume(prior: LogCholeskyPrior) -> Knowledge:
    to_phi = log_cholesky_jacobian(prior.mean) * prior.std
    phi = dynamic_parameters_from_log_cholesky(prior.mean)
    return Knowledge(phi, np.asarray(to_phi @ to_phi.T), _FORCE_STD)
