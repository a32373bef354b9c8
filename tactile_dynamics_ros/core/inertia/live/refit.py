"""Effects beside the live estimate: their model is fitted again and again to the last minute."""

from __future__ import annotations

import time as clock
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tactile_dynamics_ros.core.configuration import check_ranges, parameter
from tactile_dynamics_ros.core.effects.registry import create_effects
from tactile_dynamics_ros.core.effects.sensor_zero import zero_beside
from tactile_dynamics_ros.core.inertia.batch.fitted_model import FittedModel
from tactile_dynamics_ros.core.inertia.estimate import estimate
from tactile_dynamics_ros.core.inertia.live.live_estimate import LiveEstimate, RecentFit
from tactile_dynamics_ros.core.streams.measurement_window import MeasurementWindow
from tactile_dynamics_ros.core.streams.streams import Streams

LEAST_SPAN = 2.0
"""Span of measurements before the first fit, s: windows of the motion alone take a quarter of one,
and the fit of a single turn would not tell an effect from the load. A shorter span starts with fits
that are thrown away, a longer one delays the first reading of effects by as much."""


@dataclass(frozen=True)
class RefitConfig:
    """Measurements that a model with effects is fitted to."""

    history: float = parameter(
        60.0, "measurements kept for fits of models with effects", "s", 5.0, 300.0
    )

    def __post_init__(self) -> None:
        """Check ranges."""
        check_ranges(self)


class RefittedModel:
    """The model with effects: its name, the measurements it is fitted to, the newest fit.

    A fit with effects is nonlinear and looks at samples before and after; what a sum over all
    samples keeps (`incremental`) belongs to one linearisation of it. So the last measurements are
    kept as they are, and fitted as a recording is, again whenever new ones have come. The fit
    itself is `fit_live`, which may run in another process.
    """

    def __init__(self, config: RefitConfig | None = None) -> None:
        """Start without measurements and without effects."""
        self._config = config or RefitConfig()
        self.window = MeasurementWindow(self._config.history)
        self._asked: tuple[str, ...] = ()
        self.newest_fit: LiveEstimate | None = None
        self._fitted_until = -np.inf

    @property
    def effects(self) -> tuple[str, ...]:
        """Names of the effects of the model: those that were set, and the zero of one sensor."""
        return (*zero_beside(self.window.contacts, self._asked), *self._asked)

    @property
    def is_due(self) -> bool:
        """Whether there are measurements that no fit has been started with."""
        fresh = self.window.newest > self._fitted_until
        return bool(self.effects) and fresh and self.window.span >= LEAST_SPAN

    def set_effects(self, effects: Sequence[str]) -> None:
        """Change the model; measurements stay, fits of another model do not.

        Raises:
            BadInputError: an effect is unknown or named twice.
        """
        create_effects(effects)
        self._asked = tuple(effects)
        self.newest_fit = None
        self._fitted_until = -np.inf

    def clear(self) -> None:
        """Forget the measurements; the model stays."""
        self.window.clear()
        self.set_effects(self._asked)

    def take(self, effects: Sequence[str], fit: LiveEstimate) -> None:
        """Take a finished fit of these effects; of another model than the present it is dropped."""
        if tuple(effects) == self.effects and self.window.span > 0.0:
            self.newest_fit = fit

    def begin(self) -> tuple[Streams, tuple[str, ...]]:
        """Arguments of `fit_live` with all that has come; not due again until more comes.

        Raises:
            BadInputError: there are no measurements.
        """
        self._fitted_until = self.window.newest
        return self.window.streams(), self.effects


def fit_live(streams: Streams, effects: Sequence[str]) -> LiveEstimate:
    """Fit a model with effects as `tactile-dynamics estimate` does.

    Args:
        streams: the last measurements.
        effects: their names.

    Raises:
        BadInputError: contacts and motion are missing or do not overlap.
        NotIdentifiableError: the iteration diverged.
    """
    started = clock.perf_counter()
    model = estimate(streams, create_effects(effects))
    return live_estimate(model, clock.perf_counter() - started)


def live_estimate(model: FittedModel, latency: float) -> LiveEstimate:
    """Estimate of a batch fit in the form that the live estimator publishes.

    Args:
        model: fitted.
        latency: s of computing.
    """
    data, prior = (part[:10, :10] for part in model.coordinate_information)
    last, residual = model.stretches[-1].problem, model.white_residual
    return LiveEstimate(
        **vars(model.to_estimate()),
        time=float(last.grid[-1]),
        information=np.stack([data, prior]),
        coordinates=model.xi,
        rejected=0,
        latency=latency,
        recent=RecentFit.of_rows(residual, residual - model.white_jacobian[:, :10] @ model.phi),
    )
