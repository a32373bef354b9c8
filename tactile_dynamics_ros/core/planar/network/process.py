"""The graph network as a model of pushing that can be filtered, explored and planned with."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.planar.filter.linked_patch import LinkedPatchProcess
from tactile_dynamics_ros.core.planar.filter.patch import PatchProcess, load_left
from tactile_dynamics_ros.core.planar.filter.process import (
    Mask,
    Prediction,
    PusherMotion,
)
from tactile_dynamics_ros.core.planar.mechanics.linkage import turned
from tactile_dynamics_ros.core.planar.mechanics.outline import edge_normals, nearest_edge
from tactile_dynamics_ros.core.planar.network.graph import (
    MOTION,
    Push,
    Thing,
    build_graph,
    from_contact,
    grip_axis,
    to_contact,
    touched_first,
)
from tactile_dynamics_ros.core.planar.network.transitions import Transitions, helping, outcome
from tactile_dynamics_ros.core.planar.network.weights import Expected, GraphWeights

_ALIKE = 0.02
"""m over which errors of a network's force stay alike, as friction does for the filter: the noise
that it states counts once per such a way, not once per step. Chosen for that reason, not tuned; at
a step's way masses of slow pushes are off by up to fifteen standard deviations."""
_LASTING = 6.0
"""Times by which errors last longer still for two parts. From exact states and parameters, the mean
error over a push of 0.12 m has 4.4 to 5.2 times the variance that errors alike over 20 mm would
leave (objects 401 to 412), and up to half of it comes again in the next push of the part. Stated as
noise of states instead, it makes products too large: forces follow from velocities that were never
had. For one part intervals hold without it."""
_UNITS = np.array([1.0, 1.0, 20.0]), np.array([1.0, 1.0, 0.05])
"""Units of the features by which mechanics help, over the unit of velocities, N and N m: those that
the shipped networks are trained with."""


def help_units(speed: float, forces: int = 2) -> tuple[Array, Array]:
    """Units (MOTION,) of velocities and (forces,) of forces among a residual network's inputs."""
    return speed * np.tile(_UNITS[0], MOTION // 3), _UNITS[1][:forces]


@dataclass(frozen=True, eq=False)
class GraphProcess:
    """Networks for one object.

    Attributes:
        thing: geometry. weights: of pushes; a residual network needs an object of one link.
        base: mechanics of the links, for what is known beforehand, for what a residual network
            starts from and for what networks never saw.
        pull: weights of pulls; without them the mechanics predict those.
    """

    thing: Thing
    weights: GraphWeights
    base: LinkedPatchProcess
    pull: GraphWeights | None = None

    @classmethod
    def of(
        cls, thing: Thing, weights: GraphWeights, pull: GraphWeights | None = None
    ) -> GraphProcess:
        """The process of an object.

        Raises:
            BadInputError: a residual network for linked parts, on which none is trained.
        """
        if weights.residual and thing.links > 1:
            raise BadInputError("graph_residual: one link only; for linked parts choose graph")
        known = thing.com_height
        heights = [None] * thing.links if known is None else [float(each) for each in known]
        parts = tuple(
            PatchProcess(patch.outline, height)
            for patch, height in zip(thing.patches, heights, strict=True)
        )
        return cls(thing, weights, LinkedPatchProcess(parts, thing.joint, thing.rigid), pull)

    @property
    def links(self) -> int:
        """L."""
        return self.thing.links

    @property
    def names(self) -> tuple[str, ...]:
        """Of the parameters: those of the mechanics."""
        return self.base.names

    @property
    def prior(self) -> tuple[Array, Array]:
        """Mean (p,) and covariance (p, p)."""
        return self.base.prior

    def feasible(self, parameters: Array) -> Mask:
        """Whether each centre of mass lies above its link's footprint."""
        return self.base.feasible(parameters)

    def acting(self, states: Array, parameters: Array) -> tuple[Array, tuple[int, ...]]:
        """By what parameters act: as in the mechanics."""
        return self.base.acting(states, parameters)

    def predict(self, states: Array, parameters: Array, motion: PusherMotion) -> Prediction:
        """Advance by one step; what no network was trained on, such as no touch, by mechanics."""
        weights = self.pull if motion.grip else self.weights
        if weights is None or motion.touching is False:
            return self.base.predict(states, parameters, motion)
        push = self.push_of(states, motion)
        base = None
        if weights.residual:
            found = self.base.predict(states, parameters, motion)
            base = found.states, found.wrench[:, : weights.forces]
        loaded = self._loaded(parameters, motion)
        after, force, said = step_on(weights, self.thing, states, loaded, push, base)
        wrench = np.pad(force, ((0, 0), (0, 3 - weights.forces)))
        way = max(float(np.linalg.norm((motion.after - motion.before)[:2])), 1e-4)
        lasting = np.sqrt(max(_ALIKE / way, 1.0))
        force_std = lasting * float(np.median(said.force_std[:, :2].max(axis=1)))
        state_std = lasting * self._state_std(said, motion)
        return Prediction(after, wrench, force_std, state_std, _LASTING if self.links > 1 else 1.0)

    def _state_std(self, said: Expected, motion: PusherMotion) -> Array:
        """What the network says that it misses of states (6 L,)."""
        std = np.median(said.motion_std, axis=0)
        found = np.zeros((self.links, 6))
        for row, link in enumerate(touched_first(self.links, motion.link)):
            mean, final = std[row, :3], std[row, 3:]
            across = np.array([mean[:2].max(), mean[:2].max(), mean[2]]) * motion.step
            found[link] = [*across, final[:2].max(), final[:2].max(), final[2]]
        return found.ravel()

    def _loaded(self, parameters: Array, motion: PusherMotion) -> Array:
        """The parameters with the friction that a lift leaves of the touched link's."""
        first, loaded = 4 * motion.link, parameters.copy()
        loaded[:, first] += np.log(load_left(np.exp(parameters[:, first + 1]), motion.lift))
        return loaded

    def push_of(self, states: Array, motion: PusherMotion) -> Push:
        """What the pusher does, in the outline's or the forces normal, or the gripper's way."""
        count = len(states)
        point = np.broadcast_to(motion.before[:2], (count, 2))
        velocity = np.broadcast_to((motion.after - motion.before)[:2] / motion.step, (count, 2))
        turning = None
        if motion.grip:
            turning = np.full(count, (motion.after - motion.before)[2] / motion.step)
            normal, touching = grip_axis(velocity, np.full(count, motion.before[2])), np.ones(count)
        elif motion.normal is not None and motion.touching is not None:
            normal = np.broadcast_to(motion.normal, (count, 2))
            touching = np.full(count, float(motion.touching))
        else:
            normal, depth = self._outline_at(states, point, motion.link)
            closing = np.maximum(np.sum(velocity * normal, axis=1), 0.0)
            touching = (depth + motion.step * closing > 0.0).astype(float)
        height = np.full(count, motion.height)
        return Push(point, velocity, normal, touching, height, motion.step, motion.link, turning)

    def _outline_at(self, states: Array, point: Array, link: int) -> tuple[Array, Array]:
        own = states[:, 6 * link : 6 * link + 3]
        outline = self.thing.patches[link].outline
        local = turned(point - own[:, :2], -own[:, 2])
        depth, normal = nearest_edge(outline, edge_normals(outline), local)
        return turned(normal, own[:, 2]), depth


def step_on(
    weights: GraphWeights,
    thing: Thing,
    states: Array,
    parameters: Array,
    push: Push,
    base: tuple[Array, Array] | None = None,
) -> tuple[Array, Array, Expected]:
    """States (C, 6 L), forces (C, forces) in axes of the support, and what the network said.

    Args:
        weights: of the network.
        thing: geometry.
        states: (C, 6 L) when the step begins.
        parameters: (C, p).
        push: of the robot.
        base: states (C, 6) and forces (C, forces) that mechanics expect; a residual network needs
            them.
    """
    force = np.zeros((len(states), weights.forces))
    velocity, help_ = np.zeros((len(states), thing.links, MOTION)), None
    if base is not None:
        steps = Transitions(thing, parameters, states, base[0], push, base[1])
        velocity, force = outcome(steps, base[0]), to_contact(base[1], push.normal)
        help_ = helping(velocity, force, help_units(weights.speed, weights.forces))
    graph = build_graph(thing, states, parameters, push, weights.speed, help_)
    expected = weights.evaluate(graph)
    after = advanced(thing, states, parameters, push, velocity + expected.motion)
    forces = from_contact(force + expected.force, push.normal) * push.touching[:, None]
    return after, forces, expected


def advanced(thing: Thing, states: Array, parameters: Array, push: Push, motion: Array) -> Array:
    """States (C, 6 L) after a step in which centres of mass move as (C, L, MOTION) says."""
    after = states.copy()
    for row, link in enumerate(touched_first(thing.links, push.link)):
        own, com = slice(6 * link, 6 * link + 6), parameters[:, 4 * link + 2 : 4 * link + 4]
        moved, state = motion[:, row], states[:, own]
        yaw = state[:, 2] + push.step * moved[:, 2]
        place = state[:, :2] + turned(com, state[:, 2])
        place = place + push.step * from_contact(moved[:, :2], push.normal)
        arm = turned(com, yaw)
        across = np.stack([-arm[:, 1], arm[:, 0]], axis=1)
        velocity = from_contact(moved[:, 3:5], push.normal) - moved[:, 5:6] * across
        after[:, own] = np.column_stack([place - arm, yaw, velocity, moved[:, 5]])
    return after
