"""Motions in joint space that tell most of an arm and its payload, within limits."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.configuration import check_ranges, parameter
from tactile_dynamics_ros.core.errors import NotIdentifiableError
from tactile_dynamics_ros.core.joints.arm import Arm
from tactile_dynamics_ros.core.joints.live import KnownArm
from tactile_dynamics_ros.core.joints.prior import FRICTION_STD, USUAL_SHARE, BodyPrior, all_columns
from tactile_dynamics_ros.core.joints.samples import BLOCK, JointSamples
from tactile_dynamics_ros.core.numerics.least_squares import DECISIVE, chi_square_beside, refuted
from tactile_dynamics_ros.core.numerics.search import SearchConfig, evolve
from tactile_dynamics_ros.core.weighing.arm import Plane, SerialArm, nearest

_WAVES = 5
"""Sines of each joint: their ten numbers make reversals at many places; fewer repeat themselves,
more are faster than arms like."""
_INSTANTS = 120
"""Instants at which a motion is judged: four a second of half a minute. Twice as many change the
expected std of a payload by 3 %."""
_CLEAR_HZ = 16.0
"""Rate at which clearance is judged in the search, Hz: links move some centimetres meanwhile."""
_MARGIN = 0.02
"""Distance that links keep from each other and from the floor, m, as for weighing; what is nearer
in the middle of all ranges, as neighbours in a chain, may stay so. Half of it is left between the
instants of the search."""
_RAMP = 0.1
"""Share of a motion in which it begins from rest, and in which it ends."""
_NOISE = 0.02
"""Noise of a mean torque that is presumed without a recording, as a share of the torque that
gravity makes at most: that of usual drives."""
_PENALTY = 1e3
"""Cost of a metre below the floor or too near, in units of the logarithm of a volume: any motion
that keeps clear is better than any that does not."""
_NEAREST = 0.5
"""Share of the largest distance of two joints in a motion that they keep in any case: joints of a
finger are always nearer than arms have to be."""
_SEARCH = SearchConfig(samples=32, elites=4, rounds=8)
"""Evaluations of the search, 300 in all, some seconds; twice as many tell 5 % more."""
_PERIOD, _OF_BLOCK = 0.02, 4
"""Time between the points of motions that separate, s, and points of a block: 50 Hz follow the
fastest sines, and 80 ms are the blocks of recordings at that rate."""
_BY_ONES = 0.3
"""Std of the first variations of amplitudes, whose largest is 1."""


@dataclass(frozen=True)
class JointLimits:
    """What a motion keeps to."""

    duration: float = parameter(30.0, "length of the motion", "s", 5.0, 600.0)
    reach: float = parameter(0.8, "share of each joint's range that is used", "", 0.05, 1.0)
    pace: float = parameter(0.5, "share of each joint's largest speed", "", 0.05, 1.0)
    acceleration: float = parameter(4.0, "largest acceleration of a joint", "rad/s^2", 0.1, 50.0)
    floor: float = parameter(
        0.05, "height in the base above which all links from the third on stay", "m", -10.0, 10.0
    )
    clearance: float = parameter(
        0.12, "least distance between joints that are no neighbours", "m", 0.0, 2.0
    )

    def __post_init__(self) -> None:
        """Check the ranges."""
        check_ranges(self)


_SHORTER = JointLimits(duration=20.0)
"""Limits of motions that separate: 20 s, as for held objects; the usual ones else."""


@dataclass(frozen=True, eq=False)
class JointMotion:
    """A motion that begins and ends at rest.

    Attributes:
        names: of the joints.
        time: (N,) s. position, velocity, acceleration: (N, n).
        mass_std: of a payload, kg, before and after it, with what is known of the arm.
    """

    names: tuple[str, ...]
    time: Array
    position: Array
    velocity: Array
    acceleration: Array
    mass_std: tuple[float, float]

    def to_document(self) -> dict[str, Any]:
        """The fields of a trajectory_msgs/JointTrajectory."""
        points = [
            {
                "positions": q.tolist(),
                "velocities": dq.tolist(),
                "accelerations": ddq.tolist(),
                "time_from_start": {"sec": int(t), "nanosec": round((t - int(t)) * 1e9)},
            }
            for t, q, dq, ddq in zip(
                self.time, self.position, self.velocity, self.acceleration, strict=True
            )
        ]
        return {"joint_names": list(self.names), "points": points}


@dataclass(frozen=True, eq=False)
class Learned:
    """What a recording told of an arm, by one explanation of it.

    Attributes:
        known: the explanation.
        root: (P, P) of the prior's covariance of the bodies.
        noise: (n,) of the mean torque of a block of `BLOCK`, N m.
        information: (p, p) on [friction, bodies in units of the root, parameters of effects], with
            the prior.
    """

    known: KnownArm
    root: Array
    noise: Array
    information: Array

    def columns(self, samples: JointSamples) -> Array:
        """(M, p) derivative of the torques of other samples by what the information is on."""
        friction, bodies = all_columns(samples)
        situation = self.known.situation(samples)
        found = [friction, bodies @ self.root]
        for effect, theta in self.known.effects:
            found.append(effect.jacobian(situation, theta).reshape(len(friction), -1))
        return np.concatenate(found, axis=1)


class _Design:
    """Judges motions of an arm by what they tell beside what is known."""

    def __init__(
        self, arm: Arm, limits: JointLimits, known: Learned | None, shape: SerialArm | None = None
    ) -> None:
        self.arm, self.limits = arm, limits
        self.shape = None if shape is None or shape.names != arm.names else shape.by_bodies
        n = len(arm.names)
        if known is None:
            self.root = BodyPrior.of(arm).root(USUAL_SHARE)
            self.information = np.eye(3 * n + len(self.root))
            self.information[: 3 * n, : 3 * n] /= FRICTION_STD**2
            self.noise = np.full(n, _NOISE * self._most_torque())
        else:
            self.root, self.noise = known.root, known.noise
            size = 3 * n + len(self.root)
            self.information = known.information[:size, :size]

    def _most_torque(self) -> float:
        """Torque of gravity with the arm stretched out, N m."""
        n = len(self.arm.names)
        poses = np.random.default_rng(0).uniform(-1.5, 1.5, (50, n))
        still = np.zeros_like(poses)
        torque = self.arm.torque(self.arm.motion(poses, still, still), self.arm.inertia)
        return float(np.abs(torque).max()) or 1.0

    def motion(self, numbers: Array, count: int) -> tuple[Array, Array, Array, Array]:
        """Time (N,), and (N, n) position, velocity and acceleration of numbers (n, 2 waves + 2).

        The largest excursion, speed and acceleration of each joint are at its limits at most; the
        last two numbers move its centre and make it smaller, down to a tenth.
        """
        limits, joints = self.limits, self.arm.joints
        time = np.linspace(0.0, limits.duration, count)
        fine = np.linspace(0.0, limits.duration, 10 * count)
        omega = 2.0 * np.pi * np.arange(1, _WAVES + 1) * max(2.0, limits.duration / 10.0)
        phase = np.outer(fine / limits.duration, omega)
        shapes = np.hstack([np.sin(phase), np.cos(phase)])
        wave = (shapes @ numbers[:, : 2 * _WAVES].T) * _at_rest(fine / limits.duration)[:, None]
        rate = np.gradient(wave, fine, axis=0)
        bend = np.gradient(rate, fine, axis=0)
        lower, upper = (np.array([getattr(j, end) for j in joints]) for end in ("lower", "upper"))
        speed = np.array([j.velocity or 1.0 for j in joints])
        middle = 0.5 * (lower + upper)
        half = 0.5 * (upper - lower) * limits.reach
        centre = middle + 0.5 * half * np.tanh(numbers[:, -2])
        room = half - np.abs(centre - middle)
        size = np.minimum(room / _most(wave), limits.pace * speed / _most(rate))
        size = np.minimum(size, limits.acceleration / _most(bend))
        size = size * (0.55 + 0.45 * np.tanh(numbers[:, -1] + 1.0))
        parts = (centre + size * wave, size * rate, size * bend)
        q, dq, ddq = (
            np.stack([np.interp(time, fine, one) for one in part.T], axis=1) for part in parts
        )
        return time, q, dq, ddq

    def gained(self, numbers: Array) -> tuple[Array, float]:
        """Information after a motion, and by how much it comes too near to something, m."""
        time, q, dq, ddq = self.motion(numbers, _INSTANTS)
        n, moved = len(self.arm.names), self.arm.motion(q, dq, ddq)
        links = self.arm.regressor(moved)
        bodies = np.concatenate([links, links[:, :, -10:] @ self.arm.to_last_link], axis=2)
        shapes = (np.sign(dq), dq, np.ones_like(q))
        friction = np.concatenate([one[:, :, None] * np.eye(n) for one in shapes], axis=2)
        columns = np.concatenate([friction, bodies @ self.root], axis=2) / self.noise[:, None]
        white = columns.reshape(len(time) * n, -1)
        blocks = self.limits.duration / (BLOCK * len(time))
        near = self.too_near(self.motion(numbers, round(_CLEAR_HZ * self.limits.duration))[1])
        return self.information + blocks * white.T @ white, near

    def too_near(self, positions: Array) -> float:
        """By how much a motion (N, n) comes nearer than it may to floor and arm, m.

        By the shapes of the links where they are known, else by the distances of joints.
        """
        limits = self.limits
        if self.shape is not None:
            rest = 0.5 * (self.shape.limits("lower") + self.shape.limits("upper"))
            floor = (Plane(np.array([0.0, 0.0, 1.0]), limits.floor),)
            found = nearest(self.shape, floor, positions, rest, _MARGIN)
            return max(0.0, -round(found.room, 6))
        still = np.zeros_like(positions)
        places, n = self.arm.motion(positions, still, still).places, len(self.arm.names)
        low = sum(float(np.maximum(limits.floor - p[:, 2], 0.0).max()) for p in places[2:])
        near = 0.0
        for i in range(n):
            for j in range(i + 3, n):
                apart = np.linalg.norm(places[i] - places[j], axis=1)
                room = min(limits.clearance, _NEAREST * float(apart.max()))
                near += float(np.maximum(room - apart, 0.0).max())
        return low + near

    def costs(self, tried: Array) -> Array:
        """(C,) minus the logarithm of what motions (C, n, D) tell, and penalties."""
        found = []
        for numbers in tried:
            information, near = self.gained(numbers)
            found.append(_PENALTY * near - float(np.linalg.slogdet(information)[1]))
        return np.array(found)

    def mass_std(self, information: Array) -> float:
        """Std of a payload's mass, kg."""
        row = np.zeros(len(information))
        row[-len(self.root) :] = self.root[-10]
        return float(np.sqrt(row @ np.linalg.solve(information, row)))


def design_motion(
    arm: Arm,
    limits: JointLimits,
    known: Learned | None = None,
    seed: int = 0,
    rate_hz: float = 50.0,
    shape: SerialArm | None = None,
) -> JointMotion:
    """Design a motion that tells most of links, friction and a payload.

    Args:
        arm: by its URDF, whose limits of positions and speeds are kept.
        limits: kept besides.
        known: of a recording: the motion tells what that did not.
        seed: of the search.
        rate_hz: of the points.
        shape: of its links; without it distances of joints stand for them.

    Raises:
        NotIdentifiableError: no motion keeps clear of floor and arm.
    """
    design, random = _Design(arm, limits, known, shape), np.random.default_rng(seed)
    size = (len(arm.names), 2 * _WAVES + 2)
    parents = random.normal(size=(_SEARCH.samples, *size))
    found = evolve(design.costs, parents, np.full(size, _BY_ONES), random, _SEARCH)
    information, near = design.gained(found.best)
    time, q, dq, ddq = design.motion(found.best, round(limits.duration * rate_hz) + 1)
    near = max(near, design.too_near(q) - 0.5 * _MARGIN)
    if near > 0.0:
        raise NotIdentifiableError(
            f"no motion keeps clear of floor and arm (by {1e3 * near:.0f} mm): lower `floor` or "
            "`clearance`, or use less `reach`"
        )
    stds = design.mass_std(design.information), design.mass_std(information)
    return JointMotion(arm.names, time, q, dq, ddq, stds)


class _Separation(_Design):
    """Judges motions by how far other explanations would be from the torques of the best.

    Source: Box, Hill 1967, as for held objects.
    """

    def __init__(
        self, arm: Arm, limits: JointLimits, best: Learned, others: Sequence[Learned]
    ) -> None:
        super().__init__(arm, limits, best)
        self.best, self.others = best, others

    def samples(self, numbers: Array) -> tuple[JointSamples, float]:
        """Blocks of a motion, and by how much it comes too near to something, m."""
        count = round(self.limits.duration / _PERIOD)
        time, q, dq, ddq = self.motion(numbers, count)
        near = self.too_near(q)
        starts = np.arange(_OF_BLOCK, count - 2 * _OF_BLOCK, _OF_BLOCK)
        signals = (time, q, np.zeros_like(q))
        return JointSamples.of_blocks(self.arm, signals, starts, _OF_BLOCK, _PERIOD), near

    def gaps(self, samples: JointSamples) -> Array:
        """Expected chi^2 that each of the others leaves where the best is right."""
        std = self.noise * np.sqrt(BLOCK / samples.length)
        expected = self.best.known.predict(samples, past=True)
        found = []
        for other in self.others:
            white = ((expected - other.known.predict(samples, past=True)) / std).reshape(-1)
            columns = other.columns(samples).reshape(*expected.shape, -1) / std[:, None]
            columns = columns.reshape(len(white), -1)
            found.append(chi_square_beside(white, columns, other.information))
        return np.array(found)

    def costs(self, tried: Array) -> Array:
        """(C,) minus what motions (C, n, D) refute, each up to twice what is decisive."""
        found = []
        for numbers in tried:
            samples, near = self.samples(numbers)
            gaps = np.minimum(self.gaps(samples), 2.0 * DECISIVE)
            found.append(_PENALTY * near - float(gaps.sum()))
        return np.array(found)


def plan_separation(
    arm: Arm, best: Learned, others: Sequence[Learned], names: Sequence[str]
) -> dict[str, Any] | None:
    """Find the motion after which other explanations of a recording would be refuted.

    The new recording completes the present one: both are asked together.

    Args:
        arm: whose limits are kept.
        best: the explanation that was chosen.
        others: those that cannot be told from it.
        names: of their effects.

    Returns:
        Kind, description in words, what it refutes, expected chi^2, and the motion as the fields
        of a trajectory_msgs/JointTrajectory; None if nothing would help.
    """
    design, random = _Separation(arm, _SHORTER, best, others), np.random.default_rng(0)
    shape = (len(arm.names), 2 * _WAVES + 2)
    parents = random.normal(size=(_SEARCH.samples, *shape))
    least = -2.0 * DECISIVE * len(others)
    numbers = next((one for one in parents if design.costs(one[None])[0] <= least), None)
    if numbers is None:
        search = replace(_SEARCH, rounds=_SEARCH.rounds // 2)
        numbers = evolve(design.costs, parents, np.full(shape, _BY_ONES), random, search).best
    samples, near = design.samples(numbers)
    gaps = design.gaps(samples)
    told = refuted(names, gaps)
    if near > 0.0 or not told:
        return None
    path = design.motion(numbers, round(_SHORTER.duration / _PERIOD) + 1)
    reach = np.abs(path[1] - path[1].mean(axis=0)).max(axis=0)
    return {
        "kind": "motion",
        "description": (
            f"move all joints for {_SHORTER.duration:.0f} s along the trajectory of this answer, "
            f"at most {reach.max():.1f} rad from its middle, and ask about both recordings together"
        ),
        "separates_from": told,
        "expected_chi_square": float(gaps.max()),
        "duration_s": _SHORTER.duration,
        "trajectory": JointMotion(arm.names, *path, (np.nan, np.nan)).to_document(),
    }


def _at_rest(share: Array) -> Array:
    """Window (N,) that rises and falls with three derivatives of zero at its ends."""
    edge = np.clip(np.minimum(share, 1.0 - share) / _RAMP, 0.0, 1.0)
    return np.asarray(edge**4 * (35.0 - 84.0 * edge + 70.0 * edge**2 - 20.0 * edge**3))


def _most(values: Array) -> Array:
    return np.asarray(np.maximum(np.abs(values).max(axis=0), 1e-9))
