"""The force models that come with the package, by name."""

from __future__ import annotations

from collections.abc import Sequence

from numpy.typing import ArrayLike

from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.tactile.analytic_force import AnalyticForceEstimator
from tactile_dynamics_ros.core.tactile.fingertip import (
    FingertipConfig,
    FingertipEstimator,
    TactileEstimate,
)
from tactile_dynamics_ros.core.tactile.network.estimator import (
    NetworkForceEstimator,
    NetworkForceModel,
    predict_together,
)

FORCE_MODELS = ("network", "analytic")


def create_force_estimator(
    model: str = "network", config: FingertipConfig | None = None
) -> FingertipEstimator:
    """Return the live estimator of one fingertip.

    Raises:
        BadInputError: there is no such model.
    """
    if model == "network":
        return NetworkForceEstimator(config)
    if model == "analytic":
        return AnalyticForceEstimator(config)
    raise BadInputError(f"force model '{model}': expected one of {', '.join(FORCE_MODELS)}")


def observe_fingers(
    estimators: Sequence[FingertipEstimator], frames: Sequence[ArrayLike]
) -> list[TactileEstimate]:
    """Return what a frame (44,) of each fingertip says; networks with the same weights in one pass.

    Args:
        estimators: of the fingertips.
        frames: counts of each.

    Raises:
        NotIdentifiableError: a sensor was not tared.
        BadInputError: a frame is malformed.
    """
    changes = [e.tared_signals(frame) for e, frame in zip(estimators, frames, strict=True)]
    networks = [e.model for e in estimators if isinstance(e.model, NetworkForceModel)]
    alike = len(networks) == len(estimators) and len({id(m.weights) for m in networks}) == 1
    if alike:
        found = predict_together(networks, changes)
    else:
        found = [e.model.predict(change) for e, change in zip(estimators, changes, strict=True)]
    rows = zip(estimators, frames, changes, found, strict=True)
    return [estimator.conclude(frame, change, felt) for estimator, frame, change, felt in rows]
