"""Ranking where lasting errors of the sensors remain beside the effect.

White noise decides between rivals by their squares alone. Errors that last, such as a fingertip's
wrong gain, let a flexible effect gain more than its parameters are worth. Their sums over seconds
show how far: squares count less by that ratio, and so does the number of samples.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from tactile_dynamics_ros.core.discrepancy.assessment import assess
from tactile_dynamics_ros.core.discrepancy.model import ResidualModel, instants
from tactile_dynamics_ros.core.discrepancy.search import Step
from tactile_dynamics_ros.core.discrepancy.trials import Trial, evidence
from tactile_dynamics_ros.core.discrepancy.validation import fits_equally
from tactile_dynamics_ros.core.discrepancy.windows import window_index

_BLOCK = 5.0
_FEWEST_BLOCKS = 6


def dispersion(model: ResidualModel, floor: float) -> float:
    """Variance of sums of the residual over 5 s, over that of white noise; at least 1.

    Source: Wedderburn 1974, on quasi-likelihood; Newey & West 1987, on the block form.

    Args:
        model: fitted.
        floor: white RMS of the noise alone.
    """
    time, white = instants(model)
    length = min(_BLOCK, (time[-1] - time[0]) / _FEWEST_BLOCKS)
    index = window_index(time, max(length, 1e-9))
    counts = np.bincount(index)
    sums = np.stack([np.bincount(index, column) for column in white.T], axis=1)
    used = counts > 0
    ratio = np.mean(sums[used] ** 2 / counts[used, None]) / floor**2
    return max(1.0, float(ratio))


def temper(step: Step) -> Step:
    """Choose again between an effect and its rivals, with the dispersion that remains.

    Args:
        step: one effect that leaves an error within what the sensors state, but not white.
    """
    choice, floor = step.choice, step.after.structure.floor
    best = choice.best
    close = [r for r in choice.rivals if fits_equally(best.held_out, r.held_out)]
    ratio = max(dispersion(trial.model, floor) for trial in (best, *close))

    def tempered(trial: Trial) -> Trial:
        choices = trial.source.family.choices
        return replace(trial, criterion=evidence(trial.model, floor, choices, ratio))

    ranked = sorted(map(tempered, (best, *choice.rivals)), key=lambda trial: trial.criterion)
    bare = best.model.without_effect(best.name)
    kept = ranked[0].name == best.name
    model = choice.model if kept else ranked[0].model.refined()
    again = replace(
        choice,
        model=model,
        best=ranked[0],
        rivals=tuple(ranked[1:]),
        without=evidence(bare, floor, 1, ratio),
        dispersion=ratio,
    )
    after = step.after if kept else assess(model, step.after.significance)
    return Step(again, after) if after.within_stated else step
