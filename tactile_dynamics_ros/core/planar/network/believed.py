"""Pushes as a filter gets them: what it expects to learn of each, and what it believes of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.planar.filter.dual import DualConfig, DualFilter
from tactile_dynamics_ros.core.planar.filter.linked_patch import LinkedPatchProcess
from tactile_dynamics_ros.core.planar.filter.observation import MeasuredWrench, Observation
from tactile_dynamics_ros.core.planar.filter.patch import PatchProcess
from tactile_dynamics_ros.core.planar.filter.process import LINK_PARAMETERS, Process, PusherMotion
from tactile_dynamics_ros.core.planar.network.graph import Push
from tactile_dynamics_ros.core.planar.network.transitions import Noise, Transitions


class Sensed(Protocol):
    """One step as sensors tell it."""

    @property
    def motion(self) -> PusherMotion | None:
        """Of the pusher; None where nothing was touched."""

    @property
    def seen(self) -> Observation:
        """Poses, and the wrench where something was touched."""

    @property
    def steady(self) -> bool:
        """Whether it touched through all of the step."""

    @property
    def usual(self) -> Observation:
        """What is seen, with the wrench of steady touches only."""


@dataclass(frozen=True, eq=False)
class CandidatePush:
    """A push that may be learnt from.

    Attributes:
        steps: with the simulator's truth.
        sensed: steps as the tip was led. given: the same with the tip that gives way.
    """

    steps: Transitions
    sensed: Sequence[Sensed]
    given: Sequence[Sensed]

    @property
    def mechanics(self) -> LinkedPatchProcess:
        """Model of the object by its outline."""
        thing = self.steps.thing
        heights = [None] * thing.links if thing.com_height is None else thing.com_height.tolist()
        parts = tuple(
            PatchProcess(patch.outline, height)
            for patch, height in zip(thing.patches, heights, strict=True)
        )
        return LinkedPatchProcess(parts, thing.joint, thing.rigid)

    @property
    def start(self) -> Array:
        """Poses (3 L,) that are seen first."""
        return np.concatenate([pose.value for pose in self.sensed[0].seen.poses])

    @property
    def pose_std(self) -> Array:
        """(3,) of the poses."""
        return self.sensed[0].seen.poses[0].std


def expected_information(process: Process, push: CandidatePush) -> Array:
    """Information (4 L, 4 L) on the links' parameters that a filter expects of a push.

    It takes the steps of the push and is shown what it expects: its mean stays, and by how much
    its covariance falls does not hang on what will be measured.

    Args:
        process: the model, with what is known before.
        push: of which the way of the tip is used, and how good sensors are.

    Source: paper B, Eq. 17 (its belief after N steps).
    """
    belief = DualFilter(process, push.start, push.pose_std, DualConfig())
    size = len(LINK_PARAMETERS) * process.links
    for step in push.sensed:
        if step.motion is not None and step.seen.wrench is not None:
            belief.step(step.motion, _as_expected(belief, step.motion, step.seen))
    after, before = belief.parameters[1][:size, :size], process.prior[1][:size, :size]
    return np.asarray(np.linalg.inv(after) - np.linalg.inv(before))


def _as_expected(belief: DualFilter, motion: PusherMotion, seen: Observation) -> Observation:
    """The same measurements with the values that the filter expects."""
    assert seen.wrench is not None
    told, count = belief.expected(motion, seen)[0], len(seen.poses)
    places = told[: 3 * count].reshape(count, 3)
    poses = tuple(replace(p, value=v) for p, v in zip(seen.poses, places, strict=True))
    return replace(seen, poses=poses, wrench=MeasuredWrench(told[3 * count :], seen.wrench.std))


def believed_steps(pushes: Sequence[CandidatePush], seed: int) -> list[Transitions]:
    """Steps of pushes of one object as a filter on the mechanics believes them, without truth.

    Its first pass over all pushes tells the parameters; the second, which begins with them, the
    states. The standard deviations of rates and forces go along as noise of what is learnt.

    Args:
        pushes: of one object, each on a table of its own.
        seed: of the hypotheses.
    """
    process, config = pushes[0].mechanics, DualConfig(seed=seed)
    known = process.prior
    for push in pushes:
        belief = DualFilter(process, push.start, push.pose_std, config, known)
        _follow(belief, push.given)
        known = belief.parameters
    found = []
    for push in pushes:
        belief = DualFilter(process, push.start, push.pose_std, config, known)
        found.append(_transitions(push, known[0], *_follow(belief, push.given)))
    return found


def _follow(belief: DualFilter, steps: Sequence[Sensed]) -> tuple[Array, Array]:
    """States (K, 6 L) after each step, and their std."""
    states, spreads = [], []
    for step in steps:
        belief.step(step.motion, step.usual)
        mean, covariance = belief.state
        states.append(mean)
        spreads.append(np.sqrt(np.diag(covariance)))
    return np.array(states), np.array(spreads)


def _transitions(push: CandidatePush, mean: Array, states: Array, spread: Array) -> Transitions:
    """The steady steps of a push between states that are believed."""
    pairs = [
        (k, step.motion, step.seen.wrench)
        for k, step in enumerate(push.sensed)
        if k > 0 and step.steady and step.motion is not None and step.seen.wrench is not None
    ]
    rows = np.array([k for k, _, _ in pairs])
    first = np.array([motion.before for _, motion, _ in pairs])
    moved = np.array([motion.after - motion.before for _, motion, _ in pairs])
    one = pairs[0][1]
    links = states.shape[1] // 6
    rates = spread[rows].reshape(len(rows), links, 6)[:, :, 3:]
    across = rates[:, :, :2].max(axis=2)
    each = np.stack([across, across, rates[:, :, 2]], axis=2)
    return Transitions(
        thing=push.steps.thing,
        parameters=np.broadcast_to(mean, (len(rows), len(mean))),
        states=states[rows - 1],
        after=states[rows],
        push=Push(
            point=first[:, :2],
            velocity=moved[:, :2] / one.step,
            normal=np.array([motion.normal for _, motion, _ in pairs]),
            touching=np.ones(len(rows)),
            height=np.full(len(rows), one.height),
            step=one.step,
            link=one.link,
        ),
        force=np.array([measured.value[:2] for _, _, measured in pairs]),
        noise=Noise(
            np.concatenate([each, each], axis=2),
            np.array([measured.std[:2] for _, _, measured in pairs]),
        ),
    )
