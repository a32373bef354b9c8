"""A model held against the last seconds of live measurements."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Generic, Protocol, TypeVar

import numpy as np

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.configuration import check_ranges, parameter
from tactile_dynamics_ros.core.discrepancy.comparison import failing_intervals
from tactile_dynamics_ros.core.discrepancy.diagnosis import Diagnosis
from tactile_dynamics_ros.core.discrepancy.documents import Document, diagnosis_document
from tactile_dynamics_ros.core.errors import BadInputError


@dataclass(frozen=True)
class LiveCheckConfig:
    """Spans of the live comparison."""

    error_window: float = parameter(10.0, "span over which the error is taken", "s", 2.0, 60.0)
    diagnosis_window: float = parameter(40.0, "span that is diagnosed", "s", 5.0, 300.0)

    def __post_init__(self) -> None:
        """Check ranges."""
        check_ranges(self)


@dataclass(frozen=True)
class LiveComparison:
    """Model against measurements over the last seconds.

    Attributes:
        time: (N,) s.
        residual: (N, D) measured minus predicted, in the units of the model's D channels.
        whitened_rms: 1 where only the stated noise remains.
    """

    time: Array
    residual: Array
    whitened_rms: float


def live_document(diagnosis: Diagnosis, start: float) -> Document:
    """The document of `diagnose`, and when the effect acts and the model fails.

    Args:
        diagnosis: of a model of live measurements.
        start: stamp of the time zero of its residuals, s.
    """
    residuals, regime = diagnosis.model.residuals(), diagnosis.regime
    acts = regime.spans(residuals.time) if regime else ()
    fails = () if diagnosis.verdict == "adequate" else failing_intervals(residuals)
    spans = {"regime": acts, "failing": fails}
    stamped = {name: [[a + start, b + start] for a, b in each] for name, each in spans.items()}
    return diagnosis_document(diagnosis) | {"spans": stamped}


Measured = TypeVar("Measured")
Measured_co = TypeVar("Measured_co", covariant=True)


class Window(Protocol[Measured_co]):
    """Measurements that are kept while they come."""

    def streams(self, window: float = np.inf, /) -> Measured_co:
        """The last `window` seconds of measurements."""


class LiveModelCheck(Generic[Measured]):
    """Says what is to be computed on the last seconds of measurements, for any model.

    It computes nothing itself: what it returns is pickled and called in another process, so that
    both verbs are functions of a module, or partial ones.

    Attributes:
        window: what is measured.
        effects: names of those that the model has now.
        config: spans.

    Args:
        window: what is measured, kept for `diagnosis_window` at least.
        compare: holds the model with named effects against measurements.
        diagnose: diagnoses that model, as `tactile-dynamics diagnose` does.
        config: spans.
        learn: diagnoses and learns a law in a folder; None where no laws are learnt.
    """

    def __init__(
        self,
        window: Window[Measured],
        compare: Callable[[Measured, tuple[str, ...]], LiveComparison],
        diagnose: Callable[[Measured, tuple[str, ...]], Document],
        config: LiveCheckConfig | None = None,
        learn: Callable[[Measured, tuple[str, ...], Path], Document] | None = None,
    ) -> None:
        self.window, self.config = window, config or LiveCheckConfig()
        self.effects: tuple[str, ...] = ()
        self._compare, self._diagnose, self._learn = compare, diagnose, learn

    def comparison(self) -> Callable[[], LiveComparison]:
        """The comparison of the last `error_window` seconds with the present model.

        Raises:
            BadInputError: too little has been measured yet.
        """
        return partial(self._compare, self.window.streams(self.config.error_window), self.effects)

    def diagnosis(self) -> Callable[[], Document]:
        """The diagnosis of the present model on the last `diagnosis_window` seconds.

        Raises:
            BadInputError: too little has been measured yet.
        """
        streams = self.window.streams(self.config.diagnosis_window)
        return partial(self._diagnose, streams, self.effects)

    def learning(self, folder: Path) -> Callable[[], Document]:
        """The same diagnosis, which also learns the law of what no known effect explains.

        Args:
            folder: where the law is written.

        Raises:
            BadInputError: too little has been measured yet, or no laws are learnt of this model.
        """
        if self._learn is None:
            raise BadInputError("laws are learnt of held objects only")
        streams = self.window.streams(self.config.diagnosis_window)
        return partial(self._learn, streams, self.effects, folder)
