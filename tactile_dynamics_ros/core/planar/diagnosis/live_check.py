"""A pushed object against the latest pushes, live."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tactile_dynamics_ros.core.discrepancy.diagnosis import diagnose
from tactile_dynamics_ros.core.discrepancy.documents import Document
from tactile_dynamics_ros.core.discrepancy.live_check import LiveComparison, live_document
from tactile_dynamics_ros.core.planar.diagnosis.discrepancy_model import PushDiscrepancy
from tactile_dynamics_ros.core.planar.streams import PushedStreams


def compare_pushes(streams: PushedStreams, effects: Sequence[str]) -> LiveComparison:
    """Torque about the contact and force, axes of the support, that a fitted model leaves.

    Args:
        streams: of the latest pushes.
        effects: names of the effects in the model.

    Raises:
        BadInputError: nothing is touched, or an effect is unknown.
        NotIdentifiableError: nothing slides long enough.
    """
    model = PushDiscrepancy.of_streams(streams, effects)
    lacking, pushed = model.lacking(), model.fit.model
    residual = np.zeros((len(lacking), 6))
    residual[:, 2], residual[:, 3:5] = -lacking[:, 2], -lacking[:, :2]
    rms = float(np.sqrt(np.mean(model.residual**2)))
    return LiveComparison(pushed.intervals.time[pushed.middle], residual, rms)


def diagnose_pushes(streams: PushedStreams, effects: Sequence[str]) -> Document:
    """Diagnose a model, as `tactile-dynamics diagnose` does; return its document.

    Args:
        streams: of the latest pushes.
        effects: names of the effects in the model.

    Raises:
        BadInputError: nothing is touched, or an effect is unknown.
        NotIdentifiableError: nothing slides long enough.
    """
    model = PushDiscrepancy.of_streams(streams, effects)
    return live_document(diagnose(model), float(model.linear.times[0]))
