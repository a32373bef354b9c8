"""Other searches for pushes to a goal, as peers: white noise, MPPI, a mean over likely centres."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cached_property

import numpy as np

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.numerics.search import SearchConfig, cross_entropy
from tactile_dynamics_ros.core.planar.actions.information import Belief
from tactile_dynamics_ros.core.planar.control.plan import LENGTH, Push, PushPlanner
from tactile_dynamics_ros.core.planar.control.prediction import PushedBody
from tactile_dynamics_ros.core.planar.linked.outlines import distance_outside

Cost = Callable[[Array], Array]

_PLACES = 12
"""Starts round the outline from which a search with one mean begins anew; the best one counts."""
_WIDE = SearchConfig(samples=80, elites=10, rounds=3, kept=0.0, colour=0.0, memory=0.0)
"""As many plans as the product's wide search tries, 2 900, parted among the places."""
_NEAR = SearchConfig(samples=48, elites=6, rounds=3, kept=0.0, colour=0.0, memory=0.0)
"""Of cross-entropy while touching: as many plans as the product tries there."""
_TEMPERATURE = 0.1
"""Of MPPI, over the std of the costs of a round: the best of 80 plans then has a third of the
weight; at 1 the mean hardly moves."""


class PlainSearch(PushPlanner):
    """Cross-entropy with white noise that keeps nothing and starts from no earlier solution."""

    def plan(self, pose: Array) -> Push:
        """Return the best next push for an object at a pose (3,), wherever it begins."""

        def cost(plans: Array) -> Array:
            return self._cost(plans, pose, None)

        found = []
        for place in (np.arange(_PLACES) + 0.5) / _PLACES:
            mean = self._anywhere(place)
            found.append(self._searched(cost, mean, 2.0 * self._std(), _WIDE))
        best, error = min(found, key=lambda one: one[1])
        return self._push(best, pose, error)

    def go_on(self, plan: Array, pose: Array, tip: Array, normal: Array) -> Push:
        """Return the best way on from a tip (2,) that touches; the old plan counts for nothing."""

        def cost(plans: Array) -> Array:
            return self._cost(plans, pose, (tip, normal))

        best, error = self._searched(cost, self._anywhere(0.5), 2.0 * self._std(), _NEAR)
        direction = self._directions(best[:1], normal[None])[0, 0]
        length = float(self.length(best[:1], pose[None])[0])
        return Push(tip, direction, length, normal, error, best)

    def _anywhere(self, place: float) -> Array:
        mean = np.zeros_like(self._parents()[0])
        mean[:, 0], mean[:, LENGTH] = place, 0.25 * self.config.most_length
        return mean

    def _searched(
        self, cost: Cost, mean: Array, std: Array, config: SearchConfig
    ) -> tuple[Array, float]:
        found = cross_entropy(cost, mean, std, self._rng, config)
        return found.best, found.cost


class PathIntegral(PlainSearch):
    """MPPI: the mean moves to that of all plans, weighted by exp(-cost over a temperature).

    Source: Williams et al. 2017.
    """

    def _searched(
        self, cost: Cost, mean: Array, std: Array, config: SearchConfig
    ) -> tuple[Array, float]:
        for _ in range(config.rounds):
            tried = mean + std * self._rng.standard_normal((config.samples, *mean.shape))
            costs = cost(tried)
            spread = max(float(costs.std()), 1e-9)
            weight = np.exp(-(costs - costs.min()) / (_TEMPERATURE * spread))
            mean = np.tensordot(weight / weight.sum(), tried, axes=1)
        return mean, float(cost(mean[None])[0])


class Averaged(PushPlanner):
    """The product's search by the mean over what is not known: four likely centres of mass.

    They lie at sqrt(2) of the standard deviation of an object that was only seen, along both axes
    and within the outline (cubature points of two numbers, Arasaratnam and Haykin 2009).
    """

    body: PushedBody

    @cached_property
    def bodies(self) -> list[PushedBody]:
        """Equally likely objects."""
        com, found = self.body.com, []
        shares = np.linspace(1.0, 0.0, 11)[:, None]
        for way in np.sqrt(2.0) * np.diag(Belief.unknown(self.body.outline).std[2:]):
            for places in (com + shares * way, com - shares * way):
                inside = distance_outside(self.body.outline, places) <= 0.0
                found.append(replace(self.body, com=places[np.argmax(inside)]))
        return found

    def _cost(self, plans: Array, pose: Array, begun: tuple[Array, Array] | None) -> Array:
        """Mean over the centres before a push begins; while it touches, what is seen corrects."""
        likeliest, each = self.body, []
        for body in self.bodies if begun is None else [likeliest]:
            self.body = body
            each.append(super()._cost(plans, pose, begun))
        self.body = likeliest
        return np.asarray(np.mean(each, axis=0))
