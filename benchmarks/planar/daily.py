"""Paper B's eight daily objects (Table IV), by their published mass, friction and centre."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np

from benchmarks.planar.trial import Population, truth_of
from tactile_dynamics_ros.sim.objects import planar_object
from tactile_dynamics_ros.synthetic.pushed.objects import PushedObject, ballasted

NUMBERS = range(157, 165)
"""Of the daily objects in `config/planar_objects.yaml`."""


def daily_things() -> dict[int, PushedObject]:
    """The eight objects by their numbers; tall ones are cut so low that no push tips them over."""
    things = {}
    for number in NUMBERS:
        part = planar_object(number).parts[0]
        link = ballasted(part.corners, part.height, part.mass, part.com, part.friction)
        things[number] = PushedObject("single", (link,), np.zeros(2), None, 0.0)
    return things


def baselines(population: Population) -> dict[str, list[dict[str, float]]]:
    """Estimates of each object without a push: the mean of all eight, and from exact products."""
    truths = [truth_of(SimpleNamespace(thing=thing)) for thing in daily_things().values()]
    mean = {name: float(np.mean([t[name] for t in truths])) for name in truths[0]}
    known = [population.given_product(np.array([t["q1"]])) for t in truths]
    return {"set mean": [mean] * len(truths), "product known": known}
