"""How long it takes to choose a push by the information that is expected of it."""

from __future__ import annotations

import time
from typing import Any

import numpy as np

from tactile_dynamics_ros.core.planar.actions.exploration import (
    Choice,
    ExploreConfig,
    Explorer,
)
from tactile_dynamics_ros.core.planar.actions.information import Belief, PredictedObject
from tactile_dynamics_ros.core.planar.mechanics.outline import convex_hull
from tactile_dynamics_ros.synthetic.pushed.objects import draw_object

DIRECTIONS = 3
"""In which the explorer pushes at each place: along the normal, and turned to both sides."""


def measure(seeds: range) -> dict[str, Any]:
    """CPU time (s) of the first choice for each object, with the explorer's own candidates."""
    times, gains, config = [], [], ExploreConfig()
    for seed in seeds:
        link = draw_object(seed, "single").links[0]
        outline = convex_hull(link.corners)
        thing = PredictedObject(outline, push_height=0.012, com_height=0.5 * link.height)
        explorer = Explorer(thing, config)
        start = time.process_time()
        choice = explorer.choose(Belief.unknown(outline), np.zeros(3))
        times.append(time.process_time() - start)
        assert isinstance(choice, Choice)
        gains.append(choice.gain)
    return {
        "n": len(times),
        "candidates": DIRECTIONS * config.places * len(config.speeds),
        "cpu_s": float(np.median(times)),
        "cpu_s_worst": float(np.max(times)),
        "gain_nats": float(np.median(gains)),
    }


def table(found: dict[str, Any]) -> str:
    """One sentence."""
    return (
        f"choice of a push among {found['candidates']}: {found['cpu_s']:.2f} s of a core, "
        f"at most {found['cpu_s_worst']:.2f} s (n = {found['n']} objects)\n"
    )
