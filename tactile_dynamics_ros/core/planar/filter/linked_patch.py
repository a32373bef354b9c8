"""The physical model of pushing for two parts that a joint holds together, or that are one body."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag

from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.planar.filter.patch import PatchProcess, advanced
from tactile_dynamics_ros.core.planar.filter.process import (
    LINK_PARAMETERS,
    LINK_STATE,
    Mask,
    Prediction,
    PusherMotion,
)
from tactile_dynamics_ros.core.planar.mechanics.linkage import Joint, Linkage, turned

Array = NDArray[np.float64]

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
        joint = self._joint(states, parameters)
        return advanced(Linkage(links, joint), pusher, states, motion, touched.step, touched.rounds)

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
        friction = np.exp(parameters[:, -1]) if self._turns else np.zeros(len(states))
        other = turned(place - second[:, :2], -second[:, 2])
        return Joint(first, other, friction, self.rigid)
