"""The physical model of pushing as a process: one link with Coulomb friction of every point."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.spatial import ConvexHull

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.planar.filter.process import (
    LINK_PARAMETERS,
    Mask,
    Prediction,
    PusherMotion,
)
from tactile_dynamics_ros.core.planar.mechanics.hold import Grip, Tip
from tactile_dynamics_ros.core.planar.mechanics.linkage import (
    Link,
    Linkage,
    cross,
    shifted_twist,
    turned,
)
from tactile_dynamics_ros.core.planar.mechanics.outline import (
    area_and_centroid,
    edge_normals,
    nearest_edge,
)
from tactile_dynamics_ros.core.planar.mechanics.simulation import (
    GRAVITY,
    PlanarSimulation,
    StepConfig,
)
from tactile_dynamics_ros.core.planar.mechanics.support import SupportPatch

_FRICTION, _FRICTION_SPREAD = 0.3, 0.6
"""Median of support friction and standard deviation of its logarithm before any data: 68 % between
0.16 and 0.55, from Teflon to wood, as the fits to recordings presume."""
_MASS, _MASS_SPREAD = 0.5, 1.2
"""Median of masses, kg, and standard deviation of their logarithm: 95 % between 45 g and 5.5 kg,
what arms push. Twice as wide takes the filter one more tenth of a second."""
_TIP_FRICTION, _TIP_SPREAD = 0.4, 0.5
"""The same of the coefficient between pusher and object, which only counts where it slips."""
_REACH = 0.5
"""Standard deviation of the centre of mass from the centroid over the footprint's radius of
gyration: a lump that leaves the middle third of a box is rare."""


@dataclass(frozen=True, eq=False)
class PatchProcess:
    """Mechanics of one link.

    Attributes:
        outline: (V, 2) m, link frame.
        com_height: m above the support; None takes the height of the push for it.
        points: of the footprint, roughly; 25 instead of 64 change friction torques by 2 %, and
            centres of mass by less than 0.1 mm.
        step: s, longest step of the mechanics; 30 ms and more miss slips round corners.
        rounds: solutions of each; with three the force is off by a third in 2 % of the steps in
            which a tip slides along an edge.
    """

    outline: Array
    com_height: float | None = None
    points: int = 25
    step: float = 0.02
    rounds: int = 4
    links: int = 1

    @cached_property
    def patch(self) -> SupportPatch:
        """Footprint."""
        return SupportPatch(self.outline, self.points)

    @cached_property
    def hull(self) -> Array:
        """(H, 2) m, anticlockwise: what a tip can touch."""
        return np.asarray(self.outline[ConvexHull(self.outline).vertices], dtype=float)

    @cached_property
    def area(self) -> float:
        """Of the footprint, m^2."""
        return abs(area_and_centroid(self.outline)[0])

    @property
    def names(self) -> tuple[str, ...]:
        """Of the parameters: those of a link, and ln of the friction between pusher and object."""
        return (*LINK_PARAMETERS, "ln_tip_friction")

    @property
    def prior(self) -> tuple[Array, Array]:
        """Mean (5,) and covariance (5, 5); a heavier object has the larger product."""
        mean = np.array(
            [np.log(_MASS * _FRICTION), np.log(_MASS), *self.patch.centroid, np.log(_TIP_FRICTION)]
        )
        reach = _REACH * np.sqrt(self.patch.gyration)
        std = np.array([_FRICTION_SPREAD, _MASS_SPREAD, reach, reach, _TIP_SPREAD])
        mixing = np.eye(5)
        mixing[0, 1] = 1.0
        root = mixing * std
        return mean, np.asarray(root @ root.T)

    def feasible(self, parameters: Array) -> Mask:
        """Whether the centre of mass lies above the footprint's hull."""
        inside, _ = nearest_edge(self.hull, edge_normals(self.hull), parameters[:, 2:4])
        return np.asarray(inside > 0.0)

    def acting(self, states: Array, parameters: Array) -> tuple[Array, tuple[int, ...]]:
        """The parameters; only inertia tells the mass."""
        return parameters, (self.names.index("ln_mass"),)

    def predict(self, states: Array, parameters: Array, motion: PusherMotion) -> Prediction:
        """Advance by one step of the pusher."""
        linkage = Linkage((self.link_of(parameters, motion),))
        pusher = self.pusher_of(parameters, motion)
        return advanced(linkage, pusher, states, motion, self.step, self.rounds)

    def link_of(self, parameters: Array, motion: PusherMotion) -> Link:
        """Properties of the hypotheses; a lift takes load and its friction off the support."""
        product, mass = np.exp(parameters[:, :2].T)
        same = np.ones(len(mass))
        height = motion.height if self.com_height is None else self.com_height
        return Link(
            patch=self.patch,
            mass=mass,
            friction=product / mass * load_left(mass, motion.lift),
            com=parameters[:, 2:4],
            com_height=height * same,
            inertia=mass * self.patch.gyration,
            scale=same,
        )

    def pusher_of(self, parameters: Array, motion: PusherMotion) -> Tip | Grip:
        """Contact with this link."""
        height = np.full(len(parameters), motion.height)
        if motion.grip:
            return Grip(height, motion.link)
        friction = np.exp(parameters[:, 4])
        return Tip(self.hull, height, friction, motion.touching, motion.normal, motion.link)


def load_left(mass: Array, lift: float) -> Array:
    """Share (C,) of the weight that a lift (N) leaves on the support, at least a tenth."""
    return np.maximum(1.0 - lift / (mass * GRAVITY), 0.1)


def advanced(
    linkage: Linkage,
    pusher: Tip | Grip,
    states: Array,
    motion: PusherMotion,
    longest: float,
    rounds: int,
) -> Prediction:
    """Advance hypotheses by one step of the pusher, in as many of the mechanics as it needs.

    Args:
        linkage: links of C hypotheses.
        pusher: tip or grip.
        states: (C, 6 L) of the links' frames.
        motion: of the pusher.
        longest: s, step of the mechanics.
        rounds: solutions of each step.
    """
    count, links = len(states), len(linkage.links)
    each = states.reshape(count, links, 6)
    twist = np.stack(
        [shifted_twist(each[:, k, 3:], turned(link.com, each[:, k, 2]))
         for k, link in enumerate(linkage.links)], axis=1,
    )  # fmt: skip
    steps = max(1, int(np.ceil(motion.step / longest - 1e-9)))
    config = StepConfig(motion.step / steps, rounds)
    simulation = PlanarSimulation(linkage, pusher, each[:, :, :3], config, twist)
    wrench = np.zeros((count, 3))
    place = np.linspace(motion.before, motion.after, steps + 1)
    for k in range(steps):
        before, after = (np.broadcast_to(p, (count, 3)) for p in place[k : k + 2])
        simulation.step(before, after)
        part = simulation.wrench.copy()
        moved = np.broadcast_to(place[k, :2] - place[0, :2], (count, 2))
        part[:, 2] += cross(moved, part[:, :2])
        wrench += part / steps
    frames = linkage.frames(simulation.coordinates)
    back = np.stack(
        [shifted_twist(simulation.twist[:, k], -turned(link.com, frames[:, k, 2]))
         for k, link in enumerate(linkage.links)], axis=1,
    )  # fmt: skip
    return Prediction(np.concatenate([frames, back], axis=2).reshape(count, -1), wrench)
