"""The held object against the last seconds of live measurements."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from tactile_dynamics_ros.core.discrepancy.diagnosis import Diagnosis, diagnose
from tactile_dynamics_ros.core.discrepancy.documents import Document
from tactile_dynamics_ros.core.discrepancy.explanation import ask_twice
from tactile_dynamics_ros.core.discrepancy.laws.documents import learn_file
from tactile_dynamics_ros.core.discrepancy.live_check import LiveComparison, live_document
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
    return _document(_diagnosis(streams, effects))


def learn_from_streams(streams: Streams, effects: Sequence[str], folder: Path) -> Document:
    """Diagnose a model and learn the law of what no known effect explains, as `--learn` does.

    Args:
        streams: measurements of the last seconds.
        effects: names of the effects in the model.
        folder: where the law is written; made if missing. Its name tells the time.

    Raises:
        BadInputError: contacts and motion are missing or do not overlap.
    """
    answer = _diagnosis(streams, effects)
    document = _document(answer)
    folder.mkdir(parents=True, exist_ok=True)
    document |= learn_file(answer, folder / f"law_{datetime.now(UTC):%Y%m%d_%H%M%S}.yaml")
    if document["verdict"] != "unexplained":
        return document
    learnt = document["law"]
    said = learnt["sentence"] if learnt else f"No law is learnt: {document['nothing_learnt']}."
    return document | {"sentence": f"{document['sentence']} {said}"}


def _document(answer: Diagnosis) -> Document:
    """The document of a diagnosis, with when the effect acts and the model fails."""
    model: Any = answer.model
    return live_document(answer, model.fitted.stretches[0].problem.start)


def _diagnosis(streams: Streams, effects: Sequence[str]) -> Diagnosis:
    """The diagnosis of a model with named effects."""
    known = create_effects(effects)
    model = question(streams, known)
    answer, _ = ask_twice(diagnose, model, lambda: model_with_seen_noise(model, streams, known))
    return answer
