"""Thorough fits: the alternation of `fitting` until its end is near."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.discrepancy.model.residual_model import Misfit
from tactile_dynamics_ros.core.inertia.batch.fitted_model import FittedModel
from tactile_dynamics_ros.core.inertia.batch.fitting import (
    fit_beyond,
    fit_further,
    fit_trusting,
    fit_unfolded,
)

_MOST_ROUNDS = 7
"""Rounds of two further iterations of a thorough fit, at most. Most end by `_SETTLED` and `_NEAR`;
what has not ended by then is given as it is. More rounds cost time in proportion."""
_RISE = 1.001
"""Error of a step, over that before, up to which it may rise: 0.1 %, because the covariance changes
too. Lower ends fits at rounding, higher follows fits that get worse."""
_SETTLED = 0.995
"""Share of the error of the round before from which it is said to fall no more: less than 0.5 % a
round. Nearer to 1 fits go on for differences that no verdict sees; at 0.98 slow ones end early."""
_NEAR = 0.3
"""Length of what is left to go, in standard deviations of the white residual (noise adds one per
row), below which the end is near: a third of what one parameter is uncertain by. Less takes more
rounds, more leaves estimates off by a share of their intervals."""
_USUAL_RATE = 0.5
"""Share of a step by which the next one is presumed to be shorter before two steps have been seen;
the rest then is as long as the step. Only the end after one round depends on it."""
_SLOWEST_RATE = 0.9
"""Rate at which steps are presumed to shrink at most: what is left is then nine times the last
step. Nearer to 1 one noisy rate would throw the prolonged start far beyond the end."""
_MISFIT = 0.2
"""Squared white error beyond noise from which a misfit remains that may not go: an RMS of 1.1. Such
fits may end by `_SLOW`, others only when little is left to go. Lower ends good fits early, higher
follows hopeless ones to `_MOST_ROUNDS`."""
_SLOW = 0.02
"""Share of a misfit that a round must take away to be worth another: 2 %. With less, rivals that
cannot explain a recording are fitted to their end, at the cost of time."""
_DOUBTFUL = 1.05
"""White RMS above which a fit with effects is tried once more as if its motion were known
(`fit_trusting`): 5 % beyond noise, which 500 samples exceed by chance in 6 of 100000 cases. Lower,
clean fits pay for a second try; higher, effects that noise of the motion hides stay too small."""
_HOPEFUL = 0.9
"""Squared error beyond noise, over that before, that one step of a second try may leave to be worth
more steps: it must take away a tenth. Higher pursues tries that lead nowhere, which costs time."""


@dataclass(frozen=True)
class Step:
    """From one fit to the next.

    Attributes:
        white: (M,) change of the white residual that is due to the parameters.
    """

    white: Array

    @classmethod
    def between(cls, before: FittedModel, after: FittedModel) -> Step:
        """The step between two fits of the same effects."""
        change = [after.phi - before.phi, *map(np.subtract, after.theta, before.theta)]
        return cls(after.white_jacobian @ np.concatenate(change))

    @property
    def length(self) -> float:
        """In units of the uncertainty."""
        return float(np.linalg.norm(self.white))

    def rate(self, last: Step) -> float:
        """By which steps shrink, 0 to 0.9."""
        share = float(self.white @ last.white) / max(last.length**2, 1e-12)
        return float(np.clip(share, 0.0, _SLOWEST_RATE))


def refine(model: FittedModel, before: Misfit, foreseen: float) -> FittedModel:
    """`_to_the_end`, also from a thicker body where the fit has made it flat.

    Where a misfit remains, the fit is tried from motion as it would be if there were none.

    Args:
        model: fitted.
        before: without its last effect; a fit that is drowned in noise is not pursued.
        foreseen: white RMS above which a fit has failed and is not pursued either.
    """
    pursued = model.whitened_rms <= foreseen
    refined = _to_the_end(model, before) if pursued else model
    if before.is_drowned(refined.misfit):
        return refined
    thicker = fit_unfolded(refined, 2) if pursued else None
    if thicker is not None and thicker.whitened_rms < refined.whitened_rms:
        refined = _better(refined, thicker, before)
    if refined.effects and refined.whitened_rms > _DOUBTFUL:
        trusted = fit_trusting(refined, 1)
        if _excess(trusted) < _HOPEFUL * _excess(refined):
            trusted = fit_trusting(trusted, 2)
            if trusted.whitened_rms <= foreseen:
                refined = _better(refined, trusted, before)
    return refined


def _better(present: FittedModel, start: FittedModel, before: Misfit) -> FittedModel:
    """The end from another start, if its error is lower and not drowned in noise."""
    end = _to_the_end(start, before)
    better = end.whitened_rms < present.whitened_rms and not before.is_drowned(end.misfit)
    return end if better else present


def _excess(model: FittedModel) -> float:
    return model.whitened_rms**2 - 1.0


def _to_the_end(model: FittedModel, before: Misfit) -> FittedModel:
    """Fit on until the end of the alternation is near, or a misfit remains that does not go.

    Or until the error is drowned in noise.

    Steps that shrink by a rate r lead r / (1 - r) times the last one further: where that is far,
    the next fit starts there.

    Args:
        model: fitted.
        before: see `refine`.
    """
    last: Step | None = None
    rate = _USUAL_RATE
    for _ in range(_MOST_ROUNDS):
        if before.is_drowned(model.misfit):
            return model
        further = fit_further(model, 2)
        if further.whitened_rms > _RISE * model.whitened_rms:
            return model
        step = Step.between(model, further)
        rate = rate if last is None else step.rate(last)
        ahead = rate / (1.0 - rate)
        if _is_near(model, further, step.length * ahead):
            return further
        beyond = fit_beyond(model, further, ahead) if last is not None and ahead > 1.0 else None
        if beyond is not None and beyond.whitened_rms <= _RISE * further.whitened_rms:
            model, last = beyond, None
        else:
            model, last = further, step
    return model


def _is_near(before: FittedModel, after: FittedModel, left: float) -> bool:
    """Whether the error falls no more, and what is left to go is short or leads nowhere."""
    if after.whitened_rms <= _SETTLED * before.whitened_rms:
        return False
    excess = _excess(before)
    fall = before.whitened_rms**2 - after.whitened_rms**2
    return left < _NEAR or (excess > _MISFIT and fall < _SLOW * excess)
