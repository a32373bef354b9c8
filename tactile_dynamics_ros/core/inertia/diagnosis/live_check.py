"""The held object against the last seconds of live measurements."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tactile_dynamics_ros.core.discrepancy.diagnosis import diagnose
from tactile_dynamics_ros.core.discrepancy.documents import Document, diagnosis_document
from tactile_dynamics_ros.core.discrepancy.explanation import ask_twice
from tactile_dynamics_ros.core.discrepancy.live_check import LiveComparison
from tactile_dynamics_ros.core.effects.registry import create_effects
from tactile_dynamics_ros.core.effects.sensor_zero import with_zero
from tactile_dynamics_ros.core.inertia.batch.averaging import averaged
from tactile_dynamics_ros.core.inertia.batch.batch import BatchConfig, fit_recording
from tactile_dynamics_ros.core.inertia.diagnosis.misreading import question
from tactile_dynamics_ros.core.inertia.diagnosis.readings import (
    fit_with_readings,
    model_with_seen_noise,
)
from tactile_dynamics_ros.core.streams.streams import Streams


def compare_streams(
    streams: Streams, effects: Sequence[str], iterations: int = 2
) -> LiveComparison:
    """Wrenches [torque, force] in the body frame that a quickly fitted model leaves.

    The time of an event among the effects is looked for, which takes longer.

    Args:
        streams: measurements of the last seconds.
        effects: names of the effects in the model.
        iterations: number of iterations of the fit.

    Raises:
        BadInputError: contacts and motion are missing or do not overlap.
    """
    streams, known = averaged(streams), with_zero(streams.contacts, create_effects(effects))
    fit = fit_with_readings if any(effect.event for effect in known) else fit_recording
    model = fit(streams, known, BatchConfig(iterations=iterations))
    problems = [stretch.problem for stretch in model.stretches]
    time = np.concatenate([p.samples.time + p.start for p in problems])
    return LiveComparison(time, -model.smooth_residual(), model.whitened_rms)


def diagnose_streams(streams: Streams, effects: Sequence[str]) -> Document:
    """Diagnose a model, as `tactile-dynamics diagnose` does; return its document.

    Args:
        streams: measurements of the last seconds.
        effects: names of the effects in the model.

    Raises:
        BadInputError: contacts and motion are missing or do not overlap.
    """
    known = create_effects(effects)
    model = question(streams, known)
    answer, _ = ask_twice(diagnose, model, lambda: model_with_seen_noise(model, streams, known))
    return diagnosis_document(answer)
