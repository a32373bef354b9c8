"""What a push or a pull would tell about product, mass and centre of mass: Fisher information.

Parameters are (ln of mass times friction, ln mass, com x, com y); masses in kg, lengths in m.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.configuration import check_ranges, parameter
from tactile_dynamics_ros.core.planar.actions.candidate import Candidate, path_of
from tactile_dynamics_ros.core.planar.mechanics.linkage import Link, Linkage
from tactile_dynamics_ros.core.planar.mechanics.pusher import Grip, Pusher, Tip
from tactile_dynamics_ros.core.planar.mechanics.simulation import Motion, StepConfig, simulate
from tactile_dynamics_ros.core.planar.mechanics.support import SupportPatch

Mask = NDArray[np.bool_]

NAMES = ("ln_product", "ln_mass", "com_x", "com_y")
"""Parameters of a belief, in the order of its mean and covariance."""
_STEP, _COM_STEP = 0.02, 5e-4
"""Steps of the differences by logarithms and by centres of mass, m. Below a tenth of that
regularised friction rounds the differences, above five times that they are no longer slopes."""
_HEIGHT_STEP, _PLACE_STEP = 1e-3, 5e-4
"""m, steps of the differences by height and place of the push: what is uncertain of them; larger
ones would leave the outline's edge near corners."""
STIFFNESS, _STIFFER = 1e4, 0.2
"""N/m of the tip in these simulations, half of real ones so that steps of 5 ms follow impacts, and
the step of its logarithm. If it were known, the ringing after contact would tell the mass."""
STEPS = StepConfig(step=5e-3, rounds=3)
"""How these simulations step: the longest with which impacts of a tip of STIFFNESS are followed."""
_TURNING = 500.0
"""N m/rad of a grip in these simulations, a hundred times real ones: if it were known how far pads
give way, turns by 5 mrad would tell the centre of mass."""

_SLIDING = 0.015
"""m/s, speed below which forces are not counted: feet stick and creep there, and estimators leave
such samples out. At zero the start of every push would seem to tell the mass."""
_UNRESOLVED = 5.0
"""Poses after the beginning within which forces are not counted, nor after braking begins:
estimators know motion by poses and not by the arm, and resolve neither the impact of a tip nor its
ringing. At 2 the ringing of a slow push would seem to tell the mass to 2 %; it does to 30 %."""
_NO_USE = 1e6
"""N, standard deviation of a force that is not counted: beyond all that is measured."""


@dataclass(frozen=True)
class SensingConfig:
    """What is measured, and what is not known beside the parameters."""

    force_std: float = parameter(0.05, "of each force component", "N", 1e-4, 10.0)
    force_rate_hz: float = parameter(100.0, "of forces", "Hz", 1.0, 1000.0)
    pose_std: float = parameter(7e-4, "of each coordinate", "m", 1e-6, 0.1)
    turn_std: float = parameter(4e-3, "of the angle", "rad", 1e-6, 1.0)
    pose_rate_hz: float = parameter(30.0, "of poses", "Hz", 0.1, 1000.0)
    variation: float = parameter(0.08, "of friction from push to push, over its mean", "", 0.0, 1.0)
    local: float = parameter(0.08, "of friction from place to place, over its mean", "", 0.0, 1.0)
    place: float = parameter(0.015, "way over which friction changes", "m", 1e-3, 1.0)
    height_std: float = parameter(0.002, "of the height of the push", "m", 0.0, 0.1)
    point_std: float = parameter(5e-4, "of the contact along the outline", "m", 0.0, 0.1)
    stiffness: float = parameter(0.5, "relative std of the tip's stiffness", "", 0.0, 10.0)
    com_height_std: float = parameter(0.003, "of the centre of mass's height", "m", 0.0, 0.1)

    def __post_init__(self) -> None:
        check_ranges(self)


@dataclass(frozen=True, eq=False)
class Belief:
    """What is known so far.

    Attributes:
        mean: (n,) as `PredictedObject.names`. covariance: (n, n).
    """

    mean: Array
    covariance: Array

    @property
    def std(self) -> Array:
        """(n,) of each parameter alone."""
        return np.asarray(np.sqrt(np.diag(self.covariance)))

    @classmethod
    def unknown(cls, outline: Array) -> Belief:
        """What is known of an object that was only seen: 0.3 kg of product, 0.9 kg, the middle.

        Args:
            outline: (V, 2) m.
        """
        patch = SupportPatch(outline)
        reach = 0.35 * np.sqrt(patch.gyration)
        std = np.array([0.7, 0.6, reach, reach])
        return cls(np.array([np.log(0.3), np.log(0.9), *patch.centroid]), np.diag(std**2))


@dataclass(frozen=True, eq=False)
class PredictedObject:
    """What a simulation needs beside a belief.

    Attributes:
        outline: (V, 2) m, convex. tip_friction: against the tip. push_height: m.
        com_height: m. points: that carry it.
        footprint: (V, 2) m, of any shape, where pads grip; None: the outline.
    """

    outline: Array
    tip_friction: float = 0.35
    push_height: float = 0.02
    com_height: float = 0.025
    points: int = 36
    footprint: Array | None = None

    @property
    def names(self) -> tuple[str, ...]:
        """Of the n parameters, as a belief has them."""
        return NAMES

    @property
    def start(self) -> Array:
        """(L, 3) poses of the links' frames before the push."""
        return np.zeros((1, 3))

    @property
    def patch(self) -> SupportPatch:
        """What carries the part that is touched."""
        return SupportPatch(self.outline, self.points)

    def linkage(self, parameters: Array, com_height: Array) -> Linkage:
        """B such objects.

        Args:
            parameters: (B, n).
            com_height: (B,) m.
        """
        return Linkage((believed_link(self.patch, parameters, com_height),))


def informations(
    thing: PredictedObject,
    belief: Belief,
    candidates: Sequence[Candidate],
    sensing: SensingConfig | None = None,
) -> Array:
    """Fisher information (N, n, n) of each candidate about the parameters.

    Unknown are also friction of this push and of each place on its way, by which its centre lies
    beside the centre of mass, its height and its place on the outline, the stiffness of the tip
    and the height of the centre of mass; they are marginalised:
    F = J' W J - J' W K (K' W K + prior)^-1 K' W J.
    Of a pull the torque about the grip is not counted, as a squeeze of 12 N that acts half a
    millimetre elsewhere turns as much as a centre of mass that lies 3 mm elsewhere.

    Args:
        thing: the object.
        belief: where the sensitivities are taken.
        candidates: of one manner, with the same speed, length and acceleration.
        sensing: what is measured.
    """
    sensing = sensing or SensingConfig()
    slopes, weights, places = _slopes(thing, belief, candidates, sensing)
    count = len(belief.mean)
    names = np.array(thing.names)
    products = np.char.startswith(names, "ln_product")
    centres = np.char.startswith(names, "com")
    known = slopes[..., :count]
    lasting = [known[..., products], known[..., centres], slopes[..., count:]]
    each = [known[..., k, None] * places for k in np.flatnonzero(products)]
    nuisance = np.concatenate([*lasting, *each], axis=2)
    beside = sensing.variation * float(np.sqrt(SupportPatch(thing.outline).gyration))
    unsure = [sensing.variation] * int(products.sum()) + [beside] * int(centres.sum())
    unsure += [sensing.height_std, sensing.point_std, sensing.stiffness, sensing.com_height_std]
    unsure += [sensing.local] * places.shape[2] * int(products.sum())
    prior = np.diag(np.maximum(unsure, 1e-6) ** -2)
    weighted = weights[..., None] * known
    information = known.swapaxes(1, 2) @ weighted
    across = nuisance.swapaxes(1, 2) @ weighted
    own = nuisance.swapaxes(1, 2) @ (weights[..., None] * nuisance) + prior
    return np.asarray(information - across.swapaxes(1, 2) @ np.linalg.solve(own, across))


def expected_gain(belief: Belief, information: Array, which: Mask | None = None) -> Array:
    """Expected gain (N,) in nats: half the fall of the logarithm of the covariance's determinant.

    It is the mean, over what may be measured, of the Kullback-Leibler divergence of the belief
    after a push from the one before, 1/2 (tr(P^-1 Q) - d + u' P^-1 u + ln det P / det Q) with
    covariances P and Q and a shift u of the mean: shifts have the covariance P - Q, so that all
    but the determinants cancels.

    Args:
        belief: before.
        information: (N, n, n).
        which: (n,) parameters whose gain is meant, whatever becomes of the others; None: all.

    Source: paper B, Eq. 17 (blank in print), over all steps of a push.
    """
    chosen = np.flatnonzero(np.ones(len(belief.mean)) if which is None else which)
    own = np.ix_(chosen, chosen)
    after = np.linalg.inv(np.linalg.inv(belief.covariance) + information)[:, own[0], own[1]]
    before = np.linalg.slogdet(belief.covariance[own])[1]
    return np.asarray(0.5 * (before - np.linalg.slogdet(after)[1]))


def updated(belief: Belief, information: Array) -> Belief:
    """What will be known after a push with an information (n, n)."""
    precision = np.linalg.inv(belief.covariance) + information
    return Belief(belief.mean, np.asarray(np.linalg.inv(precision), dtype=float))


def _slopes(
    thing: PredictedObject,
    belief: Belief,
    candidates: Sequence[Candidate],
    sensing: SensingConfig,
) -> tuple[Array, Array, Array]:
    """Sensitivities (N, M, n + 4) of M measurements, weights (N, M), places (N, M, K).

    By the parameters, then by what else is unknown. Places are 1 where the tip is in the
    k-th part of its way, else 0.
    """
    motion = _simulated(thing, belief, candidates)
    count, step = len(candidates), float(motion.time[1])
    variants = len(belief.mean) + 5
    forces, poses = (
        slice(None, None, max(1, round(1.0 / (rate * step))))
        for rate in (sensing.force_rate_hz, sensing.pose_rate_hz)
    )
    runs, links = count * variants, motion.pose.shape[2]
    force = motion.wrench[:, forces, :2]
    pose = motion.pose[:, poses].reshape(runs, -1, 3 * links)
    base = force[::variants]
    slides = _slides(motion.twist[::variants, forces, 0], thing)
    slides = slides & _resolved(candidates[0], motion.time[forces], sensing)[:, None]
    noise = np.where(slides, sensing.force_std, _NO_USE)
    noise = np.broadcast_to(noise, base.shape).reshape(count, -1)
    std_pose = np.tile([sensing.pose_std, sensing.pose_std, sensing.turn_std], links)
    stds = np.broadcast_to(std_pose, (count, *pose.shape[1:])).reshape(count, -1)
    rows = np.concatenate([force.reshape(runs, -1), pose.reshape(runs, -1)], axis=1)
    rows = rows.reshape(count, variants, -1)
    steps = np.array([*_steps(thing), _HEIGHT_STEP, _PLACE_STEP, _STIFFER, _HEIGHT_STEP])
    slopes = (rows[:, 1:] - rows[:, :1]).swapaxes(1, 2) / steps
    weights = np.concatenate([noise, stds], axis=1) ** -2.0
    way = np.linalg.norm(motion.point[::variants, :, :2] - motion.point[::variants, :1, :2], axis=2)
    at = np.concatenate(
        [np.repeat(way[:, forces], 2, axis=1), np.repeat(way[:, poses], 3 * links, axis=1)], 1
    )
    parts = np.arange(int(np.ceil(way.max() / sensing.place)))
    inside = np.floor(at[..., None] / sensing.place) == parts
    return slopes, weights, inside.astype(float)


def _steps(thing: PredictedObject) -> Array:
    """Steps (n,) of the differences by the parameters."""
    return np.where(np.char.startswith(thing.names, "ln_"), _STEP, _COM_STEP)


def _resolved(candidate: Candidate, time: Array, sensing: SensingConfig) -> Mask:
    """Whether (T,) poses resolve the acceleration at times (T,) s of a push or a pull."""
    begun = time > _UNRESOLVED / sensing.pose_rate_hz
    return np.asarray(begun & (time < candidate.travel.braking_from(candidate.length)))


def _simulated(thing: PredictedObject, belief: Belief, candidates: Sequence[Candidate]) -> Motion:
    """All variants of all candidates, one after the other.

    Each candidate as believed, with each of the n parameters changed, then height and place of the
    push, stiffness of the tip, height of the centre of mass.
    """
    count, size = len(candidates), len(belief.mean)
    variants = np.repeat(belief.mean[None], size + 5, axis=0)
    variants[1 : size + 1] += np.diag(_steps(thing))
    com_height = np.full(size + 5, thing.com_height)
    com_height[size + 4] += _HEIGHT_STEP
    paths = paths_of(candidates, size + 5)
    if not candidates[0].grips:
        tangents = np.array([[-c.normal[1], c.normal[0]] for c in candidates])
        paths[size + 2 :: size + 5, :, :2] += _PLACE_STEP * tangents[:, None]
    linkage = thing.linkage(np.tile(variants, (count, 1)), np.tile(com_height, count))
    pusher = _pusher(thing, candidates, size)
    start = np.repeat(thing.start[None], len(paths), axis=0)
    return simulate(linkage, pusher, start, paths, STEPS)


def paths_of(candidates: Sequence[Candidate], variants: int) -> Array:
    """Poses (variants N, T, 3) of the tip or the grip of each candidate, repeated."""
    return np.repeat(np.stack([path_of(c, STEPS.step) for c in candidates]), variants, axis=0)


def _pusher(thing: PredictedObject, candidates: Sequence[Candidate], size: int) -> Pusher:
    """The tip or the grip of all variants of all candidates."""
    count, runs = len(candidates), (size + 5) * len(candidates)
    heights = np.full(size + 5, thing.push_height)
    heights[size + 1] += _HEIGHT_STEP
    stiffness = np.full(size + 5, STIFFNESS)
    stiffness[size + 3] *= np.exp(_STIFFER)
    heights, stiffness = np.tile(heights, count), np.tile(stiffness, count)
    if candidates[0].grips:
        points = np.repeat(np.stack([c.point for c in candidates]), size + 5, axis=0)
        return Grip(points, np.zeros(runs), heights, stiffness=stiffness, turning=_TURNING)
    friction = np.full(runs, thing.tip_friction)
    return Tip(thing.outline, heights, friction, stiffness=stiffness)


def _slides(twist: Array, thing: PredictedObject) -> Mask:
    """Whether (N, T, 1) objects with twists (N, T, 3) slide so fast that friction is Coulomb's."""
    reach = np.sqrt(SupportPatch(thing.outline, thing.points).gyration)
    speed = np.hypot(np.linalg.norm(twist[..., :2], axis=2), reach * twist[..., 2])
    return np.asarray(speed > _SLIDING)[..., None]


def believed_link(
    patch: SupportPatch, parameters: Array, com_height: Array, roughness: Array | None = None
) -> Link:
    """A part with the inertia of an even plate, in B variants.

    Args:
        patch: its footprint.
        parameters: (B, 4 or more), those of `NAMES` first.
        com_height: (B,) m, of the centre of mass.
        roughness: (B, n) friction of each point over the part's; None: all alike.
    """
    mass, com = np.exp(parameters[:, 1]), parameters[:, 2:4]
    inertia = mass * (patch.gyration + np.sum((com - patch.centroid) ** 2, axis=1))
    friction = np.exp(parameters[:, 0]) / mass
    even = np.ones(len(parameters))
    return Link(patch, mass, friction, com, com_height, inertia, even, roughness)
