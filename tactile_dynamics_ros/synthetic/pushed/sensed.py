"""A simulated recording as steps of a filter, and touch by touch."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from tactile_dynamics_ros.core.planar.filter.dual import DualFilter
from tactile_dynamics_ros.core.planar.filter.observation import (
    MeasuredWrench,
    Observation,
    SeenPose,
)
from tactile_dynamics_ros.core.planar.filter.patch import PatchProcess
from tactile_dynamics_ros.core.planar.filter.process import PusherMotion
from tactile_dynamics_ros.core.planar.network.noise_features import Touched, TouchHistory
from tactile_dynamics_ros.synthetic.pushed.scene import STEP
from tactile_dynamics_ros.synthetic.pushed.transitions import states_at, true_parameters

FORCE_STD, POSE_STD = 0.03, np.array([5e-4, 5e-4, np.radians(0.2)])
"""Noise of each mean force, N, and of each pose, m and rad, where nothing else is said."""
JUMP = 1.5 * STEP
"""m in a tick of the physical clock above which a pusher jumps: 1.5 m/s."""
TURNING_REACH = 0.05
"""m at which a turn counts as a way: grippers turn by less than 1 rad/s while they pull."""
POINT_STD = 3e-4
"""m, noise of each axis of the contact points."""
STIFFNESS = 2e4
"""N/m of tip and arm, by which the touched point lags behind the pusher."""


@dataclass(frozen=True, eq=False)
class SensedStep:
    """One step.

    Attributes:
        motion: of the pusher; None where nothing was touched.
        seen: poses, and the wrench where something was touched.
        steady: whether it touched through all of the step and already in the one before.
        share: of the step in which it touched.
        truth: (6 L,) state at its end. period: s.
    """

    motion: PusherMotion | None
    seen: Observation
    steady: bool
    share: float
    truth: np.ndarray
    period: float

    @property
    def usual(self) -> Observation:
        """What is seen, with the wrench of steady touches only."""
        return self.seen if self.steady else replace(self.seen, wrench=None)


def sensed_steps(one: Any, period: float, seed: int) -> list[SensedStep]:
    """Steps of a recording.

    Args:
        one: recording, with its scene and motion.
        period: s of each step.
        seed: of the noise.
    """
    scene, motion = one.scene, one.motion
    span, rng = round(period / STEP), np.random.default_rng([seed, 7])
    states = states_at(scene, motion)
    found: list[SensedStep] = []
    for k in range(3, len(states) - span - 1, span):
        window, truth = slice(k + 1, k + span + 1), states[k + span]
        pulls = bool(motion.contact[window, 1:].any())
        touched = float(motion.contact[window, 1 if pulls else 0].mean())
        poses = tuple(
            SeenPose(pose[:3] + POSE_STD * rng.normal(size=3), POSE_STD, 0.0, link)
            for link, pose in enumerate(truth.reshape(-1, 6))
        )
        noise = FORCE_STD * rng.normal(size=(2, 2) if pulls else 2)
        if touched < 0.5:
            found.append(SensedStep(None, Observation(poses), False, touched, truth, period))
            continue
        steady = bool(touched > 0.99 and found and found[-1].motion is not None)
        moved = pulled(scene, motion, k, period) if pulls else pushed(scene, motion, k, period)
        measured = (force_of_pads if pulls else _force_of_tip)(motion, window, moved, noise)
        seen = Observation(poses, measured)
        found.append(SensedStep(moved, seen, steady, touched, truth, period))
    return found


def giving_way(near: Sequence[SensedStep], step: SensedStep) -> SensedStep:
    """The touched point of a tip that gives way while the force grows, as the tracker has it.

    Args:
        near: the steps before, now and after.
        step: with the pusher's motion.
    """
    assert step.motion is not None
    force = [s.usual.wrench.value[:2] if s.usual.wrench is not None else np.zeros(2) for s in near]
    lag = 0.5 * (force[-1] - force[0]) / (STIFFNESS * step.motion.step)
    after = step.motion.after - np.append(step.motion.step * lag, 0.0)
    return replace(
        step, motion=replace(step.motion, after=after), seen=replace(step.seen, slack=lag)
    )


def pushed(scene: Any, motion: Any, k: int, period: float) -> PusherMotion:
    """The tip's motion in the step after a tick."""
    end = k + round(period / STEP)
    row = k + 1 + int(np.argmax(motion.contact[k + 1 : end + 1, 0]))
    normal, tip = motion.normal[row, 0], motion.pusher[:, :2]
    begin = arrived(tip, k, end)
    before = np.append(tip[begin] + scene.tip.radius * normal, 0.0)
    after = before + np.append(tip[end] - tip[begin], 0.0)
    return PusherMotion(
        before, after, period, scene.tip.height, touching=True, normal=normal,
        link=int(motion.touched[row]),
    )  # fmt: skip


def pulled(scene: Any, motion: Any, k: int, period: float) -> PusherMotion:
    """The gripper's motion in the step after a tick."""
    end = k + round(period / STEP)
    before = motion.pusher[arrived(motion.pusher, k, end)]
    return PusherMotion(
        before, motion.pusher[end], period, scene.tip.height, grip=True, touching=True,
        link=int(motion.touched[k + 1]),
    )  # fmt: skip


def arrived(place: np.ndarray, begin: int, end: int) -> int:
    """Tick at which the pusher came to this action: simulated ones jump from action to action."""
    ways = np.diff(place[begin : end + 1], axis=0)
    ways[:, 2:] *= TURNING_REACH
    jumps = np.flatnonzero(np.linalg.norm(ways, axis=1) > JUMP)
    return begin + 1 + int(jumps[-1]) if len(jumps) else begin


def _force_of_tip(motion: Any, window: slice, _: PusherMotion, noise: np.ndarray) -> MeasuredWrench:
    return MeasuredWrench(motion.force[window, 0].mean(axis=0) + noise, np.full(2, FORCE_STD))


def force_of_pads(
    motion: Any, window: slice, moved: PusherMotion, noise: np.ndarray
) -> MeasuredWrench:
    """Force of both pads and its torque about where the gripper began, as `PushTracker` has it."""
    force = motion.force[window, 1:].mean(axis=0) + noise
    arm = motion.point[window, 1:].mean(axis=0) - moved.before[:2]
    torque = float(np.sum(arm[:, 0] * force[:, 1] - arm[:, 1] * force[:, 0]))
    squeeze = float(np.linalg.norm(force, axis=1).max())
    reach = float(np.linalg.norm(arm, axis=1).max())
    spread = np.hypot(reach * FORCE_STD * np.sqrt(2.0), POINT_STD * squeeze)
    std = np.array([FORCE_STD * np.sqrt(2.0), FORCE_STD * np.sqrt(2.0), spread])
    return MeasuredWrench(np.append(force.sum(axis=0), torque), std)


_KNOWN = 0.01
"""Standard deviation of ln product, ln mass, ln friction and, in units of 5 cm, of the centre, with
which the filter knows the truth: errors that only a wrong object causes are not the sensors'."""


@dataclass(frozen=True, eq=False)
class ForceErrors:
    """Touched steps of one recording.

    Attributes:
        touched: what was known of each, N.
        errors: (N, 2) N, measured less expected.
        granted: (N, 2, 2) N^2, covariance of what is expected by the filter's own belief.
    """

    touched: list[Touched]
    errors: np.ndarray
    granted: np.ndarray


def force_errors(one: Any, period: float, seed: int) -> ForceErrors:
    """What a filter on mechanics that knows the object makes of all forces of a tip.

    It follows the poses and learns nothing from forces, so that each is judged by itself. Its
    belief about motion and local friction is what it is in use, unlike exact states: those make a
    tip that starts within a step an impact of hundreds of newtons.

    Args:
        one: recording of one link under a tip.
        period: s of each step.
        seed: of the noise.
    """
    link, truth = one.scene.thing.links[0], true_parameters(one.scene)
    process = PatchProcess(link.corners, 0.5 * link.height)
    scale = np.array([1.0, 1.0, 0.05, 0.05, 1.0])
    steps = sensed_steps(one, period, seed)
    known = truth, np.diag(np.square(_KNOWN * scale))
    belief = DualFilter(process, steps[0].seen.poses[0].value, POSE_STD, prior=known)
    history = TouchHistory()
    rows: list[tuple[Touched, np.ndarray, np.ndarray]] = []
    for k, step in enumerate(steps):
        if step.motion is None:
            history.end()
        else:
            step = giving_way(steps[max(k - 1, 0) : k + 2], step)
            rows += _judged(belief, history, step)
        belief.step(step.motion, replace(step.seen, wrench=None))
    errors = np.array([row[1] for row in rows]).reshape(-1, 2)
    granted = np.array([row[2] for row in rows]).reshape(-1, 2, 2)
    return ForceErrors([row[0] for row in rows], errors, granted)


def _judged(
    belief: DualFilter, history: TouchHistory, step: SensedStep
) -> list[tuple[Touched, np.ndarray, np.ndarray]]:
    motion, seen = step.motion, step.seen
    assert motion is not None and seen.wrench is not None
    touched = history.next(motion, seen.wrench, step.share, belief.state[0])
    if touched is None:
        return []
    mean, covariance = belief.expected(motion, seen)
    return [(touched, seen.wrench.value[:2] - mean[-2:], covariance[-2:, -2:])]
