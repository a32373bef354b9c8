"""What a live estimate is worth, in a level and a sentence."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum

from tactile_dynamics_ros.core.inertia.incremental.live_estimate import LiveEstimate

MISFIT = 1.5
"""Error over the noise from which the model is said not to fit. Noise alone stays below 1.1 over 2
s; between 1.1 and 1.5 intervals that are widened by the scatter still hold."""
GROSS = 20.0
"""Error over the noise from which nothing is published: effects of the catalogue raise it to 10 at
most in recordings with known truth, wrong units and broken sensors to hundreds."""
FEW = 50
"""Samples before which a moderate error says nothing: ten parameters were just fitted to them."""
EXPLAINED = 0.5
"""Share of the squared wrenches below which a misfit leaves nothing of the model: with forces of
the wrong sign no mass explains any, beside the effects of the catalogue a body explains most."""


class Level(Enum):
    """How much an estimate may be believed."""

    OK = "ok"
    WARN = "warn"
    ERROR = "error"


@dataclass(frozen=True)
class Verdict:
    """Level and sentence for people; whether value and interval may be published at all."""

    level: Level
    text: str

    @property
    def withheld(self) -> bool:
        """Whether nobody should use the estimate."""
        return self.level is Level.ERROR


def judge_estimate(estimate: LiveEstimate, obstacles: Sequence[str], check: str) -> Verdict:
    """Say what an estimate is worth.

    Args:
        estimate: the newest.
        obstacles: what is wrong with the measurements now, so that it cannot be believed.
        check: what to call to learn why the model does not fit.
    """
    if obstacles:
        return Verdict(Level.ERROR, "; ".join(obstacles))
    error = max(estimate.recent.rms, estimate.error.whitened_rms)
    if error > (MISFIT if estimate.samples >= FEW else GROSS):
        gross = error > GROSS or estimate.recent.explained < EXPLAINED
        level = Level.ERROR if gross else Level.WARN
        text = f"the model does not fit: error {error:.3g} times the noise; call {check}"
        return Verdict(level, text)
    directions = estimate.directions
    found = [direction for direction in directions if direction.identified]
    text = f"{len(found)} of {len(directions)} directions identified"
    if estimate.remarks:
        text = "; ".join(estimate.remarks)
    return Verdict(Level.OK if len(found) == len(directions) else Level.WARN, text)
