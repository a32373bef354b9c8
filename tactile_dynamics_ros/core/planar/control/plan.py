"""The next pushes towards a pose: where, in which direction, how far."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.configuration import check_ranges, parameter
from tactile_dynamics_ros.core.numerics.search import SearchConfig, cross_entropy, evolve
from tactile_dynamics_ros.core.planar.control.prediction import Pushable
from tactile_dynamics_ros.core.planar.mechanics.linkage import turned

PLACE, TURNS, LENGTH = 0, slice(1, 4), 4
"""Columns of a push: share of the perimeter, three directions along the way (rad from the inward
normal of its first place), length in m; below zero no push at all."""
_WIDTH = 5
"""Numbers that describe a push in a plan; see the columns above. More directions bend more."""
_WIDE = SearchConfig(samples=360, elites=24, rounds=7, kept=1.0, shrink=0.62, colour=0.0)
"""Search for new contacts: 2 900 plans take 0.4 s; of half as many one in ten ends 1 mm worse."""
_NEAR = SearchConfig(samples=48, elites=6, rounds=3)
"""Search while touching: 150 plans take 25 ms, a quarter of the 100 ms between two of them."""
_STD = np.array([0.06, 0.2, 0.2, 0.2, 0.02])
"""First std of children: a sixteenth of the perimeter, 11 deg, 2 cm; wider forgets the parents."""

_FAR, _SHORT = 1.5, 0.003
"""Longest push over the error that is left, and m beside it: long ones that the model lets slide
along an edge missed by 10 cm from 3 mm off the goal. Below 1.2 turns take more pushes."""
_UNFOLD = 2.0
"""Error that counts as much as parts that reach into each other, m per m of turning back: motion is
not predicted there, and parts above each other can hardly be pushed. Below 1 plans would fold."""


@dataclass(frozen=True)
class PlanConfig:
    """What pushes may be like, and what counts as near."""

    pushes: int = parameter(3, "that are planned ahead", "", 1, 6)
    most_length: float = parameter(0.15, "of one push", "m", 0.01, 0.5)
    most_turn: float = parameter(0.6, "of its direction from the outline's normal", "rad", 0.0, 1.2)
    arm: float = parameter(0.08, "at which an angle counts as a distance", "m", 1e-3, 1.0)
    gap: float = parameter(0.005, "between tip and object before a push", "m", 0.0, 0.05)
    effort: float = parameter(2e-4, "error that a further push must save", "m", 0.0, 0.05)
    length_effort: float = parameter(0.03, "error that a further metre must save", "", 0.0, 1.0)
    early: float = parameter(0.4, "weight of the error between pushes", "", 0.0, 1.0)
    steps: int = parameter(9, "into which the prediction of a push is cut", "", 3, 60)
    seed: int = parameter(0, "of the search", "", 0)

    def __post_init__(self) -> None:
        check_ranges(self)


@dataclass(frozen=True)
class Bounds:
    """Where a tip may be: a rectangle of the support.

    Attributes:
        low: (2,) m. high: (2,) m.
    """

    low: Array
    high: Array

    def lacking(self, point: Array) -> Array:
        """How far points (..., 2) lie outside, m."""
        outside = np.maximum(self.low - point, 0.0) + np.maximum(point - self.high, 0.0)
        return np.asarray(outside.sum(axis=-1))


@dataclass(frozen=True)
class Push:
    """One push, as the arm takes it.

    Attributes:
        start: (2,) m, of the tip's middle, world. direction: (2,) unit, at first. length: m,
            zero where no push helps.
        normal: (2,) into the object where it begins. error: m, expected after all pushes planned.
        plan: (H, 5) it and those that should follow.
    """

    start: Array
    direction: Array
    length: float
    normal: Array
    error: float
    plan: Array


class PushPlanner:
    """Looks for pushes that bring an object nearest to a pose.

    Args:
        body: the object.
        goal: (3,) x, y (m) and yaw (rad) of its frame.
        bounds: of the tip.
        config: of the plans.
    """

    def __init__(
        self, body: Pushable, goal: Array, bounds: Bounds, config: PlanConfig | None = None
    ) -> None:
        self.body, self.goal, self.bounds = body, np.asarray(goal, dtype=float), bounds
        self.config = config or PlanConfig()
        self._rng = np.random.default_rng([self.config.seed, 46])

    def error(self, pose: Array) -> Array:
        """Distance of states (N, 3 or more) from the goal, m: angles count at an arm."""
        away = pose[:, :3] - self.goal
        turn = (away[:, 2] + np.pi) % (2.0 * np.pi) - np.pi
        squared = np.sum(np.square(away[:, :2]), axis=1) + np.square(self.config.arm * turn)
        return np.asarray(np.sqrt(squared), dtype=float)

    def left(self, pose: Array) -> float:
        """What is left to do for an object at a pose (3,), m: its error, and parts to unfold."""
        return float(self._left(self.body.states(pose, 1))[0])

    def _left(self, state: Array) -> Array:
        return self.error(state) + _UNFOLD * self.body.folded(state)

    def contact(self, pose: Array, tip: Array) -> tuple[float, Array]:
        """Gap between tip (2,) and object at a pose (3,), m, and the normal (2,) into it, world."""
        distance, normal = self.body.touch(tip[None], self.body.states(pose, 1))
        return float(distance[0]) - self.body.tip_radius, normal[0]

    def retreat(self, pose: Array, tip: Array) -> Array:
        """Direction (2,) in which a tip (2,) comes free of an object at a pose (3,)."""
        return np.asarray(self.body.away(tip[None], self.body.states(pose, 1))[0])

    def strikes(self, pose: Array, tip: Array) -> bool:
        """Whether a tip (2,), world, runs into a part that it does not push."""
        return bool(self.body.struck(tip[None], self.body.states(pose, 1))[0] > 0.0)

    def plan(self, pose: Array) -> Push:
        """Return the best next push for an object at a pose (3,), wherever it begins."""

        def cost(plans: Array) -> Array:
            return self._cost(plans, pose, None)

        found = evolve(cost, self._parents(), self._std(), self._rng, _WIDE)
        return self._push(found.best, pose, found.cost)

    def go_on(self, plan: Array, pose: Array, tip: Array, normal: Array) -> Push:
        """Return the best way on from a tip (2,) that touches.

        Args:
            plan: (H, 5), the last one, of which the first push has been begun.
            pose: (3,) of the object now.
            tip: (2,) m.
            normal: (2,) to which the directions of that push refer, world.
        """

        def cost(plans: Array) -> Array:
            return self._cost(plans, pose, (tip, normal))

        std = 0.9 * self._std()
        std[:, PLACE] = 0.5 * _STD[PLACE]
        found = cross_entropy(cost, plan, std, self._rng, _NEAR)
        first = found.best[:1]
        direction = self._directions(first, normal[None])[0, 0]
        length = float(self.length(first, pose[None])[0])
        return Push(tip, direction, length, normal, found.cost, found.best)

    def _std(self) -> Array:
        return np.tile(_STD, (self.config.pushes, 1))

    def _parents(self) -> Array:
        """Plans (N, H, 5) all over the outline."""
        shape = (3 * _WIDE.samples, self.config.pushes)
        plans = np.zeros((*shape, _WIDTH))
        plans[..., PLACE] = self._rng.uniform(0.0, 1.0, shape)
        turn = self._rng.uniform(-1.0, 1.0, shape) * self.config.most_turn
        plans[..., TURNS] = turn[..., None]
        plans[..., LENGTH] = self._rng.uniform(-0.01, 1.0, shape) ** 2 * self.config.most_length
        return plans

    def _directions(self, push: Array, normal: Array) -> Array:
        """Directions (N, 3, 2) of pushes (N, 5) about normals (N, 2)."""
        most = self.config.most_turn
        turn = np.clip(push[:, TURNS], -most, most)
        flat = turned(np.repeat(normal, 3, axis=0), turn.ravel())
        return np.asarray(flat.reshape(-1, 3, 2))

    def _starts(self, share: Array, state: Array) -> tuple[Array, Array]:
        """Tips (N, 2) beside the outline and normals (N, 2) there, world."""
        point, inward = self.body.place(share, state)
        away = self.body.tip_radius + self.config.gap
        return point - away * inward, inward

    def _cost(self, plans: Array, pose: Array, begun: tuple[Array, Array] | None) -> Array:
        """Error (N,) that plans (N, H, 5) leave, early error and effort included, m."""
        count = len(plans)
        states = self.body.states(pose, count)
        total = np.zeros(count)
        for k in range(plans.shape[1]):
            push = plans[:, k]
            moves = push[:, LENGTH] > 0.0
            if k == 0 and begun is not None:
                tip = np.broadcast_to(begun[0], (count, 2)).copy()
                normal = np.broadcast_to(begun[1], (count, 2))
                gap = 0.0
            else:
                tip, normal = self._starts(push[:, PLACE], states)
                gap = self.config.gap
                total += moves * (self.config.effort + 10.0 * self.bounds.lacking(tip))
                total += 10.0 * moves * self.body.crowded(tip, states)
            states, tip = self._pushed(push, states, tip, normal, gap)
            total += 10.0 * moves * self.bounds.lacking(tip)
            total += 10.0 * moves * self.body.struck(tip, states)
            total += self.config.length_effort * np.maximum(push[:, LENGTH], 0.0)
            weight = 1.0 if k == plans.shape[1] - 1 else self.config.early
            total += weight * self._left(states)
        return total

    def _pushed(
        self, push: Array, state: Array, tip: Array, normal: Array, gap: float
    ) -> tuple[Array, Array]:
        """States and tips after one push (N, 5) each."""
        length, steps = self.length(push, state), self.config.steps
        way = np.where(length > 0.0, length + gap, 0.0)[:, None] / steps
        direction = self._directions(push, normal)
        ways = [way * direction[:, 3 * k // steps] for k in range(steps)]
        return self.body.pushed_along(state, tip, ways)

    def length(self, push: Array, state: Array) -> Array:
        """Length (N,) of pushes (N, 5) of objects in states, m: none is far past the goal."""
        most = np.minimum(_FAR * self.error(state) + _SHORT, self.config.most_length)
        return np.asarray(np.clip(push[:, LENGTH], 0.0, most), dtype=float)

    def _push(self, plan: Array, pose: Array, cost: float) -> Push:
        """Return the first push of a plan that moves anything; one of no length where none does."""
        moving = [k for k in range(len(plan)) if plan[k, LENGTH] > 0.0]
        order = moving + [k for k in range(len(plan)) if k not in moving]
        plan = plan[order]
        start, normal = self._starts(plan[:1, PLACE], self.body.states(pose, 1))
        direction = self._directions(plan[:1], normal)[0, 0]
        length = float(self.length(plan[:1], pose[None])[0]) + self.config.gap if moving else 0.0
        return Push(start[0], direction, length, normal[0], cost, plan)
