"""The first motion of an object that was never held: what its grasp site alone lets one design."""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.contact.wrench_samples import GRAVITY_W
from tactile_dynamics_ros.core.inertia.batch.prior import LogCholeskyPrior, body_prior
from tactile_dynamics_ros.core.inertia.excitation.design import DesignConfig
from tactile_dynamics_ros.core.inertia.excitation.grip import Grip
from tactile_dynamics_ros.core.inertia.excitation.limits import ArmLimits, MotionLimits
from tactile_dynamics_ros.core.inertia.excitation.plan import (
    ExcitationPlan,
    Knowledge,
    plan_motion,
)
from tactile_dynamics_ros.core.inertia.excitation.trajectory import HeldPose
from tactile_dynamics_ros.core.manipulation.grasp_planner import (
    GraspSite,
    plan_grasp,
    squeeze_forces,
)
from tactile_dynamics_ros.core.manipulation.squeeze import SqueezeConfig
from tactile_dynamics_ros.core.rigid_body.inertial_parameters import (
    dynamic_parameters_from_log_cholesky,
    log_cholesky_jacobian,
)
from tactile_dynamics_ros.core.robot.hand_kinematics import HandKinematics
from tactile_dynamics_ros.core.robot.robot import Robot

Array = NDArray[np.float64]

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
    """Design the motion that follows the first grasp, before anything of the object is felt.

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
