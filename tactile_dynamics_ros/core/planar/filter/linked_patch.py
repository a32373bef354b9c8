"""The physical model of pushing for two parts that a joint holds together, or that are one body."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import block_diag

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.planar.filter.patch import PatchProcess, advanced
from tactile_dynamics_ros.core.planar.filter.process import (
    LINK_PARAMETERS,
    LINK_STATE,
    Mask,
    Prediction,
    PusherMotion,
)
from tactile_dynamics_ros.core.planar.mechanics.hold import Grip, Tip
from tactile_dynamics_ros.core.planar.mechanics.linkage import (
    Joint,
    Link,
    Linkage,
    shifted_twist,
    turned,
)
from tactile_dynamics_ros.core.planar.mechanics.support import PairPatch

_JOINT_FRICTION, _JOINT_SPREAD = 0.03, 0.8
"""Median of a joint's friction, N m, and spread of its logarithm before any data: from hinges that
fall shut to such as hold a page. Wider only delays the filter."""


@dataclass(frozen=True, eq=False)
class LinkedPatchProcess:
    """Mechanics of links, each on its own footprint.

    Attributes:
        parts: mechanics of each link.
        joint: (2,) m in the frame of link_1, where two links meet; None for one link.
        rigid: whether the joint does not turn.
    """

    parts: tuple[PatchProcess, ...]
    joint: Array | None = None
    rigid: bool = False

    @property
    def links(self) -> int:
        """L."""
        return len(self.parts)

    @property
    def _turns(self) -> bool:
        return self.joint is not None and not self.rigid

    @property
    def names(self) -> tuple[str, ...]:
        """Of the parameters: those of each link, ln of the tip's friction and of the joint's."""
        joint = ("ln_joint_friction",) * self._turns
        return (*LINK_PARAMETERS * self.links, "ln_tip_friction", *joint)

    @property
    def prior(self) -> tuple[Array, Array]:
        """Mean (p,) and covariance (p, p)."""
        each = [part.prior for part in self.parts]
        size = len(LINK_PARAMETERS)
        means = [mean[:size] for mean, _ in each] + [each[0][0][size:]]
        blocks = [covariance[:size, :size] for _, covariance in each] + [each[0][1][size:, size:]]
        if self._turns:
            means.append(np.array([np.log(_JOINT_FRICTION)]))
            blocks.append(np.array([[_JOINT_SPREAD**2]]))
        return np.concatenate(means), np.asarray(block_diag(*blocks))

    def feasible(self, parameters: Array) -> Mask:
        """Whether each centre of mass lies above its link's footprint."""
        each = [part.feasible(self._own(parameters, k)) for k, part in enumerate(self.parts)]
        return np.asarray(np.all(each, axis=0))

    def acting(self, states: Array, parameters: Array) -> tuple[Array, tuple[int, ...]]:
        """The parameters, or by what those of a rigid pair act together."""
        if self.links == 2 and self.rigid:
            numbers = RigidPair.of(self.parts, states).acting(parameters)
            return numbers, (numbers.shape[1] - 1,)
        masses = [k for k, name in enumerate(self.names) if name == "ln_mass"]
        return parameters, tuple(masses)

    def predict(self, states: Array, parameters: Array, motion: PusherMotion) -> Prediction:
        """Advance by one step of the pusher.

        Raises:
            BadInputError: there are three links or more.
        """
        if self.links == 1:
            return self.parts[0].predict(states, parameters, motion)
        if self.links > 2 or self.joint is None:
            raise BadInputError(f"{self.links} links: the mechanics know two, and where they meet")
        links = tuple(
            part.link_of(
                self._own(parameters, k), motion if k == motion.link else replace(motion, lift=0.0)
            )
            for k, part in enumerate(self.parts)
        )
        touched = self.parts[motion.link]
        pusher = touched.pusher_of(self._own(parameters, motion.link), motion)
        if self.rigid:
            pair = RigidPair.of(self.parts, states)
            return pair.predict(links, pusher, states, motion, touched.step, touched.rounds)
        low = np.min([link.com_height for link in links], axis=0)  # where the joint's force acts
        linkage = Linkage(
            tuple(replace(link, com_height=low) for link in links), self._joint(states, parameters)
        )
        return advanced(linkage, pusher, states, motion, touched.step, touched.rounds)

    def _own(self, parameters: Array, link: int) -> Array:
        """Parameters (C, 5) of one link and of the tip."""
        size, tip = len(LINK_PARAMETERS), len(LINK_PARAMETERS) * self.links
        return np.column_stack(
            [parameters[:, size * link : size * link + size], parameters[:, tip]]
        )

    def _joint(self, states: Array, parameters: Array) -> Joint:
        """The joint, whose place on link_2 follows from where both links are."""
        assert self.joint is not None
        first = np.broadcast_to(self.joint, (len(states), 2))
        second = states[:, len(LINK_STATE) : len(LINK_STATE) + 3]
        place = states[:, :2] + turned(first, states[:, 2])
        other = turned(place - second[:, :2], -second[:, 2])
        return Joint(first, other, np.exp(parameters[:, -1]))


@dataclass(frozen=True, eq=False)
class RigidPair:
    """Mechanics of a rigid pair in the frame of its first part.

    Which part carries how much follows from where the whole centre of mass lies, not from the
    masses of the parts: only their sum and their common centre act.

    Attributes:
        patch: both footprints. first: points of the first part.
        offset: (3,) pose of the second part in the frame of the first.
    """

    patch: PairPatch
    first: int
    offset: Array

    @classmethod
    def of(cls, parts: tuple[PatchProcess, ...], states: Array) -> RigidPair:
        """Return the pair as the mean of states (C, 12) has it."""
        one, two = states[:, :3].mean(axis=0), states[:, 6:9].mean(axis=0)
        place = turned((two - one)[None, :2], -one[None, 2])[0]
        offset = np.append(place, two[2] - one[2])
        points, areas = [], []
        for part, (x, y, yaw) in zip(parts, (np.zeros(3), offset), strict=True):
            patch = part.patch
            middle = patch.centroid + patch.offset
            points.append(turned(middle, np.full(len(middle), yaw)) + [x, y])
            areas.append(patch.share * part.area)
        shares = np.concatenate(areas)
        patch = PairPatch(
            parts[0].outline, points=np.concatenate(points), shares=shares / shares.sum()
        )
        return cls(patch, len(points[0]), offset)

    def predict(
        self,
        links: tuple[Link, ...],
        pusher: Tip | Grip,
        states: Array,
        motion: PusherMotion,
        longest: float,
        rounds: int,
    ) -> Prediction:
        """Advance states (C, 12); the second part keeps its pose relative to the first."""
        pusher = replace(pusher, link=0)
        if isinstance(pusher, Tip) and motion.link == 1:
            outline = turned(pusher.outline, np.full(len(pusher.outline), self.offset[2]))
            pusher = replace(pusher, outline=outline + self.offset[:2])
        body = Linkage((self.merged(*links),))
        found = advanced(body, pusher, states[:, :6], motion, longest, rounds)
        after, yaw = found.states, states[:, 2]
        away = turned(states[:, 6:8] - states[:, :2], -yaw)
        arm = turned(away, after[:, 2])
        place = after[:, :2] + arm
        turn = (after[:, 2] + states[:, 8] - yaw)[:, None]
        both = np.concatenate([after, place, turn, shifted_twist(after[:, 3:], arm)], axis=1)
        return replace(found, states=both)

    def acting(self, parameters: Array) -> Array:
        """By what parameters (C, p) of both parts act together, (C, p - 3).

        In steady sliding these are the friction of each face under the whole mass, as ln (kg), the
        common centre, m, and what belongs to no part; ln of the whole mass, which only inertia
        tells, is last. How mass and centre are shared out acts by the common centre alone.
        """
        size = len(LINK_PARAMETERS)
        one, two = parameters[:, :size], parameters[:, size : 2 * size]
        whole = np.logaddexp(one[:, 1], two[:, 1])
        share = np.exp(two[:, 1] - whole)[:, None]
        other = turned(two[:, 2:4], np.full(len(two), self.offset[2])) + self.offset[:2]
        faces = [part[:, 0] - part[:, 1] + whole for part in (one, two)]
        com = (1.0 - share) * one[:, 2:4] + share * other
        return np.column_stack([*faces, com, parameters[:, 2 * size :], whole])

    def merged(self, one: Link, two: Link) -> Link:
        """Return one link of the mass and the centre of both."""
        mass, turn = one.mass + two.mass, np.full(len(one.mass), self.offset[2])
        centres = [one.com, turned(two.com, turn) + self.offset[:2]]
        share = np.stack([one.mass / mass, two.mass / mass])
        com = np.asarray(sum(s[:, None] * c for s, c in zip(share, centres, strict=True)))
        inertia = one.inertia + two.inertia
        for link, centre in zip((one, two), centres, strict=True):
            inertia = inertia + link.mass * np.sum((centre - com) ** 2, axis=1)
        rough = np.ones((len(mass), len(self.patch.shares)))
        rough[:, self.first :] = (two.friction / one.friction)[:, None]
        height = share[0] * one.com_height + share[1] * two.com_height
        return Link(self.patch, mass, one.friction, com, height, inertia, np.ones(len(mass)), rough)
