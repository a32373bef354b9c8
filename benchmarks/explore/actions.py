"""Pushes until all is as narrow as wanted: by expected gain, round the object, by chance.

The information of every push is taken at the true parameters, which the choosers do not know: this
grades the choice, not an estimator.
"""

from __future__ import annotations

import argparse
import json
import sys
from typing import Any

import numpy as np

from tactile_dynamics_ros.core.planar.actions.affordances import CHOOSERS, ExploreConfig
from tactile_dynamics_ros.core.planar.actions.exploration import Choice, Explorer
from tactile_dynamics_ros.core.planar.actions.information import (
    Belief,
    PredictedObject,
    SensingConfig,
    informations,
    updated,
)
from tactile_dynamics_ros.core.planar.mechanics.outline import convex_hull
from tactile_dynamics_ros.sim.objects import planar_object

NUMBERS = tuple(range(1, 21))
"""Objects of one part in config/planar_objects.yaml."""
MOST = 12
"""Pushes after which counting ends."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the section's options."""
    parser.add_argument(
        "--explored", type=int, default=len(NUMBERS), help="objects of this section"
    )


def measure(options: argparse.Namespace) -> dict[str, Any]:
    """Pushes needed of each object by each chooser, and the least that the product allows.

    Rows go to standard error as they come.
    """
    count = 2 if options.quick else options.explored
    rows = []
    for number in NUMBERS[:count]:
        rows.append({"object": number, **{c: _pushes(number, c) for c in CHOOSERS}})
        print(json.dumps(rows[-1]), file=sys.stderr, flush=True)
    sensing, config = SensingConfig(), ExploreConfig()
    least = int(np.ceil((sensing.variation / config.product) ** 2))
    return {"rows": rows, "least_by_variation": least}


def _pushes(number: int, chooser: str) -> int:
    """How many pushes an object takes; MOST if it takes more."""
    part = planar_object(number).parts[0]
    outline = convex_hull(part.corners)
    product = np.log(part.mass * part.friction)
    truth = np.array([product, np.log(part.mass), *part.com])
    thing = PredictedObject(outline, push_height=0.012, com_height=0.5 * part.height)
    config = ExploreConfig(chooser=chooser, seed=number, budget=MOST, gain=0.0, least=1)
    explorer = Explorer(thing, config)
    rng = np.random.default_rng([number, 48])
    belief = Belief.unknown(outline)
    for count in range(1, MOST + 1):
        choice = explorer.choose(belief, np.zeros(3))
        if not isinstance(choice, Choice):
            return count - 1 if not explorer.lacking(belief) else MOST
        at_truth = Belief(truth, belief.covariance)
        after = updated(at_truth, informations(thing, at_truth, [choice.candidate])[0])
        mean = rng.multivariate_normal(truth, after.covariance)
        belief = Belief(mean, after.covariance)
        if not explorer.lacking(belief):
            return count
    return MOST


def table(found: dict[str, Any]) -> str:
    """Medians of the pushes needed."""
    rows = found["rows"]
    lines = ["| chosen by | n | median pushes | most |", "|---|---|---|---|"]
    for chooser in CHOOSERS:
        counts = [row[chooser] for row in rows]
        lines.append(f"| {chooser} | {len(rows)} | {np.median(counts):.1f} | {max(counts)} |")
    least = found["least_by_variation"]
    lines.append(f"\nFriction that varies from push to push alone takes {least} pushes.")
    return "\n".join(lines)
