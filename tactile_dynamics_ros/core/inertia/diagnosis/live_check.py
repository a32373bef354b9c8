"""The model held against the last seconds of live measurements."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.configuration import check_ranges, parameter
from tactile_dynamics_ros.core.discrepancy.diagnosis import diagnose
from tactile_dynamics_ros.core.discrepancy.documents import Document, diagnosis_document
from tactile_dynamics_ros.core.discrepancy.explanation import ask_twice
from tactile_dynamics_ros.core.effects.registry import create_effects
from tactile_dynamics_ros.core.inertia.batch.batch import BatchConfig, fit_recording
from tactile_dynamics_ros.core.inertia.diagnosis.misreading import question
from tactile_dynamics_ros.core.inertia.diagnosis.readings import model_with_seen_noise
from tactile_dynamics_ros.core.streams.measurement_window import MeasurementWindow
from tactile_dynamics_ros.core.streams.streams import Streams

Array = NDArray[np.float64]


@dataclass(frozen=True)
class LiveCheckConfig:
    """Spans of the live comparison."""

    error_window: float = parameter(10.0, "span over which the error is taken", "s", 2.0, 60.0)
    diagnosis_window: float = parameter(40.0, "span that is diagnosed", "s", 5.0, 300.0)
    iterations: int = parameter(2, "iterations of the fit of a comparison", "", 1, 10)

    def __post_init__(self) -> None:
        """Check ranges."""
        check_ranges(self)


@dataclass(frozen=True)
class LiveComparison:
    """Model against measurements over the last seconds.

    Attributes:
        time: (N,) s.
        residual: (N, 6) measured minus predicted wrench [torque, force], body frame.
        whitened_rms: 1 where only the stated noise remains.
    """

    time: Array
    residual: Array
    whitened_rms: float


class LiveModelCheck:
    """Keeps the last seconds of measurements; says what is to be computed on them.

    The work itself is done by functions of this module that take plain streams, so that it can be
    given to another process.
    """

    def __init__(self, config: LiveCheckConfig | None = None) -> None:
        """Start without measurements and with the rigid body alone."""
        self.config = config or LiveCheckConfig()
        self.effects: tuple[str, ...] = ()
        self.window = MeasurementWindow(self.config.diagnosis_window)

    def compare(self) -> LiveComparison:
        """`compare_streams` of the last `error_window` seconds with the present model."""
        return compare_streams(*self.comparison())

    def diagnose(self) -> Document:
        """`diagnose_streams` of all kept measurements with the present model."""
        return diagnose_streams(*self.diagnosis())

    def comparison(self) -> tuple[Streams, tuple[str, ...], int]:
        """Arguments of `compare_streams`.

        Raises:
            BadInputError: too little has been measured yet.
        """
        streams = self.window.streams(self.config.error_window)
        return streams, self.effects, self.config.iterations

    def diagnosis(self) -> tuple[Streams, tuple[str, ...]]:
        """Arguments of `diagnose_streams`.

        Raises:
            BadInputError: too little has been measured yet.
        """
        return self.window.streams(), self.effects


def compare_streams(
    streams: Streams, effects: Sequence[str], iterations: int = 2
) -> LiveComparison:
    """Fit a model and hold it against the measurements.

    Args:
        streams: measurements of the last seconds.
        effects: names of the effects in the model.
        iterations: number of iterations of the fit.

    Raises:
        BadInputError: contacts and motion are missing or do not overlap.
    """
    model = fit_recording(streams, create_effects(effects), BatchConfig(iterations=iterations))
    samples = model.samples[0]
    start = model.blocks[0].problem.start
    return LiveComparison(samples.time + start, -model.smooth_residual(), model.whitened_rms)


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
