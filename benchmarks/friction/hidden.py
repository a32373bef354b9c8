"""Hidden frictions: is the right effect named, alone or in an honest group?"""

from __future__ import annotations

from collections import Counter
from typing import Any

from benchmarks.friction.generator import EFFECTS, draw_surface, generate_events
from tactile_dynamics_ros.core.discrepancy.diagnosis import diagnose
from tactile_dynamics_ros.core.friction.discrepancy_model import FrictionModel
from tactile_dynamics_ros.core.friction.slip_log import tabulate_slips

FIRST_SEED = 2000
CLEAN_PER_SEED = 5
"""Clean surfaces per recording of each effect, to tell 95 % of them from 90 %."""


def run_hidden(seeds: int, first: int) -> dict[str, Any]:
    """Diagnose ``seeds`` recordings of every effect and of surfaces without any."""
    outcomes = {
        name: [diagnose_one(name, seed) for seed in range(first, first + count)]
        for name, count in {"none": CLEAN_PER_SEED * seeds, **dict.fromkeys(EFFECTS, seeds)}.items()
    }
    hidden = [(name, row) for name in EFFECTS for row in outcomes[name]]
    count = len(hidden)
    return {
        "recordings": count + len(outcomes["none"]),
        "right_name_alone": sum(row["group"] == [name] for name, row in hidden) / count,
        "right_name_first": sum(row["effect"] == name for name, row in hidden) / count,
        "right_name_or_group": sum(name in row["group"] for name, row in hidden) / count,
        "clean_adequate": sum(r["verdict"] == "adequate" for r in outcomes["none"])
        / len(outcomes["none"]),
        "effects": {
            name: dict(Counter("+".join(row["group"]) or row["verdict"] for row in rows))
            for name, rows in outcomes.items()
        },
    }


def diagnose_one(name: str, seed: int) -> dict[str, Any]:
    """Generate one recording and diagnose it."""
    events = generate_events(draw_surface(name, seed), seed)
    found = diagnose(FrictionModel.fit(tabulate_slips(events)))
    group = list(found.group) or ([found.effect] if found.effect else [])
    return {"verdict": found.verdict, "effect": found.effect, "group": group}
